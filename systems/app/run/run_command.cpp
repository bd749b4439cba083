#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <initializer_list>
#include <map>
#include <optional>
#include <thread>

#include "content/scene/build_scene.hpp"
#include "content/scene/find_scene.hpp"
#include "content/write/save_mesh.hpp"
#include "engine/base/cpu.hpp"
#include "engine/base/error.hpp"
#include "engine/draw/offscreen.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/jobs/real_time.hpp"
#include "engine/jobs/trace.hpp"
#include "engine/mesh/surface_mesh.hpp"
#include "engine/tissue/links.hpp"
#include "systems/app/capture/capture.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/progress.hpp"
#include "systems/app/console/resident_memory.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/console/stop_signal.hpp"
#include "systems/app/console/version.hpp"
#include "systems/app/pictures/picture_writer.hpp"
#include "systems/app/player/player_page.hpp"
#include "systems/app/report/figures.hpp"
#include "systems/app/report/report_page.hpp"
#include "systems/app/report/run_costs.hpp"
#include "systems/app/run/live_replay.hpp"
#include "systems/app/run/live_run.hpp"
#include "systems/app/station/exercise_file.hpp"
#include "systems/app/station/score_section.hpp"
#include "systems/fluid/amounts.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

constexpr double kLongestView = 1e6;  // s, as of --seconds
constexpr size_t kTraceCapacity = 1u << 19;
// Bodies, and their total triangles, that a run writes by default: 90 MB of text.
constexpr size_t kMostMeshes = 500, kMostTriangles = 1'000'000;

void export_bodies(const World& world, const fs::path& folder, uint64_t picture) {
    prepare_folder(folder);
    const std::string number = format("%06llu_", static_cast<unsigned long long>(picture));
    for (uint32_t b = 0; b < world.bodies.mesh.size(); ++b)
        save_mesh(surface_mesh(surfaces_of(world), b), folder / (number + world.bodies.name[b] + ".obj"));
}

bool too_many_to_export(const World& world) {
    size_t triangles = 0;
    for (const uint32_t mesh : world.bodies.mesh) triangles += world.meshes.info[mesh].triangles.count;
    return world.bodies.mesh.size() > kMostMeshes || triangles > kMostTriangles;
}

void start_figures(const BuiltScene& scene, const SceneFile& file, const Frame& frame, const RunOptions& options, RunFigures& figures) {
    figures.scene = file.settings.name;
    std::error_code error;
    // a folder of that name, as of results, hides no scene
    const bool is_file = fs::exists(options.scene, error) && !fs::is_directory(options.scene, error);
    figures.scene_file = is_file ? fs::absolute(options.scene).string() : options.scene;
    for (const Override& o : options.overrides) figures.overridden.push_back({o.key, o.value});
    figures.description = file.settings.description;
    figures.version = program_version();
    figures.instruction_set = instruction_set();
    figures.machine = machine_text();
    figures.threads = thread_count();
    figures.live = options.live;
    figures.replay = !options.replay.empty();
    figures.bodies = scene.notes;
    figures.start_gravity = frame.world().energy.gravity;
    for (const std::string& name : frame.stage_names()) figures.stage.push_back({name, {}});
}

CaptureHeader capture_header(const BuiltScene& scene, const RunFigures& figures, bool external_ticks) {
    CaptureHeader header{figures.scene, figures.version, figures.instruction_set, figures.machine, "", {}, scene.camera};
    header.live = external_ticks;
    header.wireframe = scene.picture.wireframe, header.depth_colours = scene.picture.depth_colours;
    for (const StageFigures& stage : figures.stage) header.stages.push_back(stage.name);
    return header;
}

