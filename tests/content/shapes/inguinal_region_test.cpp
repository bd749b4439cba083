#include "content/shapes/inguinal_region.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "content/mend/admission.hpp"
#include "content/shapes/tube.hpp"
#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

const InguinalRegion kRegion;

// Sections of the hole are circles of radius a - c cos(angle) at heights t / 2 sin(angle); a shift along y that depends on x and z keeps
// volumes.
TEST(InguinalWall, IsAPlateWithTheRingThroughIt) {
    const InguinalRegion& r = kRegion;
    const double hole = M_PI * r.thickness / 2 * (2 * r.ring * r.ring - M_PI * r.ring * r.rim + 4.0 / 3 * r.rim * r.rim);
    const double volume = r.thickness * M_PI * r.wall_x * r.wall_z - hole;
    for (const auto& [triangles, error] : {std::pair{1000u, 2e-2}, {10000u, 2e-3}, {60000u, 4e-4}}) {
        const Mesh mesh = make_inguinal_wall(triangles);
        const auto facts = reference::survey_surface(mesh);
        EXPECT_TRUE(facts.closed && facts.one_fan);
        EXPECT_EQ(facts.components, 1u);
        EXPECT_EQ(facts.euler, 0);
        EXPECT_NEAR(facts.volume / volume, 1, error) << triangles;
        for (size_t t = 0; t < mesh.triangle.size(); ++t) {
            if (mesh.triangle_material[t] == 0) continue;
            for (const uint32_t v : mesh.triangle[t]) {
                const Vec3d& p = mesh.position[v];
                ASSERT_NEAR(p.y(), r.inside(p.x(), p.z()) + (mesh.triangle_material[t] == 1 ? r.thickness : 0), 1e-12);
            }
        }
    }
}

// A line along y through the ring meets no face; a line beside it meets two.
TEST(InguinalWall, TheRingIsOpen) {
    const Mesh mesh = make_inguinal_wall(6000);
    const auto hits = [&](double x, double z) {
        int count = 0;
        for (const Triangle& t : mesh.triangle) {
            int inside = 0;
            for (int k = 0; k < 3; ++k) {
                const Vec3d &a = mesh.position[t[k]], &b = mesh.position[t[(k + 1) % 3]];
                inside += (b.x() - a.x()) * (z - a.z()) - (b.z() - a.z()) * (x - a.x()) > 0 ? 1 : -1;
            }
            count += std::abs(inside) == 3;
        }
        return count;
    };
    EXPECT_EQ(hits(0.0001, 0.0002), 0);
    EXPECT_EQ(hits(0.0105, 0.0003), 0);
    EXPECT_EQ(hits(0.0003, -0.0105), 0);
    EXPECT_EQ(hits(0.0153, 0.0003), 2);
    EXPECT_EQ(hits(-0.07, 0.0251), 2);
}

// Volume between the sac and the sheet over its neck: a half ball, a cylinder, and slices of the bend.
double sac_volume() {
    const double s = kRegion.sac, f = kRegion.flare, straight = kRegion.sac_depth - s - f;
    return 2.0 / 3 * M_PI * s * s * s + M_PI * s * s * straight + M_PI * f * ((s + f) * (s + f) - M_PI / 2 * (s + f) * f + 2.0 / 3 * f * f);
}

