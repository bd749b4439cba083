#include "engine/distance/closest_point.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <random>
#include <thread>

#include "engine/base/cpu.hpp"
#include "engine/distance/closest_point_kernels.hpp"
#include "tests/engine/distance/closest_point_meshes.hpp"
#include "tests/reference/brute_force_distance.hpp"
namespace trocar {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::vector<SurfacePoint> query_all(const ClosestPointTree& tree, const std::vector<Vec3d>& points, std::span<const uint32_t> hint = {},
                                    double radius = kInfinity, QueryCounters* counters = nullptr) {
    std::vector<SurfacePoint> out(points.size());
    const std::vector<double> radii(points.size(), radius);
    QueryCounters own;
    tree.query(points, radii, hint, out, counters ? *counters : own);
    return out;
}

bool same_bits(const SurfacePoint& a, const SurfacePoint& b) {
    return std::memcmp(a.point.data(), b.point.data(), sizeof(Vec3d)) == 0 &&
           std::memcmp(a.normal.data(), b.normal.data(), sizeof(Vec3d)) == 0 &&
           std::memcmp(&a.distance, &b.distance, sizeof(double)) == 0 && a.triangle == b.triangle && a.feature == b.feature;
}
void expect_same_bits(const std::vector<SurfacePoint>& a, const std::vector<SurfacePoint>& b, const char* what) {
    ASSERT_EQ(a.size(), b.size());
    for (size_t i = 0; i < a.size(); ++i) ASSERT_TRUE(same_bits(a[i], b[i])) << what << ", point " << i;
}

std::vector<Vec3d> hard_points(const TestMesh& mesh, uint32_t each, uint64_t seed) {
    std::vector<Vec3d> all = points_near(mesh, each, 0.01 * mesh.diagonal(), seed);
    for (const Vec3d& p : points_in_box(mesh, each, seed + 1)) all.push_back(p);
    for (const Vec3d& p : points_at_edges(mesh, each, seed + 2)) all.push_back(p);
    return all;
}

// Distances within 1e-12 of the diagonal of 113-bit brute force, signs those of the winding number beyond
// 1e-9 of it, and closest point, triangle and normal consistent with the distance.
void expect_equals_brute_force(const TestMesh& mesh, const ClosestPointTree& tree, const std::vector<Vec3d>& points,
                               const std::string& what) {
    const double diagonal = mesh.diagonal();
    double largest = 0;
    for (const Vec3d& x : mesh.position) largest = std::max(largest, x.cwiseAbs().maxCoeff());
    const double ulp = largest * 0x1p-52;  // of the closest point's own coordinates
    const std::vector<SurfacePoint> got = query_all(tree, points);
    double worst = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        const BruteForceAnswer truth = brute_force_distance(mesh.position, mesh.triangle, points[i]);
        ASSERT_NE(got[i].triangle, kNone) << what << ", point " << i;
        const double error = std::abs(std::abs(got[i].distance) - truth.distance);
        worst = std::max(worst, error);
        ASSERT_LE(error, 1e-12 * diagonal) << what << ", point " << i << ", distance " << truth.distance;
        if (truth.distance > 1e-9 * diagonal && mesh.info.admission != Admission::kSheet) {
            ASSERT_EQ(got[i].distance<0, truth.winding> 0.5) << what << ", point " << i << ", distance " << truth.distance << ", feature "
                                                             << int(got[i].feature) << ", winding " << truth.winding;
        }
        const Triangle& t = mesh.triangle[got[i].triangle];
        ASSERT_LE(exact_triangle_distance(got[i].point, mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]),
                  1e-12 * diagonal + 2 * ulp)
            << what;
        ASSERT_NEAR(got[i].normal.norm(), 1, 1e-12) << what << ", point " << i;
        if (truth.distance > 1e-6 * diagonal) {
            ASSERT_LE((points[i] - got[i].distance * got[i].normal - got[i].point).norm(), 1e-9 * diagonal + 4 * ulp)
                << what << ", point " << i;
        }
    }
    std::printf("[   figure ] %-40s worst distance error %.1e of the diagonal over %zu points\n", what.c_str(), worst / diagonal,
                points.size());
}

// The mesh in its own position, and 1e4 and 1e5 diagonals away (with rounded coordinates: another mesh,
// equally difficult).
void expect_equals_brute_force_anywhere(const TestMesh& mesh, const std::string& what, uint32_t each) {
    for (const double away : {0.0, 1e4, 1e5}) {
        const Vec3d shift = away * mesh.diagonal() * Vec3d(0.6, -0.64, 0.48);
        const TestMesh there = mesh.moved([&](const Vec3d& x) -> Vec3d { return x + shift; });
        std::vector<Vec3d> points = hard_points(mesh, away < 1e5 ? each : each / 4, 21);
        for (Vec3d& p : points) p += shift;
        const ClosestPointTree tree(there.view());
        expect_equals_brute_force(there, tree, points, what + " at " + std::to_string(int(away)) + " diagonals");
    }
}

std::vector<std::array<double, 2>> comb_polygon() {
    std::vector<std::array<double, 2>> p{{0, 0}, {1, 0}, {1, 1}};
    double x = 0.9;
    for (const double w : {1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-4, 1e-7, 1e-3}) {
        p.push_back({x, 1 + 0.1 * x * x});
        p.push_back({x - w, 1 + 0.1 * (x - w) * (x - w)});
        x -= 0.1;
    }
    p.push_back({0, 1});
    return p;
}

