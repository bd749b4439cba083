#include "content/volume/volume.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
namespace trocar {
namespace {

template <typename Value>
Volume make_volume(VoxelType type, std::array<uint32_t, 3> size, const std::vector<Value>& values) {
    Volume volume;
    volume.type = type;
    volume.size = size;
    volume.voxels.assign(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(Value));
    return volume;
}

// 4 x 3 x 2 voxels; value 7 at (1,0,0), (2,0,0), (2,1,0) and, separately, at (3,2,1)
template <typename Value>
std::vector<Value> pattern() {
    std::vector<Value> v(24, 0);
    v[1] = v[2] = v[6] = v[23] = 7;
    v[0] = 3;
    return v;
}

TEST(Volume, ChosenVoxelsLieInTheirBoxWithAFrame) {
    const Volume volume = make_volume<uint8_t>(VoxelType::kUint8, {4, 3, 2}, pattern<uint8_t>());
    const VoxelMask mask = select_label(volume, 7, 2);
    EXPECT_EQ(mask.count, 4u);
    EXPECT_EQ(mask.first, (std::array<int64_t, 3>{-1, -2, -2}));
    EXPECT_EQ(mask.size, (std::array<uint32_t, 3>{7, 7, 6}));
    uint64_t sum = 0;
    for (uint32_t z = 0; z < 6; ++z) {
        for (uint32_t y = 0; y < 7; ++y) {
            for (uint32_t x = 0; x < 7; ++x) {
                const int64_t vx = int64_t(x) - 1, vy = int64_t(y) - 2, vz = int64_t(z) - 2;
                const bool in = vx >= 0 && vx < 4 && vy >= 0 && vy < 3 && vz >= 0 && vz < 2;
                const bool chosen = in && volume.voxels[size_t((vz * 3 + vy) * 4 + vx)] == 7;
                ASSERT_EQ(mask.inside[(z * 7 + y) * 7 + x], chosen) << x << ' ' << y << ' ' << z;
                sum += chosen;
            }
        }
    }
    EXPECT_EQ(sum, 4u);
    EXPECT_EQ(select_label(volume, 9, 1).count, 0u);
    EXPECT_TRUE(select_label(volume, 9, 1).inside.empty());
}

TEST(Volume, EveryVoxelTypeIsReadAsItsNumbers) {
    const auto check = [](const Volume& volume) {
        EXPECT_EQ(select_label(volume, 7, 1).count, 4u) << static_cast<int>(volume.type);
        EXPECT_EQ(select_above(volume, 3, 1).count, 5u) << static_cast<int>(volume.type);
        EXPECT_EQ(select_above(volume, 3.5, 1).count, 4u) << static_cast<int>(volume.type);
        const std::vector<std::pair<double, uint64_t>> expected{{0, 19}, {3, 1}, {7, 4}};
        EXPECT_EQ(count_values(volume), expected) << static_cast<int>(volume.type);
        EXPECT_EQ(volume.voxels.size(), 24 * scalar_bytes(volume.type));
    };
    check(make_volume<uint8_t>(VoxelType::kUint8, {4, 3, 2}, pattern<uint8_t>()));
    check(make_volume<int8_t>(VoxelType::kInt8, {4, 3, 2}, pattern<int8_t>()));
    check(make_volume<uint16_t>(VoxelType::kUint16, {4, 3, 2}, pattern<uint16_t>()));
    check(make_volume<int16_t>(VoxelType::kInt16, {4, 3, 2}, pattern<int16_t>()));
    check(make_volume<uint32_t>(VoxelType::kUint32, {4, 3, 2}, pattern<uint32_t>()));
    check(make_volume<int32_t>(VoxelType::kInt32, {4, 3, 2}, pattern<int32_t>()));
    check(make_volume<uint64_t>(VoxelType::kUint64, {4, 3, 2}, pattern<uint64_t>()));
    check(make_volume<int64_t>(VoxelType::kInt64, {4, 3, 2}, pattern<int64_t>()));
    check(make_volume<float>(VoxelType::kFloat, {4, 3, 2}, pattern<float>()));
    check(make_volume<double>(VoxelType::kDouble, {4, 3, 2}, pattern<double>()));
}

TEST(Volume, SignedAndFractionalValuesKeepTheirMeaning) {
    const Volume hu = make_volume<int16_t>(VoxelType::kInt16, {2, 2, 1}, {-1000, -5, 40, 300});
    EXPECT_EQ(select_above(hu, -100, 1).count, 3u);
    EXPECT_EQ(select_label(hu, -5, 1).count, 1u);
    EXPECT_EQ(select_label(hu, 65531, 1).count, 0u);
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const Volume odd = make_volume<float>(VoxelType::kFloat, {2, 2, 1}, {nan, 0.5f, 1.5f, nan});
    EXPECT_EQ(select_above(odd, -1e9, 1).count, 2u);
    EXPECT_EQ(select_label(odd, 0.5, 1).count, 1u);
    EXPECT_EQ(count_values(odd).size(), 2u);
}

TEST(Volume, MeasuredValuesAreNoLabelMap) {
    std::vector<uint16_t> many(1000);
    for (size_t i = 0; i < many.size(); ++i) many[i] = static_cast<uint16_t>(i);
    const Volume volume = make_volume(VoxelType::kUint16, {10, 10, 10}, many);
    EXPECT_TRUE(count_values(volume, 999).empty());
    EXPECT_EQ(count_values(volume, 1000).size(), 1000u);
}

// Pieces that meet only along an edge are separate.
TEST(Volume, PiecesHangTogetherAcrossFacesOnly) {
    std::vector<uint8_t> v(5 * 5 * 5, 0);
    const auto at = [&](int x, int y, int z) -> uint8_t& { return v[size_t((z * 5 + y) * 5 + x)]; };
    at(0, 0, 0) = at(1, 0, 0) = 1;                              // a piece of two
    at(2, 1, 0) = at(3, 1, 0) = at(3, 2, 0) = at(3, 2, 1) = 1;  // a piece of four, at an edge of the first
    at(4, 3, 2) = 1;                                            // a piece of one, at a corner of the second
    VoxelMask mask = select_label(make_volume(VoxelType::kUint8, {5, 5, 5}, v), 1, 1);
    EXPECT_EQ(mask.count, 7u);
    EXPECT_EQ(keep_largest_piece(mask), (std::vector<uint64_t>{4, 2, 1}));
    EXPECT_EQ(mask.count, 4u);
    const auto inside = [&](int x, int y, int z) {
        return mask.inside[(size_t(z + 1) * mask.size[1] + size_t(y + 1)) * mask.size[0] + size_t(x + 1)];
    };
    EXPECT_TRUE(inside(2, 1, 0) && inside(3, 1, 0) && inside(3, 2, 0) && inside(3, 2, 1));
    EXPECT_FALSE(inside(0, 0, 0) || inside(4, 3, 2));
    EXPECT_EQ(std::count(mask.inside.begin(), mask.inside.end(), 1), 4);
}

TEST(Volume, PlacesFollowTheSteps) {
    Volume volume;
    volume.origin = Vec3d(10, 20, 30);
    volume.step = {Vec3d(0, 2, 0), Vec3d(3, 0, 0), Vec3d(0, 0, 5)};  // mirrored: x and y exchanged
    EXPECT_EQ(place_of_index(volume, Vec3d(1, 2, 3)), Vec3d(16, 22, 45));
    EXPECT_DOUBLE_EQ(signed_voxel_volume(volume), -30);
    EXPECT_DOUBLE_EQ(voxel_volume(volume), 30);
}

}  // namespace
}  // namespace trocar
