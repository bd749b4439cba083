#include "content/shapes/tube_organs.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/reference/closed_surface.hpp"
#include "tests/reference/profile_volume.hpp"
namespace trocar {
namespace {

// Distance of a point to a centre line, and the closest arc length, by testing the whole line.
double distance_to_line(const CentreLine& line, const Vec3d& p, double& s) {
    double nearest = 1e9;
    for (size_t i = 0; i < line.point.size(); ++i) {
        const double d = (line.point[i] - p).norm();
        if (d < nearest) nearest = d, s = line.length * double(i) / double(line.point.size() - 1);
    }
    return nearest;
}

TEST(TubeOrgans, VolumesMeetPappus) {
    // without swelling the polyhedron is inscribed: its volume converges from below
    for (const bool bowel : {false, true}) {
        const CentreLine line = bowel ? bowel_line() : gallbladder_line();
        const RadiusProfile profile = bowel ? bowel_profile() : gallbladder_profile();
        const double whole = reference::profile_volume(profile);
        double before = 1;
        for (const uint32_t triangles : {2000u, 20000u}) {
            const double volume = reference::survey_surface(loft_surface(tube_loft(line, profile), triangles)).volume;
            const double miss = 1 - volume / whole;
            EXPECT_GT(miss, 0) << bowel << triangles;
            EXPECT_LT(miss, 0.2 * before) << bowel << triangles;
            before = miss;
        }
        EXPECT_LT(before, 0.006) << bowel;
        // the irregularities of a seed change the volume only slightly
        const Mesh mesh = bowel ? make_bowel(20000, 1) : make_gallbladder(20000, 1);
        EXPECT_NEAR(reference::survey_surface(mesh).volume / whole, 1, 0.04) << bowel;
    }
}

TEST(TubeOrgans, BowelProfileIsACapsule) {
    const double r = 0.014, length = bowel_line().length;
    EXPECT_NEAR(length, 0.42, 1e-4);
    EXPECT_NEAR(reference::profile_volume(bowel_profile()), M_PI * r * r * (length - 2 * r) + 4.0 / 3 * M_PI * r * r * r, 1e-12);
}

TEST(TubeOrgans, GallbladderIsAPearWithANeckOfHumanSize) {
    const CentreLine line = gallbladder_line();
    const RadiusProfile profile = gallbladder_profile();
    EXPECT_NEAR(line.length, 0.1, 0.015);
    const double ml = reference::profile_volume(profile) * 1e6;
    EXPECT_GT(ml, 30);
    EXPECT_LT(ml, 50);
    const Mesh mesh = make_gallbladder(10000, 1);
    double body = 0, duct = 0;
    for (const Vec3d& p : mesh.position) {
        double s = 0;
        const double d = distance_to_line(line, p, s);
        if (s > 0.02 && s < 0.035) body = std::max(body, d);
        if (s > 0.085) duct = std::max(duct, d);
        if (s > 0.005 && s < line.length - 0.004) {
            EXPECT_NEAR(d / profile.radius(s), 1, 0.12) << s;
        }
    }
    EXPECT_NEAR(2 * body, 0.034, 0.003);
    EXPECT_NEAR(2 * duct, 0.0056, 0.001);
}

TEST(TubeOrgans, BowelHasContractions) {
    const CentreLine line = bowel_line();
    std::vector<double> least(30, 1), most(30, 0);
    for (const Vec3d& p : make_bowel(20000, 1).position) {
        double s = 0;
        const double d = distance_to_line(line, p, s);
        const size_t bin = std::min<size_t>(29, static_cast<size_t>(30 * s / line.length));
        least[bin] = std::min(least[bin], d), most[bin] = std::max(most[bin], d);
    }
    double narrow = 1, wide = 0;
    for (size_t i = 2; i < 28; ++i) {
        EXPECT_GT(least[i], 0.0120);
        EXPECT_LT(most[i], 0.0158);
        narrow = std::min(narrow, most[i]), wide = std::max(wide, most[i]);
    }
    EXPECT_GT(wide - narrow, 0.0006);
}

}  // namespace
}  // namespace trocar
