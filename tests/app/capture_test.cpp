#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <random>
#include <set>
#include <sstream>

#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/capture/capture_difference.hpp"
#include "systems/app/capture/capture_export.hpp"
#include "systems/app/capture/what_if.hpp"
#include "systems/app/report/run_costs.hpp"
#include "systems/app/run/live_run.hpp"
#include "tests/app/quick_scene.hpp"
#include "tests/app/run_program.hpp"
#include "tests/frame/written_scene.hpp"
namespace trocar {
namespace {
namespace fs = std::filesystem;

fs::path scratch_folder(const std::string& name) {
    const fs::path folder = fs::path(testing::TempDir()) / ("trocar_capture_" + name);
    fs::remove_all(folder);
    fs::create_directories(folder);
    return folder;
}

// Runs `passes` passes with these triggers; returns the folder of the captures.
fs::path captured_run(const std::string& name, const std::string& triggers, uint32_t passes,
                      const std::function<World()>& scene = quick_scene, size_t most_bytes = FrameRecorder::kMostKeptBytes) {
    const fs::path folder = scratch_folder(name);
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(scene(), {});
        CaptureHeader header;
        header.scene = "balls";
        header.stages = frame.stage_names();
        FrameRecorder recorder(frame, header, parse_capture_triggers(triggers), folder, most_bytes, passes);
        for (uint32_t i = 0; i < passes; ++i) {
            recorder.before_pass();
            frame.step();
            PassFigures pass = pass_figures(frame, 0);
            pass.frame_ms = i == 0 ? 500 : 1 + i % 17;  // the first pass pays for memory
            recorder.after_pass(pass);
        }
        recorder.finish();
    });
    return folder;
}

ReplayVerdict replay(const Capture& capture, uint32_t threads = 2) {
    ReplayVerdict verdict;
    ThreadPool pool(threads);
    pool.run([&] { verdict = replay_capture(capture, {}); });
    return verdict;
}

// Reads, builds and steps a capture; returns the error message if it is rejected.
std::string try_capture(const fs::path& path) {
    try {
        const Capture capture = open_capture(path);
        ThreadPool pool(1);
        std::string refused;
        pool.run([&] {
            try {
                Frame frame(world_at(capture, 0), {});
                frame.step();
            } catch (const InputError& e) {
                refused = e.what();
            }
        });
        return refused;
    } catch (const InputError& e) {
        return e.what();
    }
}

void write_bytes(const fs::path& path, const std::string& bytes) { std::ofstream(path, std::ios::binary) << bytes; }

// Unused state buffers are reused. Fails when a state still referenced by a trigger is overwritten: the
// capture of the worst pass would start from a later state.
TEST(Capture, StatesThatATriggerHoldsAreNotWrittenOver) {
    const fs::path folder = captured_run("reused", "worst", 100, quick_scene, 1);
    const Capture capture = open_capture(folder / "worst.cap");
    ASSERT_GT(capture.passes(), 0u);
    const ReplayVerdict verdict = replay(capture);
    EXPECT_EQ(verdict.difference, "");
    EXPECT_EQ(verdict.compared, capture.passes());
}

// Breaks when a state is incomplete: a replay from it would differ.
TEST(Capture, ARangeOfPassesRunsAgainToTheBitOnAnyThreads) {
    const fs::path folder = captured_run("range", "21-47", 60);
    const Capture capture = open_capture(folder / "passes_21-47.cap");
    EXPECT_EQ(capture.passes(), 27u);
    EXPECT_EQ(capture.stretches.front().pass, 21u);
    EXPECT_EQ(capture.damage, "");
    double depth = 0;
    for (const auto& stretch : capture.stretches)
        for (const CaptureStep& step : stretch.steps) depth = std::max(depth, step.depth);
    EXPECT_GT(depth, 0) << "nothing touched: the test shows nothing";
    for (const uint32_t threads : {1u, 2u, 4u}) {
        const ReplayVerdict verdict = replay(capture, threads);
        EXPECT_EQ(verdict.compared, 27u);
        EXPECT_EQ(verdict.difference, "");
    }
}

TEST(Capture, TheWorstPassAndARisingCounterAreKeptWithTheirPast) {
    const fs::path folder = captured_run("worst", "worst,counter=contact_events", 40);
    const Capture worst = open_capture(folder / "worst.cap");
    EXPECT_NE(worst.header.reason.find("worst pass"), std::string::npos);
    EXPECT_EQ(replay(worst).difference, "");
    std::vector<fs::path> rose;
    for (const auto& entry : fs::directory_iterator(folder))
        if (entry.path().filename().string().starts_with("contact_events_")) rose.push_back(entry.path());
    ASSERT_EQ(rose.size(), 1u);
    const Capture touched = open_capture(rose.front());
    const CaptureStep& last = touched.stretches.back().steps.back();
    EXPECT_GT(last.depth, 0) << "ends with the pass that touched";
    EXPECT_EQ(rose.front().filename().string(), "contact_events_" + std::to_string(last.pass) + ".cap");
    EXPECT_EQ(replay(touched).difference, "");
}

