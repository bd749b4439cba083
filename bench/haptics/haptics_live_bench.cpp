#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <thread>

#include "bench/haptics/haptics.hpp"
#include "content/scene/build_scene.hpp"
#include "content/scene/find_scene.hpp"
#include "content/scene/scene_file.hpp"
#include "engine/devices/device.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/surfaces.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/run/live_run.hpp"
#include "systems/haptics/tick.hpp"
#include "systems/haptics/tool.hpp"
#include "tests/reference/poked_tissue.hpp"
namespace trocar::bench {
namespace {

World probe_scene(const char* triangles) {
    const std::vector<Override> overrides = {{"liver.triangles", triangles}};
    return build_scene(read_scene_file(find_scene("probe_on_liver"), overrides)).world;
}

// Error of a surface near a tool that its model extrapolates until the next pass, or holds still.
class SurfaceAhead {
 public:
    void on_pass(const World& world, const LocalContactModel& model, const Vec3d& tip) {
        constexpr double kNear = 0.012;  // m
        const Surfaces surfaces = surfaces_of(world);
        for (const Told& t : told_) {
            const Vec3d now = vertex_position(surfaces, t.body, t.vertex);
            off2_ += (now - t.ahead).squaredNorm(), held2_ += (now - t.was).squaredNorm(), ++count_;
        }
        told_.clear();
        for (uint32_t body = 0; body < world.bodies.mesh.size(); ++body) {
            if (!is_deformable(world.bodies, body)) continue;
            std::map<std::array<double, 3>, uint32_t> vertex_at;
            for (uint32_t v = 0; v < world.meshes.info[world.bodies.mesh[body]].vertices.count; ++v)
                if (const Vec3d p = vertex_position(surfaces, body, v); (p - tip).norm() < kNear) vertex_at[{p.x(), p.y(), p.z()}] = v;
            for (size_t row = 0; row < model.position.size(); ++row) {
                const Vec3d& p = model.position[row];
                if (const auto at = vertex_at.find({p.x(), p.y(), p.z()}); at != vertex_at.end())
                    told_.push_back({body, at->second, p + 1e-3 * world.clock.period * model.velocity[row], p});
            }
        }
    }
    double rms() const { return std::sqrt(off2_ / static_cast<double>(count_)); }
    double rms_held() const { return std::sqrt(held2_ / static_cast<double>(count_)); }

 private:
    struct Told {
        uint32_t body, vertex;
        Vec3d ahead, was;
    };
    std::vector<Told> told_;
    double off2_ = 0, held2_ = 0;
    uint64_t count_ = 0;
};

// Times the first tool's ticks on each published surface, until the next one; as in live ticks, the surface
// is prepared after the preceding tick.
struct TickTimer {
    HapticParams params;
    HandTool tool;
    Device device;
    HapticScratch scratch;
    ToolState state;
    size_t triangles = 0;  // most in one model
    uint64_t tick = 0;
    std::vector<TickCost>* cost = nullptr;
    std::vector<TickCost>* ready = nullptr;  // per pass: time to prepare its surface
    SurfaceAhead ahead;

    void on_pass(World& world) {
        const LocalContactModel& model = world.local_contact[0];
        triangles = std::max(triangles, model.triangle.size());
        ahead.on_pass(world, model, state.device.position);
        const double begin = thread_seconds();
        rehearse_tick(params, model, tool, state, scratch);
        note_tick(world.clock.pass, thread_seconds() - begin, state.contacts > 0, *ready);
        for (const uint64_t end = world.clock.tick + world.clock.period; tick < end; ++tick) {
            const double time = static_cast<double>(tick) * 1e-3;
            const DeviceState sample = read_device(device, time);
            const double start = thread_seconds();
            tick_tool(params, model, time, tool, {}, sample, scratch, state);
            note_tick(tick, thread_seconds() - start, state.contacts > 0, *cost);
        }
    }
};

// Load that never yields the processor to the simulation, one thread per core, at its own priority.
class Burners {
 public:
    Burners() {
        for (uint32_t k = 0; k < std::max(1u, std::thread::hardware_concurrency()); ++k)
            thread_.emplace_back([this] {
                volatile double x = 1;
                while (!stop_.load(std::memory_order_relaxed)) x = x * 1.0000001 + 1e-9;
            });
    }
    ~Burners() {
        stop_ = true;
        for (std::thread& t : thread_) t.join();
    }