ActionFigures action_figures(const World& w) {
    ActionFigures a;
    for (size_t i = 0; i < w.actions.action.size(); ++i) {
        const ActionProgress& p = w.action_state.progress[i];
        if (is_nozzle(w.actions.action[i].kind)) continue;
        a.any = true;
        switch (w.actions.action[i].kind) {
            case ActionKind::kStaple:
                a.staples = true;
                a.set += p.done, a.misfires += p.misfires, a.pulled_out += p.pulled_out;
                a.pull = std::max(a.pull, p.largest_force);
                break;
            case ActionKind::kCut:
                a.cuts = true;
                a.cut += p.done, a.refused += p.refused, a.area += p.area, a.work += p.work, a.owed += p.owed;
                break;
            case ActionKind::kGrasp:
                a.grasps = true;
                a.grasped += p.done, a.nothing_grasped += p.misfires, a.slipped += p.slips;
                a.grip = std::max(a.grip, p.largest_force);
                break;
            case ActionKind::kCauterise:
                a.cautery = true;
                a.burns += p.done, a.heat += p.heat, a.burnt += p.burnt;
                break;
            case ActionKind::kSuture:
                a.sutures = true;
                a.stitches += p.done, a.missed += p.misfires;
                break;
            case ActionKind::kIrrigate:
            case ActionKind::kSuck:
                break;  // of fluids
        }
    }
    for (const ThreadProgress& p : w.thread_state.progress)
        a.tension = std::max(a.tension, p.largest_tension), a.slipped_off += p.slipped_off, a.throws += p.throws,
        a.thread_friction -= p.friction_work;
    for (const ThreadHold& hold : w.thread_state.hold) a.drawn += hold.slides ? std::abs(hold.passed) : 0;
    for (const ToolGrasp& grasp : w.action_state.grasp) a.grip = std::max(a.grip, grasp.largest_force);
    for (const HeatBody& body : w.actions.heat_body)
        for (uint32_t v = body.nodes.first; v < body.nodes.end(); ++v)
            a.hottest = std::max(a.hottest, body.blood + w.action_state.heat.rise[v]);
    for (const ToolStaple& staple : w.action_state.staple) {
        const uint32_t group = find_link_group(w.links, staple.group);
        if (group != kNone) a.pull = std::max(a.pull, w.links.group[group].largest_force);
    }
    return a;
}

FluidFigures fluid_figures(const World& w) {
    if (w.fluids.body.empty()) return {};
    FluidShapeScratch scratch;
    const FluidAmounts there = measure_fluids(surfaces_of(w), w.fluids, w.fluid_state, scratch);
    const FluidLedger& l = w.fluid_state.ledger;
    FluidFigures f{true, l.bled, l.irrigated, there.film, there.pools, there.drops, l.sucked, l.sucked_blood, l.lost, there.error};
    const double now = static_cast<double>(w.clock.tick) * 1e-3;
    for (size_t i = 0; i < w.fluids.wound.size(); ++i) {
        const Wound& wound = w.fluids.wound[i];
        f.bleeding += w.fluid_state.bleeding[i];
        if (now <= wound.begin || now >= wound.end) continue;
        ++f.wounds;
        if (w.fluid_state.bleeding[i] == 0) ++f.sealed;
    }
    for (const double mass : w.fluid_state.puffs.mass) f.smoke += mass;
    f.emitted = w.fluid_state.smoke.emitted, f.smoke_sucked = w.fluid_state.smoke.sucked, f.cleared = w.fluid_state.smoke.cleared;
    return f;
}

void finish_figures(const Frame& frame, RunFigures& figures) {
    const World& w = frame.world();
    figures.bytes_per_body = figures.world_bytes / static_cast<double>(std::max<size_t>(1, w.bodies.mesh.size()));
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        if (!joins_islands(w.bodies.motion[b]) || w.bodies.motion[b] == Motion::kHand) continue;
        const double size = 2 * w.meshes.info[w.bodies.mesh[b]].radius;
        figures.body_size = figures.movable_bodies++ == 0 ? size : std::min(figures.body_size, size);
    }
    figures.state_hash = state_hash(w);
    figures.frames = w.clock.picture;
    figures.simulated_s = static_cast<double>(w.clock.tick) * 1e-3;
    figures.contact_rate = w.clock.contact_rate;
    figures.report = w.report;
    figures.search = w.settings.contact.search;
    for (const auto& tree : w.trees) figures.tree_builds += tree->builds();
    figures.tool.resize(w.haptics.tool.size());
    for (size_t t = 0; t < figures.tool.size(); ++t) {
        figures.tool[t].body = w.bodies.name[w.haptics.tool[t].body];
        figures.tool[t].safety = w.haptics.state[t].safety;
        figures.tool[t].events = w.haptics.state[t].events;
    }
    for (size_t d = 0; d < w.nodes.drive.size(); ++d)
        figures.drive.push_back({w.bodies.name[w.nodes.drive[d].body], w.nodes.drive[d].behaviour, w.node_state.drive[d].events});
    for (const LinkGroup& g : w.links.group) {
        if (g.body != kNone) figures.link.push_back({g.name, g.made, g.broken, g.largest_force, g.largest_strain});
    }
    figures.actions = action_figures(w);
    figures.fluid = fluid_figures(w);
    for (const Lens& lens : w.lenses.lens)
        figures.any_lens = true, figures.lens_film = lens.film, figures.lens_temperature = lens.temperature,
        figures.lens_wipes = lens.wipes;
    if (!figures.live) {
        figures.ticks = w.haptics.ticks;
        figures.max_force = w.haptics.max_force;
        figures.max_force_wanted = w.haptics.max_force_wanted;
    }
}