// Breaks when the number of kept states does not fall with their size: nine states of fifty thousand balls
// would take 1.4 GB.
TEST(Capture, OfLargeStatesFewAreKept) {
    const fs::path few = captured_run("few_states", "over=16.5,50-51", 100, quick_scene, 1);
    const Capture kept = open_capture(few / "over_84.cap");
    const Capture usual = open_capture(captured_run("all_states", "over=16.5", 100) / "over_84.cap");
    EXPECT_EQ(kept.stretches.size(), 2u);
    EXPECT_EQ(usual.stretches.size(), 6u);
    EXPECT_EQ(kept.stretches.back().steps.back().pass, 84u);
    EXPECT_EQ(replay(kept).difference, "");
    EXPECT_EQ(open_capture(few / "passes_50-51.cap").passes(), 2u) << "a range does not ask what is kept";
}

// Of passes over the limit the worst ten have a file at the end, whatever their order.
TEST(Capture, OverKeepsTheWorstTen) {
    const fs::path folder = captured_run("worst_ten", "over=1.5", 40);
    std::set<std::string> files, wanted;
    for (const auto& entry : fs::directory_iterator(folder)) files.insert(entry.path().filename().string());
    for (const int pass : {12, 13, 14, 15, 16, 29, 30, 31, 32, 33}) wanted.insert("over_" + std::to_string(pass) + ".cap");
    EXPECT_EQ(files, wanted);
    EXPECT_EQ(replay(open_capture(folder / "over_33.cap")).difference, "");
}

// A changed replay is what a run with that change from the start is; one that changes nothing is what was recorded.
TEST(Capture, WhatIfIsTheRunWithThatChange) {
    const fs::path folder = captured_run("what_if", "0-30", 32);
    const Capture capture = open_capture(folder / "passes_0-30.cap");
    const auto again = [&](const std::vector<Override>& changes) {
        std::vector<WhatIfPass> passes;
        ThreadPool pool(2);
        pool.run([&] { passes = what_if(capture, changes); });
        return passes;
    };
    const std::vector<WhatIfPass> same = again({{"contact.iterations", "2"}});
    ASSERT_EQ(same.size(), 31u);
    for (const WhatIfPass& p : same) {
        EXPECT_TRUE(p.same);
        EXPECT_EQ(p.depth[0], p.depth[1]);
        EXPECT_EQ(p.force[0], p.force[1]);
        EXPECT_EQ(p.contacts[0], p.contacts[1]);
    }
    EXPECT_NE(what_if_text(same).find("change nothing"), std::string::npos);
    const std::vector<WhatIfPass> changed = again({{"contact.iterations", "7"}, {"liver.tissue.damping", "5"}});
    World w = quick_scene();
    w.settings.contact.iterations = 7;
    w.bodies.tissue[0].damping = 5;
    ASSERT_EQ(w.bodies.name[0], "liver");
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(std::move(w), {});
        for (const WhatIfPass& p : changed) {
            frame.step();
            EXPECT_EQ(p.depth[1], frame.times().deepest) << p.pass;
            EXPECT_EQ(p.force[1], frame.world().haptics.state[0].output.force.norm()) << p.pass;
        }
    });
    EXPECT_FALSE(changed.back().same);
    EXPECT_GT(changed.back().force[1], 0);
    for (const Override& bad : {Override{"liver.triangles", "9"},
                                {"contact.iterations", "1.5"},
                                {"contact.iterations", "0"},
                                {"nobody.tissue.friction", "1"},
                                {"contact.share", "weight"},
                                {"gravity", "1 2"},
                                {"substep", "nan"},
                                {"liver.tissue.friction", "-1"},
                                {"contact", "1"}})
        EXPECT_THROW(again({bad}), InputError) << bad.key;
}

// Breaks when `capture info` explains the worst pass by one that was not judged, or lists a stage that did
// not run with zero cost.
TEST(CaptureCommand, InfoTellsOfThePassThatWasJudgedWorst) {
    const fs::path folder = captured_run("judged", "worst", 40);
    const std::string file = (folder / "worst.cap").string();
    const Outcome info = run_program("capture info " + file, folder, folder);
    EXPECT_NE(info.out.find("worst pass 16: 17.000 ms"), std::string::npos) << info.out;
    EXPECT_NE(info.out.find("slowest: pass 16, 17.000 ms"), std::string::npos) << info.out;
    const Outcome profile = run_program("replay " + file + " --frame 10 --repeat 2", folder, folder);
    EXPECT_NE(profile.out.find("not in this pass: surface normals, self-crossings, energy, picture\n"), std::string::npos) << profile.out;
}