TEST(ClosestPoint, OrganEqualsBruteForce) { expect_equals_brute_force_anywhere(make_organ(22), "organ of 9680", 1000); }
TEST(ClosestPoint, NeedleEqualsBruteForce) {
    expect_equals_brute_force_anywhere(make_organ(8).moved([](const Vec3d& x) { return Vec3d(x.x(), 1e-3 * x.y(), 1e-3 * x.z()); }),
                                       "needle 1:1000", 1000);
}
TEST(ClosestPoint, ThinBladeEqualsBruteForce) {
    expect_equals_brute_force_anywhere(make_organ(8).moved([](const Vec3d& x) { return Vec3d(x.x(), x.y(), 1e-3 * x.z()); }), "blade 1e-3",
                                       1000);
}
TEST(ClosestPoint, G09_G10_SliversEqualBruteForce) {
    expect_equals_brute_force_anywhere(make_prism(comb_polygon(), {0.5, 0.4}), "slivers 1e-3..1e-7", 1000);
}
TEST(ClosestPoint, SheetsOneTenMillionthApartEqualBruteForce) {
    expect_equals_brute_force_anywhere(make_organ(8).moved([](const Vec3d& x) { return Vec3d(x.x(), x.y(), 2e-7 * x.z()); }), "sheets 1e-7",
                                       1000);
}
// G37: two faces far larger than the others; error relative to the query, not to the face.
TEST(ClosestPoint, G37_OneFaceAMillionTimesTheOthers) {
    TestMesh organ = make_organ(6);
    const uint32_t apex = static_cast<uint32_t>(organ.position.size());
    std::vector<Vec3d> position = organ.position;
    std::vector<Triangle> triangle = organ.triangle;
    const Triangle t = triangle[0];
    position.push_back(1000 * position[t[0]]);  // a spike a thousand organs long
    triangle[0] = {t[0], t[1], apex};
    triangle.push_back({t[1], t[2], apex});
    triangle.push_back({t[2], t[0], apex});
    const TestMesh spiked(position, triangle);
    std::vector<Vec3d> points = hard_points(organ, 200, 5);
    const ClosestPointTree tree(spiked.view());
    const std::vector<SurfacePoint> got = query_all(tree, points);
    for (size_t i = 0; i < points.size(); ++i) {
        const BruteForceAnswer truth = brute_force_distance(spiked.position, spiked.triangle, points[i]);
        ASSERT_NEAR(std::abs(got[i].distance), truth.distance, 1e-12) << i;
        if (truth.distance > 1e-9) {
            ASSERT_EQ(got[i].distance<0, truth.winding> 0.5) << i;
        }
    }
}

// The state of a deformable body is in floats: results are exact for them.
TEST(ClosestPoint, DeformableEqualsBruteForceOfItsFloats) {
    const TestMesh organ = make_organ(12);
    const std::vector<Float4> rest = organ.offsets();
    ClosestPointTree tree(organ.view(), rest);
    std::vector<Float4> now = rest;
    for (Float4& o : now) {
        o.x += 0.3f * std::sin(2 * o.y);
        o.y *= 1.2f;
    }
    tree.refit(now);
    TestMesh bent = organ;
    for (size_t v = 0; v < now.size(); ++v) bent.position[v] = {now[v].x, now[v].y, now[v].z};
    EXPECT_EQ(tree.vertex(7), bent.position[7]);
    expect_equals_brute_force(bent, tree, hard_points(bent, 400, 31), "refitted floats");
}

// Fails if the bound omits the rounding of the vertices, the query or the kernel (removing any term gives
// many misses).
TEST(ClosestPoint, FloatDistanceKeepsItsBound) {
    std::mt19937_64 random(41);
    std::uniform_real_distribution<double> unit(0, 1);
    uint32_t sound = 0, tight = 0;
    double closest_to_bound = 0;
    for (int i = 0; i < 20000; ++i) {
        const double aspect = std::pow(10.0, -7 * unit(random)), size = std::pow(10.0, -4 * unit(random));
        const Vec3d u = random_direction(random), w = random_direction(random);
        const Vec3d v = (w - w.dot(u) * u).normalized();
        const Vec3d a = (1.5 * unit(random)) * random_direction(random);
        const Vec3d b = a + size * u, c = a + size * ((i & 1 ? unit(random) : aspect * unit(random)) * u + aspect * v);
        const double s = unit(random), r = unit(random) * (1 - s);
        const double reach = 4 * std::pow(10.0, -8 * unit(random));
        const Vec3d p = a + s * (b - a) + r * (c - a) + reach * random_direction(random);
        Meshlet m{};
        const Vec3d corner[3] = {a, b, c};
        for (int k = 0; k < 16; ++k) {
            m.x[k] = static_cast<float>(corner[std::min(k, 2)].x());
            m.y[k] = static_cast<float>(corner[std::min(k, 2)].y());
            m.z[k] = static_cast<float>(corner[std::min(k, 2)].z());
            m.corner[1][k] = 1, m.corner[2][k] = 2;
        }
        m.float_lanes = 1;
        MeshletMeasure measure;
        kMeshletKernelsAvx2.measure(&m, &measure);
        ASSERT_TRUE(bound_error(&m, &measure));
        if (m.float_lanes == 0) {
            ASSERT_LT(aspect, 0.03) << "trusted float less than the rule asks";
            continue;
        }
        const float q[3] = {float(p.x()), float(p.y()), float(p.z())};
        alignas(64) float squared[16];
        uint32_t mask;
        kMeshletKernelsAvx2.distance(&m, q, 1, squared, &mask);
        const double exact = exact_triangle_distance(p, a, b, c);
        const double bound = m.error_base + m.error_slope * exact + 0x1p-24 * p.norm();
        const double error = std::abs(std::sqrt(squared[0]) - exact);
        ASSERT_LE(error, bound) << "aspect " << aspect << " size " << size << " reach " << reach << " case " << i;
        closest_to_bound = std::max(closest_to_bound, error / bound);
        tight += error > 0.1 * bound;
        ++sound;
    }
    EXPECT_GT(sound, 5000u);
    EXPECT_GT(tight, 50u) << "the bound is so wide that it tests nothing";
    std::printf("[   figure ] largest error / bound %.2f over %u triangles\n", closest_to_bound, sound);
}

Meshlet random_meshlet(std::mt19937_64& random, bool wide) {
    Meshlet m{};
    std::uniform_real_distribution<float> unit(-1, 1);
    for (int i = 0; i < 16; ++i) {
        m.x[i] = unit(random), m.y[i] = unit(random), m.z[i] = unit(random) * (random() % 4 ? 1.0f : 1e-6f);
        m.more_x[i] = unit(random), m.more_y[i] = unit(random), m.more_z[i] = unit(random);
        for (auto& row : m.corner) row[i] = static_cast<uint8_t>(random() % (wide ? 32 : 16));
    }
    m.wide = wide;
    m.float_lanes = 0xffff;
    return m;
}

