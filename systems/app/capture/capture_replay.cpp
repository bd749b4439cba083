#include "systems/app/capture/capture_replay.hpp"

#include <algorithm>
#include <cstring>

#include "content/scene/build_scene.hpp"
#include "engine/base/error.hpp"
#include "engine/tissue/cut_setup.hpp"
#include "engine/tissue/cut_solid_setup.hpp"
#include "engine/tissue/heat.hpp"
#include "systems/app/capture/capture_difference.hpp"
#include "systems/haptics/contact/device_motion.hpp"
#include "systems/prepare/tear_bodies.hpp"
namespace trocar {
namespace {

void add_record(const CaptureRecord& record, Capture& capture) {
    if (record.kind == "state") {
        read_value(record, "pass", capture.stretches.emplace_back(record).pass);
    } else if (record.kind == "step" && !capture.stretches.empty()) {
        Capture::Stretch& stretch = capture.stretches.back();
        stretch.steps.push_back(read_step(record));
        if (stretch.steps.back().pass != stretch.pass + stretch.steps.size() - 1)
            throw InputError("record step: passes are not consecutive");
    } else if (record.kind == "picture") {
        capture.picture = read_picture(record);
    }
}

// Results independent of caches, clocks and pictures; only these are compared between runs.
bool is_compared(Resource r) {
    return r != Resource::kReport && r != Resource::kEnergy && r != Resource::kEnergyStart && r != Resource::kNormals &&
           r != Resource::kPicture;
}

CaptureRecord state_of(const World& world, uint64_t pass) {
    CaptureRecord record{"state", {}};
    add_value(record, "pass", pass);
    save_resources(world, ResourceKind::kState, record);
    return record;
}

void set_state(const CaptureRecord& state, World& world) {
    load_resources(state, ResourceKind::kState, world);
    load_resources(state, ResourceKind::kAccounts, world);
}

void restore_surfaces(World& w) {
    restore_torn_surfaces(w.solids, w.bodies, w.particles, w.torn, w.meshes, w.trees, w.tears);
    // springs of a surface that is there already have their stiffening: it is no part of the factors without
    std::vector<const HeatBody*> laid_anew;
    for (const HeatBody& body : w.actions.heat_body)
        if (body.cut != kNone && !is_cut_surface_laid(w.actions.cut_body[body.cut], body.cut, w.action_state.cut, w.bodies, w.meshes))
            laid_anew.push_back(&body);
    restore_cut_surfaces(w.actions, w.action_state.cut, w.bodies, w.particles, w.meshes, w.springs, w.anchors, w.trees);
    restore_cut_solids(w.actions, w.action_state.lattice, w.bodies, w.particles, {w.meshes, w.springs, w.solids, w.anchors}, w.trees);
    restore_heat(w.bodies, w.meshes, w.solids, w.actions);
    for (const HeatBody* body : laid_anew) note_factors(*body, w.bodies, w.springs, w.actions);
}

}  // namespace

size_t Capture::passes() const {
    size_t count = 0;
    for (const Stretch& s : stretches) count += s.steps.size();
    return count;
}

Capture open_capture(const std::filesystem::path& path) {
    CaptureFile file = read_capture(path);
    Capture capture;
    capture.damage = file.damage;
    capture.file = path.string();
    try {
        if (file.records.size() < 3 || file.records[0].kind != "header" || file.records[1].kind != "scene")
            throw InputError("capture contains no scene and state" + (file.damage.empty() ? "" : ": it " + file.damage));
        capture.header = read_header(file.records[0]);
        for (size_t i = 2; i < file.records.size(); ++i) add_record(file.records[i], capture);
        capture.scene = std::move(file.records[1]);
        for (size_t s = 0; s + 1 < capture.stretches.size(); ++s)
            if (capture.stretches[s + 1].pass != capture.stretches[s].pass + capture.stretches[s].steps.size())
                throw InputError("passes are missing between its states");
        if (capture.stretches.empty()) throw InputError("capture contains no state");
    } catch (const InputError& e) {
        throw InputError(path.string() + ": " + e.what());
    }
    return capture;
}

FrameOptions replay_options(const Capture& capture, Trace* trace) {
    FrameOptions options;
    options.external_ticks = capture.header.live;
    options.trace = trace;
    return options;
}

std::optional<size_t> stretch_of(const Capture& capture, uint64_t pass) {
    for (size_t s = 0; s < capture.stretches.size(); ++s) {
        const Capture::Stretch& stretch = capture.stretches[s];
        if (pass >= stretch.pass && pass - stretch.pass < stretch.steps.size()) return s;
    }
    return {};
}

World world_at(const Capture& capture, size_t stretch) {
    World world;
    try {
        load_resources(capture.scene, ResourceKind::kConstant, world);
        set_state(capture.stretches[stretch].state, world);
        world.settings.name = capture.header.scene;
        if (const std::string fault = find_fault(world); !fault.empty()) throw InputError("cannot be simulated: " + fault);
        make_trees(world);
        restore_surfaces(world);
    } catch (const InputError& e) {
        throw InputError(capture.file + ": " + e.what());
    }
    return world;
}

void take_up(const Capture& capture, size_t stretch, Frame& frame) {
    if (!capture.header.live) return;
    CaptureRecord before;
    for (CaptureArray a : capture.stretches[stretch].state.arrays) {
        if (!a.name.starts_with("before.")) continue;
        a.name.erase(0, std::strlen("before."));
        before.arrays.push_back(std::move(a));
    }
    if (before.arrays.empty()) return;  // the very first pass
    World last;
    load_resource(before, Resource::kToolState, last);
    frame.world().live_devices.clear();
    for (const ToolState& tool : last.haptics.state) frame.world().live_devices.push_back(foretold(tool));
}

void take_input(const CaptureStep& step, Frame& frame) {
    if (step.input.empty()) return;
    const size_t tools = frame.world().haptics.tool.size();
    load_resource({"step", step.input}, Resource::kToolState, frame.world());
    if (frame.world().haptics.state.size() != tools) throw InputError("record step: not one state per tool");
}

std::string first_stage(const Frame& frame, const CaptureStep& recorded) {
    if (recorded.resource_hash.size() != static_cast<size_t>(Resource::kCount)) return "";
    for (const Stage& stage : frame.stages()) {
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
            const Resource resource = static_cast<Resource>(r);
            if (!(stage.writes & mask(resource)) || !is_compared(resource)) continue;
            if (resource_hash(frame.world(), resource) != recorded.resource_hash[r])
                return std::string(stage.name) + " (" + resource_name(resource) + ")";
        }
    }
    return "";
}