TEST(Capture, TissueThatTearsIsKept) {
    const fs::path folder = captured_run("tears", "counter=broken_springs", 60, [] {
        const std::string path = (source_folder() / "content/scenes/tet_liver_press.toml").string();
        return build_scene(read_scene_file(path, {{"liver.cells", "6"}, {"liver.triangles", "600"}, {"liver.break_strain", "0.01"}})).world;
    });
    std::vector<fs::path> rose(fs::directory_iterator(folder), fs::directory_iterator{});
    ASSERT_EQ(rose.size(), 1u);
    const Capture torn = open_capture(rose.front());
    EXPECT_NE(torn.header.reason.find("broken_springs rose"), std::string::npos) << torn.header.reason;
    EXPECT_EQ(replay(torn).difference, "");
    // find the first pass in which a spring broke
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(world_at(torn, 0), {});
        const uint64_t last = torn.stretches.back().steps.back().pass;
        for (uint64_t pass = torn.stretches.front().pass; pass <= last; ++pass) {
            EXPECT_EQ(frame.world().report.broken_springs, 0u) << pass;
            frame.step();
        }
        EXPECT_GT(frame.world().report.broken_springs, 0u);
    });
}

TEST(Capture, TheFirstDifferenceIsNamedByPassStageArrayAndRow) {
    const fs::path folder = captured_run("diverge", "3-40", 45);
    Capture capture = open_capture(folder / "passes_3-40.cap");
    CaptureStep& step = capture.stretches[1].steps[2];
    step.state_hash ^= 1;
    step.resource_hash[static_cast<size_t>(Resource::kContacts)] ^= 1;
    EXPECT_NE(
        replay(capture).difference.find("pass " + std::to_string(step.pass) + " is the first to differ, first in stage overlap (contacts)"),
        std::string::npos)
        << replay(capture).difference;

    Capture moved = open_capture(folder / "passes_3-40.cap");
    for (CaptureArray& a : moved.stretches[1].state.arrays) {
        if (a.name != "particles.offset") continue;
        a.bytes[17 * 16] ^= std::byte{1};
    }
    EXPECT_NE(replay(moved).difference.find("particles.offset, row 17, column 0 (body \"liver\", particle 17): "), std::string::npos)
        << replay(moved).difference;
}

// Two records that differ in one number: the text names the owner of the row and both values.
TEST(Capture, ADifferenceNamesTheBodyAndBothValues) {
    World world = quick_scene();
    CaptureRecord scene{"scene", {}};
    save_resource(world, Resource::kBodies, scene);
    const auto liver =
        static_cast<size_t>(std::find(world.bodies.name.begin(), world.bodies.name.end(), "liver") - world.bodies.name.begin());
    const auto difference = [&](Resource resource, double& value) {
        CaptureRecord before{"state", {}}, after{"state", {}};
        value = 0.5;
        save_resource(world, resource, before);
        value = 0.75;
        save_resource(world, resource, after);
        return first_difference(before, after, &scene);
    };
    EXPECT_EQ(difference(Resource::kPoses, world.poses.origin[liver].y()),
              "poses.origin, row " + std::to_string(liver) + ", column 1 (body \"liver\"): 0.5 and 0.75, 0.25 apart");
    const uint32_t other = 1 - static_cast<uint32_t>(liver);
    world.pair_memory.a = {static_cast<uint32_t>(liver)}, world.pair_memory.b = {other}, world.pair_memory.direction = {Vec3d::Zero()};
    EXPECT_EQ(
        difference(Resource::kPairMemory, world.pair_memory.direction[0].z()),
        "pair_memory.direction, row 0, column 2 (bodies \"liver\" and \"" + world.bodies.name[other] + "\"): 0.5 and 0.75, 0.25 apart");
}

// Two runs, one with a displaced particle from a certain state on: the pass after it is replayed from both
// states, and the differing stage and row are named.
TEST(Capture, APassThatDiffersNamesStageAndRow) {
    const fs::path file = captured_run("differs", "3-40", 45) / "passes_3-40.cap";
    const Capture one = open_capture(file);
    Capture other = open_capture(file);
    Capture::Stretch& stretch = other.stretches[1];
    ThreadPool pool(2);
    pool.run([&] {
        World world = world_at(other, 1);
        world.particles.offset[3].z += 1e-4f;
        stretch.state.arrays.clear();
        add_value(stretch.state, "pass", stretch.pass);
        save_resources(world, ResourceKind::kState, stretch.state);
        save_resources(world, ResourceKind::kAccounts, stretch.state);
        Frame frame(world_at(other, 1), {});
        frame.step();
        stretch.steps[0].state_hash = state_hash(frame.world());
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
            stretch.steps[0].resource_hash[r] = resource_hash(frame.world(), static_cast<Resource>(r));
        const std::string difference = pass_difference(one, other, stretch.pass);
        EXPECT_TRUE(difference.starts_with("first in stage ")) << difference;
        EXPECT_NE(difference.find("; the state after it first in particles."), std::string::npos) << difference;
        EXPECT_NE(difference.find("(body \"liver\", particle "), std::string::npos) << difference;
        EXPECT_NE(difference.find(" apart"), std::string::npos) << difference;
        EXPECT_EQ(pass_difference(one, other, stretch.pass + 1), "") << "which was recorded before the particle was moved";
        EXPECT_EQ(pass_difference(one, other, 44), "") << "in none of them";
    });
}