TEST(ClosestPoint, Avx2AndAvx512KernelsGiveTheSameBits) {
    if (isa() != Isa::kAvx512) GTEST_SKIP() << "no AVX-512 here";
    std::mt19937_64 random(51);
    std::uniform_real_distribution<float> unit(-2, 2);
    for (int i = 0; i < 20000; ++i) {
        const Meshlet m = random_meshlet(random, i & 1);
        const float q[3] = {unit(random), unit(random), unit(random)};
        alignas(64) float two[16], five[16];
        uint32_t mask_two, mask_five;
        const float least_two = kMeshletKernelsAvx2.distance(&m, q, 0.5f, two, &mask_two);
        const float least_five = kMeshletKernelsAvx512.distance(&m, q, 0.5f, five, &mask_five);
        ASSERT_EQ(std::memcmp(two, five, sizeof two), 0) << i;
        ASSERT_EQ(mask_two, mask_five);
        ASSERT_EQ(std::memcmp(&least_two, &least_five, sizeof(float)), 0);
        MeshletMeasure a{}, b{};
        kMeshletKernelsAvx2.measure(&m, &a);
        kMeshletKernelsAvx512.measure(&m, &b);
        ASSERT_EQ(std::memcmp(&a, &b, sizeof a), 0) << i;
    }
}

TEST(ClosestPoint, AnswersDoNotDependOnTheInstructionSet) {
    const TestMesh organ = make_organ(14);
    const std::vector<Vec3d> points = hard_points(organ, 500, 61);
    const ClosestPointTree tree(organ.view());
    const std::vector<SurfacePoint> best = query_all(tree, points);
    force_avx2(true);
    EXPECT_EQ(isa(), Isa::kAvx2);
    const ClosestPointTree other(organ.view());
    const std::vector<SurfacePoint> plain = query_all(other, points);
    force_avx2(false);
    expect_same_bits(best, plain, "avx2 and the default");
}

TEST(ClosestPoint, AnswersDoNotDependOnHintsOrderOrBatch) {
    const TestMesh organ = make_organ(14);
    std::vector<Vec3d> points = hard_points(organ, 500, 71);
    const ClosestPointTree tree(organ.view());
    const std::vector<SurfacePoint> cold = query_all(tree, points);
    std::vector<uint32_t> hint;
    for (const SurfacePoint& s : cold) hint.push_back(s.triangle);
    expect_same_bits(cold, query_all(tree, points, hint), "right hints");
    std::mt19937_64 random(72);
    for (uint32_t& h : hint) h = random() % 8 ? static_cast<uint32_t>(random() % (organ.triangle.size() + 50)) : kNone;
    expect_same_bits(cold, query_all(tree, points, hint), "random hints, some out of range");
    for (size_t i = 0; i < points.size(); i += 7) ASSERT_TRUE(same_bits(cold[i], tree.query(points[i]))) << i;
    std::reverse(points.begin(), points.end());
    std::vector<SurfacePoint> backward = query_all(tree, points);
    std::reverse(backward.begin(), backward.end());
    expect_same_bits(cold, backward, "reversed order");
}

TEST(ClosestPoint, RefitEqualsRebuildEqualsFreshTree) {
    const TestMesh organ = make_organ(14);
    std::vector<Float4> now = organ.offsets();
    ClosestPointTree refitted(organ.view(), now), rebuilt(organ.view(), now);
    for (int frame = 1; frame <= 5; ++frame) {
        for (Float4& o : now) {
            o.x += 0.1f * std::sin(3 * o.y + frame);
            o.z += 0.1f * std::cos(2 * o.x);
        }
        refitted.refit(now);
        rebuilt.refit(now);
        rebuilt.rebuild();
        const ClosestPointTree fresh(organ.view(), now);
        TestMesh bent = organ;
        for (size_t v = 0; v < now.size(); ++v) bent.position[v] = {now[v].x, now[v].y, now[v].z};
        const std::vector<Vec3d> points = hard_points(bent, 200, 80 + frame);
        const std::vector<SurfacePoint> answers = query_all(refitted, points);
        expect_same_bits(answers, query_all(rebuilt, points), "rebuilt");
        expect_same_bits(answers, query_all(fresh, points), "fresh");
        for (size_t i = 0; i < points.size(); i += 29)
            ASSERT_NEAR(std::abs(answers[i].distance), brute_force_distance(bent.position, bent.triangle, points[i]).distance, 1e-12);
    }
}

TEST(ClosestPoint, RadiusBoundsTheSearchAndNothingElse) {
    const TestMesh organ = make_organ(14);
    const std::vector<Vec3d> points = hard_points(organ, 500, 91);
    const ClosestPointTree tree(organ.view());
    const std::vector<SurfacePoint> free = query_all(tree, points);
    for (const double radius : {0.0, 1e-4, 0.01, 0.2, 10.0}) {
        const std::vector<SurfacePoint> bound = query_all(tree, points, {}, radius);
        const std::vector<uint32_t> misleading(points.size(), 3);
        expect_same_bits(bound, query_all(tree, points, misleading, radius), "bounded with hints");
        for (size_t i = 0; i < points.size(); ++i) {
            if (std::abs(free[i].distance) < radius * (1 - 1e-12)) {
                ASSERT_TRUE(same_bits(free[i], bound[i])) << i;
            }
            if (std::abs(free[i].distance) > radius * (1 + 1e-12)) {
                ASSERT_EQ(bound[i].triangle, kNone) << i;
            }
        }
    }
    EXPECT_EQ(tree.query(points[0], -1).triangle, kNone);
    EXPECT_EQ(tree.query(points[0], std::nan("")).triangle, kNone);
}

