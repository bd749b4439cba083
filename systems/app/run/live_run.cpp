#include "systems/app/run/live_run.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <exception>
#include <optional>
#include <thread>

#include "engine/base/error.hpp"
#include "engine/base/latest.hpp"
#include "engine/base/ring.hpp"
#include "engine/devices/device.hpp"
#include "engine/devices/link.hpp"
#include "engine/jobs/real_time.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/stop_signal.hpp"
#include "systems/haptics/live_haptics.hpp"
#include "systems/haptics/manipulator.hpp"
#include "systems/prepare/sleep.hpp"
namespace trocar {

PassFigures pass_figures(const Frame& frame, double time) {
    const World& w = frame.world();
    PassFigures p;
    for (const DriveState& drive : frame.world().node_state.drive) p.coordinate.push_back(drive.coordinate);
    p.time = time;
    for (const uint32_t row : frame.detection_stages()) p.detection_ms += static_cast<double>(frame.times().stage_ns[row]) * 1e-6;
    p.response_ms = static_cast<double>(frame.times().response_ns) * 1e-6;
    p.depth = frame.times().deepest;
    p.contacts = static_cast<uint32_t>(w.contacts.point.size());
    for (size_t i = 0; i < w.penetrations.pair.size(); ++i) {
        p.pairs += w.penetrations.depth[i] > 0;
        p.inside_vertices += w.penetrations.vertices_a_in_b[i] + w.penetrations.vertices_b_in_a[i];
    }
    for (const ToolState& tool : w.haptics.state) {
        p.force = std::max(p.force, tool.output.force.norm());
        p.contact_force = std::max(p.contact_force, tool.contact_impulse.norm() / (w.clock.period * 1e-3));
    }
    p.energy = w.energy;
    p.residual = w.report.deepest_residual;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b)
        p.awake +=
            joins_islands(w.bodies.motion[b]) && w.bodies.motion[b] != Motion::kHand && !is_asleep(w.sleep, b) && !is_away(w.spawning, b);
    p.picture = frame.times().picture;
    return p;
}

void add_stage_times(const Frame& frame, RunFigures& figures) {
    const FrameTimes& times = frame.times();
    for (size_t s = 0; s < times.stage_ns.size(); ++s)
        if (times.stage_ns[s] > 0) figures.stage[s].ms.push_back(static_cast<double>(times.stage_ns[s]) * 1e-6);
}

namespace {

// Nice value of the simulation: below the haptic thread (SCHED_FIFO), above other processes if permitted.
constexpr int kSimulationNice = -10;

// Draws the newest available picture in a loop, at the lowest priority.
class DrawingThread {
 public:
    DrawingThread(PictureWriter& pictures, const PictureSnapshot& first, double slow_ms) : pictures_(pictures), slow_ms_(slow_ms) {
        pictures_.warm_up(first);
        thread_ = std::thread([this] { loop(); });
    }
    ~DrawingThread() { stop(); }
    void publish(const PictureSnapshot& snapshot) {
        newest_.back() = snapshot;
        newest_.publish();
    }
    void stop() {
        stop_ = true;
        if (thread_.joinable()) thread_.join();
    }
    // After stop(): what ended drawing early, such as a full disk; empty if nothing did.
    const std::string& failure() const { return failure_; }
    const std::vector<double>& milliseconds() const { return milliseconds_; }