// The most expensive pair of the slowest pass equals that in the figures of the run, which measured the same
// passes.
TEST(Capture, TheDearestPairIsThatOfTheRunItself) {
    const fs::path file = captured_run("pair", "3-30", 31) / "passes_3-30.cap";
    const Capture capture = open_capture(file);
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(quick_scene(), {});
        std::vector<PairCost> costs;
        for (int i = 0; i <= 25; ++i) frame.step(), costs = pair_costs(frame.world());
        ASSERT_EQ(costs.size(), 1u);
        const std::optional<size_t> s = stretch_of(capture, 25);
        ASSERT_TRUE(s);
        const CaptureStep& step = capture.stretches[*s].steps[25 - capture.stretches[*s].pass];
        const std::optional<PairFigures> pair = dearest_pair(capture, step);
        ASSERT_TRUE(pair);
        EXPECT_EQ(pair->name, frame.world().bodies.name[costs[0].a] + "/" + frame.world().bodies.name[costs[0].b]);
        EXPECT_EQ(pair->vertices, costs[0].vertices);
        EXPECT_EQ(pair->cell, frame.world().occupancy.cell_size);
        EXPECT_EQ(pair->ms, step.detection_ms);
        CaptureStep untrue = step;
        Capture damaged = capture;
        damaged.stretches[*s].steps[25 - capture.stretches[*s].pass].state_hash ^= 1;
        EXPECT_FALSE(dearest_pair(damaged, untrue));
    });
}

TEST(Capture, OnePassRunsAgainAndAgainFromItsOwnStart) {
    const fs::path folder = captured_run("profile", "2-30", 31);
    const Capture capture = open_capture(folder / "passes_2-30.cap");
    ThreadPool pool(2);
    pool.run([&] {
        const PassProfile profile = profile_pass(capture, 25, 5, nullptr);
        EXPECT_EQ(profile.pass_ms.size(), 5u);
        EXPECT_EQ(profile.stage.size(), profile.stage_ms.size());
        EXPECT_TRUE(profile.same);
        EXPECT_THROW(profile_pass(capture, 31, 5, nullptr), InputError);
        Capture other = capture;
        for (Capture::Stretch& s : other.stretches)
            for (CaptureStep& step : s.steps) step.state_hash ^= 1;
        EXPECT_FALSE(profile_pass(other, 25, 1, nullptr).same);
    });
}

// What a frame caches about sleeping bodies is valid for the repetitions, also of passes in which bodies fall
// asleep or wake up.
TEST(Capture, APassWithSleepersRunsAgainAsItWas) {
    const auto boxes = [] {
        const std::vector<Override> few{
            {"count", "12"}, {"columns", "3"}, {"floor", "0.6"}, {"ground", "-0.01"}, {"floor.triangles", "400"}};
        return build_scene(read_scene_file(source_folder() / "content/scenes/stress_settle.toml", few), Looks::kPlain).world;
    };
    const fs::path folder = captured_run("sleepers", "0-239", 240, boxes);
    const Capture capture = open_capture(folder / "passes_0-239.cap");
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(world_at(capture, 0), replay_options(capture, nullptr));
        uint32_t asleep = 0, changes = 0;
        for (uint64_t pass = 0; pass < 240; ++pass) {
            frame.step();
            const uint32_t now = frame.world().report.asleep_bodies;
            const bool changed = now != std::exchange(asleep, now);
            if (!changed && pass != 239) continue;
            changes += changed;
            EXPECT_TRUE(profile_pass(capture, pass, 3, nullptr).same) << pass;
        }
        EXPECT_GT(changes, 2u);
        EXPECT_GT(asleep, 8u);
    });
}

// A live run knows the hand's position in the previous pass, which is not part of the world's state. Fails
// when the first pass after a state starts with the hand at its final position, or the very first pass with a
// previous position.
TEST(Capture, APassOfALiveRunRunsAgainAsItWas) {
    const fs::path folder = scratch_folder("live_again");
    ThreadPool pool(2);
    pool.run([&] {
        FrameOptions options;
        options.external_ticks = true;
        Frame frame(quick_scene(), options);
        CaptureHeader header;
        header.scene = "balls", header.live = true, header.stages = frame.stage_names();
        FrameRecorder recorder(frame, header, parse_capture_triggers("0-40"), folder, FrameRecorder::kMostKeptBytes, 42);
        const Vec3d start = frame.world().haptics.state[0].device.position;
        for (int i = 0; i < 42; ++i) {
            const Vec3d velocity(0.03, 0.01 * i, -0.05);
            DeviceState& device = frame.world().haptics.state[0].device;
            device.position = start + i / 60.0 * velocity, device.velocity = velocity;
            frame.world().haptics.state[0].motion = {velocity, velocity};
            recorder.before_pass();
            frame.step();
            recorder.after_pass(pass_figures(frame, 0));
        }
        recorder.finish();
        const Capture capture = open_capture(folder / "passes_0-40.cap");
        for (const uint64_t pass : {0, 1, 15, 16, 17, 32, 40}) EXPECT_TRUE(profile_pass(capture, pass, 3, nullptr).same) << pass;
    });
    EXPECT_EQ(replay(open_capture(folder / "passes_0-40.cap")).difference, "");
}