// Our own traversal and rtcPointQuery, on every kind of mesh, with and without hints, bounds and refits.
TEST(ClosestPoint, OwnTraversalAndEmbreeGiveTheSameBits) {
    TestMesh soup = make_organ(5);
    std::vector<Vec3d> corner;
    for (Triangle& t : soup.triangle)
        for (uint32_t& v : t) {
            corner.push_back(soup.position[v]);
            v = static_cast<uint32_t>(corner.size()) - 1;
        }
    const TestMesh meshes[] = {make_organ(14),
                               make_cube(),
                               make_icosphere(8),
                               make_prism(comb_polygon(), {0.5, 0.4}),
                               make_organ(8).moved([](const Vec3d& x) { return Vec3d(x.x(), 1e-3 * x.y(), 1e-3 * x.z()); }),
                               make_organ(8).moved([](const Vec3d& x) { return Vec3d(x.x(), x.y(), 2e-7 * x.z()); }),
                               make_organ(6).moved([](const Vec3d& x) { return Vec3d(x + Vec3d(1e5, -1e5, 1e5)); }),
                               TestMesh(corner, soup.triangle, Admission::kWinding),
                               TestMesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}, Admission::kSheet)};
    for (size_t m = 0; m < std::size(meshes); ++m) {
        const TestMesh& mesh = meshes[m];
        std::vector<Vec3d> points = hard_points(mesh, mesh.triangle.size() > 200 ? 300 : 20, 200 + m);
        points.push_back(0.5 * (mesh.position[0] + mesh.position[1]));
        points.push_back(Vec3d::Zero());
        points.push_back(mesh.position[0] + 1e6 * Vec3d::Ones());
        std::vector<Float4> now = mesh.offsets();
        const ClosestPointTree embree(mesh.view(), nullptr, TreeSearch::kEmbree);
        ClosestPointTree moving_embree(mesh.view(), now, nullptr, TreeSearch::kEmbree);
        const ClosestPointTree own(mesh.view());
        ClosestPointTree moving_own(mesh.view(), now);
        const std::string name = "mesh " + std::to_string(m);
        const std::vector<SurfacePoint> answers = query_all(own, points);
        expect_same_bits(answers, query_all(embree, points), name.c_str());
        std::vector<uint32_t> hint;
        for (const SurfacePoint& s : answers) hint.push_back(s.triangle);
        expect_same_bits(answers, query_all(embree, points, hint), name.c_str());
        for (const double radius : {0.0, 1e-3 * mesh.diagonal(), 0.1 * mesh.diagonal()})
            expect_same_bits(query_all(own, points, {}, radius), query_all(embree, points, {}, radius), name.c_str());
        for (int frame = 0; frame < 3; ++frame) {
            for (Float4& o : now) o.x += 0.4f * std::sin(3 * o.y + float(frame)), o.z *= 1.3f;
            moving_own.refit(now);
            moving_embree.refit(now);
            expect_same_bits(query_all(moving_own, points), query_all(moving_embree, points), name.c_str());
        }
        EXPECT_EQ(moving_own.builds(), moving_embree.builds());
    }
}

// The tree is rebuilt once its nodes have grown by 30 %, and a tree refitted 40 times gives the same results
// as a new one. Copies share the groups of triangles, nothing else. Breaks when a shared tree uses the
// positions of the other, or reads the groups of a destroyed tree.
TEST(ClosestPoint, TreesCutLikeAnotherAnswerTheSame) {
    const TestMesh mesh = make_organ(10);
    std::vector<Float4> here, there;
    for (const Vec3d& x : mesh.position) {
        here.push_back({float(x.x()), float(x.y()), float(x.z()), 0});
        there.push_back({float(-x.y()), float(1.7 * x.x()), float(0.4 + x.z()), 0});
    }
    auto first = std::make_unique<ClosestPointTree>(mesh.view(), here);
    const ClosestPointTree alone(mesh.view(), there), like(mesh.view(), there, first.get()), rigid(mesh.view(), first.get());
    EXPECT_TRUE(like.cut_like(*first));
    EXPECT_TRUE(rigid.cut_like(*first));
    EXPECT_FALSE(alone.cut_like(*first));
    first.reset();
    const std::vector<Vec3d> points = hard_points(mesh, 300, 5);
    expect_same_bits(query_all(like, points), query_all(alone, points), "deformed");
    expect_same_bits(query_all(rigid, points), query_all(ClosestPointTree(mesh.view()), points), "rigid");
}

TEST(ClosestPoint, RebuildsWhenItsNodesHaveGrown) {
    const TestMesh organ = make_organ(14);
    std::vector<Float4> now = organ.offsets();
    ClosestPointTree tree(organ.view(), now);
    for (Float4& o : now) o.x += 1e-3f * std::sin(9 * o.y);
    tree.refit(now);
    EXPECT_EQ(tree.builds(), 1u) << "a small motion needs none";
    std::mt19937_64 random(211);
    std::uniform_real_distribution<float> unit(-0.02f, 0.02f);
    for (int frame = 0; frame < 40; ++frame) {
        for (Float4& o : now) o.x += unit(random), o.y += unit(random), o.z += unit(random);
        tree.refit(now);
    }
    EXPECT_GT(tree.builds(), 2u);
    EXPECT_LT(tree.builds(), 21u);
    const ClosestPointTree fresh(organ.view(), now);
    const std::vector<Vec3d> points = hard_points(organ, 300, 212);
    expect_same_bits(query_all(tree, points), query_all(fresh, points), "rebuilt");
}

TEST(ClosestPoint, SeveralThreadsMayAsk) {
    const TestMesh organ = make_organ(14);
    const std::vector<Vec3d> points = hard_points(organ, 1000, 101);
    const ClosestPointTree tree(organ.view());
    const std::vector<SurfacePoint> alone = query_all(tree, points);
    std::vector<SurfacePoint> together[3];
    std::vector<std::thread> threads;
    for (auto& out : together) threads.emplace_back([&] { out = query_all(tree, points); });
    for (std::thread& t : threads) t.join();
    for (const auto& out : together) expect_same_bits(alone, out, "three threads");
}