 private:
    void loop() {
        set_float_mode();
        request_low_priority();
        while (!stop_) {
            if (!newest_.update()) {
                std::this_thread::sleep_for(std::chrono::milliseconds(2));
                continue;
            }
            try {
                milliseconds_.push_back(pictures_.take(newest_.front(), slow_ms_));
            } catch (const std::exception& error) {
                failure_ = error.what();
                return;
            }
        }
    }
    PictureWriter& pictures_;
    double slow_ms_;
    Latest<PictureSnapshot> newest_;
    std::vector<double> milliseconds_;
    std::string failure_;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

// Expands a histogram into samples for the report's percentiles and plots.
std::vector<double> samples(const TimeHistogram& histogram, double unit_ns) {
    std::vector<double> values;
    constexpr int kSamples = 2000;
    for (int i = 1; i <= kSamples && histogram.count > 0; ++i)
        values.push_back(static_cast<double>(histogram.percentile(static_cast<double>(i) / kSamples)) / unit_ns);
    return values;
}

// Fills a recording during a run. The haptic thread sends ticks through a ring that the simulation empties
// once per pass. Does nothing without a recording.
class TickCollector {
 public:
    // `most_passes`: the recording ends after as many; 0 = it covers all.
    TickCollector(LiveRecording* recording, uint64_t most_passes)
        : recording_(recording), most_passes_(most_passes), ring_(recording ? kRoom : 1) {}
    LiveRecorder recorder() {
        if (!recording_) return {};
        return {[](void* ring, const LiveTick& tick) { static_cast<Ring<LiveTick>*>(ring)->push(tick); }, &ring_};
    }
    void begin(const World& world, double seconds) {
        if (!recording_) return;
        recording_->start_hash = scene_hash(world);
        recording_->tools = static_cast<uint32_t>(world.haptics.tool.size());
        // growing would copy megabytes between two passes; reserved pages that are never written cost nothing
        const double covered = most_passes_ > 0 ? static_cast<double>(most_passes_) / world.clock.contact_rate : seconds;
        recording_->tick.reserve(static_cast<size_t>(std::min({seconds, covered, kRoomSeconds}) * 1100) * recording_->tools);
    }
    void add_pass(const World& world, double slip) {
        if (!recording_) return;
        if (ended_) {
            for (LiveTick tick; ring_.pop(tick);) {
            }
            return;
        }
        recording_->slip.push_back(slip);
        for (const ToolState& tool : world.haptics.state) recording_->taken.push_back(tool.ticks);
        empty_ring();
    }
    void after_pass(const World& world) {
        if (recording_ && !ended_ && world.clock.pass == most_passes_) end(world);
    }
    bool finish(const World& world) {
        if (recording_ && !ended_) end(world);
        return complete_;
    }
    LiveRecording* open_recording() { return ended_ ? nullptr : recording_; }

