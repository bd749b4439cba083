#include "content/mend/self_crossing.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <random>

#include "engine/mesh/crossing_faces.hpp"
#include "tests/reference/meet_by_differences.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

using namespace reference;

Point point_of(const Mesh& m, uint32_t v) { return {int64_t(m.position[v].x()), int64_t(m.position[v].y()), int64_t(m.position[v].z())}; }

// Every pair of faces of an integer mesh, judged by the hull of differences in 128-bit integers.
SelfCrossings count_by_brute_force(const Mesh& m) {
    SelfCrossings out;
    const auto points = [&](const std::vector<uint32_t>& vertices) {
        std::vector<Point> p;
        for (const uint32_t v : vertices) p.push_back(point_of(m, v));
        return p;
    };
    const auto has_area = [&](const Triangle& t) {
        const auto p = points({t[0], t[1], t[2]});
        const auto to = [&](const Point& q) { return Wide3{q[0] - p[0][0], q[1] - p[0][1], q[2] - p[0][2]}; };
        return !is_zero(cross(to(p[1]), to(p[2])));
    };
    for (uint32_t t = 0; t < m.triangle.size(); ++t) {
        for (uint32_t u = t + 1; u < m.triangle.size(); ++u) {
            const Triangle &a = m.triangle[t], &b = m.triangle[u];
            if (!has_area(a) || !has_area(b)) continue;
            std::vector<uint32_t> shared, a_free, b_free;
            for (const uint32_t v : a) (std::count(b.begin(), b.end(), v) ? shared : a_free).push_back(v);
            for (const uint32_t v : b) {
                if (!std::count(a.begin(), a.end(), v)) b_free.push_back(v);
            }
            const auto pa = points({a[0], a[1], a[2]}), pb = points({b[0], b[1], b[2]});
            Meeting meeting = meet_by_differences(pa, pb);
            if (meeting == Meeting::kTouching && shared.size() == 1) {
                // they meet beyond the corner only if one of the opposite edges meets the other face
                if (meet_by_differences(points(a_free), pb) == Meeting::kDisjoint &&
                    meet_by_differences(points(b_free), pa) == Meeting::kDisjoint) {
                    meeting = Meeting::kDisjoint;
                }
            }
            if (meeting == Meeting::kTouching && shared.size() == 2) meeting = Meeting::kDisjoint;
            if (meeting == Meeting::kDisjoint) continue;
            ++(meeting == Meeting::kCrossing ? out.crossing : out.touching);
            if (out.lowest_pair[0] == kNone) out.lowest_pair = {t, u};
        }
    }
    return out;
}

void expect_same(const SelfCrossings& got, const SelfCrossings& expected, const char* what, uint64_t seed) {
    EXPECT_EQ(got.crossing, expected.crossing) << what << " " << seed;
    EXPECT_EQ(got.touching, expected.touching) << what << " " << seed;
    EXPECT_EQ(got.lowest_pair, expected.lowest_pair) << what << " " << seed;
}

// As the frame counts them, of corners in floats.
uint64_t count_in_floats(const Mesh& m) {
    std::vector<Float4> position;
    for (const Vec3d& p : m.position) {
        const Vec3 f = p.cast<float>();
        EXPECT_EQ(f.cast<double>(), p);
        position.push_back({f.x(), f.y(), f.z(), 0});
    }
    CrossingFacesScratch scratch;
    return count_crossing_faces(m.triangle, position.data(), scratch);
}

// Random faces over few grid points: most pairs share corners, edges, planes or lines. Breaks when a shortcut
// for shared corners or edges is wrong, or the box tree misses a pair.
TEST(SelfCrossing, TangledMeshesAgreeWithBruteForce) {
    uint32_t crossing = 0, touching = 0;
    for (uint64_t seed = 0; seed < 400; ++seed) {
        std::mt19937_64 random(seed);
        const int range = 2 + static_cast<int>(seed % 5);
        Mesh m;
        std::vector<Vec3d> positions;
        for (int i = 0; i < 14; ++i) {
            const auto draw = [&] { return double(random() % range); };
            const Vec3d p(draw(), draw(), seed % 4 == 0 ? 0.0 : draw());
            // corners are shared only if they are the same vertex: no two vertices at one position
            if (std::find(positions.begin(), positions.end(), p) == positions.end()) positions.push_back(p);
        }
        m.position = positions;
        for (int i = 0; i < 12; ++i) {
            Triangle t;
            for (uint32_t& v : t) v = static_cast<uint32_t>(random() % m.position.size());
            if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) m.triangle.push_back(t);
        }
        const SelfCrossings expected = count_by_brute_force(m);
        crossing += expected.crossing;
        touching += expected.touching;
        expect_same(count_self_crossings(m), expected, "tangle", seed);
        EXPECT_EQ(count_in_floats(m), expected.crossing) << seed;
    }
    EXPECT_GT(crossing, 1000u);
    EXPECT_GT(touching, 1000u);
}