 private:
    std::atomic<bool> stop_{false};
    std::vector<std::thread> thread_;
};

// Total time (s) since boot that the hypervisor has taken from the machine's processors (steal): the eighth
// number of the first line of /proc/stat, in hundredths. 0 if not reported.
double stolen_seconds() {
    std::ifstream file("/proc/stat");
    std::string word;
    double value = 0;
    file >> word;
    for (int k = 0; k < 8; ++k) file >> value;
    return file ? value / static_cast<double>(sysconf(_SC_CLK_TCK)) : 0;
}

struct LiveFiguresAt {
    RunFigures run;
    PeriodicFigures idle;
    double stolen = 0;    // s of processor time
    double stage_ms = 0;  // p99 from the start of a pass until its surface is published
};

// A live run of the probe scene with both cores busy, and an idle thread of the same period for comparison.
LiveFiguresAt live_run(uint32_t contact_rate, double seconds) {
    LiveFiguresAt result;
    ThreadPool pool(std::max(1u, std::thread::hardware_concurrency() - 1));
    pool.run([&] {
        World world = probe_scene("10000");
        world.clock.contact_rate = contact_rate;
        FrameOptions options;
        options.external_ticks = true;
        Frame frame(std::move(world), options);
        for (const std::string& name : frame.stage_names()) result.run.stage.push_back({name, {}});
        const double stolen = stolen_seconds();
        const Burners load;
        PeriodicThread idle;
        idle.start({}, monotonic_ns() + 20'000'000, [](uint64_t, int64_t) {});
        run_live({{}, seconds, frame, nullptr, nullptr, result.run}, nullptr);
        idle.stop();
        result.run.report = frame.world().report;
        result.stolen = stolen_seconds() - stolen;
        result.idle = idle.figures();
    });
    std::vector<double> frame_ms;
    for (const PassFigures& pass : result.run.pass) frame_ms.push_back(pass.frame_ms);
    result.stage_ms = quantile(frame_ms, 0.99);
    return result;
}

Row limited(std::string name, double ours, std::string unit, double at_least, double aim) {
    Row row;
    row.name = std::move(name), row.ours = ours, row.unit = std::move(unit);
    row.goal = Goal::kLimit, row.at_least = at_least, row.aim = aim;
    return row;
}

}  // namespace

int tick_runs(const Report& report) { return report.quick() ? 3 : 5; }

void note_tick(uint64_t tick, double seconds, bool touches, std::vector<TickCost>& cost) {
    if (cost.size() <= tick) cost.resize(tick + 1);
    cost[tick].seconds = std::min(cost[tick].seconds, seconds);
    cost[tick].touches = touches;
}

std::vector<double> touching_us(const std::vector<TickCost>& cost) {
    std::vector<double> us;
    for (const TickCost& tick : cost)
        if (tick.touches) us.push_back(1e6 * tick.seconds);
    return us;
}

void tick_rows(Report& report) {
    report.heading("Compute time of a 3-DOF tick on a deforming liver of 100,000 triangles (time of the thread)");
    ThreadPool pool(0);
    std::vector<TickCost> cost, ready;
    size_t triangles = 0;
    SurfaceAhead ahead;  // of one of the runs, which are identical
    const int runs = tick_runs(report);
    for (int run = 0; run < runs; ++run) {
        TickTimer timer;
        timer.cost = &cost, timer.ready = &ready;
        pool.run([&] {
            Frame frame(probe_scene("100000"), {});
            const World& w = frame.world();
            timer.params = haptic_params(w.clock.contact_rate);
            timer.tool = w.haptics.tool[0];
            timer.device = device_of(w.haptics, w.paths, timer.tool);
            frame.set_contact_hook({[](void* user, World& world) { static_cast<TickTimer*>(user)->on_pass(world); }, &timer});
            while (static_cast<double>(w.clock.tick) < (report.quick() ? 1200 : 4000)) frame.step();
        });
        triangles = std::max(triangles, timer.triangles);
        ahead = timer.ahead;
    }
    const std::vector<double> us = touching_us(cost);
    char note[160];
    std::snprintf(
        note, sizeof note,
        "minimum of %d identical runs per tick; %zu triangles in reach at most, median %.1f us, largest %.1f us, %zu ticks in contact",
        runs, triangles, quantile(us, 0.5), quantile(us, 1), us.size());
    Row row = limited("tick in contact, p99.9", quantile(us, 0.999), "us", 50, 20);
    row.note = note;
    report.add(row);
    Row rehearsal;
    rehearsal.name = "making a new surface ready, after the force of a tick is out, p99",
    rehearsal.ours = quantile(touching_us(ready), 0.99), rehearsal.unit = "us";
    report.add(rehearsal);
    Row surface;
    surface.name = "surface under the tip a pass ahead, RMS error", surface.ours = 1e3 * ahead.rms(), surface.unit = "mm";
    std::snprintf(note, sizeof note, "within 12 mm of the device; held still it is %.4g mm off", 1e3 * ahead.rms_held());
    surface.note = note;
    report.add(surface);
}

void poke_rows(Report& report) {
    if (report.quick()) return;
    constexpr double kSeconds = 600;
    report.heading(
        "Energy of an arm of 0.2 kg and 300 N/m poking a liver of 10,000 triangles for ten simulated minutes, by forces told to the "
        "device");
    World world = probe_scene("10000");
    reference::poke_at(world, 0, kSeconds, 2);
    const reference::PokeEnergy e = reference::poke_energy(std::move(world), kSeconds);
    char note[160];
    std::snprintf(note, sizeof note,
                  "%u pokes, largest force %.2f N, the hand gave %.2f J in all; the device's observer booked %.4f mJ at least", e.pokes,
                  e.largest, e.given, 1e3 * e.observer);
    report.add(limited("energy got back beyond what was given, since the start", -1e3 * e.least, "mJ", 1, 0.1));
    Row poke = limited("the same since a poke began, the worst of all pokes", -1e3 * e.least_poke, "mJ", 1, 0.1);
    poke.note = note;
    report.add(poke);
}

void live_rows(Report& report) {
    report.heading("Live, simulation and a burning thread a core beside the tick");
    const double seconds = report.quick() ? 4 : 60;
    for (const uint32_t rate : {60u, 30u, 120u}) {
        const LiveFiguresAt live = live_run(rate, seconds);
        const std::vector<double>& period = live.run.tick_period_us;
        const bool fifo = live.run.scheduling.find("SCHED_FIFO") == 0;
        const std::string unjudged = fifo ? "" : "no SCHED_FIFO here";
        const double idle99 = static_cast<double>(live.idle.period.percentile(0.99)) * 1e-6;
        const double idle999 = static_cast<double>(live.idle.period.percentile(0.999)) * 1e-6;
        if (rate == 60) {
            Row p99 = limited("tick period p99", quantile(period, 0.99) * 1e-3, "ms", 1.1, 1.05);
            p99.peer = "an idle thread of the same run", p99.peer_value = idle99, p99.not_judged = unjudged;
            p99.note = live.run.scheduling;
            report.add(p99);
            Row p999 = limited("tick period p99.9", quantile(period, 0.999) * 1e-3, "ms", 1.5, 1.1);
            p999.peer = "an idle thread of the same run", p999.peer_value = idle999, p999.not_judged = unjudged;
            report.add(p999);
            Row above =
                limited("tick periods above 2 ms, a minute", static_cast<double>(live.run.doubled_periods) * 60 / seconds, "", 5, 0);
            above.peer = "an idle thread of the same run", above.not_judged = unjudged;
            above.peer_value = static_cast<double>(live.idle.doubled) * 60 / seconds;
            char missed[160];
            std::snprintf(missed, sizeof missed,
                          "longest %.2f ms (idle: %.2f), single deadlines missed %.3g a minute (idle: %.3g); the host took %.0f ms of each "
                          "processor a minute",
                          quantile(period, 1) * 1e-3, static_cast<double>(live.idle.period.largest) * 1e-6,
                          static_cast<double>(live.run.missed_ticks) * 60 / seconds, static_cast<double>(live.idle.missed) * 60 / seconds,
                          1e3 * live.stolen / std::max(1u, std::thread::hardware_concurrency()) * 60 / seconds);
            above.note = missed;
            report.add(above);
        }
        const double allowed = 1000.0 / rate + std::min(live.stage_ms, 1000.0 / rate) + 1;  // a longer stage stays late
        char name[96], note[96];
        std::snprintf(name, sizeof name, "age of the surface under the force at %u Hz, p99", rate);
        std::snprintf(note, sizeof note, "limit: period + pass p99 %.1f ms + 1 ms; %llu passes late of %zu", live.stage_ms,
                      static_cast<unsigned long long>(live.run.report.late_passes), live.run.pass.size());
        Row age = limited(name, quantile(live.run.contact_age_ms, 0.99), "ms", allowed, allowed);
        age.note = note, age.not_judged = unjudged;
        report.add(age);
    }
}

}  // namespace trocar::bench
