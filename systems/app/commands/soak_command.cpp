#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "content/scene/build_scene.hpp"
#include "content/scene/find_scene.hpp"
#include "engine/base/cpu.hpp"
#include "engine/files/whole_file.hpp"
#include "systems/app/capture/capture.hpp"
#include "systems/app/commands/soak.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/progress.hpp"
#include "systems/app/console/resident_memory.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/console/stop_signal.hpp"
#include "systems/app/console/version.hpp"
#include "systems/app/pictures/picture_writer.hpp"
#include "systems/app/report/report_page.hpp"
#include "systems/app/report/svg_plot.hpp"
#include "systems/app/run/live_run.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

constexpr double kMemoryDrift = 0.25, kHeapDrift = 0.0625;  // MiB per minute, see soak --help
constexpr double kLeastGrowth = 0.5;                        // MiB over the run: less is pages touched late
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kMemoryIsOurs = false;  // sanitizers keep freed memory for a while
#else
constexpr bool kMemoryIsOurs = true;
#endif
constexpr double kEnergyShare = 0.02, kSlower = 0.5;
constexpr double kRounding = 1e-5;     // of the potential energy, which sums floats
constexpr double kLeastEnergy = 1e-6;  // J, smaller energies are all rounding
constexpr double kWarmShare = 0.2;     // of the run, at most kWarmMinutes: first touches of memory
constexpr double kWarmMinutes = 1;
constexpr size_t kKeptEpisodes = 2000;
constexpr uint64_t kFaultPeriod = 3;  // episodes
constexpr double kMiB = 1024 * 1024;

double resident_mib() { return resident_bytes() / kMiB; }
double heap_mib() { return static_cast<double>(mallinfo2().uordblks) / kMiB; }
uint32_t open_descriptors() {
    std::error_code error;
    uint32_t count = 0;
    for ([[maybe_unused]] const auto& entry : fs::directory_iterator("/proc/self/fd", error)) ++count;
    return count;
}

// Faults of the hands' devices: `dropout`, no new place for kDropOut passes, then where the hand has come meanwhile; `jump`, a clock
// that goes forward by kClockJump, and the hand with it.
constexpr uint64_t kDropOut = 12;        // passes: 0.2 s at 60 Hz
constexpr double kClockJump = 0.25;      // s
constexpr double kForceRounding = 1e-9;  // N
bool is_of_device(const std::string& fault) { return fault == "dropout" || fault == "jump"; }

// Whether a path is that of a hand, or of several in turn.
bool is_of_hand(const World& world, size_t path) {
    return std::ranges::any_of(world.haptics.tool, [&](const HandTool& t) { return t.path == path; });
}

// Hands do what they would have done by `seconds` earlier.
void delay_hands(double seconds, World& world) {
    for (size_t p = 0; p < world.paths.body.size(); ++p)
        for (uint32_t k = world.paths.keys[p].first; is_of_hand(world, p) && k < world.paths.keys[p].end(); ++k)
            world.paths.key[k].time += seconds;
}

double force_over_limits(const Haptics& haptics) {
    double over = 0;
    for (size_t t = 0; t < haptics.state.size(); ++t) {
        const double force = haptics.state[t].output.force.norm() - haptics.tool[t].max_force - kForceRounding;
        if (!(force <= over)) over = std::isnan(force) ? std::numeric_limits<double>::infinity() : force;
    }
    return over;
}

// Injects a fault into a running world.
void inject(const std::string& fault, World& world) {
    if (fault == "pause") {
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
        return;
    }
    for (size_t p = 0; p < world.particles.offset.size(); ++p) {
        if (!(world.particles.offset[p].w > 0)) continue;
        if (fault == "nan")
            world.particles.offset[p].x = std::numeric_limits<float>::quiet_NaN();
        else
            world.particles.velocity_x[p] = 1e12f;
        return;
    }
}

uint32_t lost_particles(const World& world) {
    uint32_t lost = 0;
    for (const Float4& o : world.particles.offset) lost += !(std::isfinite(o.x) && std::isfinite(o.y) && std::isfinite(o.z));
    return lost;
}

