#include <gtest/gtest.h>

#include "engine/distance/closest_point.hpp"
#include "tests/engine/distance/hard_surfaces.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/exact_side.hpp"

// Signs against exact arithmetic.
namespace trocar {
namespace {

struct Count {
    uint64_t points = 0;
    uint64_t beyond = 0;  // farther than 1e-9 of the diagonal
    uint64_t wrong = 0;   // of all
    double farthest = 0;  // wrong sign, in diagonals
};

void expect_right_signs(const std::string& name, const TestMesh& mesh, const std::vector<Vec3d>& points, const ClosestPointTree& tree,
                        Count& count) {
    std::vector<SurfacePoint> got(points.size());
    const std::vector<double> radius(points.size(), std::numeric_limits<double>::infinity());
    QueryCounters counters;
    tree.query(points, radius, {}, got, counters);
    const double diagonal = mesh.diagonal();
    for (size_t i = 0; i < points.size(); ++i) {
        int windings;
        if (!exact_windings(mesh.position, mesh.triangle, points[i], windings)) continue;
        ++count.points;
        const double d = std::abs(got[i].distance) / diagonal;
        count.beyond += d > 1e-9;
        if ((got[i].distance < 0) == (windings > 0)) continue;
        ++count.wrong;
        count.farthest = std::max(count.farthest, d);
        EXPECT_LT(d, 1e-15) << name << ", point " << i << ", feature " << int(got[i].feature) << ", windings " << windings;
    }
}

// Doubles at 0, 1e3 and 1e5 diagonals from the origin, then the floats of a deformable body.
Count check_signs(uint32_t each) {
    Count all;
    for (const HardSurface& surface : hard_surfaces()) {
        Count count;
        uint64_t seed = 301;
        for (const double away : {0.0, 1e3, 1e5}) {
            const PlacedSurface placed = place_surface(surface.mesh, away, each, seed++);
            const ClosestPointTree tree(placed.mesh.view());
            expect_right_signs(surface.name, placed.mesh, placed.point, tree, count);
        }
        if (surface.name != "sheets 1e-7 apart" && surface.name != "slivers") {  // floats would fold these
            PlacedSurface placed = place_surface(surface.mesh, 0, each, seed);
            const std::vector<Float4> floats = placed.mesh.offsets();
            const ClosestPointTree tree(placed.mesh.view(), floats);
            for (size_t v = 0; v < floats.size(); ++v) placed.mesh.position[v] = Vec3d(floats[v].x, floats[v].y, floats[v].z);
            expect_right_signs(surface.name + ", floats", placed.mesh, placed.point, tree, count);
        }
        std::printf("[   figure ] %-20s %8llu points, %8llu beyond 1e-9 diagonals: %llu wrong signs (farthest %.1e)\n",
                    surface.name.c_str(), static_cast<unsigned long long>(count.points), static_cast<unsigned long long>(count.beyond),
                    static_cast<unsigned long long>(count.wrong), count.farthest);
        all.points += count.points;
        all.beyond += count.beyond;
        all.wrong += count.wrong;
    }
    return all;
}

TEST(WrongSigns, NoneAmongTenThousandPoints) {
    const Count count = check_signs(500);
    EXPECT_GT(count.beyond, 9000u);
}

TEST(WrongSigns, LongNoneAmongFourHundredThousandPoints) {
    const Count count = check_signs(20000);
    EXPECT_GE(count.beyond, 400000u);
}

TestMesh joined(const std::vector<TestMesh>& parts, Admission admission) {
    std::vector<Vec3d> position;
    std::vector<Triangle> triangle;
    for (const TestMesh& part : parts) {
        const uint32_t n = static_cast<uint32_t>(position.size());
        position.insert(position.end(), part.position.begin(), part.position.end());
        for (const Triangle& t : part.triangle) triangle.push_back({t[0] + n, t[1] + n, t[2] + n});
    }
    return TestMesh(position, triangle, admission);
}
TestMesh turned(TestMesh mesh) {
    for (Triangle& t : mesh.triangle) std::swap(t[1], t[2]);
    return TestMesh(mesh.position, mesh.triangle);
}

std::vector<Vec3d> points_about(const TestMesh& mesh, uint32_t each, uint64_t seed) { return place_surface(mesh, 0, 3 * each, seed).point; }

// G24, G25: the cavity of a shell is outside, an island in it inside; separate pieces form a union.
TEST(WrongSigns, G24_G25_HollowsIslandsAndSeveralPieces) {
    const TestMesh organ = make_organ(6);
    const auto sized = [&](double s) { return organ.moved([=](const Vec3d& x) { return Vec3d(s * x); }); };
    const TestMesh nested = joined({organ, turned(sized(0.8)), sized(0.5)}, Admission::kSolid);
    const TestMesh apart = joined({organ, organ.moved([](const Vec3d& x) { return Vec3d(x + Vec3d(0, 1.8, 0)); })}, Admission::kSolid);
    Count count;
    for (const TestMesh& mesh : {nested, apart}) {
        const ClosestPointTree tree(mesh.view());
        expect_right_signs("pieces", mesh, points_about(mesh, 500, 341), tree, count);
    }
    EXPECT_GT(count.beyond, 2500u);
    EXPECT_GT(ClosestPointTree(nested.view()).query({0, 0.47, 0}).distance, 0);
    EXPECT_LT(ClosestPointTree(nested.view()).query({0, 0, 0}).distance, 0);
}

// G17, G18, G19, G23: pseudonormals are not defined everywhere on these meshes; admission calls them kWinding
// (tests/content), and their sign is that of the winding number: an opposite double face adds zero, a fin of
// three faces on an edge adds its winding, two boxes on one corner are both inside, and one flipped face
// shifts the number by its solid angle.
TEST(WrongSigns, G17_G18_G19_G23_TheSignOfWhatIsNoSolidIsTheWindingNumbers) {
    const TestMesh organ = make_organ(6);
    const auto with = [&](std::vector<Triangle> extra) {
        std::vector<Triangle> triangle = organ.triangle;
        triangle.insert(triangle.end(), extra.begin(), extra.end());
        return TestMesh(organ.position, triangle, Admission::kWinding);
    };
    const Triangle t = organ.triangle[5];
    TestMesh flipped = organ;
    std::swap(flipped.triangle[5][1], flipped.triangle[5][2]);
    const uint32_t far = organ.triangle[400][0];
    const TestMesh cube = make_cube();
    TestMesh bow = joined({cube, cube.moved([](const Vec3d& x) { return Vec3d(x + Vec3d::Ones()); })}, Admission::kWinding);
    for (Triangle& face : bow.triangle)
        for (uint32_t& v : face) v = v == 8 ? 7 : v;  // one common corner
    bow = TestMesh(bow.position, bow.triangle, Admission::kWinding);
    const TestMesh meshes[] = {with({{t[0], t[2], t[1]}}), with({{t[0], t[1], far}}), bow,
                               TestMesh(flipped.position, flipped.triangle, Admission::kWinding)};
    for (size_t m = 0; m < std::size(meshes); ++m) {
        const ClosestPointTree tree(meshes[m].view());
        for (const Vec3d& p : points_about(meshes[m], 200, 351 + m)) {
            const SurfacePoint got = tree.query(p);
            const double winding = brute_force_winding(meshes[m].position, meshes[m].triangle, p);
            if (std::abs(winding - 0.5) < 1e-9 || std::abs(got.distance) < 1e-9) continue;
            ASSERT_EQ(got.distance<0, winding> 0.5) << "mesh " << m << ", " << p.transpose() << ", " << winding;
        }
    }
}

// G26: a blade one micrometre thick, at any position: vertices and points are doubles, or floats relative to
// the body's own origin. Floats of a body whose vertices are 10 m from its origin cannot represent it: its
// sides coincide, and its inside is empty.
TEST(WrongSigns, G26_SheetOfOneMicrometre) {
    const TestMesh blade = make_cube().moved([](const Vec3d& x) { return Vec3d(0.1 * x.x(), 0.1 * x.y(), 1e-6 * x.z()); });
    for (const double away : {0.0, 0.1, 1.0, 10.0, 1000.0}) {
        const Vec3d shift(0, 0, away);
        const TestMesh there = blade.moved([&](const Vec3d& x) { return Vec3d(x + shift); });
        const ClosestPointTree tree(there.view());
        for (const double x : {0.02, 0.05, 0.08}) {
            EXPECT_NEAR(tree.query(Vec3d(x, 0.06, 0.75e-6) + shift).distance, -0.25e-6, 1e-12 * (1 + away)) << away;
            EXPECT_NEAR(tree.query(Vec3d(x, 0.06, 1.25e-6) + shift).distance, 0.25e-6, 1e-12 * (1 + away)) << away;
            EXPECT_NEAR(tree.query(Vec3d(x, 0.06, -0.25e-6) + shift).distance, 0.25e-6, 1e-12 * (1 + away)) << away;
        }
        const std::vector<Float4> floats = there.offsets();
        const ClosestPointTree drawn(there.view(), floats);
        const double thickness = drawn.vertex(4).z() - drawn.vertex(0).z();
        const double middle = 0.5 * (drawn.vertex(4).z() + drawn.vertex(0).z());
        if (thickness > 0) {
            EXPECT_LT(drawn.query({0.05, 0.06, middle}).distance, 0) << away;
        } else {
            EXPECT_NEAR(drawn.query({0.05, 0.06, middle + 1e-7}).distance, 1e-7, 1e-12 * away) << away;
        }
        EXPECT_GT(drawn.query({0.05, 0.06, middle + 0.51 * thickness + 1e-9}).distance, 0) << away;
        EXPECT_GT(drawn.query({0.05, 0.06, middle - 0.51 * thickness - 1e-9}).distance, 0) << away;
    }
}

// The oracle against cases with a known result: the ray through vertices and edges (G35), and points on
// faces.
TEST(WrongSigns, G35_TheOracleCountsRaysThroughEdgesAndVerticesOnce) {
    const TestMesh cube = make_cube(), ball = make_icosphere(4);
    int windings;
    for (const double x : {0.0, 0.25, 0.5, 1.0})
        for (const double y : {0.0, 0.25, 0.5, 1.0}) {
            const bool inside = x > 0 && x < 1 && y > 0 && y < 1;
            if (inside) {
                ASSERT_TRUE(exact_windings(cube.position, cube.triangle, {x, y, 0.5}, windings));
                EXPECT_EQ(windings, 1) << x << " " << y;
                EXPECT_FALSE(exact_windings(cube.position, cube.triangle, {x, y, 1}, windings));
            }
            ASSERT_TRUE(exact_windings(cube.position, cube.triangle, {x, y, -0.5}, windings));
            EXPECT_EQ(windings, 0) << x << " " << y;
        }
    for (const Vec3d& v : ball.position) {
        ASSERT_TRUE(exact_windings(ball.position, ball.triangle, {v.x(), v.y(), -2}, windings));
        EXPECT_EQ(windings, 0);
        if (v.z() < 0.3) continue;
        ASSERT_TRUE(exact_windings(ball.position, ball.triangle, {v.x(), v.y(), 0}, windings));
        EXPECT_EQ(windings, 1);
    }
}

}  // namespace
}  // namespace trocar
