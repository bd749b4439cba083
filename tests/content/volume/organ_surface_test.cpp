#include "content/volume/organ_surface.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "content/volume/volume_file.hpp"
#include "engine/files/child_process.hpp"
#include "tests/reference/closed_surface.hpp"
#include "tests/reference/shared_data.hpp"
namespace trocar {
namespace {

// Voxels whose centre (in units of the volume) is accepted by `inside` are 1.
template <typename Inside>
Volume fill_volume(std::array<uint32_t, 3> size, const Vec3d& origin, const std::array<Vec3d, 3>& step, const Inside& inside) {
    Volume volume;
    volume.size = size;
    volume.origin = origin;
    volume.step = step;
    for (uint32_t z = 0; z < size[2]; ++z) {
        for (uint32_t y = 0; y < size[1]; ++y) {
            for (uint32_t x = 0; x < size[0]; ++x) {
                volume.voxels.push_back(inside(place_of_index(volume, Vec3d(x, y, z))) ? 1 : 0);
            }
        }
    }
    return volume;
}

std::array<Vec3d, 3> plain_steps(double s) { return {Vec3d(s, 0, 0), Vec3d(0, s, 0), Vec3d(0, 0, s)}; }

OrganSurface make(const Volume& volume, OrganParams params = {}) {
    return make_organ_surface(params, volume, select_label(volume, 1, organ_frame(params)));
}

void expect_solid(const OrganSurface& organ) {
    const auto facts = reference::survey_surface(organ.mesh);
    EXPECT_TRUE(facts.closed && facts.one_fan);
    EXPECT_EQ(facts.unused_vertices, 0u);
    EXPECT_EQ(reference::count_crossings(organ.mesh), 0u);
    EXPECT_EQ(organ.judgement.admitted_as, Admission::kSolid) << organ.judgement.reason;
    EXPECT_NEAR(organ.stages.back().volume, facts.volume, 1e-9 * facts.volume);
}

TEST(OrganSurface, ASphereKeepsItsVoxelsVolumeAndItsPlace) {
    const Vec3d centre(31, -12, 7);
    const double radius = 40;
    const Volume volume = fill_volume({70, 70, 70}, centre - Vec3d::Constant(52.2), plain_steps(1.5),
                                      [&](const Vec3d& p) { return (p - centre).norm() < radius; });
    const OrganSurface organ = make(volume);
    expect_solid(organ);
    const auto facts = reference::survey_surface(organ.mesh);
    const double voxels = double(std::count(volume.voxels.begin(), volume.voxels.end(), 1)) * 3.375;
    EXPECT_NEAR(organ.voxel_volume, voxels, 1e-9 * voxels);
    EXPECT_NEAR(facts.volume / voxels, 1, 2e-4);
    EXPECT_NEAR(facts.volume / (4.0 / 3 * M_PI * radius * radius * radius), 1, 5e-3);
    EXPECT_LT((facts.centroid - centre).norm(), 0.05);
    EXPECT_EQ(facts.components, 1u);
    EXPECT_EQ(facts.euler, 2);
    // voxel steps are gone: less than half as rough as the bare voxels
    const auto roughness = [&](const Mesh& mesh) {
        double sum = 0;
        for (const Vec3d& p : mesh.position) sum += std::pow((p - centre).norm() - radius, 2);
        return std::sqrt(sum / double(mesh.position.size()));
    };
    OrganParams bare;
    bare.blur = 0, bare.smooth = 0;
    EXPECT_LT(roughness(organ.mesh), 0.4 * roughness(make(volume, bare).mesh));
    EXPECT_LT(roughness(organ.mesh), 0.1 * 1.5);
}

// Sheared, rotated and mirrored voxel steps of three lengths: the surface is outward and at the position of
// the voxels.
TEST(OrganSurface, ObliqueMirroredVoxelsGiveAnOutwardSurfaceInPlace) {
    const Vec3d centre(-20, 5, 90);
    const std::array<Vec3d, 3> step{Vec3d(0.6, 0.8, 0) * 0.9, Vec3d(0.8, -0.6, 0) * 1.1, Vec3d(0, 0.1, 0.995) * 2.0};
    const Vec3d origin = centre - 40 * step[0] - 34 * step[1] - 20 * step[2];
    const Volume volume = fill_volume({80, 68, 40}, origin, step, [&](const Vec3d& p) { return (p - centre).norm() < 25; });
    ASSERT_LT(signed_voxel_volume(volume), 0);
    const OrganSurface organ = make(volume);
    expect_solid(organ);
    const auto facts = reference::survey_surface(organ.mesh);
    EXPECT_NEAR(facts.volume / organ.voxel_volume, 1, 2e-4);
    EXPECT_NEAR(facts.volume / (4.0 / 3 * M_PI * 15625), 1, 1e-2);
    EXPECT_LT((facts.centroid - centre).norm(), 0.1);
}

TEST(OrganSurface, WhatTouchesTheBorderOfTheVolumeIsClosed) {
    const Volume volume = fill_volume({24, 24, 24}, Vec3d::Zero(), plain_steps(1), [](const Vec3d& p) { return p.x() < 12; });
    const OrganSurface organ = make(volume);
    expect_solid(organ);
    EXPECT_NEAR(organ.stages.back().volume / (12 * 24 * 24), 1, 2e-4);
}

// A tube two voxels thick loses more than half of its volume at the usual level of one half.
TEST(OrganSurface, ThinPartsKeepTheirVolume) {
    const Volume volume = fill_volume({40, 12, 12}, Vec3d::Zero(), plain_steps(2), [](const Vec3d& p) {
        return p.x() > 6 && p.x() < 70 && p.y() > 9 && p.y() < 13 && p.z() > 9 && p.z() < 13;
    });
    const OrganSurface organ = make(volume);
    expect_solid(organ);
    EXPECT_NEAR(organ.stages.back().volume / organ.voxel_volume, 1, 2e-4);
}

TEST(OrganSurface, SmallerPiecesGoUnlessAskedFor) {
    const Volume volume = fill_volume({60, 30, 30}, Vec3d::Zero(), plain_steps(1), [](const Vec3d& p) {
        return (p - Vec3d(15, 15, 15)).norm() < 10 || (p - Vec3d(42, 15, 15)).norm() < 7;
    });
    const OrganSurface largest = make(volume);
    expect_solid(largest);
    ASSERT_EQ(largest.pieces.size(), 2u);
    EXPECT_EQ(largest.voxels_kept, largest.pieces[0]);
    EXPECT_EQ(largest.voxels_selected, largest.pieces[0] + largest.pieces[1]);
    EXPECT_EQ(largest.warnings.size(), 1u);
    EXPECT_EQ(reference::survey_surface(largest.mesh).components, 1u);
    OrganParams params;
    params.all_pieces = true;
    const OrganSurface all = make(volume, params);
    expect_solid(all);
    EXPECT_EQ(reference::survey_surface(all.mesh).components, 2u);
    EXPECT_NEAR(all.stages.back().volume / double(all.voxels_selected), 1, 2e-4);
}

TEST(OrganSurface, AHollowStaysAHollow) {
    const Volume volume = fill_volume({40, 40, 40}, Vec3d::Zero(), plain_steps(1), [](const Vec3d& p) {
        const double r = (p - Vec3d(19.5, 19.5, 19.5)).norm();
        return r < 17 && r > 8;
    });
    const OrganSurface organ = make(volume);
    expect_solid(organ);
    EXPECT_EQ(reference::survey_surface(organ.mesh).components, 2u);
    EXPECT_NEAR(organ.stages.back().volume / organ.voxel_volume, 1, 2e-4);
}

TEST(OrganSurface, SimplificationKeepsTheSurfaceClosedAndItsVolume) {
    const Volume volume = fill_volume({64, 64, 40}, Vec3d::Zero(), plain_steps(1), [](const Vec3d& p) {
        const double ring = std::hypot(p.x() - 31.3, p.y() - 31.8) - 18;
        return std::hypot(ring, p.z() - 19.6) < 8;
    });
    OrganParams params;
    for (const uint32_t wanted : {4000u, 1000u, 300u}) {
        params.triangles = wanted;
        params.even = !params.even;
        const OrganSurface organ = make(volume, params);
        expect_solid(organ);
        EXPECT_LE(organ.mesh.triangle.size(), wanted);
        EXPECT_GE(organ.mesh.triangle.size(), wanted * 0.9);
        EXPECT_EQ(reference::survey_surface(organ.mesh).euler, 0) << "a torus has one hole";
        const auto shape = reference::survey_shape(organ.mesh);
        EXPECT_GT(shape.min_edge / shape.mean_edge, params.even ? 0.35 : 0.02);
        EXPECT_NEAR(organ.stages.back().volume / organ.voxel_volume, 1, 1e-3) << wanted;
    }
}

TEST(OrganSurface, OneVoxelIsASmallBall) {
    const Volume volume =
        fill_volume({5, 5, 5}, Vec3d::Zero(), plain_steps(2), [](const Vec3d& p) { return (p - Vec3d(4, 4, 4)).norm() < 1; });
    const OrganSurface organ = make(volume);
    ASSERT_EQ(organ.voxels_kept, 1u);
    expect_solid(organ);
    EXPECT_NEAR(organ.stages.back().volume, 8, 0.01);
    ASSERT_EQ(organ.warnings.size(), 1u);  // eight triangles are not smoothed: they would shrink to nothing
    EXPECT_NE(organ.warnings[0].find("smoothing"), std::string::npos);
}

// Every label of at least `millilitres` within 1 % of its voxels' volume above 100 ml, 2 % below; returns the
// number of labels.
uint32_t check_labels(double millilitres) {
    const Volume volume = read_volume(reference::shared_data("volumes/abdomen_labels_u8.nrrd"));
    uint32_t organs = 0;
    for (const auto& [label, count] : count_values(volume)) {
        const double size = double(count) * voxel_volume(volume) * 1e-3;
        if (label == 0 || size < millilitres) continue;
        const OrganSurface organ = make_organ_surface({}, volume, select_label(volume, label, organ_frame({})));
        ++organs;
        EXPECT_EQ(organ.judgement.admitted_as, Admission::kSolid) << label << ": " << organ.judgement.reason;
        EXPECT_NEAR(organ.judgement.volume / (double(organ.pieces[0]) * 27), 1, size > 100 ? 0.01 : 0.02) << label;
    }
    return organs;
}

TEST(OrganSurface, LargeLabelsOfTheAbdomenAreSolidWithTheirVolume) {
    if (shared_data_folder().empty()) GTEST_SKIP() << "the folder of real data is absent";
    if (find_helper_program("trocar-volume-reader").empty()) GTEST_SKIP() << "built without ITK";
    EXPECT_EQ(check_labels(400), 6u);
}

TEST(OrganSurface, LongEveryLabelOfTheAbdomenIsSolidWithItsVolume) {
    if (shared_data_folder().empty()) GTEST_SKIP() << "the folder of real data is absent";
    if (find_helper_program("trocar-volume-reader").empty()) GTEST_SKIP() << "built without ITK";
    EXPECT_EQ(check_labels(10), 41u);
}

}  // namespace
}  // namespace trocar