// Splitmix64 (Steele et al. 2014): a number in [-1, 1].
double random_share(uint64_t& state) {
    state += 0x9e3779b97f4a7c15ull;
    uint64_t z = state;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull, z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return static_cast<double>(static_cast<int64_t>((z ^ (z >> 31)) >> 11)) / static_cast<double>(int64_t{1} << 52) - 1;
}

// Hands leave their paths: every key of a tool's path by up to kStray, of which each keeps half of the one before, so that paths are
// smooth.
void stray(const Paths& as_given, uint64_t seed, World& world) {
    constexpr double kStray = 0.005;  // m: what a hand misses a place by
    uint64_t state = seed;
    world.paths = as_given;
    for (size_t p = 0; p < world.paths.body.size(); ++p) {
        if (!is_of_hand(world, p)) continue;
        Vec3d off = Vec3d::Zero();
        for (uint32_t k = world.paths.keys[p].first; k < world.paths.keys[p].end(); ++k) {
            for (double& x : off) x = 0.5 * x + 0.5 * kStray * random_share(state);
            world.paths.key[k].position += off;
        }
    }
}

// Runs one scene repeatedly from its first state to its end.
class Soaker {
 public:
    Soaker(const SoakOptions& options, Frame& frame, double seconds, FrameRecorder* recorder)
        : options_(options), frame_(frame), seconds_(seconds), recorder_(recorder) {
        start_.kind = "state";
        save_resources(frame.world(), ResourceKind::kState, start_);
        save_resources(frame.world(), ResourceKind::kAccounts, start_);
        paths_ = frame.world().paths;
    }
    Episode run(uint64_t number, Soak& soak) {
        World& world = frame_.world();
        load_resources(start_, ResourceKind::kState, world);
        load_resources(start_, ResourceKind::kAccounts, world);
        if (options_.hands >= 0)
            stray(paths_, static_cast<uint64_t>(options_.hands) + number / 2, world);
        else if (disturbed_)
            world.paths = paths_;
        if (recorder_) options_.hands >= 0 || disturbed_ ? recorder_->constants_changed() : recorder_->forget();
        const Paths paths = world.paths;
        Episode e;
        const bool has_fault = !options_.faults.empty() && number % kFaultPeriod == kFaultPeriod - 1;
        // in turn: a second fault in the same pass would go unnoticed
        const std::string fault = has_fault ? options_.faults[number / kFaultPeriod % options_.faults.size()] : "";
        e.with_fault = has_fault && fault != "pause";  // a pause must change nothing
        e.of_device = disturbed_ = is_of_device(fault);
        const double end_tick = seconds_ * 1000;
        const auto middle = static_cast<uint64_t>(0.5 * seconds_ * world.clock.contact_rate);  // pass at half time
        std::vector<double> pass_ms, tick_us;
        double largest_energy = 0, largest_balance = 0;
        while (static_cast<double>(world.clock.tick) < end_tick && soak.broken.empty() && stop_signal() == 0) {
            if (has_fault && e.passes == middle) ++soak.faults;
            if (e.of_device)
                disturb_hands(fault, e.passes, middle, paths);
            else if (has_fault && e.passes == middle)
                inject(fault, world);
            if (recorder_) recorder_->before_pass();
            const uint64_t begin = now_ns();
            frame_.step();
            PassFigures pass = pass_figures(frame_, 0);
            pass.frame_ms = static_cast<double>(now_ns() - begin) * 1e-6;
            if (recorder_) recorder_->after_pass(pass);
            pass_ms.push_back(pass.frame_ms);
            e.pass_s += 1e-3 * pass.frame_ms;
            for (const uint64_t ns : frame_.times().tick_ns) tick_us.push_back(static_cast<double>(ns) * 1e-3);
            e.residual_mm = std::max(e.residual_mm, world.report.deepest_residual * 1e3);
            e.over_force = std::max(e.over_force, force_over_limits(world.haptics));
            const Energy& energy = world.energy;
            largest_energy = std::max({largest_energy, energy.elastic, energy.kinetic, std::abs(energy.work_hand)});
            // a potential energy is known only to its rounding
            largest_balance = std::max(largest_balance, std::abs(energy.balance) - kRounding * std::abs(energy.gravity));
            if (const uint32_t lost = lost_particles(world); lost > 0)
                soak.broken = "particles: " + std::to_string(lost) + " are not finite after pass " + std::to_string(world.clock.pass - 1);
            ++e.passes;
        }
        e.energy_share = std::max(0.0, largest_balance) / std::max(largest_energy, kLeastEnergy);
        e.median_ms = quantile(pass_ms, 0.5), e.p99_ms = quantile(pass_ms, 0.99), e.worst_ms = quantile(pass_ms, 1);
        e.tick_p99_us = quantile(tick_us, 0.99);
        e.lost = world.report.nonfinite_particles;
        e.hash = state_hash(world);
        e.resident = resident_mib(), e.heap = heap_mib(), e.descriptors = open_descriptors();
        return e;
    }