// A ball that is cut while awake and again while asleep; nothing else moves it.
constexpr const char* kCutTwice = R"(
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "ball"
shape = "sphere"
size = 0.1
triangles = 400
motion = "deformable"
MODEL
[[cut]]
body = "ball"
sphere = [0.0, 0.0, 0.05, 0.03]
time = 0.2
[[cut]]
body = "ball"
sphere = [0.0, 0.05, 0.0, 0.03]
time = 1.6
)";

// Surfaces follow tears but are not part of a state: a restored world has the surfaces that belong to its
// state, before and after a cut, and a body that was asleep when captured stays asleep. Fails when a
// repetition starts with the surface left by the previous one, or a state after a cut has an uncut surface,
// which wakes the body.
void expect_cuts_run_again(const std::string& name, const std::string& model) {
    std::string text = kCutTwice;
    text.replace(text.find("MODEL"), 5, model);
    const WrittenScene scene("cut_again_" + name, text);
    const fs::path folder = captured_run("cut_again_" + name, "0-119,30-119", 120, [&] { return scene.build().world; });
    const Capture whole = open_capture(folder / "passes_0-119.cap"), later = open_capture(folder / "passes_30-119.cap");
    EXPECT_EQ(replay(later).difference, "");
    ThreadPool pool(2);
    pool.run([&] {
        Frame frame(world_at(whole, 0), {});
        for (uint64_t pass = 0; pass < 120; ++pass) {
            const size_t cuts = static_cast<size_t>(std::ranges::count(frame.world().torn.cut, uint8_t{1}));
            const uint32_t still = frame.world().sleep.still.empty() ? 0 : frame.world().sleep.still[0];
            frame.step();
            const bool now = static_cast<size_t>(std::ranges::count(frame.world().torn.cut, uint8_t{1})) != cuts;
            if (!now && pass % 13 != 0) continue;
            EXPECT_TRUE(profile_pass(whole, pass, 3, nullptr).same) << name << ", pass " << pass << ", still for " << still;
        }
        EXPECT_EQ(std::ranges::count(frame.world().torn.cut, uint8_t{1}), 2);
    });
}
TEST(Capture, APassWithACutRunsAgainAsItWas) {
    expect_cuts_run_again("shell", "");
    expect_cuts_run_again("solid", "model = \"solid\"\ncells = 6");
}

// Wherever the writer is interrupted, every complete record before that point can be read.
TEST(Capture, ACaptureCutShortAnywhereKeepsItsCompleteRecords) {
    const fs::path folder = captured_run("cut", "0-12", 14);
    const std::string whole = read_file_bytes(folder / "passes_0-12.cap");
    const CaptureFile complete = read_capture(folder / "passes_0-12.cap");
    std::mt19937 random(1);
    size_t before = 0;
    for (size_t size = 0; size < whole.size(); size += 1 + random() % (whole.size() / 100)) {
        write_bytes(folder / "cut.cap", whole.substr(0, size));
        if (size < 16) {
            EXPECT_THROW(read_capture(folder / "cut.cap"), InputError);
            continue;
        }
        const CaptureFile cut = read_capture(folder / "cut.cap");
        EXPECT_NE(cut.damage, "") << size;
        EXPECT_GE(cut.records.size(), before);
        before = cut.records.size();
        for (size_t i = 0; i < cut.records.size(); i += 7) EXPECT_EQ(first_difference(cut.records[i], complete.records[i]), "");
    }
    EXPECT_GE(before + 1, complete.records.size());
    EXPECT_EQ(complete.damage, "");
}

TEST(Capture, FlippedBytesAreSeen) {
    const fs::path folder = captured_run("flip", "0-3", 5);
    const std::string whole = read_file_bytes(folder / "passes_0-3.cap");
    std::mt19937 random(2);
    for (int i = 0; i < 100; ++i) {
        std::string flipped = whole;
        flipped[random() % flipped.size()] ^= static_cast<char>(1 + random() % 255);
        write_bytes(folder / "flipped.cap", flipped);
        try {
            EXPECT_NE(read_capture(folder / "flipped.cap").damage, "");
        } catch (const InputError&) {
        }
    }
}

