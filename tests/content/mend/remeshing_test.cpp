#include "content/mend/remeshing.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "content/volume/marching_cubes.hpp"
#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

// A torus: genus 1, so a collapse that ignores the link condition would soon close or pinch its hole.
Mesh contour_torus(double h, double ring, double tube) {
    const uint32_t n = uint32_t(2 * (ring + tube) / h) + 4;
    ScalarGrid grid{Vec3d::Constant(-0.5 * h * (n - 1)), Vec3d::Constant(h), n, n, n, {}};
    for (uint32_t z = 0; z < n; ++z) {
        for (uint32_t y = 0; y < n; ++y) {
            for (uint32_t x = 0; x < n; ++x) {
                const Vec3d p = grid.origin + h * Vec3d(x, y, z);
                grid.values.push_back(float(std::hypot(std::hypot(p.x(), p.y()) - ring, p.z()) - tube));
            }
        }
    }
    return contour(grid, 0.0);
}

SurfaceProjection onto_torus(double ring, double tube) {
    return [=](const Vec3d& p) {
        const double r = std::hypot(p.x(), p.y());
        const Vec3d middle(p.x() / r * ring, p.y() / r * ring, 0);
        return Vec3d(middle + tube * (p - middle).normalized());
    };
}

TEST(Remeshing, ReachesTheCountAndKeepsGenusOrientationAndSurface) {
    for (const uint32_t wanted : {60u, 200u, 1000u, 4000u}) {
        Mesh mesh = contour_torus(0.04, 1.0, 0.35);
        ASSERT_EQ(reference::survey_surface(mesh).euler, 0);
        remesh_evenly({.triangles = wanted}, onto_torus(1.0, 0.35), mesh.position, mesh.triangle);
        const auto facts = reference::survey_surface(mesh);
        EXPECT_TRUE(facts.closed && facts.one_fan) << wanted;
        EXPECT_EQ(facts.euler, 0) << wanted;
        EXPECT_EQ(facts.components, 1u) << wanted;
        EXPECT_EQ(facts.unused_vertices, 0u) << wanted;
        EXPECT_EQ(reference::count_crossings(mesh), 0u) << wanted;
        EXPECT_NEAR(double(mesh.triangle.size()), wanted, 1.0) << wanted;
        for (const Vec3d& p : mesh.position) {
            ASSERT_NEAR(std::hypot(std::hypot(p.x(), p.y()) - 1.0, p.z()), 0.35, 1e-12);
        }
        if (wanted >= 1000) {
            const auto shape = reference::survey_shape(mesh);
            EXPECT_GT(shape.angle_p1, 28.0) << wanted;
            EXPECT_GT(shape.min_edge / shape.mean_edge, 0.35) << wanted;
            EXPECT_NEAR(facts.volume, 2 * M_PI * M_PI * 0.35 * 0.35, 0.05 * facts.volume) << wanted;
        }
    }
}

// The smallest closed surface has no collapsible edge, and a vertex of three triangles must not lose one.
TEST(Remeshing, NeverCollapsesATetrahedronOrADoublePyramid) {
    const SurfaceProjection stay = [](const Vec3d& p) { return p; };
    std::vector<Vec3d> four{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    std::vector<Triangle> faces{{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    remesh_evenly({.triangles = 2, .rounds = 0}, stay, four, faces);
    EXPECT_EQ(faces.size(), 4u);
    std::vector<Vec3d> five{{1, 0, 0}, {-0.5, 0.8, 0}, {-0.5, -0.8, 0}, {0, 0, 1}, {0, 0, -1}};
    std::vector<Triangle> six{{0, 1, 3}, {1, 2, 3}, {2, 0, 3}, {1, 0, 4}, {2, 1, 4}, {0, 2, 4}};
    remesh_evenly({.triangles = 2, .rounds = 0}, stay, five, six);
    Mesh mesh;
    mesh.position = five;
    mesh.triangle = six;
    EXPECT_TRUE(reference::survey_surface(mesh).closed);
    EXPECT_EQ(reference::survey_surface(mesh).euler, 2);
}

// A three-sided tube: the short edges go around it, and the ends of each have a third common neighbour that
// is in no triangle with both. Collapsing one would join four triangles at an edge.
TEST(Remeshing, DoesNotPinchATubeOfThreeSides) {
    Mesh mesh;
    std::vector<Triangle>& t = mesh.triangle;
    constexpr uint32_t kRings = 20;
    for (uint32_t ring = 0; ring < kRings; ++ring) {
        for (uint32_t k = 0; k < 3; ++k) {
            const double turn = 2 * M_PI * k / 3;
            mesh.position.push_back({0.2 * std::cos(turn), 0.2 * std::sin(turn), 0.5 * ring});
            if (ring == 0) continue;
            const uint32_t a = 3 * ring - 3 + k, b = 3 * ring - 3 + (k + 1) % 3;
            t.push_back({a, b, b + 3});
            t.push_back({a, b + 3, a + 3});
        }
    }
    const uint32_t low = 3 * kRings, high = low + 1, last = 3 * kRings - 3;
    mesh.position.push_back({0, 0, -0.4});
    mesh.position.push_back({0, 0, 0.5 * kRings - 0.1});
    for (uint32_t k = 0; k < 3; ++k) {
        t.push_back({low, (k + 1) % 3, k});
        t.push_back({high, last + k, last + (k + 1) % 3});
    }
    ASSERT_TRUE(reference::survey_surface(mesh).closed);
    const double volume = reference::survey_surface(mesh).volume;
    ASSERT_GT(volume, 0.0);
    remesh_evenly(
        {.triangles = 40, .rounds = 0}, [](const Vec3d& p) { return p; }, mesh.position, mesh.triangle);
    const auto facts = reference::survey_surface(mesh);
    EXPECT_TRUE(facts.closed && facts.one_fan);
    EXPECT_EQ(facts.euler, 2);
    EXPECT_LT(mesh.triangle.size(), 80u);
    EXPECT_GT(facts.volume, 0.5 * volume);
}

}  // namespace
}  // namespace trocar