 private:
    void disturb_hands(const std::string& fault, uint64_t pass, uint64_t middle, const Paths& paths) {
        const double period = 1e-3 * frame_.world().clock.period;
        if (fault == "jump" && pass == middle) delay_hands(-kClockJump, frame_.world());
        if (fault == "dropout" && pass >= middle && pass < middle + kDropOut) delay_hands(period, frame_.world());
        if (fault == "dropout" && pass == middle + kDropOut) return restore_hands(paths);
        if (recorder_ && pass >= middle && pass < middle + kDropOut) recorder_->constants_changed();
    }
    void restore_hands(const Paths& paths) {
        frame_.world().paths = paths;
        if (recorder_) recorder_->constants_changed();
    }
    const SoakOptions& options_;
    Frame& frame_;
    double seconds_;
    FrameRecorder* recorder_;
    CaptureRecord start_;
    Paths paths_;             // as the scene has them
    bool disturbed_ = false;  // they are not: they stay so for a capture of an episode that broke
};

nlohmann::ordered_json drift_json(const Drift& d) {
    if (!d.known) return nullptr;
    return {{"slope_per_min", d.slope}, {"low", d.low}, {"high", d.high}};
}

std::string soak_json(const Soak& soak, const Drifts& d) {
    double residual = 0, energy = 0, worst = 0;
    std::vector<double> p99;
    for (const Episode& e : soak.episode) {
        residual = std::max(residual, e.residual_mm), worst = std::max(worst, e.worst_ms);
        if (!e.with_fault || e.of_device) energy = std::max(energy, e.energy_share);
        p99.push_back(e.p99_ms);
    }
    return nlohmann::ordered_json{{"scene", soak.scene},
                                  {"version", soak.version},
                                  {"threads", soak.threads},
                                  {"minutes", soak.minutes},
                                  {"minutes_in_passes", soak.pass_minutes},
                                  {"episodes", soak.episodes},
                                  {"passes", soak.passes},
                                  {"sound", soak.broken.empty()},
                                  {"not_judged", not_judged(soak, d)},
                                  {"broken", soak.broken},
                                  {"faults_injected", soak.faults},
                                  {"particles_restored", soak.lost},
                                  {"resident_mib_end", soak.episode.empty() ? 0 : soak.episode.back().resident},
                                  {"heap_mib_end", soak.episode.empty() ? 0 : soak.episode.back().heap},
                                  {"resident_mib", drift_json(d.resident)},
                                  {"heap_mib", drift_json(d.heap)},
                                  {"median_pass_ms", drift_json(d.median)},
                                  {"median_p99_pass_ms", quantile(p99, 0.5)},
                                  {"worst_pass_ms", worst},
                                  {"deepest_residual_mm", residual},
                                  {"worst_energy_share", energy}}
               .dump(2) +
           "\n";
}

std::string soak_csv(const Soak& soak) {
    std::string out =
        "minute,resident_mib,heap_mib,descriptors,median_ms,p99_ms,worst_ms,tick_p99_us,residual_mm,energy_share,lost,passes,with_fault,"
        "state_hash\n";
    for (const Episode& e : soak.episode) {
        out +=
            format("%.4f,%.3f,%.4f,%u,%.4f,%.4f,%.4f,%.3f,%.5f,%.3g,%llu,%llu,%d,%016llx\n", e.minute, e.resident, e.heap, e.descriptors,
                   e.median_ms, e.p99_ms, e.worst_ms, e.tick_p99_us, e.residual_mm, e.energy_share, static_cast<unsigned long long>(e.lost),
                   static_cast<unsigned long long>(e.passes), e.with_fault, static_cast<unsigned long long>(e.hash));
    }
    return out;
}