// A capture with valid checksums and invalid contents ends in an error message or in a step, not in a crash
// (also run under the sanitizers). Breaks when find_fault misses an index.
TEST(Capture, HostileArraysAreRefusedOrHarmless) {
    const fs::path folder = captured_run("hostile", "12-14", 16);
    const CaptureFile good = read_capture(folder / "passes_12-14.cap");
    std::mt19937 random(3);
    uint32_t refused = 0;
    constexpr int kMutants = 250;
    for (int i = 0; i < kMutants; ++i) {
        CaptureFile bad = good;
        CaptureRecord& record = bad.records[1 + random() % 2];
        CaptureArray& array = record.arrays[random() % record.arrays.size()];
        if (array.bytes.empty()) continue;
        if (random() % 4 == 0) {
            const uint64_t rows = random() % array.rows;
            array.rows = rows;
            array.bytes.resize(rows * array.columns * element_size(array.type));
        } else {
            const size_t size = element_size(array.type), at = random() % (array.bytes.size() / size) * size;
            constexpr uint64_t kWords[] = {0, 1, 255, 65535, UINT32_MAX, UINT64_MAX, 0x7ff8000000000000, 1u << 31, 0x7f800000};
            const uint64_t word = kWords[random() % std::size(kWords)];
            std::memcpy(array.bytes.data() + at, &word, size);
        }
        const fs::path file = folder / "bad.cap";
        CaptureWriter writer(file);
        for (const CaptureRecord& r : bad.records) writer.add(r);
        writer.finish();
        const std::string reason = try_capture(file);
        refused += !reason.empty();
        EXPECT_EQ(reason.find('\n'), std::string::npos) << reason;
    }
    EXPECT_GT(refused, kMutants / 10u);
}

TEST(Capture, ABuiltSceneHasNoFault) {
    ThreadPool pool(1);
    pool.run([] { EXPECT_EQ(find_fault(quick_scene()), ""); });
}

TEST(Capture, TriggersAreReadOrTaught) {
    EXPECT_EQ(parse_capture_triggers("5-25").ranges[0][1], 25u);
    EXPECT_EQ(parse_capture_triggers("5-25,7-9,5-25").ranges, (std::vector<std::array<uint64_t, 2>>{{5, 25}, {7, 9}}));
    EXPECT_EQ(parse_capture_triggers("counter=expired_constraints,counter=late_passes").counters.size(), 2u);
    EXPECT_TRUE(parse_capture_triggers("worst,nan").lost);
    EXPECT_EQ(parse_capture_triggers("over=2.5").over_ms, 2.5);
    for (const char* bad : {"", "5", "25-5", "-5", "5-", "over=", "over=-1", "over=x", "counter=nothing", "worst,", "best", "over=1,over=2",
                            "5--7", "1-99999999999999999999999", "5-7x"})
        EXPECT_THROW(parse_capture_triggers(bad), InputError) << bad;
}

TEST(Capture, RangesMayOverlap) {
    const fs::path folder = captured_run("ranges", "2-20,18-33,40-41", 42);
    for (const auto& [file, first, count] :
         {std::tuple{"passes_2-20.cap", 2u, 19u}, {"passes_18-33.cap", 18u, 16u}, {"passes_40-41.cap", 40u, 2u}}) {
        const Capture capture = open_capture(folder / file);
        EXPECT_EQ(capture.stretches.front().pass, first) << file;
        EXPECT_EQ(capture.passes(), count) << file;
        EXPECT_EQ(replay(capture).difference, "") << file;
    }
}

// The numbers of a data array in a .vtp; empty if it is missing.
std::vector<double> vtp_array(const fs::path& file, const std::string& name) {
    const std::string text = read_text_file(file);
    const size_t at = text.find("Name=\"" + name + "\"");
    if (at == std::string::npos) return {};
    const size_t begin = text.find('>', at) + 1;
    std::istringstream numbers(text.substr(begin, text.find("</DataArray>", begin) - begin));
    return {std::istream_iterator<double>(numbers), {}};
}