// G33: the centre of a sphere or the axis of a prism has up to hundreds of equidistant faces, more than there
// are slots; the result is still the least (d^2, triangle) for every traversal order.
TEST(ClosestPoint, G33_CentresTieMoreFacesThanThereAreSlotsAndAreStillExact) {
    std::vector<std::array<double, 2>> circle;
    for (int i = 0; i < 100; ++i) circle.push_back({std::cos(0.02 * M_PI * i), std::sin(0.02 * M_PI * i)});
    TestMesh prism = make_prism(circle, {0, 0}).moved([](const Vec3d& x) -> Vec3d { return x - Vec3d(0, 0, 0.5); });
    for (Vec3d& x : prism.position) x.z() *= 6;
    uint64_t overflows = 0;
    for (const TestMesh& mesh : {make_icosphere(4), make_icosphere(8), make_icosphere(16), prism}) {
        const ClosestPointTree tree(mesh.view());
        QueryCounters counters;
        const SurfacePoint got = query_all(tree, {Vec3d::Zero()}, {}, kInfinity, &counters)[0];
        overflows += counters.tie_overflows;
        const double truth = brute_force_distance(mesh.position, mesh.triangle, Vec3d::Zero()).distance;
        EXPECT_NEAR(got.distance, -truth, 1e-15);
        EXPECT_NEAR(got.normal.norm(), 1, 1e-12);
        for (uint32_t hint = 0; hint < mesh.triangle.size(); hint += 97)
            EXPECT_TRUE(same_bits(got, query_all(tree, {Vec3d::Zero()}, std::vector{hint})[0]));
        force_avx2(true);
        EXPECT_TRUE(same_bits(got, tree.query(Vec3d::Zero())));
        force_avx2(false);
    }
    EXPECT_GT(overflows, 0u) << "nothing here overflows: the restart is not tested";
}

TEST(ClosestPoint, G33_CentreOfACubeTakesTheFirstFace) {
    const TestMesh cube = make_cube();
    const ClosestPointTree tree(cube.view());
    const SurfacePoint got = tree.query({0.5, 0.5, 0.5});
    EXPECT_EQ(got.distance, -0.5);
    EXPECT_EQ(got.triangle, 0u);
    EXPECT_EQ(got.normal, Vec3d(0, 0, -1));
}

TEST(ClosestPoint, G01_G02_G03_PointsOnTheSurface) {
    const TestMesh cube = make_cube(), organ = make_organ(10);
    const ClosestPointTree cube_tree(cube.view()), organ_tree(organ.view());
    for (const Vec3d& x : organ.position) {
        const SurfacePoint got = organ_tree.query(x);
        ASSERT_EQ(got.distance, 0);
        ASSERT_NEAR(got.normal.norm(), 1, 1e-12);
        ASSERT_EQ(got.point, x);
    }
    const SurfacePoint corner = cube_tree.query({1, 1, 1});
    EXPECT_EQ(corner.distance, 0);
    EXPECT_NEAR((corner.normal - Vec3d(1, 1, 1) / std::sqrt(3.0)).norm(), 0, 1e-15);
    const SurfacePoint edge = cube_tree.query({1, 1, 0.3});
    EXPECT_EQ(edge.distance, 0);
    EXPECT_NEAR((edge.normal - Vec3d(1, 1, 0) / std::sqrt(2.0)).norm(), 0, 1e-15);
    const SurfacePoint face = cube_tree.query({1, 0.4, 0.3});
    EXPECT_EQ(face.distance, 0);
    EXPECT_EQ(face.normal, Vec3d(1, 0, 0));
}

TEST(ClosestPoint, G04_SignIsRightFromTwoUlp) {
    const TestMesh cube = make_cube();
    for (const double away : {0.0, 1e3, 1e6}) {
        const TestMesh there = cube.moved([&](const Vec3d& x) -> Vec3d { return x + Vec3d::Constant(away); });
        const ClosestPointTree tree(there.view());
        const double face = 1 + away;
        double out = face, in = face;
        for (int ulp = 1; ulp <= 4; ++ulp) {
            out = std::nextafter(out, kInfinity);
            in = std::nextafter(in, -kInfinity);
            if (ulp == 1) continue;
            EXPECT_EQ(tree.query({out, away + 0.4, away + 0.3}).distance, out - face);
            EXPECT_EQ(tree.query({in, away + 0.4, away + 0.3}).distance, in - face);
            // at the corner and the edge
            EXPECT_GT(tree.query({out, out, away + 0.3}).distance, 0);
            EXPECT_LT(tree.query({in, in, away + 0.3}).distance, 0);
            EXPECT_GT(tree.query({out, out, out}).distance, 0);
            EXPECT_LT(tree.query({in, in, in}).distance, 0);
        }
    }
}

TEST(ClosestPoint, G05_CoplanarOutsideAFace) {
    const TestMesh cube = make_cube();
    const ClosestPointTree tree(cube.view());
    EXPECT_EQ(tree.query({1, 1.5, 0.5}).distance, 0.5);
    EXPECT_NEAR(tree.query({1, 2, 2}).distance, std::sqrt(2.0), 1e-15);
    EXPECT_EQ(tree.query({3, 1, 1}).distance, 2);
}

// G06: a spike whose tip has one wide face and many narrow ones: area or uniform weights give the wrong sign.
TEST(ClosestPoint, G06_UnevenFanAtAVertex) {
    std::vector<std::array<double, 2>> rim;
    for (int i = 0; i < 20; ++i) rim.push_back({0.3 * std::cos(0.02 * i), 0.3 * std::sin(0.02 * i)});
    rim.push_back({-0.3, 0.1});
    rim.push_back({-0.3, -0.1});
    TestMesh prism = make_prism(rim, {0.05, 0.0});
    prism.position.back() = Vec3d(0.5, 0.05, 1.6);  // move the centre of the upper cap out and aside
    const ClosestPointTree tree(prism.view());
    const std::vector<Vec3d> points = [&] {
        std::mt19937_64 random(111);
        std::vector<Vec3d> p;
        for (int i = 0; i < 2000; ++i)
            p.push_back(prism.position[random() % prism.position.size()] +
                        std::pow(10.0, -1 - static_cast<double>(random() % 5)) * random_direction(random));
        return p;
    }();
    expect_equals_brute_force(prism, tree, points, "uneven fans");
}