// A full disk must end neither the simulation nor its figures: the first failure is reported at the end.
template <typename Write>
void attempt(RunFigures& figures, const Write& write) {
    try {
        write();
    } catch (const InputError& error) {
        if (figures.write_failure.empty()) figures.write_failure = error.what();
    }
}

void take_picture(Frame& frame, PictureWriter& pictures, RunFigures& figures, PassFigures& pass) {
    attempt(figures, [&] {
        pass.render_ms = pictures.take(frame.world().picture);
        pass.frame_ms += pass.render_ms;
        figures.render_ms.push_back(pass.render_ms);
    });
}

void print_warnings(const std::vector<std::string>& warnings) {
    for (const std::string& warning : warnings) std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
}

// Runs as fast as possible in one deterministic order, freely or following a recorded live run.
// `recording`: what viewers do, or null.
void run_lockstep(const RunParts& run, LiveReplay* replay, LiveRecording* recording, Trace* trace) {
    const auto& [options, seconds, frame, pictures, recorder, figures, watch, player, exercise, view, actions, most_passes] = run;
    const auto is_recorded = [&] { return recording && (most_passes == 0 || recording->slip.size() < most_passes); };
    std::map<uint64_t, std::string_view> names;
    CostMeter costs;
    Progress progress(figures.scene);
    const uint64_t start = now_ns();
    const double end_tick = replay ? static_cast<double>(replay->end_tick()) : seconds * 1000;
    while (static_cast<double>(frame.world().clock.tick) < end_tick && stop_signal() == 0) {
        if (view && !view->wait_for_turn(frame)) break;
        const double time = static_cast<double>(frame.world().clock.tick) * 1e-3;
        if (replay) replay->begin_pass(watch);
        heed_viewers(run, is_recorded() ? recording : nullptr);
        const uint64_t keep_start = now_ns();
        if (recorder) recorder->before_pass();
        uint64_t keep_ns = now_ns() - keep_start;
        const double bytes = resident_bytes();
        const uint64_t pass_start = now_ns();
        frame.step();
        const double frame_ms = static_cast<double>(now_ns() - pass_start) * 1e-6;
        const double bytes_now = resident_bytes();
        figures.world_bytes += bytes_now - bytes;
        watch->after_pass(frame);
        print_warnings(watch->take_warnings());
        if (is_recorded()) {
            recording->slip.push_back(0);
            if (!is_recorded()) recording->state_hash = state_hash(frame.world());
        }
        PassFigures pass = pass_figures(frame, time);
        pass.frame_ms = frame_ms;
        pass.resident = bytes_now;
        if (run.keeps()) costs.add(frame, figures);
        if (trace && run.keeps()) trace_pairs(frame, names, *trace);
        const uint64_t kept_start = now_ns();
        if (recorder) recorder->after_pass(pass);
        keep_ns += now_ns() - kept_start;
        if (recorder) figures.capture_s += static_cast<double>(keep_ns) * 1e-9;
        if (frame.times().picture && figures.write_failure.empty() && run.keeps()) {
            if (pictures) take_picture(frame, *pictures, figures, pass);
            if (options.export_every > 0 && !options.out.empty() && (frame.world().clock.picture - 1) % options.export_every == 0)
                attempt(figures, [&] { export_bodies(frame.world(), options.out / "meshes", frame.world().clock.picture - 1); });
        }
        if (player) player->after_pass(frame, frame.times().stage_ns);
        if (view) view->after_pass(frame, frame.times().stage_ns);
        progress.show(time * 1e3 / end_tick, format("%.2f s simulated, depth %.2f mm, %.2f N", time, pass.depth * 1e3, pass.force));
        if (!run.keeps()) {
            note_end_of_results(run);
            continue;
        }
        add_stage_times(frame, figures);
        for (const uint64_t ns : frame.times().tick_ns) figures.tick_us.push_back(static_cast<double>(ns) * 1e-3);
        figures.pass.push_back(pass);
        record_tools(frame, figures.tool_sample);
        if (exercise) exercise->after_pass(frame);
    }
    figures.wall_s = static_cast<double>(now_ns() - start) * 1e-9;
    figures.stopped_by = static_cast<double>(frame.world().clock.tick) < end_tick ? stop_signal() : 0;
    costs.finish(frame, figures);
    if (replay) figures.replay_difference = replay->difference();
    if (is_recorded()) recording->state_hash = state_hash(frame.world());
}

// Runs in lockstep for viewers and writes what they did into the folder.
void run_viewed(const RunParts& run, Trace* trace) {
    LiveRecording recording;
    recording.lockstep = recording.viewed = true;
    recording.start_hash = scene_hash(run.frame.world());
    run_lockstep(run, nullptr, &recording, trace);
    const fs::path file = run.options.out / "live.recording";
    std::error_code error;
    fs::remove(file, error);  // left by an earlier run
    write_live_recording(file, recording), run.figures.recorded = true;
}

