// Two builds of the program on the same scenes, in turn: which stage costs more than before?
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "bench/suites.hpp"
#include "bench/table.hpp"
#include "engine/base/error.hpp"
#include "engine/files/child_process.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/station/exercise_file.hpp"
namespace trocar::bench {
namespace {
namespace fs = std::filesystem;

constexpr double kMostGrowth = 1.05;  // of a stage at the same error
constexpr double kLeastShare = 0.02;  // of a scene's time: cheaper stages are only counted in its sum

struct Options {
    fs::path program, against;
    std::vector<std::string> scenes = {"kidney_on_liver", "probe_on_liver", "field"};
    std::string seconds = "1";
    int repeat = 5;
};

const char* kUsage =
    "usage: trocar_bench scenes --against PROGRAM [--program PROGRAM] [--scenes A,B,...] [--seconds S] [--repeat N] [--quick] [--json FILE]\n"
    "  Runs scenes with another build of trocar and with this one (the one beside trocar_bench) in turn, on one thread, and compares\n"
    "  every stage: the sum over the passes of the least time of any repetition. Default scenes: kidney_on_liver, probe_on_liver, field;\n"
    "  --quick: 3 repetitions instead of 5. Exit code 1 when a stage with 2 % or more of the time takes 5 % more.\n";

// One program on one scene: the least time of every pass in every stage, and the figures of its last run.
struct Course {
    std::map<std::string, std::vector<double>> stage;  // ms per pass
    nlohmann::json figures;
};

std::vector<std::string> split(const std::string& list) {
    std::vector<std::string> parts(1);
    for (const char c : list) c == ',' ? parts.emplace_back() : (parts.back() += c, parts.back());
    return parts;
}

fs::path beside_this() { return fs::read_symlink("/proc/self/exe").parent_path().parent_path() / "trocar"; }

Options read_options(int argc, char** argv) {
    Options o;
    o.program = beside_this();
    for (int i = 1; i < argc; ++i) {
        const std::string key = argv[i];
        if (i + 1 == argc) throw InputError(key + " needs a value\n" + kUsage);
        const std::string value = argv[++i];
        if (key == "--against")
            o.against = value;
        else if (key == "--program")
            o.program = value;
        else if (key == "--scenes")
            o.scenes = split(value);
        else if (key == "--seconds")
            o.seconds = value;
        else if (key == "--repeat")
            o.repeat = std::max(1, std::atoi(value.c_str()));
        else
            throw InputError("scenes has no option \"" + key + "\"\n" + kUsage);
    }
    if (o.against.empty()) throw InputError(std::string("--against is missing\n") + kUsage);
    for (const fs::path& p : {o.program, o.against})
        if (!fs::exists(p)) throw InputError(p.string() + ": no such program");
    return o;
}

// A run that ends with 1 has bad physics, which both builds may have: its times count.
void run_once(const fs::path& program, const std::string& scene, const Options& o, const fs::path& folder, Course& course) {
    fs::remove_all(folder);
    const std::vector<std::string> command = {fs::absolute(program).string(), "run",       scene,           "--seconds", o.seconds,
                                              "--no-render",                  "--no-player", "--no-exercise", "--threads", "1",
                                              "--out",                        folder.string()};
    const ChildLimits limits{.wall_seconds = 3600};
    const ChildResult done = run_child(command, limits);
    if (done.end != ChildEnd::kExited || done.exit_code > 1)
        throw InputError(program.string() + " run " + scene + " " + describe_child_end(done, limits));
    const CsvTable table = read_csv(folder / "stages.csv");
    for (size_t c = table.find("time_s") + 1; c < table.column.size(); ++c) {
        std::vector<double>& least = course.stage[table.column[c]];
        if (least.empty()) least.assign(table.row.size(), std::numeric_limits<double>::infinity());
        if (least.size() != table.row.size())
            throw InputError(scene + ": two runs of " + program.string() + " have different numbers of passes");
        for (size_t pass = 0; pass < least.size(); ++pass) least[pass] = std::min(least[pass], table.number(pass, c));
    }
    course.figures = nlohmann::json::parse(std::ifstream(folder / "metrics.json"));
}

double sum(const std::vector<double>& v) {
    double total = 0;
    for (const double x : v) total += x;
    return total;
}
double sum_of(const Course& c, const std::string& stage) {
    const auto found = c.stage.find(stage);
    return found == c.stage.end() ? 0 : sum(found->second);
}
double sum_of(const Course& c) {
    double total = 0;
    for (const auto& [name, passes] : c.stage) total += sum(passes);
    return total;
}

void compare(const std::string& scene, const Course& then, const Course& now, Report& report) {
    const bool same = then.figures["state_hash"] == now.figures["state_hash"];
    const auto left = [](const Course& c) { return 1e3 * c.figures["contact"].value("left_m", 0.0); };
    const auto add = [&](const std::string& name, double ours, double theirs) {
        report.add({.name = scene + ": " + name,
                    .ours = ours,
                    .unit = "ms",
                    .peer = "before",
                    .peer_value = theirs,
                    .error = left(now),
                    .peer_error = left(then),
                    .error_unit = "mm left",
                    .goal = Goal::kPeerShare,
                    .at_least = kMostGrowth,
                    .aim = 1,
                    .not_judged = theirs > 0 ? crowded() : "is new",
                    .note = same ? "same bits" : "another hash"});
    };
    add("all stages", sum_of(now), sum_of(then));
    const double all = sum_of(then);
    for (const auto& [name, passes] : now.stage) {
        const double ours = sum(passes), theirs = sum_of(then, name);
        if (std::max(ours, theirs) >= kLeastShare * all) add(name.substr(0, name.rfind("_ms")), ours, theirs);
    }
}

}  // namespace
}  // namespace trocar::bench

int scenes_suite(int argc, char** argv) {
    using namespace trocar::bench;
    Report report("scenes", argc, argv);
    Options options = read_options(argc, argv);
    if (report.quick()) options.repeat = std::min(options.repeat, 3);
    const std::filesystem::path folder = std::filesystem::temp_directory_path() / ("trocar_scenes_" + std::to_string(getpid()));
    for (const std::string& scene : options.scenes) {
        report.heading(scene);
        Course then, now;
        for (int i = 0; i < options.repeat; ++i) {
            run_once(options.against, scene, options, folder, then);
            run_once(options.program, scene, options, folder, now);
        }
        compare(scene, then, now, report);
    }
    std::filesystem::remove_all(folder);
    return report.finish();
}
