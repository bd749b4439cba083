#include "engine/devices/device.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "engine/base/error.hpp"
#include "mutate/mutants.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

struct TemporaryFile {
    fs::path path = fs::temp_directory_path() / ("trocar_device_test_" + std::to_string(::getpid()) + ".csv");
    ~TemporaryFile() { fs::remove(path); }
    void write(const std::string& text) const { std::ofstream(path, std::ios::binary) << text; }
};

std::string message_of(const fs::path& path) {
    try {
        read_device_trace(path);
    } catch (const InputError& error) {
        return error.what();
    }
    return "";
}

constexpr const char* kHeader = "time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons\n";

std::vector<Keyframe> stroke() {
    return {{0.0, {0, 0, 0.02}, {}, 0}, {0.5, {0, 0, -0.01}, {}, 0}, {1.0, {0.03, 0, -0.01}, {}, 0}, {1.5, {0.03, 0, 0.02}, {}, 0}};
}

// ---- scripted ----

// Breaks when a key is missed or the velocity is not that of the path.
TEST(Device, ScriptedHandPassesItsKeysWithTheVelocityOfItsPath) {
    const std::vector<Keyframe> keys = stroke();
    Device hand;
    hand.path = keys;
    for (const Keyframe& key : keys) EXPECT_NEAR((read_device(hand, key.time).position - key.position).norm(), 0, 1e-15);
    const double h = 1e-6;
    for (double t = 0.01; t < 1.5; t += 0.0137) {
        const Vec3d slope = (read_device(hand, t + h).position - read_device(hand, t - h).position) / (2 * h);
        EXPECT_NEAR((read_device(hand, t).velocity - slope).norm(), 0, 1e-5) << t;
        EXPECT_EQ(read_device(hand, t).time, t);
    }
}

TEST(Device, ScriptedJumpHappensAtOnce) {
    std::vector<Keyframe> keys = stroke();
    keys.insert(keys.begin() + 2, {0.7, {0.1, 0, -0.01}, {}, 1});
    Device hand;
    hand.path = keys;
    EXPECT_NEAR(read_device(hand, 0.7 - 1e-9).position.x(), 0, 1e-6);
    EXPECT_NEAR(read_device(hand, 0.7).position.x(), 0.1, 1e-12);
}

TEST(Device, TremorIsOffByDefaultAndSmooth) {
    const std::vector<Keyframe> keys = {{0.0, {0.01, 0.02, 0.03}, {}, 0}};
    Device hand;
    hand.path = keys;
    EXPECT_EQ((read_device(hand, 0.37).position - keys[0].position).norm(), 0);
    hand.tremor.amplitude = 1e-4;
    double largest = 0;
    const double h = 1e-7;
    for (double t = 0; t < 2; t += 0.003) {
        const DeviceState s = read_device(hand, t);
        largest = std::max(largest, (s.position - keys[0].position).cwiseAbs().maxCoeff());
        const Vec3d slope = (read_device(hand, t + h).position - read_device(hand, t - h).position) / (2 * h);
        ASSERT_NEAR((s.velocity - slope).norm(), 0, 1e-7);
    }
    EXPECT_LE(largest, 1e-4);
    EXPECT_GT(largest, 0.99e-4);
}

// ---- recorded ----

std::vector<DeviceState> random_samples(uint32_t count) {
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    std::vector<DeviceState> samples(count);
    for (uint32_t k = 0; k < count; ++k) {
        DeviceState& s = samples[k];
        s.time = 1e-3 * k + 1e-7 * std::abs(normal(random));
        s.position = 0.1 * Vec3d(normal(random), normal(random), normal(random));
        s.velocity = Vec3d(normal(random), 1e-300 * normal(random), -0.0);
        const double a = normal(random);
        s.orientation = {std::cos(a), std::sin(a) * 0.6, 0, std::sin(a) * -0.8};
        s.buttons = static_cast<uint32_t>(random());
    }
    return samples;
}
bool same_bits(double a, double b) { return std::memcmp(&a, &b, sizeof a) == 0; }
bool same_bits(const DeviceState& a, const DeviceState& b) {
    bool same = same_bits(a.time, b.time) && a.buttons == b.buttons;
    for (int k = 0; k < 3; ++k) same = same && same_bits(a.position[k], b.position[k]) && same_bits(a.velocity[k], b.velocity[k]);
    return same && same_bits(a.orientation.w, b.orientation.w) && same_bits(a.orientation.x, b.orientation.x) &&
           same_bits(a.orientation.y, b.orientation.y) && same_bits(a.orientation.z, b.orientation.z);
}