// Runs live and writes the recording into the folder.
void run_recorded(const RunParts& run) {
    if (run.options.out.empty()) {
        run_live(run, nullptr);
        return;
    }
    const fs::path file = run.options.out / "live.recording";
    std::error_code error;
    fs::remove(file, error);  // left by an earlier run
    LiveRecording recording;
    if (run_live(run, &recording)) {
        write_live_recording(file, recording), run.figures.recorded = true;
        if (run.exercise) run.exercise->add_ticks(recording.tick, recording.slip);
    } else
        std::fprintf(stderr, "trocar: warning: no recording: the simulation was interrupted for too long\n");
}

// Writes tools.csv, and a force map for every tool that palpated a surface.
void write_tools(const fs::path& folder, const RunFigures& figures) {
    std::vector<std::string> names;
    for (const ToolFigures& tool : figures.tool) names.push_back(tool.body);
    write_whole_file(folder / "tools.csv", tools_csv(figures.tool_sample, names));
    for (uint32_t t = 0; t < names.size(); ++t) {
        const std::optional<ForceMap> map = force_map(figures.tool_sample, t);
        if (map) write_whole_file(folder / ("force_map_" + names[t] + ".svg"), svg_force_map("Force on " + names[t], *map));
    }
}

std::vector<std::string> thread_names() {
    std::vector<std::string> names{"main"};
    for (uint32_t t = 1; t < thread_count(); ++t) names.push_back("worker " + std::to_string(t));
    names.resize(kPairTrack);
    names.push_back("pairs of bodies (their shares of detection)");
    return names;
}

// Bodies in the run, the cost of a displayed frame and the stages that caused it.
std::string frames_text(const RunFigures& f) {
    const std::vector<double> frames = displayed_frames(f.pass);
    if (frames.empty()) return "  shorter than a displayed frame\n";
    return format("  %.1f frames per second; a frame %.2f ms median, %.2f ms p99, %.2f ms worst\n",
                  f.wall_s > 0 ? static_cast<double>(f.frames) / f.wall_s : 0, quantile(frames, 0.5), quantile(frames, 0.99),
                  quantile(frames, 1));
}

