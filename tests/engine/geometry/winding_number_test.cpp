#include "engine/geometry/winding_number.hpp"

#include <gtest/gtest.h>

#include "tests/engine/distance/closest_point_meshes.hpp"
namespace trocar {
namespace {

double winding(const TestMesh& m, const Vec3d& p) { return winding_number(m.position, m.triangle, p); }

TEST(WindingNumber, OneInsideZeroOutside) {
    const TestMesh cube = make_cube(), organ = make_organ(6);
    EXPECT_NEAR(winding(cube, {0.5, 0.4, 0.3}), 1, 1e-14);
    EXPECT_NEAR(winding(cube, {1.5, 0.4, 0.3}), 0, 1e-14);
    EXPECT_NEAR(winding(cube, {0.5, 0.4, 1 - 1e-9}), 1, 1e-8);
    EXPECT_NEAR(winding(cube, {0.5, 0.4, 1 + 1e-9}), 0, 1e-8);
    EXPECT_NEAR(winding(organ, {0, 0, 0}), 1, 1e-12);
    EXPECT_NEAR(winding(organ, {1e6, 2e6, 0}), 0, 1e-12);
}

// Solid angle of a square of half width w seen from height w above its centre is a sixth of the sphere.
TEST(WindingNumber, OpenSquareIsASixth) {
    const TestMesh square({{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}}, {{0, 1, 2}, {0, 2, 3}}, Admission::kSheet);
    EXPECT_NEAR(winding(square, {0, 0, -1}), 1.0 / 6, 1e-15);
    EXPECT_NEAR(winding(square, {0, 0, 1}), -1.0 / 6, 1e-15);
}

// G20: a unit sphere without the cap of half angle a has (1 + cos a) / 2 at its centre; a is measured at the
// mesh's own rim.
TEST(WindingNumber, G20_SphereMinusCap) {
    TestMesh sphere = make_icosphere(24);
    std::vector<Triangle> kept;
    double cap = 0;  // solid angle of the dropped faces by the closed form of a spherical triangle (l'Huilier)
    for (const Triangle& t : sphere.triangle) {
        const Vec3d &a = sphere.position[t[0]], &b = sphere.position[t[1]], &c = sphere.position[t[2]];
        if ((a + b + c).z() < 3 * 0.8) {
            kept.push_back(t);
            continue;
        }
        const auto angle = [](const Vec3d& u, const Vec3d& v) { return 2 * std::asin(0.5 * (u - v).norm()); };
        const double x = angle(b, c), y = angle(c, a), z = angle(a, b), s = 0.5 * (x + y + z);
        cap += 4 * std::atan(std::sqrt(std::tan(s / 2) * std::tan((s - x) / 2) * std::tan((s - y) / 2) * std::tan((s - z) / 2)));
    }
    const double w = winding_number(sphere.position, kept, Vec3d::Zero());
    EXPECT_NEAR(w, 1 - cap / (4 * M_PI), 1e-12);
    EXPECT_NEAR(w, (1 + 0.8) / 2, 0.01);  // the rim follows triangles, not the circle
}

// G21, G24: overlapping spheres have winding number two in the lens; a cavity is outside.
TEST(WindingNumber, G21_G24_OverlapsAddAndCavitiesSubtract) {
    const TestMesh one = make_icosphere(8);
    const auto join = [&](const Vec3d& shift, double scale, bool flip) {
        std::vector<Vec3d> position = one.position;
        std::vector<Triangle> triangle = one.triangle;
        const uint32_t n = static_cast<uint32_t>(one.position.size());
        for (const Vec3d& x : one.position) position.push_back(scale * x + shift);
        for (Triangle t : one.triangle) {
            if (flip) std::swap(t[1], t[2]);
            triangle.push_back({t[0] + n, t[1] + n, t[2] + n});
        }
        return TestMesh(position, triangle, Admission::kWinding);
    };
    const TestMesh lens = join({1, 0, 0}, 1, false), shell = join({0, 0, 0}, 0.5, true);
    EXPECT_NEAR(winding(lens, {0.5, 0, 0}), 2, 1e-12);
    EXPECT_NEAR(winding(lens, {-0.5, 0, 0}), 1, 1e-12);
    EXPECT_NEAR(winding(shell, {0, 0, 0}), 0, 1e-12);
    EXPECT_NEAR(winding(shell, {0.75, 0, 0}), 1, 1e-12);
}

TEST(WindingNumber, FloatPositionsGiveTheSameNumber) {
    const TestMesh organ = make_organ(5);
    const std::vector<Float4> offset = organ.offsets();
    std::vector<Vec3d> rounded;
    for (const Float4& o : offset) rounded.push_back({o.x, o.y, o.z});
    for (const Vec3d& p : points_in_box(organ, 50, 3))
        EXPECT_EQ(winding_number(offset, organ.triangle, p), winding_number(rounded, organ.triangle, p));
}

}  // namespace
}  // namespace trocar