// What a soak spends time on besides passes.
std::string outside_text(const Soak& soak) {
    const double share = soak.minutes > 0 ? 100 * soak.pass_minutes / soak.minutes : 0;
    return format("%.0f %% of %.2f minutes was spent in passes, the rest in copying states, hashing and judging.", share, soak.minutes);
}

std::string drift_hint(const Soak& soak) {
    return format(" Judging drift needs %zu episodes after the first %.1f minutes, and one took %.3g s: --seconds makes them shorter.",
                  kLeastPoints, std::min(kWarmMinutes, kWarmShare * soak.minutes),
                  60 * soak.minutes / static_cast<double>(std::max<uint64_t>(1, soak.episodes)));
}

std::string open_rules(const Soak& soak, const Drifts& d) {
    std::string text;
    for (const std::string& rule : not_judged(soak, d)) text += (text.empty() ? " Too short to judge " : ", ") + escape_html(rule);
    return (text.empty() ? text : text + ".") + (d.resident.known ? "" : drift_hint(soak));
}

std::string soak_html(const Soak& soak, const Drifts& d) {
    PlotSeries resident{"resident", {}, {}}, heap{"heap", {}, {}}, median{"median", {}, {}}, p99{"p99", {}, {}};
    for (const Episode& e : soak.episode) {
        for (PlotSeries* s : {&resident, &heap, &median, &p99}) s->x.push_back(e.minute);
        resident.y.push_back(e.resident), heap.y.push_back(e.heap), median.y.push_back(e.median_ms), p99.y.push_back(e.p99_ms);
    }
    const auto words = [](const Drift& drift, const char* unit) {
        if (!drift.known) return std::string("unknown (too few episodes)");
        return format("%+.4f %s per minute, 95 %% between %+.4f and %+.4f", drift.slope, unit, drift.low, drift.high);
    };
    return html_page(soak.scene + " soak",
                     "<h1>" + escape_html(soak.scene) + ": " + (soak.broken.empty() ? "sound" : "broken") + "</h1><p>" +
                         escape_html(soak.broken.empty() ? std::to_string(soak.episodes) + " episodes, no rule broken." : soak.broken) +
                         "</p><p>Resident memory " + words(d.resident, "MiB") + "; heap " + words(d.heap, "MiB") + "; median pass " +
                         words(d.median, "ms") + ".</p><p>" + escape_html(outside_text(soak)) + open_rules(soak, d) + "</p>" +
                         svg_plot({"Memory", "minutes", "MiB", {resident, heap}}) +
                         svg_plot({"Time of a contact pass", "minutes", "ms", {median, p99}}));
}

void print_minute(const Soak& soak) {
    const Episode& e = soak.episode.back();
    write_standard_output(format(
        "%6.1f min  %5llu episodes  resident %.1f MiB  heap %.1f MiB  pass median %.2f p99 %.2f ms  residual %.3f mm  energy %.2f %%\n",
        e.minute, static_cast<unsigned long long>(soak.episodes), e.resident, e.heap, e.median_ms, e.p99_ms, e.residual_mm,
        100 * e.energy_share));
}

// `told`: the minute of the last line printed.
void run_soak(const SoakOptions& options, Soaker& soaker, Soak& soak, double& told) {
    const uint64_t start = now_ns();
    const auto minutes = [&] { return static_cast<double>(now_ns() - start) * 1e-9 / 60; };
    Progress progress(soak.scene);
    soak.episode.reserve(kKeptEpisodes + 2);  // reserved, so that our own list does not look like a leak
    uint64_t printed = 0;
    Episode twin;  // with random hands: the episode that the next one repeats
    do {
        Episode e = soaker.run(soak.episodes, soak);
        if (stop_signal() != 0 && !soak.episode.empty()) break;  // the episode is incomplete
        e.minute = minutes();
        ++soak.episodes, soak.passes += e.passes, soak.lost += e.lost, soak.pass_minutes += e.pass_s / 60;
        if (soak.episode.empty() || e.minute >= static_cast<double>(soak.episode.size()) * options.minutes / kKeptEpisodes)
            soak.episode.push_back(e);
        const bool is_second = soak.episodes % 2 == 0 && !twin.with_fault;
        judge_episode(e, options.hands < 0 ? soak.episode.front() : is_second ? twin : e, soak);
        twin = e;
        progress.show(std::min(1.0, e.minute / options.minutes), std::to_string(soak.episodes) + " episodes");
        if (!options.json && static_cast<uint64_t>(e.minute) > printed) {
            printed = static_cast<uint64_t>(e.minute);
            print_minute(soak);
            told = soak.episode.back().minute;
        }
    } while (minutes() < options.minutes && soak.broken.empty() && stop_signal() == 0);
    soak.minutes = minutes();
}

}  // namespace