// Two intersecting balls, corners rounded to a fine grid, faces of very different size.
TEST(SelfCrossing, G21_TwoBallsInOneMesh) {
    for (uint64_t seed = 0; seed < 2; ++seed) {
        Mesh m = make_sphere({0, 0, 0}, 5000, 2);
        append(m, make_sphere({3000.0 + double(seed), 10, 0}, 4000, 2));
        append(m, make_box({-90000, -90000, -90000}, {90000, 90000, 90000}));
        for (Vec3d& p : m.position) p = p.array().round();
        shuffle(m, seed);
        const SelfCrossings expected = count_by_brute_force(m);
        EXPECT_GT(expected.crossing, 20u);
        expect_same(count_self_crossings(m), expected, "balls", seed);
        EXPECT_EQ(count_in_floats(m), expected.crossing);
    }
}

// Two cones of slivers on one ring, whose corners alternate between two radii and jump up and down.
Mesh make_fan(uint32_t n, double inner, double outer, double height, double rough, uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> jitter(-rough * outer, rough * outer);
    Mesh m;
    m.position = {{0, 0, height}, {0, 0, -height}};
    for (uint32_t i = 0; i < n; ++i) {
        const double angle = 2 * M_PI * i / n, r = i % 2 ? outer : inner;
        m.position.push_back({r * std::cos(angle), r * std::sin(angle), jitter(random)});
        const uint32_t a = 2 + i, b = 2 + (i + 1) % n;
        m.triangle.push_back({0, a, b});
        m.triangle.push_back({1, b, a});
    }
    return m;
}

// Many faces at one corner, some corners of the ring thrown across it. Breaks when pairs are lost where directions from
// the corner or oriented boxes are searched.
TEST(SelfCrossing, A10_FansAgreeWithBruteForce) {
    Mesh m = make_fan(500, 20000, 100000, 70000, 0.05, 1);
    std::mt19937_64 random(2);
    for (int i = 0; i < 5; ++i) m.position[2 + random() % 500].head<2>() *= -0.7;
    for (Vec3d& p : m.position) p = p.array().round();
    shuffle(m, 3);
    const SelfCrossings expected = count_by_brute_force(m), found = count_self_crossings(m);
    EXPECT_GT(expected.crossing, 20u);
    expect_same(found, expected, "fan", 1);
    EXPECT_EQ(count_in_floats(m), expected.crossing);
    EXPECT_LT(found.tested, 120 * m.triangle.size());
}

// Rough fans and flat ones, at an angle: 5 to 110 pairs per face, however many faces there are.
TEST(SelfCrossing, A10_FansTakeLinearTime) {
    for (const uint32_t n : {1000u, 4000u, 16000u}) {
        for (int kind = 0; kind < 12; ++kind) {
            const double inner = kind % 3 == 0 ? 1 : 0.1 * kind;
            Mesh m = kind < 8 ? make_fan(n, inner, 1, 0.25 * (1 + kind), 0.05, uint64_t(kind))
                              : make_fan(n, inner, 1, std::pow(10, 4 - kind), 0, uint64_t(kind));
            const Eigen::Quaterniond turn = Eigen::Quaterniond(0.3, 0.5, -0.4, 0.7).normalized();
            for (Vec3d& p : m.position) p = turn * p;
            const SelfCrossings found = count_self_crossings(m);
            EXPECT_LT(double(found.tested), 120.0 * double(m.triangle.size())) << n << " " << kind;
            EXPECT_EQ(found.crossing + found.touching, 0u) << n << " " << kind;
        }
    }
}

TEST(SelfCrossing, SoundSurfacesHaveNone) {
    Mesh flat = make_sheet(20);
    Mesh tilted = flat;
    for (Vec3d& p : tilted.position) p = Vec3d(p.x() / 3 + 0.1, p.x() / 7 + p.y() / 9, p.y() * M_PI);
    Mesh hollow = make_sphere({0, 0, 0}, 2, 3);
    append(hollow, make_sphere({0, 0, 0}, 1, 3));
    for (const Mesh& m : {flat, tilted, hollow, make_sphere({1e6, 0, 0}, 1, 4), make_moebius(30), Mesh{}}) {
        const SelfCrossings found = count_self_crossings(m);
        EXPECT_EQ(found.crossing, 0u);
        EXPECT_EQ(found.touching, 0u);
        EXPECT_EQ(found.lowest_pair[0], kNone);
    }
}

// Two faces folded onto each other in one plane overlap; opened by one last bit they do not.
TEST(SelfCrossing, FoldsAlongASharedEdge) {
    Mesh m;
    m.position = {{0, 0, 0}, {1, 0, 0}, {0.2, 1, 0}, {0.7, 0.5, 0}};
    m.triangle = {{0, 1, 2}, {1, 0, 3}};
    EXPECT_EQ(count_self_crossings(m).crossing, 1u);
    m.position[3].z() = 1e-300;
    EXPECT_EQ(count_self_crossings(m).crossing, 0u);
    m.position[3] = {0.7, -0.5, 0};
    EXPECT_EQ(count_self_crossings(m).crossing, 0u);
}

// Breaks when a file that repeats one shape a thousand times makes the count run for hours.
TEST(SelfCrossing, counting_stops_at_its_limit) {
    Mesh m;
    m.position = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    m.triangle.assign(20000, {0, 1, 2});  // 2e8 pairs
    const uint32_t counted = count_self_crossings(m).crossing;
    EXPECT_GE(counted, kSelfCrossingLimit);
    EXPECT_LE(counted, kSelfCrossingLimit + 16);
}

}  // namespace
}  // namespace trocar