 private:
    static constexpr double kRoomSeconds = 3600;
    static constexpr size_t kRoom = 1u << 15;  // ticks; the simulation thread may be delayed by as many ms
    void end(const World& world) {
        empty_ring();
        recording_->state_hash = state_hash(world);
        ended_ = true, complete_ = ring_.lost() == 0;
    }
    void empty_ring() {
        for (LiveTick tick; ring_.pop(tick);) recording_->tick.push_back(tick);
    }
    LiveRecording* recording_;
    uint64_t most_passes_;
    bool ended_ = false, complete_ = true;
    Ring<LiveTick> ring_;
};

void publish_models(void* user, World& world) {
    LiveHaptics& haptics = *static_cast<LiveHaptics*>(user);
    for (uint32_t t = 0; t < world.local_contact.size(); ++t) {
        haptics.model_to_fill(t) = world.local_contact[t];
        haptics.publish_model(t);
    }
}

// One link per tool, null where the scene's scripted hand holds it. `devices` are BODY=SPECIFICATION.
std::vector<std::unique_ptr<DeviceLink>> open_links(const std::vector<std::string>& devices, const World& world, LiveView* view) {
    std::vector<std::unique_ptr<DeviceLink>> links(world.haptics.tool.size());
    for (const std::string& text : devices) {
        const size_t equals = text.find('=');
        if (equals == std::string::npos) throw InputError("--device " + text + ": write BODY=DEVICE, for example --device probe=udp");
        const std::string body = text.substr(0, equals);
        size_t tool = 0;
        while (tool < links.size() && world.bodies.name[world.haptics.tool[tool].body] != body) ++tool;
        if (tool == links.size()) throw InputError("--device " + text + ": the scene has no tool on a body named \"" + body + "\"");
        if (!world.node_state.laid_down.empty() && world.node_state.laid_down[tool])
            throw InputError("--device " + text + ": \"" + body + "\" is exchanged for another instrument and shares its device");
        if (links[tool]) throw InputError("--device " + text + ": the tool \"" + body + "\" has a device already");
        const std::string specification = text.substr(equals + 1);
        const HandTool& hand = world.haptics.tool[tool];
        links[tool] = view && specification == "browser"
                          ? view->open_device(hand.body, hand, read_device(device_of(world.haptics, world.paths, hand), 0))
                          : open_device(specification);
    }
    return links;
}

// Adds the results of the device that holds a tool. `link` is per tool; exchanged tools share an entry.
void add_device(const DeviceLink* device, const std::vector<DeviceLink*>& link, const LiveHaptics& haptics, ToolFigures& figures) {
    if (!device) return;
    figures.device = device->name();
    figures.counts = device->counts();
    for (uint32_t t = 0; t < link.size(); ++t) {
        if (link[t] != device) continue;
        figures.device_heard |= haptics.state(t).device_valid;
        figures.refused_ticks += haptics.state(t).rejected_samples;
    }
}

}  // namespace

void first_device_states(World& world) {
    for (size_t t = 0; t < world.haptics.tool.size(); ++t) {
        const HandTool& tool = world.haptics.tool[t];
        ClutchState clutch;
        world.haptics.state[t].device = place_tool(tool, read_device(device_of(world.haptics, world.paths, tool), 0), clutch);
    }
}

void heed_viewers(const RunParts& run, LiveRecording* recording) {
    if (!run.view) return;
    const World& w = run.frame.world();
    if (run.view->take_capture() && run.recorder) {
        const size_t before = run.recorder->files().size();
        run.recorder->write_now("view");
        run.view->tell(run.recorder->files().size() > before ? "captured: captures/" + run.recorder->files().back()
                                                             : "no pass to capture yet");
    }
    for (ViewCommand& command : run.view->take_commands()) {
        command.pass = w.clock.pass;
        if (!run.actions) {
            run.view->tell("a run that is repeated takes no commands");
            continue;
        }
        try {
            run.actions->obey(command, run.frame, run.watch);
        } catch (const InputError& error) {
            run.view->tell(error.what());
            continue;
        }
        const bool sets = command.kind == ViewCommand::Kind::kSet;
        const std::string from = format(" from %.3f s on", 1e-3 * static_cast<double>(w.clock.tick));
        if (sets) run.view->tell(command.key + " = " + command.value + from);
        if (command.kind == ViewCommand::Kind::kBleed)
            run.view->tell(w.bodies.name[command.body] + format(" bleeds %.0f ml/min", 6e7 * command.rate) + from);
        if (command.kind == ViewCommand::Kind::kSlip) run.view->tell("the staple holds no more" + from);
        // a hand that moves only ends what a capture reaches back to; all else ends a range of passes, too
        const bool moves = command.kind == ViewCommand::Kind::kPull || command.kind == ViewCommand::Kind::kLet;
        if (run.recorder) moves ? run.recorder->forget() : run.recorder->constants_changed();
        if (recording) recording->command.push_back(std::move(command));
    }
    if (!run.actions) return;
    run.actions->before_pass(run.frame);
    // a capture repeats passes, not what a hand does between them
    if (run.recorder && run.actions->holds()) run.recorder->forget();
}

void note_end_of_results(const RunParts& run) {
    if (run.figures.kept_s > 0) return;
    run.figures.kept_s =
        run.figures.pass.empty() ? 0 : 1e-3 * static_cast<double>(run.frame.world().clock.tick - run.frame.world().clock.period);
    std::fprintf(stderr, "trocar: note: results cover the first %llu passes, %.1f s; the run goes on (--keep-passes)\n",
                 static_cast<unsigned long long>(run.most_passes), run.figures.kept_s);
}

int64_t time_let_go(int64_t behind, int64_t period) { return behind > period ? behind : 0; }

bool run_live(const RunParts& run, LiveRecording* recording) {
    const auto& [options, seconds, frame, pictures, recorder, figures, watch, player, exercise, view, actions, most_passes] = run;
    World& world = frame.world();
    TickCollector collector(recording, most_passes);
    if (recording) recording->viewed = actions != nullptr;
    collector.begin(world, seconds);
    first_device_states(world);
    const std::vector<std::unique_ptr<DeviceLink>> links = open_links(options.devices, world, view);
    std::vector<DeviceLink*> link;
    for (const auto& opened : links) link.push_back(opened.get());
    for (const ToolExchange& e : world.nodes.exchange)
        if (!link[e.to]) link[e.to] = link[e.from];  // exchanged tools share one hand
    const std::vector<uint8_t>& laid_down = world.node_state.laid_down;
    std::vector<LiveTool> tools;
    for (size_t t = 0; t < world.haptics.tool.size(); ++t) {
        const HandTool& tool = world.haptics.tool[t];
        tools.push_back({tool, effects_of(world.haptics, tool), device_of(world.haptics, world.paths, tool), link[t],
                         laid_down.empty() || !laid_down[t]});
    }
    LiveHaptics haptics(haptic_params(world.clock.contact_rate), tools, collector.recorder());
    frame.set_contact_hook({publish_models, &haptics});
    std::optional<DrawingThread> drawing;
    if (pictures) drawing.emplace(*pictures, frame.snapshot_now(), options.slow_render_ms);

    constexpr int64_t kMillisecond = 1'000'000;
    const int64_t start = monotonic_ns() + 20 * kMillisecond;
    PeriodicOptions ticks;
    ticks.processors = 2;  // a host that takes one processor away for some milliseconds rarely takes both
    const std::vector<int> allowed = allowed_processors();
    if (!tools.empty()) {
        haptics.start(ticks, start);
        if (allowed.size() > 1) allow_processors(std::span(allowed).subspan(1));  // the first processor is reserved for the ticks
    }
    const int nice_before = set_nice(kSimulationNice);
    int64_t slip = 0;
    uint64_t published = 0;
    while (static_cast<double>(world.clock.tick) < seconds * 1000 && stop_signal() == 0) {
        const int64_t asked = monotonic_ns();
        if (view && !view->wait_while_paused(frame)) break;
        const int64_t waited = monotonic_ns() - asked;
        if (waited > kMillisecond) slip += waited;  // paused, which is not late
        const int64_t due = start + slip + static_cast<int64_t>(world.clock.tick) * kMillisecond;
        const int64_t behind = world.clock.pass > 0 ? monotonic_ns() - due : 0;
        world.report.late_passes += behind > kMillisecond;
        slip += time_let_go(behind, static_cast<int64_t>(world.clock.period) * kMillisecond);
        haptics.set_slip(static_cast<double>(slip) * 1e-9);
        sleep_until_ns(due);
        haptics.take_states(world.haptics);
        collector.add_pass(world, static_cast<double>(slip) * 1e-9);
        heed_viewers(run, collector.open_recording());
        if (recorder) recorder->before_pass();
        const double time = static_cast<double>(world.clock.tick) * 1e-3;
        const int64_t pass_start = monotonic_ns();
        frame.step();
        if (watch) watch->after_pass(frame);
        collector.after_pass(world);
        PassFigures pass = pass_figures(frame, time);
        if (frame.times().picture && drawing && run.keeps()) drawing->publish(world.picture), ++published;
        pass.frame_ms = static_cast<double>(monotonic_ns() - pass_start) * 1e-6;
        if (recorder) recorder->after_pass(pass);
        if (player) player->after_pass(frame, frame.times().stage_ns);
        if (view) view->after_pass(frame, frame.times().stage_ns);
        if (!run.keeps()) {
            note_end_of_results(run);
            continue;
        }
        add_stage_times(frame, figures);
        figures.pass.push_back(pass);
        record_tools(frame, figures.tool_sample);
        if (exercise) exercise->after_pass(frame);
    }
    figures.wall_s = static_cast<double>(monotonic_ns() - start) * 1e-9;
    figures.stopped_by = static_cast<double>(world.clock.tick) < seconds * 1000 ? stop_signal() : 0;
    set_nice(nice_before);
    if (!tools.empty() && allowed.size() > 1) allow_processors(allowed);
    haptics.stop();
    std::vector<DeviceLink*> devices;
    for (const auto& opened : links)
        if (opened) devices.push_back(opened.get());
    close_devices(devices);
    const bool complete = collector.finish(world);
    frame.set_contact_hook({});
    if (drawing) {
        drawing->stop();
        figures.write_failure = drawing->failure();
        figures.render_ms = drawing->milliseconds();
        world.report.dropped_pictures = published - std::min<uint64_t>(published, figures.render_ms.size());
    }
    figures.tool.resize(tools.size());
    for (uint32_t t = 0; t < tools.size(); ++t) add_device(links[t].get(), link, haptics, figures.tool[t]);
    if (tools.empty()) return complete;
    const PeriodicFigures& timing = haptics.timing();
    figures.ticks = timing.compute.count;
    figures.max_force = haptics.figures().max_force;
    figures.max_force_wanted = haptics.figures().max_force_wanted;
    figures.tick_us = samples(timing.compute, 1e3);
    figures.tick_period_us = samples(timing.period, 1e3);
    figures.contact_age_ms = samples(haptics.figures().contact_age, 1e6);
    figures.missed_ticks = timing.missed;
    figures.doubled_periods = timing.doubled;
    figures.relieved_ticks = timing.relieved;
    figures.scheduling = describe(timing.grant);
    return complete;
}

}  // namespace trocar