// Breaks when a number loses a bit in the file.
TEST(Device, RecordingReadsBackBitForBit) {
    const TemporaryFile file;
    const std::vector<DeviceState> samples = random_samples(2000);
    write_device_trace(file.path, samples);
    const DeviceTrace trace = read_device_trace(file.path);
    ASSERT_EQ(trace.sample.size(), samples.size());
    for (size_t k = 0; k < samples.size(); ++k) ASSERT_TRUE(same_bits(samples[k], trace.sample[k])) << k;
}

TEST(Device, ReplayGivesTheNewestSampleAsRecorded) {
    const std::vector<DeviceState> samples = random_samples(100);
    Device device;
    device.trace = samples;
    for (size_t k = 0; k < samples.size(); ++k) {
        EXPECT_TRUE(same_bits(read_device(device, samples[k].time), samples[k]));
        if (k + 1 < samples.size()) {
            EXPECT_TRUE(same_bits(read_device(device, std::nextafter(samples[k + 1].time, 0.0)), samples[k]));
        }
    }
    EXPECT_TRUE(same_bits(read_device(device, -1), samples.front()));
    EXPECT_TRUE(same_bits(read_device(device, 1e9), samples.back()));
}

TEST(Device, ReadsWindowsLinesAndASpareEmptyLine) {
    const TemporaryFile file;
    std::string text = kHeader + std::string("0,1,2,3,1,0,0,0,4,5,6,7\n0.001,1,2,3,1,0,0,0,4,5,6,8\n\n");
    for (size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.replace(at, 1, "\r\n");
    file.write(text);
    const DeviceTrace trace = read_device_trace(file.path);
    ASSERT_EQ(trace.sample.size(), 2u);
    EXPECT_EQ(trace.sample[1].buttons, 8u);
    EXPECT_EQ(trace.sample[0].velocity, Vec3d(4, 5, 6));
}

// Orientations written with few digits are normalised.
TEST(Device, TurnsOfFewDigitsAreMadeUnit) {
    const TemporaryFile file;
    file.write(kHeader + std::string("0,1,2,3,1,0,0,0.0009,4,5,6,7\n"));
    const Quat q = read_device_trace(file.path).sample.at(0).orientation;
    EXPECT_NEAR(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z, 1, 1e-15);
    EXPECT_NEAR(q.z / q.w, 0.0009, 1e-15);
}

// Every kind of damage is reported with file, line and column.
TEST(Device, BadRecordingsAreRefusedWithTheirPlace) {
    const TemporaryFile file;
    const std::string good = "0,1,2,3,1,0,0,0,4,5,6,7\n", name = file.path.string();
    const struct {
        std::string text, position, reason;
    } cases[] = {
        {"", "", "no sample"},
        {kHeader, "", "no sample"},
        {"t,x,y\n" + good, ":1:1:", "header"},
        {kHeader + good + "1,2\n", ":3:4:", "expected 12 numbers, found 2"},
        {kHeader + good + "1,1,2,3,1,0,0,0,4,5,6,7,8\n", ":3:24:", "more than 12"},
        {kHeader + good + "1,1,two,3,1,0,0,0,4,5,6,7\n", ":3:5:", "not a number"},
        {kHeader + good + "1,1,,3,1,0,0,0,4,5,6,7\n", ":3:5:", "not a number"},
        {kHeader + good + "1,1,1e400,3,1,0,0,0,4,5,6,7\n", ":3:5:", "not a number in range"},
        {kHeader + good + "1,1,nan,3,1,0,0,0,4,5,6,7\n", ":3:5:", "not finite"},
        {kHeader + good + "1,1,2,3,1,0,0,0,4,5,inf,7\n", ":3:21:", "not finite"},
        {kHeader + good + "1,1,2,3,1,0,0,0,4,5,6,-7\n", ":3:23:", "not a number in range"},
        {kHeader + good + "1,1,2,3,1,1,0,0,4,5,6,7\n", ":3:1:", "unit quaternion"},
        {kHeader + good + "0,1,2,3,1,0,0,0,4,5,6,7\n", ":3:1:", "does not ascend"},
    };
    for (const auto& c : cases) {
        file.write(c.text);
        const std::string message = message_of(file.path);
        EXPECT_EQ(message.rfind(name + c.position, 0), 0u) << message;
        EXPECT_NE(message.find(c.reason), std::string::npos) << message;
    }
    EXPECT_NE(message_of("/nonexistent/trace.csv"), "");
}

// The grip has its own column, present only if a device has one.
TEST(Device, GripReadsBackBitForBit) {
    const TemporaryFile file;
    std::vector<DeviceState> samples = random_samples(100);
    for (size_t k = 0; k < samples.size(); ++k) samples[k].grip = 0.1 * std::sqrt(static_cast<double>(k));
    write_device_trace(file.path, samples);
    const DeviceTrace trace = read_device_trace(file.path);
    ASSERT_EQ(trace.sample.size(), samples.size());
    for (size_t k = 0; k < samples.size(); ++k)
        ASSERT_TRUE(same_bits(samples[k], trace.sample[k]) && same_bits(samples[k].grip, trace.sample[k].grip)) << k;
    file.write("time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons,grip\n0,1,2,3,1,0,0,0,4,5,6,7\n");
    EXPECT_NE(message_of(file.path).find("expected 13 numbers, found 12"), std::string::npos);
    file.write("time,x,y,z,qw,qx,qy,qz,vx,vy,vz,buttons,grip\n0,1,2,3,1,0,0,0,4,5,6,7,nan\n");
    EXPECT_NE(message_of(file.path).find("not finite"), std::string::npos);
}

// Damaged recordings are read completely or rejected in one line.
TEST(Device, FiveHundredMutantsOfARecordingAreReadOrRefused) {
    const TemporaryFile file;
    std::vector<mutate::Seed> seeds;
    for (const bool grip : {false, true}) {
        std::vector<DeviceState> samples = random_samples(20);
        samples[3].grip = grip ? 0.5 : 0;
        write_device_trace(file.path, samples);
        std::ifstream stream(file.path, std::ios::binary);
        seeds.push_back({"a.csv", std::string(std::istreambuf_iterator<char>(stream), {})});
    }
    size_t read = 0;
    for (uint64_t number = 0; number < 500; ++number) {
        file.write(mutate::make_mutant(seeds, number).bytes);
        try {
            const DeviceTrace trace = read_device_trace(file.path);
            ++read;
            ASSERT_FALSE(trace.sample.empty());
            for (const DeviceState& s : trace.sample)
                ASSERT_TRUE(s.position.allFinite() && s.velocity.allFinite() && std::isfinite(s.grip));
        } catch (const InputError& error) {
            ASSERT_EQ(std::string(error.what()).rfind(file.path.string(), 0), 0u) << error.what();
        }
    }
    EXPECT_GT(read, 5u);
    EXPECT_LT(read, 490u);
}

// ---- device selection ----

TEST(Device, ATraceComesBeforeAPath) {
    Haptics haptics;
    haptics.trace.push_back({random_samples(3)});
    Paths paths;
    paths.key = stroke();
    paths.keys = {{0, 1}, {1, 3}};
    HandTool tool;
    tool.path = 1;
    const Device scripted = device_of(haptics, paths, tool);
    EXPECT_TRUE(scripted.trace.empty());
    ASSERT_EQ(scripted.path.size(), 3u);
    EXPECT_EQ(scripted.path.data(), &paths.key[1]);
    tool.trace = 0;
    const Device recorded = device_of(haptics, paths, tool);
    EXPECT_EQ(recorded.trace.data(), haptics.trace[0].sample.data());
}

}  // namespace
}  // namespace trocar