std::vector<std::string> not_judged(const Soak& soak, const Drifts& drifts) {
    std::vector<std::string> rules;
    if (!drifts.resident.known) rules.emplace_back("drift");
    size_t whole = 0;
    for (const Episode& e : soak.episode) whole += !e.with_fault;
    if (whole < 2) rules.emplace_back("that episodes end the same");
    for (uint64_t i = soak.faults; i < soak.faults_wanted.size(); ++i) rules.push_back("fault " + soak.faults_wanted[i]);
    return rules;
}

void judge_episode(const Episode& e, const Episode& first, Soak& soak) {
    if (!soak.broken.empty() || (e.with_fault && !e.of_device)) return;
    if (e.over_force > 0) {
        soak.broken = format("force: %.3f N more on a hand than its device bears", e.over_force);
    } else if (!e.with_fault && e.hash != first.hash) {
        soak.broken = format("hash: an episode ended in %016llx, the first in %016llx", static_cast<unsigned long long>(e.hash),
                             static_cast<unsigned long long>(first.hash));
    } else if (e.lost > 0) {
        soak.broken = "particles: " + std::to_string(e.lost) + " were lost and restored";
    } else if (e.energy_share > kEnergyShare) {
        soak.broken = format("energy: the balance is off by %.2f %% of the largest energy", 100 * e.energy_share);
    }
}

Drifts measure_drifts(const Soak& soak) {
    const double warm = std::min(kWarmMinutes, kWarmShare * soak.minutes);
    std::vector<double> minute, resident, heap, median;
    for (const Episode& e : soak.episode) {
        if (e.minute < warm) continue;
        minute.push_back(e.minute), resident.push_back(e.resident), heap.push_back(e.heap), median.push_back(e.median_ms);
    }
    return {theil_sen(minute, resident), theil_sen(minute, heap), theil_sen(minute, median)};
}

void judge_drifts(const Drifts& d, Soak& soak) {
    if (!soak.broken.empty() || soak.episode.empty()) return;
    const uint32_t first = soak.episode.front().descriptors, last = soak.episode.back().descriptors;
    if (kMemoryIsOurs && d.resident.low > kMemoryDrift && d.resident.low * soak.minutes > kLeastGrowth)
        soak.broken = format("memory: grows by %.3f MiB a minute (95 %%: %.3f to %.3f)", d.resident.slope, d.resident.low, d.resident.high);
    else if (kMemoryIsOurs && d.heap.low > kHeapDrift && d.heap.low * soak.minutes > kLeastGrowth)
        soak.broken = format("heap: grows by %.3f MiB a minute (95 %%: %.3f to %.3f)", d.heap.slope, d.heap.low, d.heap.high);
    else if (last > first)
        soak.broken = format("descriptors: %u files are open at the end, %u at the start", last, first);
    else if (d.median.low * soak.minutes > kSlower * soak.episode.front().median_ms)
        soak.broken = format("time: the median pass grows by %.4f ms a minute", d.median.slope);
}

