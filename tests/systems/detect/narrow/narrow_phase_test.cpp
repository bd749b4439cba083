#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <set>

#include "engine/geometry/predicates.hpp"
#include "engine/geometry/triangle_triangle.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "tests/reference/brute_force_contact.hpp"
#include "tests/systems/detect/contact_scene.hpp"

// Contours of intersecting surfaces, and the overlap regions that they bound.
namespace trocar::test {
namespace {

Mesh ball(double radius, uint32_t n) {
    return make_sphere(n, [=](const Vec3d& p) { return Vec3d(radius * p); });
}

Mesh both(const Mesh& a, const Mesh& b) {
    Mesh out = a;
    const uint32_t first = uint32_t(out.position.size());
    out.position.insert(out.position.end(), b.position.begin(), b.position.end());
    for (const Triangle& t : b.triangle) out.triangle.push_back({t[0] + first, t[1] + first, t[2] + first});
    return out;
}
Mesh moved(Mesh mesh, const Vec3d& by) {
    for (Vec3d& p : mesh.position) p += by;
    return mesh;
}
Mesh inside_out(Mesh mesh) {
    for (Triangle& t : mesh.triangle) std::swap(t[1], t[2]);
    return mesh;
}

double sum(const std::vector<double>& x) {
    double s = 0;
    for (const double v : x) s += v;
    return s;
}

// Invariants of contours of closed surfaces: closed curves with pieces joined end to start, each point on its
// named edge and triangle, every pair of triangles once.
void expect_sound(const ContactScene& scene, const std::string& what) {
    const Contours& k = scene.contours;
    std::set<std::array<uint32_t, 3>> seen;
    for (uint32_t pair = 0; pair < k.pair.size(); ++pair) {
        const uint32_t body[2] = {scene.pairs.a[pair], scene.pairs.b[pair]};
        for (uint32_t i = k.pair[pair].first; i < k.pair[pair].end(); ++i) {
            const Range curve = k.curve[i];
            ASSERT_TRUE(k.closed[i]) << what;
            ASSERT_GE(curve.count, 3u) << what;
            for (uint32_t s = curve.first; s < curve.end(); ++s) {
                const uint32_t next = s + 1 == curve.end() ? curve.first : s + 1;
                ASSERT_EQ(k.end[s][1], k.end[next][0]) << what;
                ASSERT_TRUE(seen.insert({pair, k.triangle[s][0], k.triangle[s][1]}).second) << what;
                for (const uint32_t p : k.end[s]) {
                    const uint32_t own = k.edge_of_b[p], other = 1 - own;
                    const MeshView mesh = mesh_view(scene.meshes, scene.bodies.mesh[body[own]]);
                    const auto& edges = mesh.triangle_edge[k.triangle[s][own]];
                    ASSERT_TRUE(std::find(edges.begin(), edges.end(), k.edge[p]) != edges.end()) << what;
                    ASSERT_EQ(k.pierced[p], k.triangle[s][other]) << what;
                }
            }
        }
    }
}

// ---- predicates ----

// The signs against the same determinants of points moved by a small exact amount: 2^-20 along x, then y,
// then z, on integers small enough that nothing rounds.
TEST(Predicates, MovingSignsAreThoseOfSmallMoves) {
    std::mt19937 random(7);
    std::uniform_int_distribution<int> small(-3, 3);
    const double e = 0x1p-10;
    const Vec3d move(e, e * e, e * e * e);
    uint32_t ties = 0, zeros = 0;
    for (int trial = 0; trial < 100'000; ++trial) {
        std::array<Vec3d, 4> p;
        for (Vec3d& x : p) x = Vec3d(small(random), small(random), small(random));
        ties += orient3d(p[0], p[1], p[2], p[3]) == 0;
        const int point = orient3d(p[0], p[1], p[2], p[3] + move);
        const int edge = orient3d(p[0], p[1], p[2] + move, p[3] + move);
        ASSERT_EQ(orient3d_moving_point(p[0], p[1], p[2], p[3]), point);
        ASSERT_EQ(orient3d_moving_edge(p[0], p[1], p[2], p[3]), edge);
        zeros += point == 0;
    }
    EXPECT_GT(ties, 5000u);
    EXPECT_GT(zeros, 100u);
    EXPECT_GT(ties, zeros + 3000);
}

// ---- contours ----

// Triangles in general position: a contour segment exactly where they cross (their own exact test).
TEST(Contours, SegmentsAreTheCrossingTriangles) {
    for (const uint32_t seed : {1u, 2u, 3u}) {
        ContactScene scene(
            {{make_noisy_sphere(8, 0.1, 0.2, seed), Motion::kHand, Vec3d::Zero(), turn({1, 2, 3}, seed)},
             {make_noisy_sphere(9, 0.1, 0.2, 2 * seed), Motion::kHand, Vec3d(0.06, 0.05, 0.03), turn({3, 1, 2}, 2.0 * seed)}});
        scene.run_with_regions();
        expect_sound(scene, std::to_string(seed));
        const Vec3d base = scene.poses.origin[0];
        const auto corners = [&](uint32_t body, uint32_t t) {
            const BodyPoints points(scene.surfaces(), body, base);
            const Triangle& v = mesh_view(scene.meshes, body).triangle[t];
            return Corners{points.point(v[0]), points.point(v[1]), points.point(v[2])};
        };
        std::set<std::array<uint32_t, 2>> want, found(scene.contours.triangle.begin(), scene.contours.triangle.end());
        for (uint32_t i = 0; i < scene.meshes.info[0].triangles.count; ++i)
            for (uint32_t j = 0; j < scene.meshes.info[1].triangles.count; ++j)
                if (meet_triangles(corners(0, i), corners(1, j)) == Meeting::kCrossing) want.insert({i, j});
        EXPECT_GT(want.size(), 50u);
        EXPECT_EQ(found, want);
        // points lie on both surfaces
        const reference::Surface a(scene.surfaces(), 0), b(scene.surfaces(), 1);
        for (const Vec3d& p : scene.contours.point) {
            EXPECT_LT(a.unsigned_distance(p), 1e-14);
            EXPECT_LT(b.unsigned_distance(p), 1e-14);
        }
    }
}

// Boxes on a grid of a few positions share planes, edges and corners in all combinations; tetrahedra on small
// integers too. All contours close and regions have the exact volume of the overlap, touching or not.
TEST(Contours, GridBoxesOfEveryCoincidence) {
    std::mt19937 random(11);
    std::uniform_int_distribution<int> position(-4, 4), cells(1, 3);
    uint32_t touching = 0, overlapping = 0;
    for (int trial = 0; trial < 400; ++trial) {
        const std::array<uint32_t, 3> n{uint32_t(cells(random)), uint32_t(cells(random)), uint32_t(cells(random))};
        const Vec3d size_b(cells(random), cells(random), cells(random));
        const Vec3d at(0.5 * position(random), 0.5 * position(random), 0.5 * position(random));
        ContactScene scene(
            {{make_box({2, 2, 2}, n), Motion::kHand, Vec3d::Zero(), {}}, {make_box(size_b, {1, 2, 1}), Motion::kHand, at, {}}});
        scene.run_with_regions();
        const std::string what = "trial " + std::to_string(trial);
        expect_sound(scene, what);
        double want = 1;
        for (int k = 0; k < 3; ++k) {
            const double low = std::max(-1.0, at[k] - 0.5 * size_b[k]), high = std::min(1.0, at[k] + 0.5 * size_b[k]);
            want *= std::max(0.0, high - low);
        }
        EXPECT_NEAR(sum(scene.regions.volume), want, 1e-14) << what;
        EXPECT_LE(scene.regions.pair.size(), 1u) << what;
        (want > 0 ? overlapping : touching) += !scene.contours.curve.empty();
    }
    EXPECT_GT(touching, 20u);
    EXPECT_GT(overlapping, 100u);
}

// Duplicate surfaces: a body on its copy, in place and moved along its own faces.
TEST(Contours, CoincidentSurfacesClose) {
    for (const Vec3d& by : {Vec3d(0, 0, 0), Vec3d(0.5, 0, 0), Vec3d(0.5, 0.5, 0), Vec3d(0.25, 0.5, 1)}) {
        ContactScene scene(
            {{make_box({2, 2, 2}, {4, 4, 4}), Motion::kHand, Vec3d::Zero(), {}}, {make_box({2, 2, 2}, {4, 4, 4}), Motion::kHand, by, {}}});
        scene.run_with_regions();
        expect_sound(scene, "moved by " + std::to_string(by.x()));
        const double want = (2 - by.x()) * (2 - by.y()) * (2 - by.z());
        EXPECT_NEAR(sum(scene.regions.volume), want, 1e-13);
    }
}

TEST(Contours, NothingFromNothing) {
    Contours contours;
    ContoursScratch scratch;
    ContactScene empty({});
    find_contours(empty.inputs(), empty.candidates, scratch, contours);
    EXPECT_TRUE(contours.pair.empty() && contours.point.empty());
    // a sheet in a ball: the curve ends at the sheet's rim where it does not pass through
    ContactScene scene({{ball(0.5, 8), Motion::kHand, Vec3d::Zero(), {}},
                        {make_sheet(0.8, 4), Motion::kHand, Vec3d(0.5, 0.01, 0.02), turn({1, 2, 0}, 0.1), Admission::kSheet, 1e-3}});
    scene.run_with_regions();
    ASSERT_EQ(scene.contours.curve.size(), 1u);
    EXPECT_FALSE(scene.contours.closed[0]);
    EXPECT_TRUE(scene.regions.pair.empty());
}

// ---- regions ----

// Spheres: volume and area of the lens against the closed form pi (R + r - d)^2 (d^2 + 2 d (R + r) - 3 (R - r)^2) / 12 d,
// second order in the edge length.
TEST(Regions, LensOfTwoSpheres) {
    const double big = 0.5, small = 0.4, d = 0.7;
    const double height_big = big - (d * d + big * big - small * small) / (2 * d),
                 height_small = small - (d * d + small * small - big * big) / (2 * d);
    const double volume = M_PI * std::pow(big + small - d, 2) * (d * d + 2 * d * (big + small) - 3 * std::pow(big - small, 2)) / (12 * d);
    const double area = 2 * M_PI * (big * height_big + small * height_small);
    const double rim = 2 * M_PI * std::sqrt(big * big - std::pow(big - height_big, 2));
    double before = 1;
    for (const uint32_t n : {8, 16, 32, 64}) {
        ContactScene scene({{ball(big, n), Motion::kHand, Vec3d::Zero(), turn({1, 2, 3}, 1)},
                            {ball(small, n), Motion::kHand, Vec3d(0, d, 0), turn({3, 1, 2}, 2)}});
        scene.run_with_regions();
        expect_sound(scene, std::to_string(n));
        ASSERT_EQ(scene.regions.pair.size(), 1u);
        EXPECT_EQ(scene.regions.curves[0], 1u);
        EXPECT_EQ(scene.regions.vertices_a[0], scene.penetrations.vertices_a_in_b[0]);
        EXPECT_EQ(scene.regions.vertices_b[0], scene.penetrations.vertices_b_in_a[0]);
        EXPECT_EQ(scene.regions.depth[0], scene.penetrations.depth[0]);
        EXPECT_EQ(scene.regions.witness[0], scene.penetrations.witness[0]);
        const double error = std::abs(scene.regions.volume[0] / volume - 1);
        EXPECT_LT(error, 0.36 * before) << n;  // a quarter, give or take
        EXPECT_NEAR(scene.regions.area[0] / area, 1, 1.5 * error) << n;
        EXPECT_NEAR(scene.regions.contour[0] / rim, 1, 1.5 * error) << n;
        before = error;
    }
    EXPECT_LT(before, 1.5e-3);
}

// Rotated cubes: overlap of two convex bodies by clipping one against the planes of the other, in the test.
double clipped_volume(const ContactScene& scene) {
    const reference::Surface a(scene.surfaces(), 0), b(scene.surfaces(), 1);
    const Vec3d centre = 0.5 * (scene.poses.origin[0] + scene.poses.origin[1]);
    double volume = 0;
    const auto add = [&](const reference::Surface& own, const reference::Surface& other) {
        for (const Triangle& t : own.triangle) {
            std::vector<Vec3d> polygon{own.position[t[0]], own.position[t[1]], own.position[t[2]]};
            for (const Triangle& u : other.triangle) {
                const Vec3d o = other.position[u[0]];
                const Vec3d n = (other.position[u[1]] - o).cross(other.position[u[2]] - o);
                std::vector<Vec3d> kept;
                for (size_t i = 0; i < polygon.size(); ++i) {
                    const Vec3d &p = polygon[i], &q = polygon[(i + 1) % polygon.size()];
                    const double hp = n.dot(p - o), hq = n.dot(q - o);
                    if (hp <= 0) kept.push_back(p);
                    if (hp * hq < 0) kept.push_back(p + hp / (hp - hq) * (q - p));
                }
                polygon = kept;
            }
            for (size_t i = 2; i < polygon.size(); ++i) {
                volume += (polygon[0] - centre).dot((polygon[i - 1] - centre).cross(polygon[i] - centre)) / 6;
            }
        }
    };
    add(a, b);
    add(b, a);
    return volume;
}

TEST(Regions, TurnedCubesHaveTheVolumeOfThePolytope) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    uint32_t deep = 0;
    for (int trial = 0; trial < 150; ++trial) {
        const Vec3d at(unit(random), unit(random), unit(random));
        ContactScene scene({{make_box({1, 1.5, 1.2}), Motion::kHand, Vec3d::Zero(), turn({unit(random), 1, 0}, 2)},
                            {make_box({1.1, 0.7, 1.3}), Motion::kHand, at, turn({1, unit(random), 1}, 3 * unit(random))}});
        scene.run_with_regions();
        const double want = clipped_volume(scene);
        EXPECT_NEAR(sum(scene.regions.volume), want, 1e-12) << trial;
        EXPECT_EQ(scene.regions.pair.size(), want > 1e-9 ? 1u : 0u) << trial;
        deep += want > 0.05;
    }
    EXPECT_GT(deep, 50u);
}

// A bowel loop that touches twice: a half ring with both ends in a slab has two regions, each with its own
// depth, witness and contour; the deeper one is the pair's.
TEST(Regions, ALoopThatTouchesTwiceHasTwo) {
    ContactScene scene({{make_box({6, 6, 0.5}, {6, 6, 1}), Motion::kDeformable, Vec3d(0, 0, -0.25), {}},
                        {make_torus(1, 0.3, 60, 24), Motion::kHand, Vec3d(0, 0, 0.9), turn({1, 0, 0}, M_PI / 2 - 0.2)}});
    scene.run_with_regions();
    ASSERT_EQ(scene.regions.pair.size(), 1u);  // the low end of a ring
    EXPECT_EQ(scene.regions.curves[0], 1u);
    // lowered to its middle the ring passes through the slab on both sides of its hole
    scene.poses.origin[1] = Vec3d(0, 0, 0.05);
    scene.poses.orientation[1] = turn({1, 0, 0}, M_PI / 2);
    scene.run_with_regions();
    ASSERT_EQ(scene.regions.pair.size(), 2u);
    for (uint32_t i = 0; i < 2; ++i) {
        EXPECT_EQ(scene.regions.curves[i], 2u);
        EXPECT_NEAR(scene.regions.volume[i], 0.5 * M_PI * 0.09, 0.03);
        EXPECT_GT(scene.regions.vertices_b[i], 50u);
        // a region's inside points of b are on the region's side
        EXPECT_GT(std::abs(scene.contacts.point[scene.regions.witness[i]].x()), 0.3);
    }
    EXPECT_NEAR(scene.regions.volume[0], scene.regions.volume[1], 1e-3);
    EXPECT_EQ(std::max(scene.regions.depth[0], scene.regions.depth[1]), scene.penetrations.depth[0]);
    EXPECT_EQ(scene.regions.vertices_b[0] + scene.regions.vertices_b[1], scene.penetrations.vertices_b_in_a[0]);
    EXPECT_LT(scene.contacts.point[scene.regions.witness[0]].x() * scene.contacts.point[scene.regions.witness[1]].x(), 0);
}

// One huge face poked at two places: no vertex of it is inside, still two regions, as of each alone.
TEST(Regions, TwoBumpsOnOneFace) {
    const Mesh bump = ball(0.2, 10);
    const Mesh two = both(moved(bump, {-0.5, 0.3, 0.1}), moved(bump, {0.6, -0.2, 0.05}));
    ContactScene scene({{make_box({100, 100, 10}), Motion::kHand, Vec3d(7, 11, -5), {}}, {two, Motion::kHand, Vec3d::Zero(), {}}});
    scene.run_with_regions();
    ASSERT_EQ(scene.regions.pair.size(), 2u);
    for (const uint32_t i : {0u, 1u}) {
        const Vec3d at = i == 0 ? Vec3d(-0.5, 0.3, 0.1) : Vec3d(0.6, -0.2, 0.05);
        ContactScene alone({{make_box({100, 100, 10}), Motion::kHand, Vec3d(7, 11, -5), {}}, {bump, Motion::kHand, at, {}}});
        alone.run_with_regions();
        EXPECT_NEAR(scene.regions.volume[i], alone.regions.volume[0], 1e-12);
        EXPECT_NEAR(scene.regions.depth[i], alone.regions.depth[0], 1e-12);
        EXPECT_EQ(scene.regions.vertices_b[i], alone.regions.vertices_b[0]);
    }
}

// Bodies wholly inside, with and without a hollow; a hollow ball half in a slab: a void is subtracted.
TEST(Regions, NestedBodiesAndVoids) {
    const Mesh outer = ball(0.4, 12), hollow = both(outer, inside_out(ball(0.3, 12)));
    ContactScene whole({{ball(1, 12), Motion::kHand, Vec3d::Zero(), {}}, {outer, Motion::kHand, Vec3d(0.1, 0, 0), {}}});
    whole.run_with_regions();
    ASSERT_EQ(whole.regions.pair.size(), 1u);
    EXPECT_TRUE(whole.contours.curve.empty());
    EXPECT_NEAR(whole.regions.volume[0], whole.meshes.info[1].volume, 1e-14);
    EXPECT_NEAR(whole.regions.area[0], whole.meshes.info[1].area, 1e-13);
    ContactScene shell({{ball(1, 12), Motion::kHand, Vec3d::Zero(), {}}, {hollow, Motion::kHand, Vec3d(0.1, 0, 0), {}}});
    shell.run_with_regions();
    ASSERT_EQ(shell.regions.pair.size(), 1u);
    EXPECT_NEAR(shell.regions.volume[0], shell.meshes.info[1].volume, 1e-14);
    EXPECT_NEAR(shell.regions.area[0], shell.meshes.info[1].area, 1e-13);
    // mirror symmetric in z: exactly half of it below the plane
    ContactScene half({{make_box({100, 100, 10}), Motion::kHand, Vec3d(7, 11, -5), {}}, {hollow, Motion::kHand, Vec3d::Zero(), {}}});
    half.run_with_regions();
    ASSERT_EQ(half.regions.pair.size(), 1u);
    EXPECT_EQ(half.regions.curves[0], 2u);
    EXPECT_NEAR(half.regions.volume[0], 0.5 * half.meshes.info[1].volume, 1e-13);
}

// Same bits for any number of threads and with the bodies in many pairs.
TEST(Regions, SameOnManyThreads) {
    std::vector<BodyInput> bodies;
    for (uint32_t i = 0; i < 20; ++i) {
        bodies.push_back(
            {make_noisy_sphere(6 + i % 3, 0.1, 0.1, i), Motion::kDeformable, Vec3d(0.13 * (i % 5), 0.14 * (i / 5), 0.02 * (i % 3)), {}});
    }
    const auto run = [&](uint32_t threads) {
        auto scene = std::make_unique<ContactScene>(bodies);
        ThreadPool pool(threads);
        pool.run([&] { scene->run_with_regions(); });
        return scene;
    };
    const auto one = run(1), four = run(4);
    ASSERT_GT(one->regions.pair.size(), 20u);
    EXPECT_EQ(one->regions.pair, four->regions.pair);
    EXPECT_EQ(one->regions.volume, four->regions.volume);
    EXPECT_EQ(one->regions.witness, four->regions.witness);
    EXPECT_EQ(one->contours.end, four->contours.end);
    EXPECT_EQ(one->contours.along, four->contours.along);
    // every pair alone has the same regions as among the others
    for (uint32_t r = 0; r < one->regions.pair.size(); ++r) {
        const uint32_t pair = one->regions.pair[r];
        if (r > 0 && one->regions.pair[r - 1] == pair) continue;
        ContactScene alone({bodies[one->pairs.a[pair]], bodies[one->pairs.b[pair]]});
        alone.run_with_regions();
        ASSERT_FALSE(alone.regions.pair.empty());
        EXPECT_EQ(alone.regions.volume[0], one->regions.volume[r]);
    }
}

}  // namespace
}  // namespace trocar::test