// The single file per pass contains, in order, what the separate files of all bodies contain. Breaks when the
// rows or triangles of a body are shifted, or contacts are marked on the wrong body.
TEST(Capture, ParaViewGetsAllBodiesOfAPassInOneFile) {
    const fs::path folder = captured_run("vtp", "1-60", 61);
    ThreadPool pool(2);
    const Capture capture = open_capture(folder / "passes_1-60.cap");
    pool.run([&] { export_vtp(capture, folder / "all", false), export_vtp(capture, folder / "each", true); });
    uint64_t deep = 0;  // a pass with an overlap
    for (const Capture::Stretch& stretch : capture.stretches)
        for (const CaptureStep& step : stretch.steps)
            if (step.depth > 0) deep = step.pass;
    ASSERT_GT(deep, 0u);
    char number[16];
    std::snprintf(number, sizeof number, "_%06llu.vtp", static_cast<unsigned long long>(deep));
    EXPECT_NE(read_text_file(folder / "all/bodies.pvd").find(std::string("bodies") + number), std::string::npos);
    const fs::path all = folder / "all" / (std::string("bodies") + number);
    const std::vector<std::string>& names = world_at(capture, 0).bodies.name;
    ASSERT_GT(names.size(), 1u);
    std::string table = "body,name\n";
    std::vector<double> body, triangles;
    for (size_t i = 0; i < names.size(); ++i) {
        table += std::to_string(i) + "," + names[i] + "\n";
        const fs::path own = folder / "each" / (names[i] + number);
        EXPECT_NE(read_text_file(folder / "each" / (names[i] + ".pvd")).find(own.filename().string()), std::string::npos);
        const double first = static_cast<double>(body.size());
        for (const double corner : vtp_array(own, "connectivity")) triangles.push_back(first + corner);
        body.resize(body.size() + vtp_array(own, "depth").size(), static_cast<double>(i));
    }
    EXPECT_EQ(read_text_file(folder / "all/bodies.csv"), table);
    EXPECT_EQ(vtp_array(all, "body"), body);
    EXPECT_EQ(vtp_array(all, "connectivity"), triangles);
    for (const char* field : {"Points", "velocity", "depth", "contact", "strain", "stress"}) {
        std::vector<double> together;
        for (const std::string& name : names) {
            const auto own = vtp_array(folder / "each" / (name + number), field);
            together.insert(together.end(), own.begin(), own.end());
        }
        EXPECT_EQ(vtp_array(all, field), together) << field;
        EXPECT_NE(together, std::vector<double>(together.size(), 0.0)) << field;
    }
}

TEST(Capture, ParaViewFilesSayOfWhichMomentTheirFieldsAre) {
    const fs::path folder = captured_run("note", "3-4", 6);
    ThreadPool pool(1);
    pool.run([&] { export_vtp(open_capture(folder / "passes_3-4.cap"), folder / "vtp", false); });
    EXPECT_NE(
        read_text_file(folder / "vtp/bodies_000003.vtp").find("<!-- Points, velocity, strain and stress are of the end of the pass; depth"),
        std::string::npos);
}

// A slab is removed from a solid ball fixed at its lower half, and the part above drifts away. The springs
// across the gap are gone and have no strain. Breaks when strain uses the springs present at load: 34 at the
// end.
TEST(Capture, StrainIsOfTheSpringsThatAreLeft) {
    const WrittenScene scene(
        "strain",
        "[contact]\nrate = 60\n[[body]]\nname = \"ball\"\nshape = \"sphere\"\ntriangles = 300\nsize = 0.06\nmotion = \"deformable\"\n"
        "model = \"solid\"\ncells = 6\nfixed_below = -0.01\n[body.tissue]\nyoungs_modulus = 2e4\n"
        "[[cut]]\nname = \"slab\"\nbody = \"ball\"\ntime = 0.03\nbox = [-0.1, -0.1, 0.0, 0.1, 0.1, 0.012]\n");
    double before = 0, most = 0, apart = 0;
    uint64_t removed = 0;
    run(scene.build({{"gravity", "[6.0, 0.0, 6.0]"}}).world, 20, [&](const Frame& frame, int) {
        const World& w = frame.world();
        removed = w.report.removed_tetrahedra;
        const std::vector<float> strain = vertex_strain(w, 0);
        double& largest = removed == 0 ? before : most;
        largest = std::max<double>(largest, *std::max_element(strain.begin(), strain.end()));
        for (uint32_t v = 0; v < strain.size(); ++v) apart = std::max(apart, vertex_position(surfaces_of(w), 0, v).z());
    });
    EXPECT_GT(removed, 0u);
    EXPECT_GT(before, 0.001);
    EXPECT_GT(apart, 0.1) << "the cap has drifted away";
    EXPECT_LT(most, 3 * before);
}

// Killed by SIGKILL while writing: everything written before can be replayed.
TEST(Capture, AKilledRunLeavesAReadableCapture) {
    const fs::path folder = scratch_folder("killed");
    std::mt19937 random(4);
    uint32_t replayed = 0;
    for (int i = 0; i < 3; ++i) {
        const std::string out = folder / std::to_string(i);
        const pid_t child = fork();
        if (child == 0) {
            execl(program_path().c_str(), "trocar", "run", "probe_on_liver", "--no-render", "--seconds", "60", "--threads", "1", "--set",
                  "liver.triangles=600", "--capture", "0-100000", "--out", out.c_str(), nullptr);
            _exit(127);
        }
        const fs::path file = fs::path(out) / "captures/passes_0-100000.cap";
        for (int wait = 0; wait < 2000 && !(fs::exists(file) && fs::file_size(file) > 100000); ++wait) usleep(5000);
        usleep(static_cast<useconds_t>(random() % 50000));
        kill(child, SIGKILL);
        int status = 0;
        waitpid(child, &status, 0);
        ASSERT_TRUE(fs::exists(file));
        const CaptureFile records = read_capture(file);
        EXPECT_NE(records.damage, "");
        if (records.records.size() < 4) continue;
        const Capture capture = open_capture(file);
        EXPECT_EQ(replay(capture).difference, "");
        ++replayed;
    }
    EXPECT_GT(replayed, 0u);
}

