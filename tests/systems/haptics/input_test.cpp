#include "systems/haptics/input.hpp"

#include <gtest/gtest.h>
namespace trocar {
namespace {

// Two devices over one pass: every millisecond of each, both ends included, at whole-tick times even late in a run.
TEST(DeviceInput, EveryDeviceEveryMillisecond) {
    const std::vector<Keyframe> a = {{0.0, {0, 0, 0}, {}, 0}, {100.0, {1, 0, 0}, {}, 0}};
    const std::vector<DeviceState> b(1);
    std::vector<Device> devices(2);
    devices[0].path = a;
    devices[1].trace = b;
    std::vector<DeviceState> sample;
    read_devices(devices, 50'000, 17, sample);
    ASSERT_EQ(sample.size(), 2u * 18u);
    for (uint64_t k = 0; k <= 17; ++k) {
        EXPECT_EQ(sample[k].time, static_cast<double>(50'000 + k) * 1e-3);
        EXPECT_EQ(sample[k].position, read_device(devices[0], sample[k].time).position);
        EXPECT_EQ(sample[18 + k].time, 0);
    }
    EXPECT_GT(sample[17].position.x(), sample[0].position.x());
    // a later, shorter pass leaves nothing of the longer one
    read_devices(devices, 50'017, 16, sample);
    EXPECT_EQ(sample.size(), 2u * 17u);
    EXPECT_EQ(sample[0].time, 50.017);
}

}  // namespace
}  // namespace trocar