TEST(Peritoneum, IsADiscWithASacAndOneRim) {
    const InguinalRegion& r = kRegion;
    for (const uint32_t triangles : {1500u, 10000u, 40000u}) {
        const Mesh mesh = make_peritoneum(triangles);
        EXPECT_NEAR(double(mesh.triangle.size()), triangles, 0.1 * triangles);
        const MeshJudgement judgement = judge_mesh(mesh);
        EXPECT_EQ(judgement.admitted_as, Admission::kSheet);
        EXPECT_TRUE(judgement.manifold);
        EXPECT_EQ(judgement.components, 1u);
        EXPECT_EQ(judgement.self_crossing + judgement.self_touching + judgement.flipped_edges + judgement.degenerate, 0u);
        const uint32_t edges = (3 * judgement.triangles + judgement.boundary_edges) / 2;
        EXPECT_EQ(int(judgement.vertices) - int(edges) + int(judgement.triangles), 1);
        // the flux of (0, height over the sheet, 0) through it, by the midpoints of edges: exact for squares of x and z
        double flux = 0, facing = 0;
        uint32_t rim = 0;
        const auto height = [&](const Vec3d& p) { return p.y() - r.inside(p.x(), p.z()) + r.gap; };
        for (const auto& [i, j, k] : mesh.triangle) {
            const Vec3d &a = mesh.position[i], &b = mesh.position[j], &c = mesh.position[k];
            const double across = (b - a).cross(c - a).y() / 2;
            flux += across * (height((a + b) / 2) + height((b + c) / 2) + height((c + a) / 2)) / 3;
            facing += across;
        }
        for (const Vec3d& p : mesh.position)
            rim += std::abs(std::hypot((p.x() - r.middle_x) / r.peritoneum_x, p.z() / r.peritoneum_z) - 1) < 1e-9;
        EXPECT_EQ(rim, judgement.boundary_edges);
        // a polygon in the circle of the sac lacks edge^2 / (6 radius^2) of its area, and so do its arcs along the sac
        EXPECT_NEAR(-flux / sac_volume(), 1, 400.0 / triangles) << triangles;
        EXPECT_LT(-flux / sac_volume(), 1) << triangles;
        EXPECT_NEAR(-facing / (M_PI * r.peritoneum_x * r.peritoneum_z), 1, 20.0 / triangles) << triangles;  // towards the belly
        // its parts: what touches the rim; what is deeper than the sheet
        for (size_t t = 0; t < mesh.triangle.size(); ++t) {
            const auto of = [&](const auto& test) {
                return std::ranges::any_of(mesh.triangle[t], [&](uint32_t v) { return test(mesh.position[v]); });
            };
            const bool deep = of([&](const Vec3d& p) { return height(p) > 1e-9; });
            ASSERT_EQ(mesh.triangle_material[t] == 2, deep) << t;
        }
    }
}

// Length of a curve by chords, from 20,000 points of its own.
double length_of(const RegionTube& tube) {
    const auto curve = curve_through(tube.point);
    double length = 0;
    for (int i = 0; i < 20000; ++i) length += (curve((i + 1) / 20000.0) - curve(i / 20000.0)).norm();
    return length;
}

// Volumes by Pappus: cylinders with half balls at their ends, bent along their axes.
TEST(InguinalTubes, HaveTheirVolumes) {
    const std::pair<std::vector<RegionTube>, Mesh (*)(uint32_t)> all[] = {{cord_tubes(), make_cord},
                                                                          {epigastric_tubes(), make_epigastric_vessels},
                                                                          {iliac_tubes(), make_iliac_vessels},
                                                                          {pubic_tubes(), make_pubic_bone}};
    for (const auto& [tubes, make] : all) {
        double volume = 0;
        for (const RegionTube& tube : tubes) volume += M_PI * tube.radius * tube.radius * (length_of(tube) - 2.0 / 3 * tube.radius);
        const auto facts = reference::survey_surface(make(20000));
        EXPECT_TRUE(facts.closed && facts.one_fan);
        EXPECT_EQ(facts.components, tubes.size());
        EXPECT_EQ(facts.euler, 2 * int(tubes.size()));
        // what inscribed surfaces lack falls with the square of their edges: a quarter of it with four times the triangles
        const double coarse = reference::survey_surface(make(5000)).volume;
        EXPECT_NEAR((facts.volume + (facts.volume - coarse) / 3) / volume, 1, 2e-3);
    }
}

// At load nothing touches: the peritoneum is half a sheet of 1 mm and more away from every tube, and from the wall.
TEST(InguinalTubes, AreClearOfThePeritoneum) {
    constexpr double kHalfSheet = 5e-4;  // m
    const Mesh sheet = make_peritoneum(10000);
    for (const auto& tubes : {cord_tubes(), epigastric_tubes(), iliac_tubes(), pubic_tubes()}) {
        for (const RegionTube& tube : tubes) {
            const auto curve = curve_through(tube.point);
            double nearest = 1;
            for (int i = 0; i <= 300; ++i) {
                const Vec3d at = curve(i / 300.0);
                for (const Vec3d& p : sheet.position) nearest = std::min(nearest, (p - at).squaredNorm());
            }
            EXPECT_GT(std::sqrt(nearest), tube.radius + kHalfSheet);
        }
    }
    const InguinalRegion& r = kRegion;
    EXPECT_LT(r.sac + kHalfSheet, r.ring - r.rim);
}

}  // namespace
}  // namespace trocar