TEST(ClosestPoint, G07_AcuteEdgeWithFacesOfVeryUnequalArea) {
    // a wedge of one degree; one side is a thousand times longer than the other, which is closed by a back
    // face
    const double a = 0.02, reach = 1000;
    const TestMesh wedge({{0, 0, 0}, {0, 0, 1}, {reach, 0, 0}, {reach, 0, 1}, {1, a, 0}, {1, a, 1}},
                         {{0, 2, 3}, {0, 3, 1}, {0, 1, 5}, {0, 5, 4}, {4, 5, 3}, {4, 3, 2}, {0, 4, 2}, {1, 3, 5}});
    const ClosestPointTree tree(wedge.view());
    std::mt19937_64 random(121);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<Vec3d> points;
    for (int i = 0; i < 2000; ++i)
        points.push_back(Vec3d(0, 0, unit(random)) + std::pow(10.0, -6 * unit(random)) * random_direction(random));
    expect_equals_brute_force(wedge, tree, points, "acute wedge");
}

// G08: on the border between a face and its edge the sign must not depend on which of the two rounding
// selects.
TEST(ClosestPoint, G08_TieOfFaceAndEdge) {
    const TestMesh cube = make_cube();
    const ClosestPointTree tree(cube.view());
    for (double y = 1 - 8 * 0x1p-53; y < 1 + 8 * 0x1p-52; y = std::nextafter(y, 2.0)) {
        EXPECT_NEAR(tree.query({1.25, y, 0.5}).distance, 0.25, 1e-15);
        EXPECT_NEAR(tree.query({0.75, std::min(y, 1.0) - 0.25, 0.5}).distance, -0.25, 1e-15);
    }
}

TEST(ClosestPoint, G11_G12_TrianglesWithoutArea) {
    // a cube with a collinear triangle along an edge and one collapsed to a corner: both are on the surface
    // and must not change a result
    const TestMesh cube = make_cube();
    std::vector<Vec3d> position = cube.position;
    std::vector<Triangle> triangle = cube.triangle;
    position.push_back({1, 1, 0.5});
    position.push_back({1, 1, 1});
    triangle.push_back({3, 8, 7});
    triangle.push_back({7, 9, 9});
    const TestMesh soiled(position, triangle);
    const ClosestPointTree tree(soiled.view()), clean(cube.view());
    const std::vector<Vec3d> points = hard_points(cube, 500, 131);
    const std::vector<SurfacePoint> got = query_all(tree, points), want = query_all(clean, points);
    for (size_t i = 0; i < points.size(); ++i) {
        ASSERT_NEAR(got[i].distance, want[i].distance, 1e-15) << i;
        ASSERT_NEAR(got[i].normal.norm(), 1, 1e-12);
    }
    // a closed cube whose edge 3-7 is a pair of zero-area faces, translated so that differences round
    const Vec3d shift(0.1, 7.3, -1.7);
    TestMesh pinched({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 1, 0.3}}, {{8, 3, 7},
                                                                                                                             {0, 2, 3},
                                                                                                                             {0, 3, 1},
                                                                                                                             {4, 5, 7},
                                                                                                                             {4, 7, 6},
                                                                                                                             {0, 1, 5},
                                                                                                                             {0, 5, 4},
                                                                                                                             {2, 6, 7},
                                                                                                                             {2, 7, 3},
                                                                                                                             {0, 4, 6},
                                                                                                                             {0, 6, 2},
                                                                                                                             {1, 3, 8},
                                                                                                                             {1, 8, 7},
                                                                                                                             {1, 7, 5}});
    for (Vec3d& x : pinched.position) x += shift;
    const ClosestPointTree pinched_tree(pinched.view());
    std::mt19937_64 random(132);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<Vec3d> around;
    for (int i = 0; i < 2000; ++i)
        around.push_back(shift + Vec3d(1, 1, unit(random)) + std::pow(10.0, -1 - 6 * unit(random)) * random_direction(random));
    expect_equals_brute_force(pinched, pinched_tree, around, "faces without area");
    const TestMesh segment({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{0, 1, 2}}, Admission::kSheet);
    const ClosestPointTree segment_tree(segment.view());
    EXPECT_EQ(segment_tree.query({1.5, 3, 4}).distance, 5);
    EXPECT_EQ(segment_tree.query({1.5, 0, 0}).distance, 0);
    EXPECT_NEAR(segment_tree.query({1.5, 0, 0}).normal.norm(), 1, 1e-15);
    const TestMesh dot({{1, 2, 3}, {1, 2, 3}, {1, 2, 3}}, {{0, 1, 2}}, Admission::kSheet);
    const ClosestPointTree dot_tree(dot.view());
    EXPECT_EQ(dot_tree.query({1, 5, 7}).distance, 5);
}

TEST(ClosestPoint, G16_G21_WindingMeshesTakeTheirSignFromTheWindingNumber) {
    const TestMesh one = make_organ(6);
    std::vector<Vec3d> position = one.position;
    std::vector<Triangle> triangle = one.triangle;
    const uint32_t n = static_cast<uint32_t>(position.size());
    for (const Vec3d& x : one.position) position.push_back(x + Vec3d(0.7, 0.2, 0.1));
    for (const Triangle& t : one.triangle) triangle.push_back({t[0] + n, t[1] + n, t[2] + n});
    triangle.push_back(triangle[3]);  // a duplicate face
    const TestMesh both(position, triangle, Admission::kWinding);
    const ClosestPointTree tree(both.view());
    expect_equals_brute_force(both, tree, hard_points(both, 300, 141), "crossing organs");
}

TEST(ClosestPoint, G20_SheetsHaveNoInside) {
    TestMesh organ = make_organ(8);
    organ.triangle.resize(organ.triangle.size() / 2);
    const TestMesh sheet(organ.position, organ.triangle, Admission::kSheet);
    const ClosestPointTree tree(sheet.view());
    for (const SurfacePoint& s : query_all(tree, hard_points(sheet, 300, 151))) ASSERT_GE(s.distance, 0);
    expect_equals_brute_force(sheet, tree, hard_points(sheet, 300, 151), "sheet");
}