std::string scale_text(const RunFigures& f) {
    std::vector<double> residual, found;
    double awake = 0, contacts = 0;
    for (const PassFigures& p : f.pass) awake += p.awake, contacts += p.contacts, residual.push_back(p.residual), found.push_back(p.depth);
    const auto percent = [&](double depth) { return f.body_size > 0 ? 100 * depth / f.body_size : 0; };
    const double passes = std::max(1.0, static_cast<double>(f.pass.size()));
    std::string all = frames_text(f);
    all += format(
        "  %llu movable bodies, %.0f awake on average, %u at the end; %.0f contacts; %.0f bytes per body\n"
        "  overlap found by a pass: median %.3g mm, p99 %.3g mm, worst %.3g mm, which is %.2g %% of the smallest body\n",
        static_cast<unsigned long long>(f.movable_bodies), awake / passes, f.pass.empty() ? 0 : f.pass.back().awake, contacts / passes,
        f.bytes_per_body, quantile(found, 0.5) * 1e3, quantile(found, 0.99) * 1e3, quantile(found, 1) * 1e3, percent(quantile(found, 1)));
    all += format("  overlap after it, by its planes: p99 %.3g mm, worst %.3g mm, which is %.2g %% of the smallest body",
                  quantile(residual, 0.99) * 1e3, quantile(residual, 1) * 1e3, percent(quantile(residual, 1)));
    all += format("; left in the last tenth of the run, by the surfaces: %.3g mm\n", overlap_left(f) * 1e3);
    // overlap that is new in a pass; when large in more than a tenth of all passes, it is not a single impact
    std::vector<double> late;
    for (size_t k = 1; k < found.size(); ++k) late.push_back(found[k] - residual[k - 1]);
    if (f.contact_rate < kHighestContactRate && !late.empty() && percent(quantile(late, 0.9)) > 1)
        all += format("  contacts were detected late at %u Hz: --set contact.rate=%u finds them earlier\n", f.contact_rate,
                      std::min(2 * f.contact_rate, kHighestContactRate));
    if (f.live && (!f.render_ms.empty() || f.report.dropped_pictures > 0)) {
        all += format("  %zu pictures drawn beside it, %llu dropped", f.render_ms.size(),
                      static_cast<unsigned long long>(f.report.dropped_pictures));
        if (!f.render_ms.empty())
            all += format("; one %.2f ms median, %.2f ms p99", quantile(f.render_ms, 0.5), quantile(f.render_ms, 0.99));
        all += "\n";
    }
    std::vector<std::pair<double, const StageFigures*>> stages;
    double total = 0;
    for (const StageFigures& s : f.stage)
        stages.emplace_back(mean(s.ms) * static_cast<double>(s.ms.size()), &s), total += stages.back().first;
    std::stable_sort(stages.begin(), stages.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    all += "  stages, ms per pass (share):";
    for (size_t i = 0; i < std::min<size_t>(stages.size(), 8); ++i) {
        all += format("%s %s %.3f (%.0f %%)", i > 0 ? "," : "", stages[i].second->name.c_str(), stages[i].first / passes,
                      total > 0 ? 100 * stages[i].first / total : 0);
    }
    return all + "\n";
}

// One line: quantiles of samples, and the share of samples below each edge and beyond the last.
std::string samples_text(const char* what, const char* unit, const std::vector<double>& samples, std::initializer_list<double> edges) {
    std::string line = format("  %-20s median %.4g, p99 %.4g, p99.9 %.4g, worst %.4g %s;", what, quantile(samples, 0.5),
                              quantile(samples, 0.99), quantile(samples, 0.999), quantile(samples, 1), unit);
    double from = -1e300;
    const auto share = [&](double to) {
        const auto inside = std::count_if(samples.begin(), samples.end(), [&](double x) { return x >= from && x < to; });
        from = to;
        return 100 * static_cast<double>(inside) / std::max(1.0, static_cast<double>(samples.size()));
    };
    for (const double edge : edges) line += format(" below %g: %.3g %%,", edge, share(edge));
    return line + format(" beyond: %.3g %%\n", share(1e300));
}

// Timing of the haptic thread in a live run.
std::string live_text(const RunFigures& f) {
    if (!f.live || f.tick_us.empty()) return "";
    return "  haptic thread: " + f.scheduling + "; " + std::to_string(f.missed_ticks) + " deadlines missed, " +
           std::to_string(f.doubled_periods) + " periods above 2 ms, " + std::to_string(f.relieved_ticks) +
           " ticks taken over by the second processor\n" +
           samples_text("period of the tick", "us", f.tick_period_us, {950, 1050, 1500, 2000}) +
           samples_text("compute time", "us", f.tick_us, {10, 50, 200, 600}) +
           samples_text("age of the surface", "ms", f.contact_age_ms, {10, 20, 50, 100});
}

// Why the figures of a run are meaningless; empty = they are valid.
std::string ruin_text(const RunFigures& f) {
    if (f.report.nonfinite_particles > 0)
        return std::to_string(f.report.nonfinite_particles) +
               " particles had positions or velocities that are not finite, and their bodies were restored";
    if (!f.ruin.empty()) return f.ruin;
    for (const PassFigures& p : f.pass)
        if (!std::isfinite(p.energy.balance)) return format("the energy is not finite after %.3f s", p.time);
    return "";
}

std::string files_text(const RunFigures& f, bool figures_only) {
    std::string text = "metrics.json, passes.csv";
    if (!figures_only) text = "report.html, trace.json, " + text;
    if (!figures_only && !f.pass_stage_ms.empty()) text += ", stages.csv";
    if (!f.tool.empty()) text += ", tools.csv";
    if (f.exercise_written) text += ", exercise.json, exercise.csv";
    if (f.recorded) text += ", live.recording";
    if (f.meshes_written) text += ", meshes/";
    if (f.too_many_meshes) text += " (not meshes/ of so many bodies: --export-every N writes them)";
    if (!f.render_ms.empty()) text += ", frames/";
    for (const std::string& capture : f.captures) text += ", captures/" + capture;
    if (f.capture_asked && f.captures.empty()) text += "; no capture: no trigger fired";
    return text;
}

// Cost of --capture beside the passes.
std::string capture_text(const RunFigures& f) {
    if (!f.capture_asked || f.live || f.pass.empty()) return "";
    double passes = 0;
    for (const PassFigures& p : f.pass) passes += 1e-3 * (p.frame_ms - p.render_ms);
    return format("  keeping states and writing captures: %.3f ms per pass in addition, %.1f %% of the passes' time\n",
                  1e3 * f.capture_s / static_cast<double>(f.pass.size()), passes > 0 ? 100 * f.capture_s / passes : 0);
}

std::string fluid_text(const RunFigures& f) {
    const FluidFigures& l = f.fluid;
    if (!l.any) return "";
    std::string text = format(
        "  bled %.2f ml, irrigated %.2f ml, sucked %.2f ml; film %.2f ml, pools %.2f ml, drops %.2f ml, lost %.2f ml; ledger to %.1e",
        1e6 * l.bled, 1e6 * l.irrigated, 1e6 * l.sucked, 1e6 * l.film, 1e6 * l.pools, 1e6 * l.drops, 1e6 * l.lost, std::abs(l.error));
    if (l.wounds > 0) text += format("; %u of %u wounds sealed", l.sealed, l.wounds);
    if (l.emitted > 0)
        text += format("\n  smoke %.3g mg: %.3g sucked, %.3g cleared, %.3g left", 1e6 * l.emitted, 1e6 * l.smoke_sucked, 1e6 * l.cleared,
                       1e6 * l.smoke);
    return text + "\n";
}

void print_summary(const RunFigures& f, const fs::path& out, bool figures_only) {
    const ContactColumns contact = contact_columns(f);
    const std::string text = format(
        "%s: %.2f s simulated in %.2f s, built in %.2f s, %u thread%s, %s\n  contact events %zu, %.3f ms mean, %.3f ms p99; "
        "deepest %.2f mm\n"
        "  haptic ticks %llu, largest force on the hand %.2f N; state hash %016llx\n",
        f.scene.c_str(), f.simulated_s, f.wall_s, f.build_s, f.threads, f.threads == 1 ? "" : "s", f.instruction_set.c_str(),
        contact.total.size(), mean(contact.total), quantile(contact.total, 0.99), quantile(contact.depth_mm, 1),
        static_cast<unsigned long long>(f.ticks), f.max_force, static_cast<unsigned long long>(f.state_hash));
    write_standard_output(text + fluid_text(f) + live_text(f) + scale_text(f) + capture_text(f));
    if (f.replay)
        write_standard_output(f.replay_difference.empty() ? "  the same to the bit as the live run\n"
                                                          : "  differs from the live run: " + f.replay_difference + "\n");
    if (f.kept_s > 0) write_standard_output(format("  figures and files cover the first %.1f s\n", f.kept_s));
    if (!out.empty()) write_standard_output("  wrote " + out.string() + "/: " + files_text(f, figures_only) + "\n");
}

// Reports every device on standard error; false if one delivered no sample that a tick could use.
bool tell_of_devices(const RunFigures& f) {
    bool all_heard = true;
    for (const ToolFigures& t : f.tool) {
        if (t.device.empty()) continue;
        std::fprintf(stderr, "trocar: \"%s\" was held by %s\n", t.body.c_str(), device_text(t).c_str());
        if (t.device_heard) continue;
        all_heard = false;
        std::fprintf(stderr, "trocar: error: %s gave no usable sample in the whole run: no device moved \"%s\"\n", t.device.c_str(),
                     t.body.c_str());
    }
    return all_heard;
}

// The haptic thread does not support scene nodes from an object pool (come and go).
void refuse_what_is_not_live(const World& w) {
    for (const HandTool& tool : w.haptics.tool) {
        const bool in_node = !w.nodes.of_body.empty() && w.nodes.of_body[tool.body] != kNone && !w.nodes.toggle.empty();
        if (in_node)
            throw InputError("tool \"" + w.bodies.name[tool.body] +
                             "\" belongs to a node that is switched: supported in lockstep only, without --live");
    }
}

// Removes the outputs of an earlier run, to avoid confusion. Meshes stay: a scene may read them.
void clear_outputs(const fs::path& folder) {
    std::error_code error;
    const auto clear = [&](const fs::path& inside, const auto& is_ours) {
        for (const fs::directory_entry& old : fs::directory_iterator(inside, error)) {
            if (fs::is_regular_file(old.symlink_status(error)) && is_ours(old.path().filename().string())) fs::remove(old.path(), error);
        }
    };
    clear(folder, [](const std::string& name) {
        return name == "report.html" || name == "metrics.json" || name == "passes.csv" || name == "trace.json" || name == "tools.csv" ||
               name == "stages.csv" || name == "exercise.json" || name == "exercise.csv" ||
               (name.starts_with("force_map_") && name.ends_with(".svg"));
    });
    clear_pictures(folder);
    clear(folder / "captures", [](const std::string& name) { return name.ends_with(".cap"); });
}

void finish_captures(FrameRecorder& recorder, RunFigures& figures) {
    recorder.finish();
    figures.capture_asked = true;
    figures.captures = recorder.files();
    for (const std::string& note : recorder.notes()) std::fprintf(stderr, "trocar: note: --capture %s\n", note.c_str());
    if (!recorder.failure().empty())
        std::fprintf(stderr, "trocar: warning: capturing stopped, the run went on: %s\n", recorder.failure().c_str());
}

}  // namespace

