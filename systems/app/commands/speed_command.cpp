#include "systems/app/commands/speed_command.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <thread>

#include "content/scene/build_scene.hpp"
#include "content/scene/find_scene.hpp"
#include "engine/jobs/trace.hpp"
#include "systems/app/console/command_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/console/stop_signal.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {
namespace {

struct SpeedRow {
    std::string scene;
    uint32_t threads = 0;
    uint64_t passes = 0, hash = 0;
    double seconds = 0;    // of all passes, in the fastest run
    double simulated = 0;  // s
    bool same = true;      // as with the first number of threads, in every run
};

std::vector<uint32_t> thread_counts(const SpeedOptions& options) {
    if (!options.threads.empty()) return options.threads;
    std::vector<uint32_t> counts;
    const uint32_t cores = std::max(1u, std::thread::hardware_concurrency());
    for (uint32_t n = 1; n < cores; n *= 2) counts.push_back(n);
    counts.push_back(cores);
    return counts;
}

// One run of a scene, with nothing beside it: s that its passes took.
double timed_run(const SceneFile& file, double seconds, SpeedRow& row) {
    BuiltScene scene = build_scene(file, Looks::kPlain);
    FrameOptions frame_options;
    frame_options.pictures = false;
    Frame frame(std::move(scene.world), frame_options);
    const World& w = frame.world();
    uint64_t ns = 0;
    while (static_cast<double>(w.clock.tick) < seconds * 1000 && stop_signal() == 0) {
        const uint64_t begin = now_ns();
        frame.step();
        ns += now_ns() - begin;
    }
    row.passes = w.clock.pass, row.simulated = 1e-3 * static_cast<double>(w.clock.tick), row.hash = state_hash(w);
    return 1e-9 * static_cast<double>(ns);
}

SpeedRow measure_speed(const SpeedOptions& options, const std::string& name, uint32_t threads, const SpeedRow* first) {
    SpeedRow row;
    row.scene = name, row.threads = threads;
    const SceneFile file = read_scene_file(find_scene(name), options.overrides);
    CommandPool pool(threads);
    pool.run([&] {
        for (uint32_t run = 0; run < options.repeat && stop_signal() == 0; ++run) {
            const uint64_t before = first ? first->hash : row.hash;
            const double seconds = timed_run(file, options.seconds, row);
            row.seconds = run == 0 ? seconds : std::min(row.seconds, seconds);
            if (first || run > 0) row.same = row.same && row.hash == before;
        }
    });
    return row;
}

}  // namespace

int speed_command(const SpeedOptions& options) {
    const StopOnSignal stop;
    nlohmann::ordered_json json = nlohmann::ordered_json::array();
    bool same = true;
    if (!options.json)
        write_standard_output(
            format("%-24s %7s %10s %9s %8s  %s\n", "scene", "threads", "passes/s", "real time", "speed-up", "state hash"));
    for (const std::string& name : options.scenes) {
        std::vector<SpeedRow> rows;
        for (const uint32_t threads : thread_counts(options)) {
            rows.push_back(measure_speed(options, name, threads, rows.empty() ? nullptr : &rows.front()));
            if (stop_signal() != 0) return exit_code_of_signal(stop_signal());
            const SpeedRow& row = rows.back();
            same = same && row.same;
            const double rate = static_cast<double>(row.passes) / row.seconds, speed_up = rows.front().seconds / row.seconds;
            if (!options.json)
                write_standard_output(format("%-24s %7u %10.1f %8.2fx %8.2f  %016llx%s\n", name.c_str(), threads, rate,
                                             row.simulated / row.seconds, speed_up, static_cast<unsigned long long>(row.hash),
                                             row.same ? "" : "  differs"));
            json.push_back({{"scene", name},
                            {"threads", threads},
                            {"passes", row.passes},
                            {"passes_per_s", rate},
                            {"real_time", row.simulated / row.seconds},
                            {"speed_up", speed_up},
                            {"state_hash", hex(row.hash)},
                            {"same", row.same}});
        }
    }
    if (options.json) write_standard_output(json.dump(2) + "\n");
    return same ? kDone : kNo;
}

}  // namespace trocar