TEST(ClosestPoint, G27_G28_G29_OffsetAndScale) {
    const TestMesh organ = make_organ(8);
    const std::vector<Vec3d> points = hard_points(organ, 200, 161);
    const std::vector<SurfacePoint> here = query_all(ClosestPointTree(organ.view()), points);
    for (const double scale : {0x1p-40, 0x1p-30, 0x1p-20, 0x1p20, 0x1p30, 0x1p40}) {
        const TestMesh scaled = organ.moved([&](const Vec3d& x) -> Vec3d { return scale * x; });
        std::vector<Vec3d> moved = points;
        for (Vec3d& p : moved) p *= scale;
        const std::vector<SurfacePoint> there = query_all(ClosestPointTree(scaled.view()), moved);
        for (size_t i = 0; i < points.size(); ++i) {
            ASSERT_EQ(there[i].distance, scale * here[i].distance) << scale;
            ASSERT_EQ(there[i].triangle, here[i].triangle);
        }
    }
    for (const double away : {1e3, 1e6}) {
        const TestMesh there = organ.moved([&](const Vec3d& x) -> Vec3d { return x + Vec3d(away, -away, away); });
        std::vector<Vec3d> moved = points;
        for (Vec3d& p : moved) p += Vec3d(away, -away, away);
        expect_equals_brute_force(there, ClosestPointTree(there.view()), moved, "offset " + std::to_string(int(away)));
    }
}

// Distances of far queries tie in float; the result must not change.
TEST(ClosestPoint, FarQueriesAreExact) {
    const TestMesh organ = make_organ(10);
    const ClosestPointTree tree(organ.view());
    std::mt19937_64 random(171);
    for (const double far : {10.0, 1e3, 1e6, 1e12, 1e17, 1e30}) {
        for (int i = 0; i < 10; ++i) {
            const Vec3d p = far * random_direction(random);
            const SurfacePoint got = tree.query(p);
            const double truth = brute_force_distance(organ.position, organ.triangle, p).distance;
            ASSERT_NE(got.triangle, kNone);
            ASSERT_NEAR(got.distance, truth, 1e-15 * far) << far;
            ASSERT_GT(got.distance, 0);
        }
    }
}

TEST(ClosestPoint, G30_DenormalsAndNegativeZero) {
    TestMesh cube = make_cube();
    for (Vec3d& x : cube.position)
        for (int k = 0; k < 3; ++k)
            if (x[k] == 0) x[k] = k == 0 ? -0.0 : 1e-310;
    const ClosestPointTree tree(cube.view());
    EXPECT_NEAR(tree.query({0.5, 0.5, -0.25}).distance, 0.25, 1e-15);
    EXPECT_NEAR(tree.query({0.5, 1e-310, 0.5}).distance, 0, 1e-300);
    std::vector<Float4> offset = make_cube().offsets();
    for (Float4& o : offset) o.y = o.y == 0 ? -1e-42f : o.y;
    const ClosestPointTree deformable(make_cube().view(), offset);
    EXPECT_NEAR(deformable.query({0.5, -0.25, 0.5}).distance, 0.25, 1e-15);
}

// G31: loading rejects such meshes; a vertex that becomes NaN at run time must not hide the other triangles
// or cause an endless loop.
TEST(ClosestPoint, G31_ANonFiniteVertexHidesOnlyItsTriangles) {
    const TestMesh organ = make_organ(10);
    for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        std::vector<Float4> now = organ.offsets();
        ClosestPointTree tree(organ.view(), now);
        now[17].y = bad;
        tree.refit(now);
        std::vector<Triangle> rest;
        for (const Triangle& t : organ.triangle)
            if (t[0] != 17 && t[1] != 17 && t[2] != 17) rest.push_back(t);
        std::vector<Vec3d> floats;
        for (const Float4& o : now) floats.push_back({o.x, o.y, o.z});
        for (const Vec3d& p : hard_points(organ, 100, 181)) {
            const SurfacePoint got = tree.query(p);
            ASSERT_NE(got.triangle, kNone);
            ASSERT_NEAR(std::abs(got.distance), brute_force_distance(floats, rest, p).distance, 1e-12) << bad;
        }
        now = organ.offsets();
        tree.refit(now);
        const ClosestPointTree fresh(organ.view(), now);
        const std::vector<Vec3d> points = hard_points(organ, 100, 182);
        expect_same_bits(query_all(tree, points), query_all(fresh, points), "healed");
    }
}

TEST(ClosestPoint, G32_NanAndInfiniteQueriesFindNothing) {
    const TestMesh cube = make_cube();
    const ClosestPointTree tree(cube.view());
    for (const double bad : {std::nan(""), kInfinity, -kInfinity})
        for (int k = 0; k < 3; ++k) {
            Vec3d p(0.5, 0.5, 0.5);
            p[k] = bad;
            EXPECT_EQ(tree.query(p).triangle, kNone);
        }
}

TEST(ClosestPoint, G36_NoFacesOneFaceTwoFacesUnusedVertices) {
    const TestMesh none({{0, 0, 0}}, {}, Admission::kRefused);
    EXPECT_EQ(ClosestPointTree(none.view()).query({0, 0, 0}).triangle, kNone);
    const TestMesh empty({}, {}, Admission::kRefused);
    EXPECT_EQ(ClosestPointTree(empty.view()).query({0, 0, 0}).triangle, kNone);
    const TestMesh one({{9, 9, 9}, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-5, 0, 0}}, {{1, 2, 3}}, Admission::kSheet);
    const ClosestPointTree tree(one.view());
    EXPECT_EQ(tree.query({0.25, 0.25, 2}).distance, 2);
    EXPECT_EQ(tree.query({0.25, 0.25, -2}).distance, 2);
    EXPECT_EQ(tree.query({0.25, 0.25, -2}).normal, Vec3d(0, 0, -1));
    EXPECT_EQ(tree.query({9, 9, 9}).triangle, 0u);
}

// Soups have three vertices per triangle: groups of 16 would need 48 and must be cut.
TEST(ClosestPoint, SoupOfUnweldedTriangles) {
    const TestMesh organ = make_organ(6);
    std::vector<Vec3d> position;
    std::vector<Triangle> triangle;
    for (const Triangle& t : organ.triangle) {
        const uint32_t n = static_cast<uint32_t>(position.size());
        for (const uint32_t v : t) position.push_back(organ.position[v]);
        triangle.push_back({n, n + 1, n + 2});
    }
    const TestMesh soup(position, triangle, Admission::kWinding);
    expect_equals_brute_force(soup, ClosestPointTree(soup.view()), hard_points(soup, 300, 191), "soup");
}