std::string machine_text() {
    std::ifstream cpu("/proc/cpuinfo");
    std::string model = "unknown processor";
    for (std::string line; std::getline(cpu, line);) {
        if (line.rfind("model name", 0) == 0) {
            model = line.substr(line.find(':') + 2);
            break;
        }
    }
    return model + ", " + kernel_name();
}

namespace {

// Writes exercise.json and exercise.csv; returns the report's section about it.
std::string write_exercise(const fs::path& folder, Exercise& e, RunFigures& figures) {
    e.scene = figures.scene, e.version = figures.version, e.state_hash = state_hash_text(figures), e.live = figures.live;
    if (e.sample.empty()) return "";
    write_whole_file(folder / "exercise.csv", exercise_csv(e));
    write_whole_file(folder / "exercise.json", exercise_json(e));
    figures.exercise_written = true;
    return score_section(e, score_exercise(e, {}));
}

// Writes the files of a run into options.out, except pictures and captures, which exist already.
void write_outputs(const RunOptions& options, Frame& frame, Trace& trace, PictureWriter* pictures, const Camera& camera,
                   PlayerRecorder* player, ExerciseRecorder* exercise, RunFigures& figures) {
    write_whole_file(options.out / "passes.csv", passes_csv(figures));
    write_whole_file(options.out / "metrics.json", metrics_json(figures));
    if (!figures.tool.empty()) write_tools(options.out, figures);
    if (options.figures_only) return;
    std::string score;
    if (exercise) score = write_exercise(options.out, exercise->exercise(), figures);
    if (!figures.pass_stage_ms.empty()) write_whole_file(options.out / "stages.csv", stages_csv(figures));
    write_trace(options.out / "trace.json", trace, thread_names(), &figures);
    figures.too_many_meshes = options.export_every == 0 && too_many_to_export(frame.world());
    if (!figures.too_many_meshes) {
        attempt(figures, [&] {
            export_bodies(frame.world(), options.out / "meshes", frame.world().clock.picture);
            figures.meshes_written = true;
        });
    }
    const std::string film = pictures ? pictures->finish_film() : "";
    std::vector<size_t> worst = worst_passes(figures, 6);
    for (size_t& pass : worst) pass = picture_of_pass(figures, pass);
    ReportMedia media = pictures ? embed_media(options.out, pictures->files(), film, worst) : ReportMedia{};
    if (player)
        media.player = player_section(*player, figures.scene, camera);
    else if (options.player)
        media.player = missing_player_section();
    media.score = score;
    write_whole_file(options.out / "report.html", report_html(figures, media));
}

// Prints figures and warnings and returns the exit code.
int tell_of_run(const RunOptions& options, const RunFigures& figures) {
    const std::string ruin = ruin_text(figures);
    if (!ruin.empty()) std::fprintf(stderr, "trocar: warning: the simulation broke: %s\n", ruin.c_str());
    if (options.json)
        write_standard_output(metrics_json(figures));
    else if (options.tells)
        print_summary(figures, options.out, options.figures_only);
    const bool devices_heard = tell_of_devices(figures);
    if (figures.stopped_by != 0) {
        std::fprintf(stderr, "trocar: stopped by %s after %.3f s of simulated time; the results cover that time\n",
                     name_of_signal(figures.stopped_by), figures.simulated_s);
        return exit_code_of_signal(figures.stopped_by);
    }
    if (!figures.write_failure.empty()) throw InputError(figures.write_failure + "; the figures of the run are complete");
    const bool is_expected = options.expected_hash.empty() || options.expected_hash == state_hash_text(figures);
    if (!is_expected)
        std::fprintf(stderr, "trocar: the state hash is %s, not %s as expected\n", state_hash_text(figures).c_str(),
                     options.expected_hash.c_str());
    return ruin.empty() && figures.replay_difference.empty() && devices_heard && is_expected ? kDone : kNo;
}

}  // namespace

