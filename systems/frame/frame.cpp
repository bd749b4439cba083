#include "systems/frame/frame.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "engine/base/error.hpp"
#include "engine/contact/displacement_bound.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/jobs/trace.hpp"
#include "systems/detect/broad/rounds.hpp"
#include "systems/frame/state.hpp"
#include "systems/prepare/tear_bodies.hpp"
namespace trocar {

using R = Resource;
using S = StageId;
using P = FramePart;

namespace {
const FrameStage& row(StageId id) { return frame_stages()[static_cast<size_t>(id)]; }
}  // namespace

// The stages this scene needs, and their graphs: one for a pass, one for a picture.
struct Frame::Graphs {
    // Data of an observer about its list.
    struct List {
        Graphs* graphs = nullptr;
        uint32_t first = 0;
    };
    FrameState* state = nullptr;
    std::vector<Stage> stages;  // all, in serial order
    std::vector<std::string> names;
    std::array<uint32_t, static_cast<size_t>(StageId::kCount)> index{};  // of stages, per id; kNone = not wanted
    std::vector<uint32_t> detection;
    uint32_t end_first = 0;
    std::vector<uint64_t> begin_ns;
    List pass_list, end_list;
    std::unique_ptr<JobGraph> pass, end;

    static void begin_stage(void* user, uint32_t index) {
        const List& list = *static_cast<List*>(user);
        Graphs& g = *list.graphs;
        if (g.state->options.clear_scratch) g.state->scratch = {};
        g.begin_ns[list.first + index] = now_ns();
    }
    static void end_stage(void* user, uint32_t index) {
        const List& list = *static_cast<List*>(user);
        Graphs& g = *list.graphs;
        const uint32_t stage = list.first + index;
        const uint64_t duration = now_ns() - g.begin_ns[stage];
        g.state->times.stage_ns[stage] += duration;
        if (g.state->options.trace)
            g.state->options.trace->add(
                {g.stages[stage].name, g.begin_ns[stage], duration, thread_index(), static_cast<uint32_t>(g.state->world.clock.pass)});
    }
    void choose() {
        stages.clear(), names.clear(), detection.clear();
        index.fill(kNone);
        for (const FrameStage& s : frame_stages())
            if (is_wanted(s)) add(s);
        end_first = first_of_picture();
        begin_ns.assign(stages.size(), 0);
        state->times.stage_ns.assign(stages.size(), 0);
        pass_list = {this, 0};
        end_list = {this, end_first};
        const std::span<const Stage> all(stages);
        pass = std::make_unique<JobGraph>(all.first(end_first), *state, StageObserver{begin_stage, end_stage, &pass_list});
        end = std::make_unique<JobGraph>(all.subspan(end_first), *state, StageObserver{begin_stage, end_stage, &end_list});
    }
    bool is_wanted(const FrameStage& s) const {
        if (!state->options.pictures && (s.stage.writes & mask(R::kNormals, R::kPicture))) return false;
        return s.wanted(state->world);
    }
    void add(const FrameStage& s) {
        const auto at = static_cast<uint32_t>(stages.size());
        index[static_cast<size_t>(s.id)] = at;
        if (s.part == P::kDetection) detection.push_back(at);
        stages.push_back(s.stage);
        names.emplace_back(s.stage.name);
    }
    // Index of the first stage of a picture, or the end.
    uint32_t first_of_picture() const {
        const auto picture = std::ranges::find(frame_stages(), P::kPicture, &FrameStage::part) - frame_stages().begin();
        const uint32_t first = *std::min_element(index.begin() + picture, index.end());
        return std::min(first, static_cast<uint32_t>(stages.size()));  // kNone is the largest
    }
    void run(bool end_of_picture) {
        const std::span<const Stage> all(stages);
        List& list = end_of_picture ? end_list : pass_list;
        const StageObserver observer{begin_stage, end_stage, &list};
        if (state->options.serial || state->options.clear_scratch) {
            run_serial(end_of_picture ? all.subspan(end_first) : all.first(end_first), *state, observer);
        } else {
            (end_of_picture ? end : pass)->run();
        }
    }
};

namespace {

// Energy of the bodies from index `first` on, J.
double energy_from(FrameState& f, size_t first) {
    const World& w = f.world;
    const EnergyInputs inputs = energy_inputs(f.world);
    Energy sum;
    for (uint32_t body = static_cast<uint32_t>(first); body < w.bodies.mesh.size(); ++body)
        add_body_energy(inputs, body, f.scratch.energy.part[0], sum);
    return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity;
}

}  // namespace

Frame::Frame(World world, const FrameOptions& options) : state_(new FrameState), graphs_(new Graphs) {
    const FloatModeScope ours;
    state_->world = std::move(world);
    state_->world.live_devices.clear();
    state_->world.energy_start = {};
    state_->options = options;
    graphs_->state = state_.get();
    take_in_bodies();
    warm_up();
}

// Sets up the frame's data on its bodies, for all or for those added since the last call.
void Frame::take_in_bodies() {
    FrameState& f = *state_;
    World& w = f.world;
    const bool at_first = graphs_->pass == nullptr;
    const size_t before = f.bodies;
    if (!at_first && w.bodies.mesh.size() == before && w.meshes.info.size() == f.prototypes) return;
    if (w.bodies.mesh.size() < before) throw InputError("a body was taken out of a running frame: only those of a pool go");
    if (const std::string missing = find_unfinished(w); !missing.empty()) throw InputError("cannot be simulated: " + missing);
    f.bodies = w.bodies.mesh.size();
    f.prototypes = w.meshes.info.size();
    if (w.settings.contact.hulls) f.hulls = make_convex_hulls(w.meshes, w.bodies);
    for (size_t body = before; f.options.trace && body < f.bodies; ++body)
        f.island_name.push_back(f.options.trace->keep("island of " + w.bodies.name[body]));
    graphs_->choose();
    if (row(S::kTears).wanted(w)) copy_torn_springs(w.springs, w.solids, w.bodies, w.tears, w.torn, w.torn_springs);
    if (w.energy_start.known)
        w.energy_start.sum += energy_from(f, before);
    else if (row(S::kEnergy).wanted(w) && f.options.account_energy)
        row(S::kEnergy).stage.run(f);  // opens the accounts
}

Frame::~Frame() = default;

namespace {

// Caches may change time, never results: tests clear them all.
void clear_caches(FrameState& f) {
    f.scratch = {};
    for (const auto& tree : f.world.trees) tree->rebuild();
}

void begin_pass(FrameState& f) {
    Clock& clock = f.world.clock;
    clock.period = static_cast<uint32_t>(pass_tick(clock.pass + 1, clock.contact_rate) - clock.tick);
    std::fill(f.times.stage_ns.begin(), f.times.stage_ns.end(), 0);
    f.times.response_ns = 0;
    f.times.deepest = 0;
    f.times.picture = false;
    if (f.options.clear_caches) clear_caches(f);
    SleeperCache& sleeping_bodies = f.scratch.sleeping_bodies;
    if (clock.pass != sleeping_bodies.next_pass) std::fill(sleeping_bodies.number.begin(), sleeping_bodies.number.end(), 0);
    sleeping_bodies.next_pass = clock.pass + 1;
}

// Moves the clock to the end of the pass; true if a picture is due there.
bool end_pass(FrameState& f) {
    Clock& clock = f.world.clock;
    clock.tick += clock.period;
    ++clock.pass;
    return clock.tick >= pass_tick(clock.picture + 1, clock.display_rate);
}

// Bodies at rest look as far ahead as moving ones: what tools will touch. See FrameLimits.
void reach_out(World& w) {
    for (uint32_t body = 0; body < w.boxes.box.size(); ++body) {
        const double edge = w.meshes.info[w.bodies.mesh[body]].mean_edge;
        w.boxes.margin[body] += edge;
        w.boxes.box[body].min.array() -= edge;
        w.boxes.box[body].max.array() += edge;
    }
}

// Devices that stay where they are told.
void hold_devices(const Clock& clock, std::span<const DeviceState> held, DeviceSamples& devices) {
    devices.per_tool = clock.period + 1;
    devices.placed.clear();
    for (const DeviceState& device : held) devices.placed.insert(devices.placed.end(), devices.per_tool, device);
}

}  // namespace

// Finds contacts once before the clock starts, so that the first passes find their memory allocated.
void Frame::warm_up() {
    const Report before = state_->world.report;
    const std::vector<ToolState> tools_before = state_->world.haptics.state;
    const Sleep sleep_before = state_->world.sleep;
    begin_pass(*state_);
    World& w = state_->world;
    hold_devices(w.clock, std::vector<DeviceState>(w.haptics.tool.size()), w.devices);
    for (const uint32_t s : graphs_->detection) {
        run_stage(s);
        const bool boxed = s == row_of(StageId::kFastBodies) || (s == row_of(StageId::kBodyBoxes) && row_of(StageId::kFastBodies) == kNone);
        if (boxed && w.boxes.box.size() <= state_->limits.most_warmed_bodies) reach_out(w);
    }
    state_->world.report = before;
    for (size_t t = 0; t < tools_before.size(); ++t) w.haptics.state[t].exit = tools_before[t].exit;
    state_->world.sleep = sleep_before;
}

// Rounds that the rest of a pass takes for what moves fast in it.
uint32_t Frame::count_rounds_of(uint32_t left) {
    World& w = state_->world;
    const double seconds = 1e-3 * left, fall = fall_in_period(w.settings.gravity, seconds), tolerance = w.settings.contact.tolerance;
    const bool hands = !w.haptics.tool.empty();
    if (hands) run_stage(row_of(StageId::kDeviceInput));
    if (hands ? !any_fast_hand(w.haptics.tool, w.devices, w.poses) : !may_need_rounds(surfaces_of(w), fall, tolerance, seconds)) return 1;
    for (const StageId id :
         {StageId::kBodyBoxes, StageId::kFastBodies, StageId::kExcludedPairs, StageId::kBoxPairs, StageId::kCandidatePairs})
        if (const uint32_t stage = row_of(id); stage != kNone) run_stage(stage);
    if (hands) return count_hand_rounds(surfaces_of(w), w.pairs, w.haptics, w.devices);
    return count_rounds(surfaces_of(w), w.pairs, w.contact_memory, fall, tolerance, seconds);
}

// Runs the pass in rounds while free bodies or hands are fast: each finds contacts and advances its part of the period.
void Frame::run_rounds() {
    World& w = state_->world;
    const uint64_t begin = w.clock.tick, end = begin + w.clock.period;
    SleeperCache& sleepers = state_->scratch.sleeping_bodies;
    const auto set_period = [&](uint32_t period) {  // boxes of sleeping bodies cover what gravity does in a period
        if (std::exchange(sleepers.round, period) != period) std::ranges::fill(sleepers.seen[kSeenByBoxes], 0);
        w.clock.period = period;
    };
    // hands with tissue in lockstep, and free bodies without either
    const bool tools = !w.haptics.tool.empty(), tissue = !w.particles.offset.empty();
    const bool divides = row_of(StageId::kCandidatePairs) != kNone && (tools ? tissue && !state_->options.external_ticks : !tissue);
    while (w.clock.tick < end) {
        const auto left = static_cast<uint32_t>(end - w.clock.tick);
        if (divides && (!tools || sleepers.round != 0)) set_period(left);
        if (const uint32_t rounds = divides && left > 1 ? count_rounds_of(left) : 1; rounds > 1) set_period((left + rounds - 1) / rounds);
        graphs_->run(false);
        for (const double depth : w.penetrations.depth) state_->times.deepest = std::max(state_->times.deepest, depth);
        w.clock.tick += w.clock.period;
    }
    w.clock.tick = begin;
    w.clock.period = static_cast<uint32_t>(end - begin);
}

void Frame::step() {
    const FloatModeScope ours;
    take_in_bodies();
    begin_pass(*state_);
    run_rounds();
    if (!end_pass(*state_)) return;
    graphs_->run(true);
    ++state_->world.clock.picture;
    state_->times.picture = true;
}

void Frame::step_until(uint32_t index) {
    const FloatModeScope ours;
    take_in_bodies();
    begin_pass(*state_);
    for (uint32_t s = 0; s < index; ++s) {
        run_stage(s);
        if (s + 1 == graphs_->end_first) end_pass(*state_);
    }
}

void Frame::set_contact_hook(const ContactHook& hook) { state_->contact_hook = hook; }

void Frame::run_pass_again() { state_->scratch.sleeping_bodies.next_pass = state_->world.clock.pass; }

void Frame::state_replaced() {
    FrameState& f = *state_;
    f.scratch = {};
    restore_torn_surfaces(f.world.solids, f.world.bodies, f.world.particles, f.world.torn, f.world.meshes, f.world.trees, f.world.tears);
}

const PictureSnapshot& Frame::snapshot_now() {
    const FloatModeScope ours;
    if (row(S::kSurfaceNormals).wanted(state_->world)) row(S::kSurfaceNormals).stage.run(*state_);
    row(S::kPicture).stage.run(*state_);
    return state_->world.picture;
}

void Frame::run_stage(uint32_t index) {
    const FloatModeScope ours;
    if (state_->options.clear_scratch) state_->scratch = {};
    graphs_->stages[index].run(*state_);
}
std::span<const Stage> Frame::stages() const { return graphs_->stages; }
uint32_t Frame::row_of(StageId id) const { return graphs_->index[static_cast<size_t>(id)]; }
World& Frame::world() { return state_->world; }
const World& Frame::world() const { return state_->world; }
const std::vector<std::string>& Frame::stage_names() const { return graphs_->names; }
const FrameTimes& Frame::times() const { return state_->times; }
std::span<const uint32_t> Frame::detection_stages() const { return graphs_->detection; }

void detect_contacts(World& world, bool show_cells) {
    const FloatModeScope ours;
    if (const std::string missing = find_unfinished(world); !missing.empty()) throw InputError("cannot be simulated: " + missing);
    FrameState state;
    state.limits.face_queries = 100'000;  // an answer, not a frame
    if (show_cells) state.limits.direct_tests = 0;
    std::swap(state.world, world);
    World& w = state.world;
    std::vector<DeviceState> held(w.haptics.tool.size());  // hands stay in place
    for (size_t t = 0; t < held.size(); ++t) {
        const HandTool& tool = w.haptics.tool[t];
        held[t].orientation = w.poses.orientation[tool.body];
        held[t].position = w.poses.origin[tool.body] + rotate(held[t].orientation, tool.tip);
    }
    hold_devices(w.clock, held, w.devices);
    for (const FrameStage& s : frame_stages())
        if (s.part == P::kDetection && s.wanted(w)) s.stage.run(state);
    std::swap(state.world, world);
}

}  // namespace trocar
