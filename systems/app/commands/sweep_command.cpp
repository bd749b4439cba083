#include <algorithm>
#include <atomic>
#include <cstdio>
#include <exception>
#include <fstream>
#include <iterator>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "content/scene/find_scene.hpp"
#include "content/scene/sweep_file.hpp"
#include "engine/base/error.hpp"
#include "engine/files/child_process.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/files/whole_file.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/progress.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/app/console/stop_signal.hpp"
#include "systems/app/pictures/picture_writer.hpp"
namespace trocar {
namespace fs = std::filesystem;
namespace {

// One run of a sweep, in a folder of its own.
struct Job {
    std::vector<std::string> values;  // per axis
    uint32_t repetition = 0;
    std::vector<std::string> arguments;  // arguments[0] is this program
    fs::path folder;
};

std::string read_text(const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

std::string quoted(const std::string& word) {
    std::string out = "'";
    for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return out + "'";
}
std::string command_line(const Job& job) {
    std::string line;
    for (const std::string& a : job.arguments) line += (line.empty() ? "" : " ") + quoted(a);
    return line;
}

// Done means that this exact command ended successfully: an interrupted run also leaves metrics.
bool is_done(const Job& job) {
    return read_text(job.folder / "command") == command_line(job) && read_text(job.folder / "exit") == "0\n" &&
           fs::exists(job.folder / "metrics.json");
}

// Runs are named by their values, so that results stay valid when values are added; repetitions are numbered.
std::string name_of_run(const SweepFile& sweep, const std::vector<std::string>& values, uint32_t repetition) {
    StateHash hash;
    for (size_t a = 0; a < values.size(); ++a) {
        const std::string line = sweep.axes[a].key + "=" + values[a] + "\n";
        hash.add_bytes(reinterpret_cast<const std::byte*>(line.data()), line.size());
    }
    return hex(hash.value) + (repetition > 0 ? "_" + std::to_string(repetition) : "");
}

// All combinations once, then all again: if the machine slows down, each is affected equally.
std::vector<Job> expand(const SweepFile& sweep, const fs::path& out) {
    std::error_code error;
    const std::string program = fs::read_symlink("/proc/self/exe", error).string();
    std::vector<Job> jobs;
    const std::vector<std::vector<std::string>> all = combinations(sweep);
    for (size_t i = 0; i < sweep.repeat * all.size(); ++i) {
        const auto& values = all[i % all.size()];
        const auto repetition = static_cast<uint32_t>(i / all.size());
        Job job{values, repetition, {}, fs::absolute(out / "runs" / name_of_run(sweep, values, repetition))};
        std::string scene = sweep.scene;
        for (size_t a = 0; a < values.size(); ++a)
            if (sweep.axes[a].key == "scene") scene = values[a];
        if (const fs::path beside = sweep.path.parent_path() / scene; scene.ends_with(".toml") && fs::exists(beside, error))
            scene = beside.string();
        job.arguments = {program,
                         "run",
                         fs::absolute(find_scene(scene)).string(),
                         "--figures-only",
                         "--threads",
                         std::to_string(sweep.threads),
                         "--out",
                         job.folder.string()};
        if (sweep.seconds > 0) job.arguments.insert(job.arguments.end(), {"--seconds", std::to_string(sweep.seconds)});
        const auto set = [&](const std::string& key, const std::string& value) {
            job.arguments.insert(job.arguments.end(), {"--set", key + "=" + value});
        };
        for (const Override& o : sweep.fixed) set(o.key, o.value);
        for (size_t a = 0; a < values.size(); ++a)
            if (sweep.axes[a].key != "scene") set(sweep.axes[a].key, values[a]);
        jobs.push_back(std::move(job));
    }
    return jobs;
}

// Reads every scene before anything runs, so that a wrong key is reported at once, not in a thousand logs.
void check_jobs(const SweepFile& sweep, const std::vector<Job>& jobs) {
    for (const Job& job : jobs) {
        if (job.repetition > 0) return;
        std::vector<Override> overrides = sweep.fixed;
        for (size_t a = 0; a < job.values.size(); ++a)
            if (sweep.axes[a].key != "scene") overrides.push_back({sweep.axes[a].key, job.values[a]});
        read_scene_file(job.arguments[2], overrides);
    }
}

// Shell command of one job: skips it if done, else runs it, logs the output and returns its exit code.
std::string shell_line(const Job& job) {
    const std::string folder = quoted(job.folder.string());
    return "test \"$(cat " + folder + "/exit 2>/dev/null)\" = 0 || { " + command_line(job) + " > " + folder +
           "/log 2>&1; code=$?; echo $code > " + folder + "/exit; (exit $code); }";
}

// Creates folders, commands, and the list of lines for all engines. Deletes results of other commands.
void prepare(const fs::path& out, const std::vector<Job>& jobs) {
    prepare_folder(out);
    std::string lines;
    for (const Job& job : jobs) {
        if (!is_done(job)) {
            std::error_code error;
            fs::remove_all(job.folder, error);
            prepare_folder(job.folder);
            write_whole_file(job.folder / "command", command_line(job));
        }
        lines += shell_line(job) + "\n";
    }
    write_whole_file(out / "runs.txt", lines);
}

constexpr ChildLimits kUntilStopped{.stop = [] { return stop_signal() != 0; }};

void run_here(const std::vector<Job>& jobs, uint32_t at_once) {
    std::atomic<size_t> next{0}, done{0};
    std::mutex lock;
    std::exception_ptr failure;  // no process or pipe available
    Progress progress("sweep");
    const auto work = [&] {
        for (size_t i = next++; i < jobs.size() && stop_signal() == 0; i = next++) {
            try {
                if (!is_done(jobs[i]))
                    static_cast<void>(run_child({"/bin/sh", "-c", shell_line(jobs[i])}, kUntilStopped));  // result: in the folder
            } catch (...) {
                const std::lock_guard guard(lock);
                failure = std::current_exception();
                return;
            }
            const std::lock_guard guard(lock);
            progress.show(static_cast<double>(++done) / static_cast<double>(jobs.size()),
                          std::to_string(done) + " of " + std::to_string(jobs.size()) + " runs");
        }
    };
    std::vector<std::thread> threads;
    for (uint32_t t = 0; t < at_once; ++t) threads.emplace_back(work);
    for (std::thread& thread : threads) thread.join();
    if (failure) std::rethrow_exception(failure);
}

void run_by_parallel(const fs::path& out, uint32_t at_once) {
    const std::string parallel = find_on_path("parallel");
    if (parallel.empty()) throw InputError("--engine parallel: GNU parallel is not installed (apt-get install parallel)");
    const ChildResult result = run_child({"/bin/sh", "-c",
                                          "exec " + quoted(parallel) + " --will-cite --jobs " + std::to_string(at_once) + " --joblog " +
                                              quoted((out / "joblog").string()) + " < " + quoted((out / "runs.txt").string())},
                                         kUntilStopped);
    if (result.end != ChildEnd::kExited && result.end != ChildEnd::kStopped) throw InputError("parallel " + describe_child_end(result, {}));
}

// "0,3-5": the tasks with unfinished jobs. Task k of `tasks` executes lines k + 1, k + 1 + tasks, ...
std::string tasks_left(const std::vector<Job>& jobs, size_t tasks) {
    std::vector<bool> left(tasks, false);
    for (size_t i = 0; i < jobs.size(); ++i)
        if (!is_done(jobs[i])) left[i % tasks] = true;
    std::string list;
    for (size_t first = 0; first < tasks; ++first) {
        if (!left[first]) continue;
        size_t last = first;
        while (last + 1 < tasks && left[last + 1]) ++last;
        list += (list.empty() ? "" : ",") + std::to_string(first) + (last > first ? "-" + std::to_string(last) : "");
        first = last;
    }
    return list;
}

// An array job with `at_once` concurrent tasks, 0 = no limit. By default Slurm accepts up to 1,000 array
// tasks (MaxArraySize, slurm.conf(5)). The list of runs is not rewritten: an earlier array may be reading it.
std::string slurm_script(const SweepFile& sweep, const fs::path& out, const std::vector<Job>& jobs, uint32_t at_once) {
    const size_t tasks = std::min<size_t>(jobs.size(), 1000);
    const std::string throttle = at_once > 0 ? "%" + std::to_string(at_once) : "";
    std::string script = "#!/bin/sh\n";
    script += "#SBATCH --job-name=" + sweep.name + "\n";
    script += "#SBATCH --array=" + tasks_left(jobs, tasks) + throttle + "\n";
    script += "#SBATCH --ntasks=1\n";
    script += "#SBATCH --cpus-per-task=" + std::to_string(sweep.threads) + "\n";
    script += "#SBATCH --output=/dev/null\n";
    script += "line=$((SLURM_ARRAY_TASK_ID + 1)) code=0\n";
    script += "while [ $line -le " + std::to_string(jobs.size()) + " ]; do\n";
    script += "  run=$(sed -n \"${line}p\" " + quoted(fs::absolute(out).string() + "/runs.txt") + ")\n";
    script += "  eval \"$run\" || code=1\n";
    script += "  line=$((line + " + std::to_string(tasks) + "))\n";
    return script + "done\nexit $code\n";
}

void run_by_slurm(const SweepFile& sweep, const fs::path& out, const std::vector<Job>& jobs, uint32_t at_once) {
    if (std::all_of(jobs.begin(), jobs.end(), is_done)) return;
    const fs::path script = fs::absolute(out / "sweep.sbatch");
    write_whole_file(script, slurm_script(sweep, out, jobs, at_once));
    const std::string sbatch = find_on_path("sbatch");
    if (sbatch.empty())
        throw InputError("--engine slurm: sbatch is not installed; submit " + script.string() +
                         " on a cluster, then run this command again with --engine merge");
    const ChildResult result = run_child({sbatch, "--wait", script.string()}, kUntilStopped);
    if (result.end == ChildEnd::kStopped) return;  // the array continues without us
    if (result.end != ChildEnd::kExited) throw InputError("sbatch " + describe_child_end(result, {}));
    // --wait returns the highest exit code of the tasks; the table shows which failed
    if (result.output.find("Submitted") == std::string::npos) throw InputError("sbatch: " + last_error_line(result));
}

// The value at "a.b.c"; null if there is none.
nlohmann::ordered_json at_path(const nlohmann::ordered_json& root, const std::string& path) {
    const nlohmann::ordered_json* node = &root;
    std::istringstream words(path);
    for (std::string word; std::getline(words, word, '.');) {
        if (!node->is_object() || !node->contains(word)) return nullptr;
        node = &(*node)[word];
    }
    return *node;
}

// Warns of columns that no run has although some run finished: most likely a misspelling.
void warn_of_unknown(const std::vector<std::string>& columns, const nlohmann::ordered_json& rows) {
    const auto is_done = [](const nlohmann::ordered_json& row) { return row["failed"].is_null(); };
    if (std::none_of(rows.begin(), rows.end(), is_done)) return;
    for (const std::string& column : columns) {
        const auto has = [&](const nlohmann::ordered_json& row) { return !row[column].is_null(); };
        if (std::none_of(rows.begin(), rows.end(), has))
            std::fprintf(stderr, "trocar: warning: column \"%s\": no metrics.json contains it\n", column.c_str());
    }
}

// Writes sweep.csv and sweep.json from the finished runs. Returns the number of unfinished ones.
size_t merge(const SweepFile& sweep, const fs::path& out, const std::vector<Job>& jobs) {
    size_t missing = 0;
    nlohmann::ordered_json rows = nlohmann::ordered_json::array();
    std::string csv = "run";
    for (const SweepAxis& axis : sweep.axes) csv += "," + csv_field(axis.key);
    if (sweep.repeat > 1) csv += ",repeat";
    for (const std::string& column : sweep.columns) csv += "," + csv_field(column);
    csv += ",failed\n";
    for (const Job& job : jobs) {
        nlohmann::ordered_json row = {{"run", job.folder.filename().string()}};
        csv += job.folder.filename().string();
        for (size_t a = 0; a < job.values.size(); ++a) row[sweep.axes[a].key] = job.values[a], csv += "," + csv_field(job.values[a]);
        if (sweep.repeat > 1) row["repeat"] = job.repetition, csv += "," + std::to_string(job.repetition);
        const nlohmann::ordered_json metrics =
            is_done(job) ? nlohmann::ordered_json::parse(read_text(job.folder / "metrics.json"), nullptr, false) : nlohmann::ordered_json();
        std::string failed;
        if (!metrics.is_object()) {
            ++missing;
            failed = read_text(job.folder / "log");
            failed = failed.empty() ? "did not run" : failed.substr(0, failed.find('\n'));
        }
        for (const std::string& column : sweep.columns) {
            const nlohmann::ordered_json value = at_path(metrics, column);
            row[column] = value;
            csv += "," + (value.is_null() ? "" : csv_field(value.is_string() ? value.get<std::string>() : value.dump()));
        }
        row["failed"] = failed.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(failed);
        csv += "," + csv_field(failed) + "\n";
        rows.push_back(row);
    }
    warn_of_unknown(sweep.columns, rows);
    write_whole_file(out / "sweep.csv", csv);
    write_whole_file(out / "sweep.json", nlohmann::ordered_json{{"sweep", sweep.name}, {"runs", rows}}.dump(1) + "\n");
    return missing;
}

}  // namespace

int sweep_command(const SweepOptions& options) {
    const SweepFile sweep = read_sweep_file(options.file);
    const fs::path out = options.out.empty() ? fs::path("out") / ("sweep_" + sweep.name) : options.out;
    const std::vector<Job> jobs = expand(sweep, out);
    check_jobs(sweep, jobs);
    if (options.dry_run) {
        std::string text;
        for (const Job& job : jobs) text += command_line(job) + "\n";
        write_standard_output(text);
        return kDone;
    }
    const uint32_t cores = std::max(1u, std::thread::hardware_concurrency());
    const uint32_t at_once = options.jobs > 0 ? options.jobs : std::max(1u, cores / sweep.threads);
    const StopOnSignal stop;
    if (options.engine != "merge") prepare(out, jobs);  // which also deletes results of unfinished runs
    const auto done = static_cast<size_t>(std::count_if(jobs.begin(), jobs.end(), is_done));
    if (options.engine == "parallel")
        run_by_parallel(out, at_once);
    else if (options.engine == "slurm")
        run_by_slurm(sweep, out, jobs, options.jobs);
    else if (options.engine == "local")
        run_here(jobs, at_once);
    const size_t missing = merge(sweep, out, jobs);
    const std::string text =
        format("%s: %zu runs, %zu were there, %zu failed or missing; table in ", sweep.name.c_str(), jobs.size(), done, missing);
    write_standard_output(options.json ? read_text(out / "sweep.json") : text + (out / "sweep.csv").string() + "\n");
    if (stop_signal() == 0) return missing == 0 ? kDone : kNo;
    std::fprintf(stderr, "trocar: stopped by %s; the same command continues from here\n", name_of_signal(stop_signal()));
    return exit_code_of_signal(stop_signal());
}

}  // namespace trocar