// Intersecting organs, an open one, doubled faces: groups of far triangles give the sign of the direct sum.
TEST(ClosestPoint, FarGroupsNeverChangeTheSignOfTheWindingNumber) {
    const TestMesh one = make_organ(10);
    std::vector<Vec3d> position = one.position;
    std::vector<Triangle> triangle = one.triangle;
    const uint32_t n = static_cast<uint32_t>(position.size());
    for (const Vec3d& x : one.position) position.push_back(x + Vec3d(0.7, 0.2, 0.1));
    for (const Triangle& t : one.triangle) triangle.push_back({t[0] + n, t[1] + n, t[2] + n});
    triangle.resize(triangle.size() - 300);  // a hole
    TestMesh both(position, triangle, Admission::kWinding);
    std::vector<Float4> now = both.offsets();
    ClosestPointTree tree(both.view(), now);
    for (int frame = 0; frame < 3; ++frame) {
        uint32_t open = 0;
        for (size_t v = 0; v < now.size(); ++v) both.position[v] = Vec3d(now[v].x, now[v].y, now[v].z);
        for (const Vec3d& p : hard_points(both, 700, 221 + frame)) {
            const double direct = brute_force_winding(both.position, both.triangle, p);
            if (std::abs(direct - 0.5) < 1e-9) continue;
            ASSERT_EQ(tree.winds_around(p), direct > 0.5) << p.transpose() << ", " << direct;
            open += std::abs(direct - 0.5) < 0.05;
        }
        EXPECT_GT(open, 0u) << "no number near one half: the exact sum is not tested";
        for (Float4& o : now) o.x += 0.2f * std::sin(2 * o.y), o.z *= 1.1f;
        tree.refit(now);
    }
}

// A self-intersecting body: pseudonormals err there, and the cross-check counts how often.
TEST(ClosestPoint, CrossCheckCountsWrongPseudonormals) {
    const TestMesh organ = make_organ(10);
    std::vector<Float4> now = organ.offsets();
    ClosestPointTree tree(organ.view(), now);
    tree.cross_check(true);
    QueryCounters sound, folded;
    const std::vector<Vec3d> points = hard_points(organ, 500, 231);
    query_all(tree, points, {}, kInfinity, &sound);
    EXPECT_EQ(sound.disagreements, 0u);
    for (Float4& o : now) o.x = o.x > 0.2f ? -1.5f * o.x : o.x;
    tree.refit(now);
    TestMesh bent = organ;
    for (size_t v = 0; v < now.size(); ++v) bent.position[v] = Vec3d(now[v].x, now[v].y, now[v].z);
    const std::vector<SurfacePoint> got = query_all(tree, points, {}, kInfinity, &folded);
    uint64_t wrong = 0;
    for (size_t i = 0; i < points.size(); ++i) {
        const double direct = brute_force_winding(bent.position, bent.triangle, points[i]);
        wrong += std::abs(got[i].distance) > 1e-12 && (direct > 0.5) != (got[i].distance < 0);
    }
    EXPECT_GT(wrong, 10u);
    EXPECT_EQ(folded.disagreements, wrong);
    tree.cross_check(false);
    QueryCounters off;
    query_all(tree, points, {}, kInfinity, &off);
    EXPECT_EQ(off.disagreements, 0u);
}

// Solids bent until they intersect themselves, in doubles and floats, at points whose rays graze corners and
// edges (surface points moved along x) and at random points, against the sum of solid angles. Breaks when a
// box ahead is skipped, when an edge is counted twice or not at all, and when the tree has outdated
// positions.
TEST(ClosestPoint, SidesOfFoldedSolidsAreCountedAlongARay) {
    const TestMesh organ = make_organ(20);
    std::vector<Float4> now = organ
                                  .moved([](const Vec3d& x) {  // a ring whose ends overlap
                                      return Vec3d((1.2 - x.y()) * std::cos(4 * x.x()), (1.2 - x.y()) * std::sin(4 * x.x()), x.z());
                                  })
                                  .offsets();
    TestMesh bent = organ;
    for (size_t v = 0; v < now.size(); ++v) bent.position[v] = {now[v].x, now[v].y, now[v].z};
    const ClosestPointTree rigid(bent.view());
    ClosestPointTree refitted(organ.view(), organ.offsets());
    refitted.refit(now);
    std::vector<Vec3d> points = points_in_box(bent, 1500, 5);
    std::mt19937 random(6);
    std::uniform_real_distribution<double> along(-1, 1);
    for (size_t v = 0; v < bent.position.size(); v += 7) {
        const double displacement = 2 * along(random);
        points.push_back(bent.position[v] + Vec3d(displacement, 0, 0));
        const Triangle& t = bent.triangle[v % bent.triangle.size()];
        points.push_back(0.5 * (bent.position[t[0]] + bent.position[t[1]]) + Vec3d(displacement, 0, 0));
    }
    uint32_t twice = 0, outside = 0;
    for (const Vec3d& p : points) {
        const double direct = brute_force_winding(bent.position, bent.triangle, p);
        twice += direct > 1.5;
        outside += direct < 0.5;
        ASSERT_EQ(rigid.winds_around(p), direct > 0.5) << p.transpose() << ", " << direct;
        ASSERT_EQ(refitted.winds_around(p), direct > 0.5) << p.transpose() << ", " << direct;
    }
    EXPECT_GT(twice, 50u);
    EXPECT_GT(outside, 500u);
}

TEST(ClosestPoint, WindingNumberOfTheTreeFollowsRefits) {
    const TestMesh cube = make_cube();
    std::vector<Float4> now = cube.offsets();
    ClosestPointTree tree(cube.view(), now);
    EXPECT_NEAR(tree.winding_number({0.5, 0.5, 1.5}), 0, 1e-14);
    for (Float4& o : now) o.z *= 2;
    tree.refit(now);
    EXPECT_NEAR(tree.winding_number({0.5, 0.5, 1.5}), 1, 1e-14);
}

}  // namespace
}  // namespace trocar