namespace {

struct SoakRun {
    Soak soak;
    Drifts drifts;
    double told = -1;  // the minute of the last line printed
};

SoakRun soak_once(const SoakOptions& options, const std::string& name) {
    const SceneFile file = read_scene_file(find_scene(name), options.overrides);
    if (!options.out.empty()) prepare_folder(options.out), prepare_folder(options.out / "captures");
    CommandPool pool(options.threads);
    SoakRun run;
    Soak& soak = run.soak;
    soak.scene = file.settings.name;
    soak.faults_wanted = options.faults;
    soak.version = program_version();
    pool.run([&] {
        soak.threads = thread_count();
        BuiltScene scene = build_scene(file);
        if (std::ranges::any_of(options.faults, is_of_device) &&
            std::ranges::none_of(scene.world.haptics.tool, [](const HandTool& t) { return t.path != kNone; }))
            throw InputError("--faults dropout, jump: no hand of the scene follows a path");
        Frame frame(std::move(scene.world), {});
        std::optional<FrameRecorder> recorder;
        if (!options.out.empty()) {
            CaptureHeader header{soak.scene, program_version(), instruction_set(), machine_text(), "", frame.stage_names(), scene.camera};
            header.wireframe = scene.picture.wireframe, header.depth_colours = scene.picture.depth_colours;
            recorder.emplace(frame, std::move(header), CaptureTriggers{}, options.out / "captures");
        }
        Soaker soaker(options, frame, options.seconds > 0 ? options.seconds : file.settings.seconds, recorder ? &*recorder : nullptr);
        run_soak(options, soaker, soak, run.told);
        run.drifts = measure_drifts(soak);
        judge_drifts(run.drifts, soak);
        if (!soak.broken.empty() && recorder) recorder->write_now("broken " + soak.broken);
    });
    if (!options.out.empty()) {
        write_whole_file(options.out / "soak.json", soak_json(soak, run.drifts));
        write_whole_file(options.out / "soak.csv", soak_csv(soak));
        write_whole_file(options.out / "soak.html", soak_html(soak, run.drifts));
    }
    return run;
}

void print_end(const SoakRun& run) {
    const Soak& soak = run.soak;
    if (soak.episode.back().minute > run.told) print_minute(soak);
    std::string open;
    for (const std::string& rule : not_judged(soak, run.drifts)) open += (open.empty() ? "; too short to judge " : ", ") + rule;
    write_standard_output(outside_text(soak) + (run.drifts.resident.known ? "" : drift_hint(soak)) + "\n");
    write_standard_output(soak.broken.empty() ? "sound: no rule broken" + open + "\n" : "broken: " + soak.broken + "\n");
}

int code_of(const Soak& soak, double minutes) {
    if (!soak.broken.empty()) return kNo;
    if (stop_signal() == 0) return kDone;
    std::fprintf(stderr, "trocar: stopped by %s after %.2f of %.2f minutes\n", name_of_signal(stop_signal()), soak.minutes, minutes);
    return exit_code_of_signal(stop_signal());
}

}  // namespace