ReplayVerdict replay_capture(const Capture& capture, const ReplayObserver& observer) {
    Frame frame(world_at(capture, 0), replay_options(capture, nullptr));
    take_up(capture, 0, frame);
    ReplayVerdict verdict;
    uint64_t diverged = UINT64_MAX;
    for (const Capture::Stretch& stretch : capture.stretches) {
        const bool reached = &stretch != &capture.stretches.front() && !capture.header.live;  // a live state holds the next pass's input
        const CaptureRecord now = reached ? state_of(frame.world(), stretch.pass) : CaptureRecord{};
        if (const std::string array = first_difference(now, stretch.state, &capture.scene); !array.empty()) {
            verdict.difference += (verdict.difference.empty() ? "" : "; ") + ("the state before pass " + std::to_string(stretch.pass)) +
                                  " differs first in " + array;
            return verdict;
        }
        if (diverged != UINT64_MAX) return verdict;
        for (const CaptureStep& step : stretch.steps) {
            take_input(step, frame);
            frame.step();
            ++verdict.compared;
            if (state_hash(frame.world()) != step.state_hash && diverged == UINT64_MAX) {
                diverged = step.pass;
                const std::string stage = first_stage(frame, step);
                verdict.difference =
                    "pass " + std::to_string(step.pass) + " is the first to differ" + (stage.empty() ? "" : ", first in stage " + stage);
            }
            if (observer.pass) observer.pass(observer.user, frame, step);
        }
    }
    return verdict;
}

PassProfile profile_pass(const Capture& capture, uint64_t pass, uint32_t repeat, Trace* trace) {
    const std::optional<size_t> s = stretch_of(capture, pass);
    if (!s)
        throw InputError(capture.file + ": holds passes " + std::to_string(capture.stretches[0].pass) + " to " +
                         std::to_string(capture.stretches[0].pass + capture.passes() - 1) + ", not " + std::to_string(pass));
    const Capture::Stretch& stretch = capture.stretches[*s];
    const CaptureStep& step = stretch.steps[pass - stretch.pass];
    Frame frame(world_at(capture, *s), replay_options(capture, trace));
    take_up(capture, *s, frame);
    for (const CaptureStep& earlier : stretch.steps) {
        if (earlier.pass == pass) break;
        take_input(earlier, frame);
        frame.step();
    }
    if (trace) trace->clear();  // drop the spans of the passes before the one wanted
    CaptureRecord start{"state", {}};
    save_resources(frame.world(), ResourceKind::kState, start);
    save_resources(frame.world(), ResourceKind::kAccounts, start);
    PassProfile profile{frame.stage_names(), std::vector<std::vector<double>>(frame.stage_names().size()), {}};
    const std::vector<DeviceState> devices = frame.world().live_devices;
    for (uint32_t i = 0; i < repeat; ++i) {
        set_state(start, frame.world());
        restore_surfaces(frame.world());
        if (i > 0) frame.run_pass_again();
        frame.world().live_devices = devices;
        take_input(step, frame);
        const uint64_t begin = now_ns();
        frame.step();
        profile.pass_ms.push_back(static_cast<double>(now_ns() - begin) * 1e-6);
        for (size_t row = 0; row < profile.stage.size(); ++row)
            profile.stage_ms[row].push_back(static_cast<double>(frame.times().stage_ns[row]) * 1e-6);
        profile.same = profile.same && state_hash(frame.world()) == step.state_hash;
    }
    return profile;
}

}  // namespace trocar
