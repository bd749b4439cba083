#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/commands/read_run.hpp"
#include "systems/app/report/figures.hpp"
#include "systems/app/run/live_recording.hpp"
#include "systems/app/run/live_run.hpp"
#include "systems/app/station/exercise_file.hpp"
#include "systems/app/station/score.hpp"
#include "tests/app/quick_scene.hpp"
#include "tests/app/run_program.hpp"

// The record of an exercise, from runs and from files of older ones.
namespace trocar {
namespace {
namespace fs = std::filesystem;

class ExerciseFiles : public testing::Test {
 protected:
    void SetUp() override {
        folder_ = fs::path(testing::TempDir()) / ("trocar_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
        fs::remove_all(folder_), fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }
    trocar::Outcome run(const std::string& arguments) const { return run_program(arguments, folder_, folder_); }
    fs::path write(const std::string& name, const std::string& text) const {
        std::ofstream(folder_ / name) << text;
        return folder_ / name;
    }
    std::string fault_of(const fs::path& file) const {
        try {
            read_run(file);
        } catch (const InputError& e) {
            return e.what();
        }
        return "none";
    }
    fs::path folder_;
};

// A hand hooks a soft ball by links alone and lifts it off.
constexpr const char* kHook = R"(
name = "Hook"
seconds = 1.2
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "ball"
shape = "sphere"
size = 0.05
triangles = 300
motion = "deformable"
anchor = "world"
[body.tissue]
youngs_modulus = 5e3
wall = 3e-3
depth = 0.05
damping = 20.0
[[body]]
name = "hook"
shape = "sphere"
size = 0.01
triangles = 100
motion = "hand"
position = [0.0, 0.0, 0.036]
mass = 0.05
[[tool]]
body = "hook"
tip = [0.0, 0.0, 0.0]
tip_radius = 0.004
stiffness = 500.0
damping = 5.0
max_force = 3.3
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.036]
[[tool.path]]
time = 0.3
position = [0.0, 0.0, 0.0315]
[[tool.path]]
time = 0.5
position = [0.0, 0.0, 0.0315]
[[tool.path]]
time = 1.0
position = [0.0, 0.0, 0.05]
[[link]]
name = "barb"
body = "ball"
to = "hook"
within = 6e-3
from = 0.4
)";

// The same force in every output: that on the hand. Breaks when a picture or a table shows the contact's part of it, which is none here.
TEST_F(ExerciseFiles, AForceThroughLinksAloneIsShownEverywhere) {
    write("hook.toml", kHook);
    const trocar::Outcome done = run("run hook.toml --out out --no-render --no-player --threads 1");
    ASSERT_EQ(done.code, 0) << done.err;
    const CsvTable passes = read_csv(folder_ / "out" / "passes.csv"), tools = read_csv(folder_ / "out" / "tools.csv");
    const Exercise e = read_run(folder_ / "out");
    ASSERT_EQ(passes.row.size(), tools.row.size());
    ASSERT_EQ(passes.row.size(), e.sample.size());
    const size_t shown = passes.find("force_n"), x = tools.find("force_x_n"), contacts = tools.find("contacts");
    double pulled = 0, largest = 0;
    for (size_t r = 0; r < passes.row.size(); ++r) {
        const double force = Vec3d(tools.number(r, x), tools.number(r, x + 1), tools.number(r, x + 2)).norm();
        EXPECT_NEAR(passes.number(r, shown), force, 1e-5 * (1 + force));
        EXPECT_NEAR(e.sample[r].hand.norm(), force, 1e-6 * (1 + force));
        EXPECT_GE(e.sample[r].hand_peak, e.sample[r].hand.norm() * (1 - 1e-8));
        if (tools.number(r, contacts) == 0) pulled = std::max(pulled, force);
        largest = std::max(largest, e.sample[r].hand_peak);
    }
    EXPECT_GT(pulled, 0.3) << "the links pull without any contact";
    const auto metrics = nlohmann::json::parse(std::ifstream(folder_ / "out" / "metrics.json"));
    EXPECT_NEAR(metrics["haptics"]["max_force_n"].get<double>(), largest, 1e-6 * largest) << "peaks of passes hold every tick";
    EXPECT_LE(largest, 3.3);
    // what the tool pulls the ball with is what the ball pulls it with
    const ExerciseSample& last = e.sample.back();
    ASSERT_EQ(last.organs.count, 1u);
    EXPECT_EQ(e.organ[e.organ_force[last.organs.first].organ], "ball");
    EXPECT_NEAR(e.organ_force[last.organs.first].force, last.tissue.norm(), 1e-6 * last.tissue.norm());
    const auto attached = std::ranges::find(e.event, "attach", &ExerciseEvent::kind);
    ASSERT_NE(attached, e.event.end());
    EXPECT_EQ(attached->object, "barb");
    EXPECT_NEAR(attached->time, 0.4, 0.04);
    EXPECT_EQ(phases_of(e).back().name, "barb");
    const std::string page = (std::stringstream() << std::ifstream(folder_ / "out" / "report.html").rdbuf()).str();
    EXPECT_NE(page.find("<h2>Exercise</h2>"), std::string::npos);
    // the snapshot that a picture is drawn from
    Frame frame(build_scene(read_scene_file(folder_ / "hook.toml", {})).world, {});
    frame.step();
    frame.world().haptics.state[0].command.force = {0, 0, 0};
    frame.world().haptics.state[0].output.force = {0, 0, -2.5};
    EXPECT_EQ(frame.snapshot_now().force, 2.5);
    EXPECT_EQ(pass_figures(frame, 0).force, 2.5);
}

TEST_F(ExerciseFiles, AreWrittenWhereAsked) {
    write("hook.toml", kHook);
    const auto exists = [&](const char* name) { return fs::exists(folder_ / "out" / name); };
    ASSERT_EQ(run("run hook.toml --seconds 0.1 --out out --no-render --no-player").code, 0);
    EXPECT_TRUE(exists("exercise.csv") && exists("exercise.json") && exists("stages.csv"));
    ASSERT_EQ(run("run hook.toml --seconds 0.1 --out out --no-render --no-player --no-exercise").code, 0);
    EXPECT_FALSE(exists("exercise.csv") || exists("exercise.json")) << "those of an earlier run go";
    ASSERT_EQ(run("run hook.toml --seconds 0.1 --out out --figures-only").code, 0);
    EXPECT_FALSE(exists("exercise.csv") || exists("exercise.json") || exists("stages.csv"));
}

TEST_F(ExerciseFiles, AHashThatIsNotExpectedIsTold) {
    write("hook.toml", kHook);
    ASSERT_EQ(run("run hook.toml --seconds 0.1 --out out --figures-only").code, 0);
    const std::string hash = nlohmann::json::parse(std::ifstream(folder_ / "out" / "metrics.json"))["state_hash"];
    EXPECT_EQ(run("run hook.toml --seconds 0.1 --expect-hash " + hash).code, 0);
    std::string other = hash;
    other[15] = other[15] == '0' ? '1' : '0';
    const trocar::Outcome differs = run("run hook.toml --seconds 0.1 --expect-hash " + other);
    EXPECT_EQ(differs.code, 1);
    EXPECT_NE(differs.err.find(hash + ", not " + other), std::string::npos) << differs.err;
    for (const char* bad : {"12", "0123456789abcdeg", "0123456789abcdef0"})
        EXPECT_EQ(run("run hook.toml --expect-hash " + std::string(bad)).code, 2) << bad;
}

TEST_F(ExerciseFiles, PicturesHaveTheSizeAsked) {
    write("hook.toml", kHook);
    const trocar::Outcome done = run("run hook.toml --seconds 0.05 --out out --no-player --size 320x200");
    ASSERT_EQ(done.code, 0) << done.err;
    std::ifstream png(folder_ / "out" / "frames" / "000000.png", std::ios::binary);
    unsigned char head[24] = {};
    png.read(reinterpret_cast<char*>(head), sizeof head);
    EXPECT_EQ(head[18] << 8 | head[19], 320);
    EXPECT_EQ(head[22] << 8 | head[23], 200);
    EXPECT_EQ(run("run hook.toml --size 320").code, 2);
}

// Written and read back: the same numbers to what nine digits hold.
TEST_F(ExerciseFiles, ReadBackAsWritten) {
    Exercise e;
    e.scene = "A, \"quoted\" scene", e.tool = {"left", "right, large"}, e.organ = {"liver", "small bowel"}, e.rate = 60;
    for (int k = 0; k < 6; ++k) {
        ExerciseSample s;
        s.time = k / 2 * 0.016, s.tool = k % 2;
        s.tip = {0.1 * k, -1e-7 / 3, 2}, s.turn = {0.5, 0.5, -0.5, 0.5}, s.proxy = s.tip * 0.9, s.grip = 0.3 * k, s.buttons = 5;
        s.hand = {1, 2, 2}, s.hand_peak = 3.25, s.torque = {0.01, 0, 0}, s.tissue = {0, 0.125, 0}, s.contacts = 7;
        s.organs = {static_cast<uint32_t>(e.organ_force.size()), k == 3 ? 2u : 0u};
        if (k == 3) e.organ_force.push_back({0, 1.5}), e.organ_force.push_back({1, 1e-4});
        e.sample.push_back(s);
    }
    e.event = {{0.01, "touch", "", 1}, {0.02, "attach", "tack \"1\""}};
    write("exercise.csv", exercise_csv(e)), write("exercise.json", exercise_json(e));
    const Exercise r = read_run(folder_);
    EXPECT_EQ(r.scene, e.scene);
    EXPECT_EQ(r.tool, e.tool);
    EXPECT_EQ(r.organ, e.organ);
    ASSERT_EQ(r.sample.size(), e.sample.size());
    for (size_t i = 0; i < e.sample.size(); ++i) {
        const ExerciseSample &a = e.sample[i], &b = r.sample[i];
        EXPECT_EQ(a.tool, b.tool);
        EXPECT_LT((a.tip - b.tip).norm() + (a.proxy - b.proxy).norm() + (a.hand - b.hand).norm() + (a.tissue - b.tissue).norm(), 1e-8);
        EXPECT_NEAR(a.time, b.time, 1e-9);
        EXPECT_NEAR(a.turn.y, b.turn.y, 1e-12);
        EXPECT_NEAR(a.grip, b.grip, 1e-8);
        EXPECT_EQ(a.buttons, b.buttons);
        EXPECT_EQ(a.contacts, b.contacts);
        EXPECT_EQ(a.organs.count, b.organs.count);
    }
    EXPECT_EQ(r.organ_force[1].organ, 1u);
    EXPECT_EQ(r.organ_force[1].force, 1e-4);
    ASSERT_EQ(r.event.size(), 2u);
    EXPECT_EQ(r.event[0].tool, 1u);
    EXPECT_EQ(r.event[1].object, "tack \"1\"");
}

// tools.csv of older runs, and a recording of a live one: what they hold gives the same metrics.
TEST_F(ExerciseFiles, OlderRecordingsAreScored) {
    std::string text =
        "time_s,tool,device_x_m,device_y_m,device_z_m,proxy_x_m,proxy_y_m,proxy_z_m,force_x_n,force_y_n,force_z_n,"
        "torque_x_nm,torque_y_nm,torque_z_nm,tissue_x_n,tissue_y_n,tissue_z_n,contacts\n";
    LiveRecording live;
    live.tools = 1;
    for (int k = 0; k <= 200; ++k) {
        const double t = k / 100.0, force = k > 100 ? 2.0 : 0.0;
        char row[256];
        std::snprintf(row, sizeof row, "%.3f,probe,%.9f,0,0,0,0,0,0,0,%.3f,0,0,0,0,0,0,%d\n", t, 0.05 * t, force, force > 0);
        text += row;
        LiveTick tick;
        tick.tick = k, tick.time = t, tick.sample.position = {0.05 * t, 0, 0}, tick.force = {0, 0, force};
        live.tick.push_back(tick);
    }
    fs::create_directories(folder_ / "old"), fs::create_directories(folder_ / "live");
    write("old/tools.csv", text);
    write_live_recording(folder_ / "live" / "live.recording", live);
    for (const char* name : {"old", "live"}) {
        const Exercise e = read_run(folder_ / name);
        const MetricValues m = score_exercise(e, {}).all;
        EXPECT_NEAR(m.at("path_m"), 0.1, 1e-6) << name;
        EXPECT_NEAR(m.at("impulse_ns"), 2, 0.02) << name;
        EXPECT_EQ(m.at("peak_force_n"), 2) << name;
        EXPECT_EQ(m.contains("turn_rad"), std::string(name) == "live");
        ASSERT_EQ(phases_of(e).size(), 2u) << name;
        EXPECT_NEAR(phases_of(e)[1].from, 1.01, 1e-9) << name;
    }
    const trocar::Outcome scored = run("score old live --json");
    ASSERT_EQ(scored.code, 0) << scored.err;
    EXPECT_EQ(std::ranges::count(scored.out, '\n'), 2);
    for (const char* key : {"time_s", "path_m", "sparc", "ldlj", "peak_force_n"})
        EXPECT_TRUE(nlohmann::json::parse(scored.out.substr(0, scored.out.find('\n'))).contains(key)) << key;
}

TEST_F(ExerciseFiles, FaultsAreNamedWithFileAndLine) {
    fs::create_directories(folder_ / "empty");
    EXPECT_NE(fault_of(folder_ / "empty").find("has no exercise.csv"), std::string::npos);
    Exercise e;
    e.tool = {"t"};
    e.sample.resize(2);
    e.sample[1].time = 1;
    const std::string good = exercise_csv(e);
    EXPECT_EQ(fault_of(write("good.csv", good)), "none");
    const auto broken = [&](size_t at, const char* with) {
        std::string text = good;
        text.replace(at, 1, with);
        return fault_of(write("bad.csv", text));
    };
    const size_t second = good.find('\n') + 1, third = good.find('\n', second) + 1;
    EXPECT_NE(broken(third, "x").find("bad.csv:3: \"x.000\" in column time_s is no number"), std::string::npos);
    EXPECT_NE(broken(third, "0").find("bad.csv:3: times of a tool must ascend"), std::string::npos);
    EXPECT_NE(broken(second, "nan").find("bad.csv:2:"), std::string::npos);
    EXPECT_NE(broken(0, "b").find("column time_s is missing"), std::string::npos);
    EXPECT_NE(broken(good.size() - 1, ",1\n").find("bad.csv:3: "), std::string::npos);
    write("good.json", "{\"format\": 99, \"events\": []}");
    EXPECT_NE(fault_of(folder_ / "good.csv").find("exercise of format 99"), std::string::npos);
    write("good.json", "{");
    EXPECT_NE(fault_of(folder_ / "good.csv").find("good.json"), std::string::npos);
    EXPECT_EQ(run("score nowhere").code, 2);
    EXPECT_EQ(run("score good.csv --damage liver").code, 2);
}

// Two runs of ten minutes at 60 Hz: read, scored, aligned and written.
TEST_F(ExerciseFiles, LongRunsAreCompared) {
    for (const char* name : {"a", "b"}) {
        Exercise e;
        e.tool = {"probe"}, e.organ = {"liver"}, e.rate = 60;
        const double slower = *name == 'b' ? 1.1 : 1;
        for (int k = 0; k < 36000; ++k) {
            ExerciseSample s;
            s.time = std::floor(k * 1000 / 60.0) / 1000;
            const double u = s.time / slower;
            s.tip = {0.05 * std::sin(u), 0.03 * std::sin(1.7 * u), 0.01 * std::cos(2.9 * u)};
            s.hand = {0, 0, std::max(0.0, std::sin(0.3 * u))}, s.hand_peak = s.hand.norm(), s.contacts = s.hand_peak > 0;
            e.sample.push_back(s);
        }
        fs::create_directories(folder_ / name);
        write(std::string(name) + "/exercise.csv", exercise_csv(e));
    }
    const trocar::Outcome done = run("compare a b --out page.html");
    EXPECT_EQ(done.code, 0) << done.err;
    EXPECT_GT(fs::file_size(folder_ / "page.html"), 20000u);
    EXPECT_EQ(run("compare a").code, 2);
}

// A hand of a live run is recorded by its ticks, too: the peak lies between passes.
TEST(ExerciseRecorder, TicksOfALiveRunGoIntoTheirPasses) {
    Frame frame(quick_scene(), {.external_ticks = true});
    ExerciseRecorder recorder(frame);
    for (int k = 0; k < 3; ++k) frame.step(), recorder.after_pass(frame);
    std::vector<LiveTick> ticks;
    for (uint64_t k = 0; k < 50; ++k) {
        LiveTick t;
        t.tick = k, t.time = 1e-3 * static_cast<double>(k), t.force = {0, 0, k == 20 ? 3.0 : k == 40 ? 2.0 : 1.0};
        ticks.push_back(t);
    }
    recorder.add_ticks(ticks, std::vector<double>{0, 0, 0});
    const auto& s = recorder.exercise().sample;
    ASSERT_EQ(s.size(), 3u);
    EXPECT_EQ(s[0].hand_peak, 1);
    EXPECT_EQ(s[1].hand_peak, 3);
    EXPECT_EQ(s[2].hand_peak, 2);
}

}  // namespace
}  // namespace trocar