TEST(CaptureCommand, RunCaptureReplayInfoDiff) {
    const fs::path folder = scratch_folder("command");
    const std::string run = "run kidney_on_liver --no-render --seconds 0.4 --set liver.triangles=600 --set kidney.triangles=400 --capture ";
    EXPECT_EQ(run_program(run + "2-9", folder, folder).code, 2) << "without --out";
    EXPECT_EQ(run_program(run + "sometimes --out out", folder, folder).code, 2);
    EXPECT_EQ(run_program(run + "2-9,worst --out out", folder, folder).code, 0);
    const Outcome info = run_program("capture info out/captures/passes_2-9.cap --json", folder, folder);
    EXPECT_NE(info.out.find("\"passes\":8"), std::string::npos) << info.out;
    const Outcome told = run_program("capture info out/captures/worst.cap", folder, folder);
    EXPECT_NE(told.out.find("its dearest pair: liver/kidney: "), std::string::npos) << told.out;
    EXPECT_NE(told.out.find(" candidate vertices, cell "), std::string::npos) << told.out;
    EXPECT_EQ(run_program("replay out/captures/worst.cap", folder, folder).code, 0);
    EXPECT_EQ(run_program("capture diff out/captures/worst.cap out/captures/passes_2-9.cap", folder, folder).code, 0);
    // a truncated capture is compared as far as it goes, and never reported as complete
    fs::copy_file(folder / "out/captures/passes_2-9.cap", folder / "cut.cap");
    fs::resize_file(folder / "cut.cap", fs::file_size(folder / "cut.cap") - 100);
    for (const char* command :
         {"replay cut.cap", "capture diff cut.cap out/captures/passes_2-9.cap", "capture export cut.cap --csv cut.csv"}) {
        const Outcome cut = run_program(command, folder, folder);
        EXPECT_EQ(cut.code, 1) << command;
        EXPECT_NE(cut.err.find("cut.cap is not whole"), std::string::npos) << cut.err;
    }
    EXPECT_EQ(run_program("capture export out/captures/worst.cap --csv same --trace same", folder, folder).code, 2);
    // a run removes the captures of an earlier one and reports which passes it could not capture
    const Outcome later = run_program(run + "900-901 --out out", folder, folder);
    EXPECT_EQ(later.code, 0);
    EXPECT_NE(later.err.find("900-901: the run ended before pass"), std::string::npos) << later.err;
    EXPECT_TRUE(fs::is_empty(folder / "out/captures"));
    // foreign files stay, and a scene that cannot be built deletes nothing
    fs::create_directories(folder / "out/frames");
    for (const char* own : {"out/meshes/mine.obj", "out/frames/photo.png"}) std::ofstream(folder / own) << "mine";
    std::ofstream(folder / "bad.toml") << "[[body]]\nname = \"a\"\nfile = \"nope.obj\"\n";
    EXPECT_EQ(run_program("run bad.toml --out out", folder, folder).code, 2);
    EXPECT_TRUE(fs::exists(folder / "out/metrics.json"));
    EXPECT_EQ(
        run_program("run kidney_on_liver --seconds 0.05 --set liver.triangles=600 --set kidney.triangles=400 --out out", folder, folder)
            .code,
        0);
    for (const char* own : {"out/meshes/mine.obj", "out/frames/photo.png", "out/frames/000000.png"})
        EXPECT_TRUE(fs::exists(folder / own)) << own;
    const Outcome none = run_program("replay " + std::string(source_folder() / "README.md"), folder, folder);
    EXPECT_EQ(none.code, 2);
    EXPECT_NE(none.err.find("is not a capture"), std::string::npos) << none.err;
}

// Breaks when captures omit a device limit: a replay would differ.
TEST(Capture, KeepsAllLimitsOfADevice) {
    constexpr size_t kNumbers = sizeof(DeviceLimits) / sizeof(double);
    std::array<double, kNumbers> number;
    for (size_t i = 0; i < kNumbers; ++i) number[i] = 0.125 + static_cast<double>(i);
    World saved = quick_scene(), loaded = quick_scene();
    std::memcpy(static_cast<void*>(&saved.haptics.tool.at(0).limits), number.data(), sizeof number);
    CaptureRecord record;
    save_resource(saved, Resource::kTools, record);
    load_resource(record, Resource::kTools, loaded);
    std::array<double, kNumbers> back;
    std::memcpy(back.data(), &loaded.haptics.tool.at(0).limits, sizeof back);
    EXPECT_EQ(back, number);
}

}  // namespace
}  // namespace trocar
