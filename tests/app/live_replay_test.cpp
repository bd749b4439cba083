#include "systems/app/run/live_replay.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/run/live_run.hpp"
#include "tests/app/quick_scene.hpp"
namespace trocar {
namespace {
namespace fs = std::filesystem;

FrameOptions live_options() {
    FrameOptions options;
    options.external_ticks = true;
    return options;
}

// Runs `work` with a frame of the quick scene.
template <typename Work>
void with_frame(uint32_t threads, const Work& work) {
    ThreadPool pool(threads);
    pool.run([&] {
        Frame frame(quick_scene(), live_options());
        work(frame);
    });
}

// The message of a replay of this recording.
std::string replay_live(const LiveRecording& recording, uint32_t threads = 2) {
    std::string difference;
    with_frame(threads, [&](Frame& frame) {
        LiveReplay replay({}, recording, "file", frame);
        while (frame.world().clock.tick < replay.end_tick()) {
            replay.begin_pass();
            frame.step();
        }
        difference = replay.difference();
    });
    return difference;
}

fs::path scratch_file(const std::string& name) { return fs::path(testing::TempDir()) / ("trocar_" + name); }

std::string error_of(const fs::path& path) {
    try {
        read_live_recording(path);
    } catch (const InputError& e) {
        return e.what();
    }
    return "";
}

void expect_error(const LiveRecording& recording, const std::string& text) {
    try {
        replay_live(recording);
        ADD_FAILURE() << "accepted: " << text;
    } catch (const InputError& e) {
        EXPECT_NE(std::string(e.what()).find(text), std::string::npos) << e.what();
    }
}

// Three passes of the quick scene and five ticks far from every body.
LiveRecording made_up_recording() {
    LiveRecording r;
    with_frame(1, [&](Frame& frame) { r.start_hash = scene_hash(frame.world()); });
    r.state_hash = 1;
    r.tools = 1;
    r.slip = {0, 0, 0.25};
    r.taken = {0, 2, 5};
    for (uint64_t k = 0; k < 5; ++k) {
        LiveTick tick;
        tick.tick = k;
        tick.time = static_cast<double>(k) * 1e-3;
        tick.model_sequence = k < 2 ? 0 : 1;
        tick.sample.time = tick.time;
        tick.sample.position = {0.1, 0.2, 0.3};
        tick.sample.velocity = {-1, 1e-300, 3};
        tick.sample.buttons = 7;
        r.tick.push_back(tick);
    }
    return r;
}

// A slightly late pass is caught up with, so that a run follows the clock; a long stall is not.
TEST(LiveRun, CatchesUpWithLessThanAPass) {
    EXPECT_EQ(time_let_go(-5, 100), 0);
    EXPECT_EQ(time_let_go(100, 100), 0);
    EXPECT_EQ(time_let_go(101, 100), 101);
}

// A pass simulates the coming period: at its end the tool is where the hand is at that time, although the
// hand was sampled at the pass's start. Without extrapolation the tool would be v / 60 s behind. When the
// hand stops, the tool overshoots, but by at most two millimetres.
TEST(LiveRun, ToolsKeepUpWithTheHand) {
    with_frame(1, [](Frame& frame) {
        World& w = frame.world();
        const double pass = 1.0 / w.clock.contact_rate;
        const uint32_t body = w.haptics.tool[0].body;
        const Vec3d start = w.haptics.state[0].device.position + Vec3d(0, 0, 0.5);
        for (const double speed : {0.03, 0.4}) {
            const Vec3d velocity(speed, 0, 0.5 * speed);
            const auto hand = [&](double time) { return Vec3d(start + time * velocity); };
            const auto step = [&](const Vec3d& position, const Vec3d& moves) {
                w.haptics.state[0].device.position = position;
                w.haptics.state[0].motion = {moves, moves};
                w.haptics.state[0].device.velocity = moves + Vec3d(0, 0.3, 0);  // a velocity reported by a single sample has no effect
                frame.step();
                return Vec3d(w.poses.origin[body] + rotate(w.poses.orientation[body], w.haptics.tool[0].tip));
            };
            Vec3d tip;
            for (int k = 0; k < 60; ++k) tip = step(hand(k * pass), velocity);
            const double behind = std::max(0.0, velocity.norm() * pass - 2e-3);
            EXPECT_NEAR((tip - hand(60 * pass)).norm(), behind, 2e-5 + 0.01 * behind) << speed;
            const Vec3d end = hand(60 * pass);
            double farthest = 0;
            for (int k = 0; k < 60; ++k) {
                tip = step(end, Vec3d::Zero());
                farthest = std::max(farthest, (tip - end).dot(velocity.normalized()));
            }
            EXPECT_LT(farthest, 2.1e-3) << speed;
            EXPECT_NEAR((tip - end).norm(), 0, 1e-5) << speed;
        }
    });
}

// A run against the real clock with haptics on their own thread is reproduced bit for bit from its recording,
// through a file and with a different number of threads. Breaks when a value reaches the run by a path that
// is not recorded.
TEST(LiveReplay, ALiveRunComesOutTheSame) {
    LiveRecording recording;
    RunFigures figures;
    uint64_t hash = 0;
    with_frame(1, [&](Frame& frame) {
        for (const std::string& name : frame.stage_names()) figures.stage.push_back({name, {}});
        ASSERT_TRUE(run_live({{}, 0.5, frame, nullptr, nullptr, figures}, &recording));
        hash = state_hash(frame.world());
        EXPECT_GT(frame.world().report.contact_events, 0u);
    });
    EXPECT_EQ(recording.state_hash, hash);
    EXPECT_EQ(recording.slip.size(), 30u);
    EXPECT_GT(figures.max_force, 0.1);
    EXPECT_EQ(figures.ticks, recording.tick.size());
    EXPECT_GT(recording.taken.back(), 0u);
    const fs::path file = scratch_file("live.recording");
    write_live_recording(file, recording);
    const LiveRecording again = read_live_recording(file);
    fs::remove(file);
    for (const uint32_t threads : {1u, 3u}) EXPECT_EQ(replay_live(again, threads), "");

    // and the replay detects changes: a hand displaced by a nanometre, a force changed in its last bit
    LiveRecording changed = again;
    size_t felt = 0;
    while (changed.tick[felt].force.norm() == 0) ++felt;
    ASSERT_LT(felt, changed.taken.back());
    changed.tick[felt].sample.position.z() += 1e-9;
    EXPECT_NE(replay_live(changed).find("another force"), std::string::npos);
    changed = again;
    changed.tick[felt].force.x() = std::nextafter(changed.tick[felt].force.x(), 10);
    EXPECT_NE(replay_live(changed).find("1 haptic ticks gave another force"), std::string::npos);
}

// When pictures cannot be written, drawing ends at once with a reason, although another thread draws them. A
// full disk ends the pictures, not the session, and is reported.
TEST(LiveReplay, PicturesThatCannotBeWrittenEndThePicturesWithAReason) {
    const fs::path out = scratch_file("no_pictures");
    with_frame(1, [&](Frame& frame) {
        const World& w = frame.world();
        PictureWriter pictures(PictureParams{}, Camera{}, w.meshes, out);
        fs::remove_all(out / "frames");
        RunFigures figures;
        for (const std::string& name : frame.stage_names()) figures.stage.push_back({name, {}});
        run_live({{}, 0.5, frame, &pictures, nullptr, figures}, nullptr);
        EXPECT_NE(figures.write_failure.find("frames/000000.png"), std::string::npos) << figures.write_failure;
        EXPECT_GE(w.clock.tick, 500u);
        EXPECT_EQ(figures.pass.size(), 30u);
    });
    fs::remove_all(out);
}

TEST(LiveReplay, FilesReadBackToTheBit) {
    const LiveRecording r = made_up_recording();
    const fs::path file = scratch_file("bits.recording");
    write_live_recording(file, r);
    const LiveRecording back = read_live_recording(file);
    fs::remove(file);
    EXPECT_EQ(back.start_hash, r.start_hash);
    EXPECT_EQ(back.state_hash, r.state_hash);
    EXPECT_EQ(back.tools, r.tools);
    EXPECT_EQ(back.slip, r.slip);
    EXPECT_EQ(back.taken, r.taken);
    ASSERT_EQ(back.tick.size(), r.tick.size());
    for (size_t k = 0; k < r.tick.size(); ++k) {
        EXPECT_EQ(back.tick[k].tick, r.tick[k].tick);
        EXPECT_EQ(back.tick[k].time, r.tick[k].time);
        EXPECT_EQ(back.tick[k].tool, r.tick[k].tool);
        EXPECT_EQ(back.tick[k].model_sequence, r.tick[k].model_sequence);
        EXPECT_EQ(back.tick[k].sample.time, r.tick[k].sample.time);
        EXPECT_EQ(back.tick[k].sample.position, r.tick[k].sample.position);
        EXPECT_EQ(back.tick[k].sample.orientation.w, r.tick[k].sample.orientation.w);
        EXPECT_EQ(back.tick[k].sample.velocity, r.tick[k].sample.velocity);
        EXPECT_EQ(back.tick[k].sample.buttons, r.tick[k].sample.buttons);
        EXPECT_EQ(back.tick[k].force, r.tick[k].force);
    }
}

TEST(LiveReplay, BadFilesAreRefusedWithAReason) {
    const fs::path file = scratch_file("bad.recording");
    write_live_recording(file, made_up_recording());
    std::ifstream stream(file, std::ios::binary);
    const std::string whole((std::istreambuf_iterator<char>(stream)), {});
    const auto write = [&](const std::string& bytes) { std::ofstream(file, std::ios::binary) << bytes; };
    for (const size_t length : {size_t{8}, size_t{40}, size_t{56}, whole.size() / 2, whole.size() - 8, whole.size() - 1}) {
        write(whole.substr(0, length));
        EXPECT_NE(error_of(file).find("bad.recording: recording"), std::string::npos) << length << error_of(file);
        EXPECT_NE(error_of(file).find("cut short"), std::string::npos) << length << error_of(file);
    }
    for (size_t byte = 8; byte < whole.size(); byte += 5) {
        std::string damaged = whole;
        damaged[byte] = static_cast<char>(damaged[byte] ^ 0x10);
        write(damaged);
        EXPECT_NE(error_of(file), "") << byte;
    }
    write(whole + "x");
    EXPECT_NE(error_of(file).find("followed by something else"), std::string::npos) << error_of(file);
    write("name = \"x\"\n");
    EXPECT_NE(error_of(file).find("is not a recording"), std::string::npos) << error_of(file);
    write("");
    EXPECT_NE(error_of(file).find("is not a recording"), std::string::npos) << error_of(file);
    fs::remove(file);
    EXPECT_NE(error_of(file), "");
}

TEST(LiveReplay, AnotherSceneAndContradictionsAreRefused) {
    const LiveRecording good = made_up_recording();
    EXPECT_NE(replay_live(good).find("recorded 0000000000000001"), std::string::npos);  // its hash is invented; everything else matches
    LiveRecording bad = good;
    bad.start_hash ^= 1;
    expect_error(bad, "another scene");
    bad = good;
    bad.taken[2] = 6;  // there are only five ticks
    expect_error(bad, "a tick that is not there");
    bad = good;
    bad.taken[2] = 1;  // two had been taken already
    expect_error(bad, "a tick that is not there");
    bad = good;
    bad.tick[4].model_sequence = 3;  // the second model is published only in pass 2
    expect_error(bad, "tick 4 felt a surface");
    bad = good;
    bad.tick[4].model_sequence = 0;  // the previous tick used a newer model
    expect_error(bad, "tick 4 felt a surface");
}

}  // namespace
}  // namespace trocar