int run_command(const RunOptions& options) {
    const uint64_t start = now_ns();
    const SceneFile file = read_scene_file(find_scene(options.scene), options.overrides);
    const bool replay = !options.replay.empty();
    const LiveRecording recording = replay ? read_live_recording(options.replay) : LiveRecording{};
    if (!options.capture.empty() && options.out.empty()) throw InputError("--capture needs --out FOLDER");
    const StopOnSignal stop;
    const CaptureTriggers triggers = options.capture.empty() ? CaptureTriggers{} : parse_capture_triggers(options.capture);
    std::optional<CaptureSignal> capture_signal;
    if (triggers.signal) capture_signal.emplace();
    if (!options.out.empty()) prepare_folder(options.out);
    if (triggers.any()) prepare_folder(options.out / "captures");
    set_offscreen_threads(0);
    // live: one core is reserved for the haptic thread
    const uint32_t cores = std::max(1u, std::thread::hardware_concurrency());
    CommandPool pool(options.threads == 0 && options.live ? std::max(1u, cores - 1) : options.threads);
    RunFigures figures;
    std::optional<LiveView> view;
    if (options.view >= 0) {
        view.emplace(static_cast<uint16_t>(options.view));
        std::fprintf(stderr, "trocar: open %s in a browser on this machine\n", view->address().c_str());
    }
    // True if the run shall start again.
    const auto simulate = [&] {
        figures = {};
        double bytes = resident_bytes();
        const bool draws = options.render && !options.figures_only && file.settings.render && !options.out.empty();
        // captures may be drawn later, and recordings must be of the same world as their replay
        const bool is_kept = options.live || replay || view || !options.capture.empty();
        BuiltScene scene = build_scene(file, draws || is_kept ? Looks::kPainted : Looks::kPlain);
        figures.world_bytes = resident_bytes() - bytes;
        if (!options.out.empty()) clear_outputs(options.out);  // a faulty scene must not delete results
        if (options.live) refuse_what_is_not_live(scene.world);
        print_warnings(scene.warnings);
        Trace trace(options.out.empty() || options.figures_only ? 0 : kTraceCapacity);
        FrameOptions frame_options;
        frame_options.trace = options.out.empty() || options.figures_only ? nullptr : &trace;
        frame_options.external_ticks = options.live || (replay && !recording.lockstep);
        frame_options.pictures = draws;
        if (view || recording.viewed) ViewerActions::make_room(scene.world);
        bytes = resident_bytes();
        Frame frame(std::move(scene.world), frame_options);
        figures.world_bytes += resident_bytes() - bytes;
        start_figures(scene, file, frame, options, figures);
        figures.build_s = static_cast<double>(now_ns() - start) * 1e-9;
        std::optional<PictureWriter> pictures;
        if (options.width > 0) scene.picture.width = options.width, scene.picture.height = options.height;
        if (draws) pictures.emplace(scene.picture, scene.camera, frame.world().meshes, options.out);
        // a view lasts until it is ended
        const double seconds = options.seconds > 0 ? options.seconds : view ? kLongestView : file.settings.seconds;
        std::optional<LiveReplay> repeat;
        if (replay) repeat.emplace(haptic_params(frame.world().clock.contact_rate), recording, options.replay.string(), frame);
        std::optional<FrameRecorder> recorder;
        if (!options.capture.empty())
            recorder.emplace(frame, capture_header(scene, figures, frame_options.external_ticks), triggers, options.out / "captures",
                             FrameRecorder::kMostKeptBytes,
                             static_cast<uint64_t>(std::min(seconds, 1e6) * frame.world().clock.contact_rate));
        if (!options.render || options.figures_only) recorder->leave_out_pictures();
        std::optional<PlayerRecorder> player;
        if (options.player && has_player() && !options.out.empty() && !options.figures_only) player.emplace(frame);
        std::optional<ExerciseRecorder> exercise;
        if (options.exercise && !options.out.empty() && !options.figures_only && !frame.world().haptics.tool.empty())
            exercise.emplace(frame);
        RunWatch watch(frame.world());
        print_warnings(watch.take_warnings());
        ViewerActions actions;
        const bool endless = view && options.seconds <= 0;
        const uint64_t kept = options.keep_passes >= 0 ? static_cast<uint64_t>(options.keep_passes) : endless ? kMostViewedPasses : 0;
        const RunParts run{options,
                           seconds,
                           frame,
                           pictures ? &*pictures : nullptr,
                           recorder ? &*recorder : nullptr,
                           figures,
                           &watch,
                           player ? &*player : nullptr,
                           exercise ? &*exercise : nullptr,
                           view ? &*view : nullptr,
                           view && !replay ? &actions : nullptr,
                           kept};
        if (view) view->offer_captures(recorder.has_value());
        if (view) view->attach(frame, figures.scene, scene.camera, !options.live);
        if (options.live)
            run_recorded(run);
        else if (view && !replay && !options.out.empty() && !options.figures_only)
            run_viewed(run, frame_options.trace);
        else
            run_lockstep(run, repeat ? &*repeat : nullptr, nullptr, frame_options.trace);
        if (view && view->take_reset()) return true;
        if (replay && exercise && !recording.lockstep) exercise->add_ticks(recording.tick, recording.slip);
        if (recorder) finish_captures(*recorder, figures);
        watch.finish(frame.world());
        print_warnings(watch.take_warnings());
        figures.ruin = watch.ruin();
        finish_figures(frame, figures);
        if (!options.out.empty()) write_outputs(options, frame, trace, run.pictures, scene.camera, run.player, run.exercise, figures);
        return false;
    };
    pool.run([&] {
        while (simulate()) {
        }
    });
    return tell_of_run(options, figures);
}

}  // namespace trocar
