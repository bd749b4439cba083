#include "content/shapes/ring_and_sac.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

double area_of(const Mesh& mesh) {
    double area = 0;
    for (const auto& [a, b, c] : mesh.triangle)
        area += 0.5 * (mesh.position[b] - mesh.position[a]).cross(mesh.position[c] - mesh.position[a]).norm();
    return area;
}

// Volumes by Pappus and Guldin, the cannula's by slices across it (its funnel opens to the mean of its ends); a surface inscribed in a smooth one tends to it with the square of its edges.
TEST(RingAndSac, RingAndCannulaHaveTheirVolumes) {
    const double ring = 2 * M_PI * M_PI * 0.016 * 0.004 * 0.004, cannula = M_PI * 0.001 * (0.011 * 0.06 + 2 * 0.005 * 0.006);
    EXPECT_NEAR(reference::survey_surface(make_ring(100000)).volume / ring, 1, 1e-3);
    EXPECT_NEAR(reference::survey_surface(make_cannula(100000)).volume / cannula, 1, 1e-3);
}

// Areas by Pappus: a hemisphere, a cylinder and the inner quarter of a torus; one rim, in z = 0.
TEST(RingAndSac, SacHasItsAreaAndOneRim) {
    const double area = 2 * M_PI * 0.02 * 0.02 + 2 * M_PI * 0.02 * 0.024 + M_PI / 2 * 0.006 * 2 * M_PI * (0.026 - 2 / M_PI * 0.006);
    for (const uint32_t triangles : {1000u, 20000u}) {
        const Mesh sac = make_sac(triangles);
        EXPECT_NEAR(area_of(sac) / area, 1, 20.0 / triangles) << triangles;
        const auto [low, high] = std::ranges::minmax(sac.position, {}, [](const Vec3d& p) { return p.z(); });
        EXPECT_NEAR(low.z(), -0.05, 1e-12);
        EXPECT_EQ(high.z(), 0);
        const auto rim = std::ranges::count_if(sac.position, [](const Vec3d& p) { return p.z() > -1e-9; });
        double outward = 0;
        std::vector<std::pair<uint32_t, uint32_t>> edge;
        for (const Triangle& t : sac.triangle) {
            const Vec3d &a = sac.position[t[0]], &b = sac.position[t[1]], &c = sac.position[t[2]];
            outward += (b - a).cross(c - a).dot((a + b + c) / 3 + Vec3d(0, 0, 0.02));
            for (size_t k = 0; k < 3; ++k) edge.push_back(std::minmax(t[k], t[(k + 1) % 3]));
        }
        EXPECT_GT(outward, 0);
        std::ranges::sort(edge);
        long open = 0;
        for (size_t i = 0; i < edge.size(); ++i)
            open += (i == 0 || edge[i] != edge[i - 1]) && (i + 1 == edge.size() || edge[i] != edge[i + 1]);
        EXPECT_EQ(open, rim) << triangles;  // all rim edges are in z = 0
    }
}

}  // namespace
}  // namespace trocar