namespace {

// One line of nights.csv: what one scene did in one night.
struct NightLine {
    std::string date, version, scene, broken;
    uint64_t episodes = 0;
    double minutes = 0, p99_ms = 0, resident = 0;  // median of the episodes' p99, ms; MiB at the end
};

NightLine night_line(const SoakRun& run, const std::string& date, const std::string& name) {
    NightLine line{date, run.soak.version, name, run.soak.broken, run.soak.episodes, run.soak.minutes, 0, 0};
    std::vector<double> p99;
    for (const Episode& e : run.soak.episode) p99.push_back(e.p99_ms);
    line.p99_ms = quantile(p99, 0.5), line.resident = run.soak.episode.back().resident;
    return line;
}

std::string csv_line(NightLine line) {
    for (char& c : line.broken)
        if (c == ',' || c == '\n' || c == '"') c = ';';
    return format("%s,%s,%s,%llu,%.3f,%.4f,%.2f,%s\n", line.date.c_str(), line.version.c_str(), line.scene.c_str(),
                  static_cast<unsigned long long>(line.episodes), line.minutes, line.p99_ms, line.resident, line.broken.c_str());
}

constexpr const char* kNightHeader = "date,version,scene,episodes,minutes,p99_pass_ms,resident_mib,broken\n";

// Lines of earlier nights; those that are none are left out.
std::vector<NightLine> read_nights(const fs::path& file) {
    std::vector<NightLine> lines;
    std::ifstream in(file);
    for (std::string text; std::getline(in, text);) {
        std::vector<std::string> cell(1);
        for (const char c : text) {
            if (c == ',')
                cell.emplace_back();
            else
                cell.back() += c;
        }
        if (cell.size() != 8 || cell[0] == "date") continue;
        lines.push_back({cell[0], cell[1], cell[2], cell[7], std::strtoull(cell[3].c_str(), nullptr, 10),
                         std::strtod(cell[4].c_str(), nullptr), std::strtod(cell[5].c_str(), nullptr),
                         std::strtod(cell[6].c_str(), nullptr)});
    }
    return lines;
}

std::string night_page(const std::vector<NightLine>& before, const std::vector<NightLine>& now) {
    std::string table =
        "<table><tr><th>scene</th><th>episodes</th><th>minutes</th><th>p99 of a pass, ms</th><th>against the night before</th>"
        "<th>resident, MiB</th><th>against the night before</th><th>verdict</th></tr>";
    std::string plots;
    for (const NightLine& line : now) {
        const auto last = std::find_if(before.rbegin(), before.rend(), [&](const NightLine& b) { return b.scene == line.scene; });
        const auto change = [&](double value, double earlier) {
            return last == before.rend() || !(earlier > 0) ? std::string("-") : format("%+.1f %%", 100 * (value / earlier - 1));
        };
        const bool known = last != before.rend();
        table += "<tr><td>" + escape_html(line.scene) +
                 format("</td><td>%llu</td><td>%.1f</td><td>%.3f</td><td>", static_cast<unsigned long long>(line.episodes), line.minutes,
                        line.p99_ms) +
                 change(line.p99_ms, known ? last->p99_ms : 0) + format("</td><td>%.1f</td><td>", line.resident) +
                 change(line.resident, known ? last->resident : 0) + "</td><td>" +
                 escape_html(line.broken.empty() ? "sound" : line.broken) + "</td></tr>";
        PlotSeries trend{line.scene, {}, {}};
        for (const NightLine& b : before)
            if (b.scene == line.scene) trend.x.push_back(static_cast<double>(trend.x.size())), trend.y.push_back(b.p99_ms);
        trend.x.push_back(static_cast<double>(trend.x.size())), trend.y.push_back(line.p99_ms);
        if (trend.x.size() > 1) plots += svg_plot({line.scene + ": p99 of a pass over nights", "night", "ms", {trend}});
    }
    return html_page("Soak", "<h1>Soak of " + escape_html(now.empty() ? "" : now.front().date) + "</h1>" + table + "</table>" + plots);
}

// Every scene for its share of the time, in a folder of its own, and one report.
int soak_night(const SoakOptions& options) {
    std::vector<NightLine> now;
    const std::vector<NightLine> before = options.out.empty() ? std::vector<NightLine>{} : read_nights(options.out / "nights.csv");
    const std::time_t start = std::time(nullptr);
    std::array<char, 32> date{};
    std::strftime(date.data(), date.size(), "%Y-%m-%dT%H:%M", std::localtime(&start));
    SoakOptions own = options;
    own.minutes = options.minutes / static_cast<double>(options.scenes.size());
    int code = kDone;
    for (const std::string& scene : options.scenes) {
        const std::string name = fs::path(scene).stem().string();
        if (!options.out.empty()) own.out = options.out / name;
        if (!options.json) write_standard_output(name + "\n");
        const SoakRun run = soak_once(own, scene);
        if (!options.json) print_end(run);
        now.push_back(night_line(run, date.data(), name));
        code = std::max(code, code_of(run.soak, own.minutes));
        if (stop_signal() != 0) break;
    }
    std::string table = kNightHeader;
    if (options.json) {
        for (const NightLine& line : now) table += csv_line(line);
        write_standard_output(table);
    }
    if (options.out.empty()) return code;
    table = kNightHeader;
    for (const NightLine& line : before) table += csv_line(line);
    for (const NightLine& line : now) table += csv_line(line);
    write_whole_file(options.out / "nights.csv", table);
    write_whole_file(options.out / "night.html", night_page(before, now));
    return code;
}

}  // namespace

int soak_command(const SoakOptions& options) {
    const StopOnSignal stop;
    if (options.scenes.size() > 1) return soak_night(options);
    const SoakRun run = soak_once(options, options.scenes.front());
    if (options.json)
        write_standard_output(soak_json(run.soak, run.drifts));
    else
        print_end(run);
    return code_of(run.soak, options.minutes);
}

}  // namespace trocar
