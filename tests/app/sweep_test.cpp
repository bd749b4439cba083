#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "content/scene/sweep_file.hpp"
#include "engine/base/error.hpp"
#include "tests/app/run_program.hpp"

namespace trocar {
namespace {
namespace fs = std::filesystem;

fs::path fresh_folder(const std::string& name) {
    const fs::path folder = fs::path(testing::TempDir()) / ("sweep_" + name);
    fs::remove_all(folder);
    fs::create_directories(folder);
    return folder;
}
fs::path write(const fs::path& file, const std::string& text) {
    std::ofstream(file) << text;
    return file;
}
std::string text_of(const fs::path& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
}

const std::string kScene =
    "seconds = 0.1\n[parameters]\nheight = 0.1\n[[body]]\nname = \"ball\"\nshape = \"sphere\"\ntriangles = 80\nsize = 0.05\nmotion = "
    "\"free\"\nposition = [0.0, 0.0, \"$height\"]\n";
const std::string kSweep =
    "name = \"drop\"\nscene = \"ball.toml\"\ncolumns = [\"simulated_s\", \"energy.kinetic_j\", \"state_hash\"]\n[vary]\nheight = [0.1, "
    "0.2]\ngravity = [[0.0, 0.0, -9.81], [0.0, 0.0, 0.0]]\n";

TEST(SweepFile, EveryCombinationOnceInOrder) {
    const fs::path folder = fresh_folder("file");
    const SweepFile sweep =
        read_sweep_file(write(folder / "s.toml", "scene = \"x\"\n[vary]\na = [1, 2]\n\"b.c\" = [\"p\", \"q\", \"r\"]\n"));
    const auto all = combinations(sweep);
    ASSERT_EQ(all.size(), 6u);
    EXPECT_EQ(all[0], (std::vector<std::string>{"1", "p"}));
    EXPECT_EQ(all[1], (std::vector<std::string>{"1", "q"}));
    EXPECT_EQ(all[3], (std::vector<std::string>{"2", "p"}));
    EXPECT_EQ((std::set<std::vector<std::string>>(all.begin(), all.end()).size()), 6u);
    for (const auto& [text, reason] : std::vector<std::pair<std::string, std::string>>{
             {"scene = 3\n[vary]\na = [1]\n", "1:9: scene must be a string"},
             {"scene = \"x\"\n", "nothing varies"},
             {"[vary]\na = [1]\n", "needs a scene"},
             {"scene = \"x\"\n[vary]\na = 1\n", "needs a list of values"},
             {"scene = \"x\"\nsecond = 1\n", "unknown key \"second\""},
             {"scene = \"x\"\nseconds = -1\n", "seconds = -1 is outside"},
             {"scene = \"x\"\nrepeat = 1.5\n[vary]\na = [1]\n", "repeat must be a whole number"},
             {"scene = \"x\"\nrepeat = 900000\n[vary]\na = [1, 2]\n", "more than a million runs"},
             {"scene = \"x\"\nrepeat = 2\n[vary]\nrepeat = [1, 2]\n", "can be named repeat"},
             {"scene = [", "s.toml:1:"},
             {"scene = \"x\"\n[vary]\na = [1e-4, 2.0, 0.1e-3]\n", "s.toml:3:17: a has this value twice"},
             {"scene = \"x\"\n[vary]\na = [\"b\\nc\"]\n", "s.toml:3:6: line ends"},
             {"scene = \"x\"\nname = \"a\\u001b\"\n[vary]\na = [1]\n", "s.toml:2:8: line ends"},
             {"scene = \"x\"\n[set]\nk = \"a\\rb\"\n", "s.toml:3:5: line ends"}}) {
        try {
            read_sweep_file(write(folder / "s.toml", text));
            ADD_FAILURE() << text;
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
        }
    }
}

// The kinetic energy of a ball in free fall is known from the duration: m (g t)^2 / 2, from any height; zero
// without gravity.
TEST(SweepCommand, RunsMergesResumesAndIsTheSameOnEveryEngine) {
    const fs::path folder = fresh_folder("run");
    write(folder / "ball.toml", kScene);
    const fs::path sweep = write(folder / "drop.toml", kSweep);
    const auto run = [&](const std::string& more) { return run_program("sweep " + sweep.string() + " " + more, source_folder(), folder); };
    const Outcome dry = run("--dry-run --out " + (folder / "dry").string());
    EXPECT_EQ(std::count(dry.out.begin(), dry.out.end(), '\n'), 4);
    EXPECT_FALSE(fs::exists(folder / "dry"));

    const fs::path out = folder / "out";
    ASSERT_EQ(run("--out " + out.string()).code, 0);
    const auto rows = nlohmann::json::parse(text_of(out / "sweep.json"))["runs"];
    ASSERT_EQ(rows.size(), 4u);
    double falling = 0;
    for (const auto& row : rows) {
        const double kinetic = row["energy.kinetic_j"];
        const bool falls = row["gravity"].get<std::string>().find("9.81") != std::string::npos;
        EXPECT_EQ(kinetic > 0, falls) << row;
        falling = std::max(falling, kinetic);
        EXPECT_TRUE(row["failed"].is_null());
        EXPECT_EQ(row["state_hash"].get<std::string>().size(), 16u);
    }
    EXPECT_GT(falling, 0);
    EXPECT_NE(rows[0]["state_hash"], rows[2]["state_hash"]) << "another height";

    // finished runs are kept; a missing one and one with a different command are run again
    const fs::path second = out / "runs" / rows[1]["run"].get<std::string>() / "metrics.json";
    const auto stamp = fs::last_write_time(second);
    fs::remove_all(out / "runs" / rows[2]["run"].get<std::string>());
    const Outcome again = run("--out " + out.string());
    EXPECT_EQ(again.code, 0);
    EXPECT_NE(again.out.find("4 runs, 3 were there, 0 failed"), std::string::npos) << again.out;
    EXPECT_EQ(fs::last_write_time(second), stamp);
    // merging changes no run, and an added value leaves the other runs in place
    fs::remove(out / "runs" / rows[3]["run"].get<std::string>() / "exit");
    const Outcome table = run("--engine merge --out " + out.string());
    EXPECT_EQ(table.code, 1);
    EXPECT_TRUE(fs::exists(out / "runs" / rows[3]["run"].get<std::string>() / "metrics.json"));
    std::string more = kSweep;
    const size_t list = more.find("[", more.find("[vary]") + 6);
    more.insert(list + 1, more.compare(list + 1, 1, "[") == 0 ? "[0.0, 0.0, -1.0], " : "7.0, ");
    const Outcome wider =
        run_program("sweep " + write(folder / "drop.toml", more).string() + " --out " + out.string(), source_folder(), folder);
    EXPECT_NE(wider.out.find("6 runs, 3 were there, 0 failed"), std::string::npos) << wider.out << wider.err;
    EXPECT_EQ(fs::last_write_time(second), stamp);
    write(folder / "drop.toml", kSweep);
    ASSERT_EQ(run("--out " + out.string()).code, 0);
    if (std::system("command -v parallel >/dev/null 2>&1") == 0) {
        ASSERT_EQ(run("--engine parallel --out " + (folder / "p").string()).code, 0);
        EXPECT_EQ(text_of(folder / "p/sweep.csv"), text_of(out / "sweep.csv"));
    }
}

// Every combination twice, all of them before the second round; results are equal, and nothing is run again.
TEST(SweepCommand, RepetitionsAreRunsOfTheirOwn) {
    const fs::path folder = fresh_folder("repeat");
    write(folder / "ball.toml", kScene);
    const std::string text = "scene = \"ball.toml\"\nrepeat = 2\ncolumns = [\"state_hash\"]\n[vary]\nheight = [0.1, 0.2]\n";
    const fs::path sweep = write(folder / "twice.toml", text), out = folder / "out";
    const auto run = [&] { return run_program("sweep " + sweep.string() + " --out " + out.string(), source_folder(), folder); };
    ASSERT_EQ(run().code, 0);
    const auto rows = nlohmann::json::parse(text_of(out / "sweep.json"))["runs"];
    ASSERT_EQ(rows.size(), 4u);
    std::set<std::string> runs;
    for (size_t i = 0; i < 4; ++i) {
        EXPECT_EQ(rows[i]["repeat"], i / 2);
        EXPECT_EQ(rows[i]["height"], rows[i % 2]["height"]);
        EXPECT_EQ(rows[i]["state_hash"], rows[i % 2]["state_hash"]);
        runs.insert(rows[i]["run"]);
    }
    EXPECT_EQ(runs.size(), 4u);
    EXPECT_TRUE(text_of(out / "sweep.csv").starts_with("run,height,repeat,state_hash,failed\n")) << text_of(out / "sweep.csv");
    EXPECT_NE(run().out.find("4 runs, 4 were there"), std::string::npos);
    write(folder / "twice.toml", "scene = \"ball.toml\"\n[vary]\nheight = [0.1, 0.2]\n");
    EXPECT_NE(run().out.find("2 runs, 2 were there"), std::string::npos) << "the first round is that of a sweep without repetitions";
}

// `trocar sweep` with no sbatch on the PATH, whatever this machine has.
Outcome sweep_without_cluster(const std::string& arguments, const fs::path& folder) {
    const char* path = std::getenv("PATH");
    const std::string kept = path ? path : "";
    setenv("PATH", folder.c_str(), 1);
    const Outcome outcome = run_program("sweep " + arguments, source_folder(), folder);
    setenv("PATH", kept.c_str(), 1);
    return outcome;
}

// The number of concurrent runs on a cluster is left to the cluster unless --jobs sets it.
TEST(SweepCommand, SlurmIsThrottledOnlyWhenAsked) {
    const fs::path folder = fresh_folder("slurm");
    write(folder / "ball.toml", kScene);
    const fs::path sweep = write(folder / "drop.toml", kSweep);
    const auto script = [&](const std::string& more) {
        sweep_without_cluster(sweep.string() + " --engine slurm --out " + (folder / "o").string() + more, folder);
        return text_of(folder / "o/sweep.sbatch");
    };
    EXPECT_NE(script("").find("--array=0-3\n"), std::string::npos) << script("");
    EXPECT_NE(script(" --jobs 2").find("--array=0-3%2\n"), std::string::npos) << script(" --jobs 2");
}

// Executes the tasks of a Slurm array one after the other in a shell. Breaks when a task skips lines of a
// long list, or an array contains finished runs.
TEST(SweepCommand, SlurmTasksWorkOffWhatIsLeft) {
    const fs::path folder = fresh_folder("slurm_left");
    write(folder / "ball.toml", kScene);
    const std::string list = write(folder / "drop.toml", kSweep).string() + " --out " + (folder / "o").string();
    const auto command = [&](const std::string& engine) { return sweep_without_cluster(list + " --engine " + engine, folder); };
    command("slurm");
    const auto run_tasks = [&](std::initializer_list<int> tasks) {
        for (const int task : tasks)
            std::system(("SLURM_ARRAY_TASK_ID=" + std::to_string(task) + " sh " + (folder / "o/sweep.sbatch").string()).c_str());
    };
    run_tasks({1});
    command("slurm");
    EXPECT_NE(text_of(folder / "o/sweep.sbatch").find("--array=0,2-3\n"), std::string::npos) << text_of(folder / "o/sweep.sbatch");
    run_tasks({0, 2, 3});
    EXPECT_EQ(command("slurm").code, 0) << "nothing is left, no cluster needed";
    EXPECT_EQ(command("merge").code, 0);
}

// Breaks when an array has more tasks than Slurm accepts, or a line belongs to no task.
TEST(SweepCommand, SlurmArraysHoldAtMostAThousandTasks) {
    const fs::path folder = fresh_folder("slurm_many");
    write(folder / "ball.toml", kScene);
    std::string heights;
    for (int i = 0; i < 1500; ++i) heights += std::to_string(0.1 + 1e-4 * i) + ", ";
    const fs::path sweep = write(folder / "many.toml", "scene = \"ball.toml\"\n[vary]\nheight = [" + heights + "]\n");
    sweep_without_cluster(sweep.string() + " --engine slurm --out " + (folder / "o").string(), folder);
    EXPECT_NE(text_of(folder / "o/sweep.sbatch").find("--array=0-999\n"), std::string::npos);
    std::string lines;
    for (int i = 0; i < 1500; ++i) lines += "echo " + std::to_string(i) + " >> " + (folder / "said").string() + "\n";
    write(folder / "o/runs.txt", lines);
    for (const int task : {0, 499, 500, 999})
        std::system(("SLURM_ARRAY_TASK_ID=" + std::to_string(task) + " sh " + (folder / "o/sweep.sbatch").string()).c_str());
    EXPECT_EQ(text_of(folder / "said"), "0\n1000\n499\n1499\n500\n999\n");
}

TEST(SweepCommand, AWrongKeyShowsBeforeAnythingRunsAndAFailedRunInTheTable) {
    const fs::path folder = fresh_folder("wrong");
    write(folder / "ball.toml", kScene);
    const fs::path wrong = write(folder / "wrong.toml", "scene = \"ball.toml\"\n[vary]\n\"ball.triangels\" = [80, 100]\n");
    const Outcome refused = run_program("sweep " + wrong.string() + " --out " + (folder / "o").string(), source_folder(), folder);
    EXPECT_EQ(refused.code, 2);
    EXPECT_NE(refused.err.find("did you mean \"triangles\""), std::string::npos) << refused.err;
    EXPECT_FALSE(fs::exists(folder / "o"));
    const fs::path shapes = write(folder / "shapes.toml", "scene = \"ball.toml\"\n[vary]\n\"ball.shape\" = [\"sphere\", \"cloud\"]\n");
    const Outcome half = run_program("sweep " + shapes.string() + " --out " + (folder / "h").string(), source_folder(), folder);
    EXPECT_EQ(half.code, 1) << half.err;
    EXPECT_NE(text_of(folder / "h/sweep.csv").find("no shape \"\"cloud\"\""), std::string::npos) << text_of(folder / "h/sweep.csv");
}

}  // namespace
}  // namespace trocar
