#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "engine/files/text_file.hpp"
#include "tests/app/run_program.hpp"
namespace trocar {
namespace {
namespace fs = std::filesystem;

fs::path speed_folder(const char* name) {
    const fs::path folder = fs::path(testing::TempDir()) / name;
    fs::remove_all(folder), fs::create_directories(folder);
    return folder;
}

// Scenes times threads: the hashes are those of `trocar run`, for any number of threads.
TEST(Speed, TellsRatesAndTheHashesOfRuns) {
    const fs::path folder = speed_folder("trocar_speed");
    const std::string sets = " --set liver.triangles=500 --set probe.triangles=300 --seconds 0.3";
    const Outcome table = run_program("speed probe_on_liver --threads 1,3 --repeat 2 --json" + sets, folder, folder);
    ASSERT_EQ(table.code, 0) << table.err;
    ASSERT_EQ(run_program("run probe_on_liver --figures-only --threads 2 --out run" + sets, folder, folder).code, 0);
    const nlohmann::json rows = nlohmann::json::parse(table.out), run = nlohmann::json::parse(read_text_file(folder / "run/metrics.json"));
    ASSERT_EQ(rows.size(), 2u);
    for (const nlohmann::json& row : rows) {
        EXPECT_EQ(row["state_hash"], run["state_hash"]);
        EXPECT_EQ(row["passes"], 18);
        EXPECT_GT(row["passes_per_s"].get<double>(), 0);
        EXPECT_TRUE(row["same"].get<bool>());
    }
    EXPECT_EQ(rows[1]["threads"], 3);
    const Outcome text = run_program("speed rigid_stack no_such_scene --threads 1 --repeat 1 --seconds 0.02", folder, folder);
    EXPECT_EQ(text.code, 2);
    EXPECT_NE(text.out.find("rigid_stack"), std::string::npos);
    EXPECT_NE(text.err.find("no_such_scene"), std::string::npos) << text.err;
}

// A night over two scenes, twice: a folder each, one table of both nights, and hands that differ from pair to pair of episodes but not
// within one.
TEST(Soak, ANightGoesThroughScenesWithRandomHands) {
    const fs::path folder = speed_folder("trocar_night");
    const std::string night =
        "soak probe_on_liver ball_on_liver --minutes 0.03 --seconds 0.5 --hands 5 --set liver.triangles=500 --out night";
    for (int i = 0; i < 2; ++i) {
        const Outcome told = run_program(night, folder, folder);
        EXPECT_EQ(told.code, 0) << told.out << told.err;
    }
    std::ifstream nights(folder / "night/nights.csv");
    std::map<std::string, int> lines;
    for (std::string line; std::getline(nights, line);) {
        const size_t version = line.find(',') + 1, scene = line.find(',', version) + 1;
        ++lines[line.substr(scene, line.find(',', scene) - scene)];
    }
    EXPECT_EQ(lines, (std::map<std::string, int>{{"scene", 1}, {"probe_on_liver", 2}, {"ball_on_liver", 2}}));
    const std::string page = read_text_file(folder / "night/night.html");
    EXPECT_NE(page.find("against the night before"), std::string::npos);
    EXPECT_NE(page.find("over nights"), std::string::npos) << "a plot of the trend";
    std::ifstream episodes(folder / "night/probe_on_liver/soak.csv");
    std::set<std::string> ends;
    size_t count = 0;
    std::string line;
    std::getline(episodes, line);
    for (; std::getline(episodes, line); ++count) ends.insert(line.substr(line.rfind(',') + 1));
    EXPECT_GT(count, 0u);
    EXPECT_EQ(ends.size(), (count + 1) / 2) << "two episodes of the same hands end the same, others elsewhere";
    EXPECT_EQ(run_program("soak probe_on_liver --hands -3", folder, folder).code, 2);
}

}  // namespace
}  // namespace trocar
