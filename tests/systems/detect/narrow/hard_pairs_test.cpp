#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "content/mend/unit_guess.hpp"
#include "content/read/load_mesh.hpp"
#include "content/scene/make_prototype.hpp"
#include "content/shapes/shape_library.hpp"
#include "tests/reference/brute_force_contact.hpp"
#include "tests/reference/shared_data.hpp"
#include "tests/systems/detect/contact_scene.hpp"

// Oracles that need no truth: relations between two answers for the same pair, moved, scaled, swapped or
// pushed. And pairs that are hard by their size or position.
namespace trocar::test {
namespace {

double depth_of(const ContactScene& scene) { return scene.penetrations.depth.empty() ? 0 : scene.penetrations.depth[0]; }
double overlap_volume(const ContactScene& scene) { return std::accumulate(scene.regions.volume.begin(), scene.regions.volume.end(), 0.0); }

// A random pair of bumpy balls, about one or two edges deep.
struct RandomPair {
    Mesh a, b;
    Vec3d at;
    Quat turn_b;

    explicit RandomPair(uint32_t seed) {
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> unit(-1, 1);
        a = make_noisy_sphere(7, 1, 0.15, unit(random));
        b = make_noisy_sphere(6, 0.7, 0.15, 3 * unit(random));
        const Vec3d direction = Vec3d(unit(random), unit(random), unit(random)).normalized();
        at = (1.45 + 0.2 * unit(random)) * direction;
        turn_b = turn({unit(random), unit(random), unit(random)}, 3 * unit(random));
    }
};

constexpr double kTolerance = 1e-6;  // in edges, in the units of the pair

ContactScene scene_of(const Mesh& a, const Mesh& b, const Vec3d& at, const Quat& turned, double scale = 1,
                      const Vec3d& shift = Vec3d::Zero(), const Quat& whole = {}) {
    Mesh x = a, y = b;
    for (Mesh* mesh : {&x, &y})
        for (Vec3d& p : mesh->position) p *= scale;
    // bodies rotate about their own origin: the shape of b is rotated first, then both as one
    for (Vec3d& p : y.position) p = rotate(turned, p);
    ContactScene scene({{x, Motion::kHand, shift, whole}, {y, Motion::kHand, shift + rotate(whole, Vec3d(scale * at)), whole}});
    scene.settings.contact.tolerance = kTolerance * scale;
    scene.run_with_regions();
    return scene;
}

// Every oracle on one pair. Returns whether the pair overlapped.
bool check_pair(uint32_t seed) {
    const RandomPair pair(seed);
    const std::string what = "seed " + std::to_string(seed);
    const ContactScene base = scene_of(pair.a, pair.b, pair.at, pair.turn_b);
    const double depth = depth_of(base), volume = overlap_volume(base);

    Mesh turned_b = pair.b;
    for (Vec3d& p : turned_b.position) p = rotate(pair.turn_b, p);
    ContactScene swapped({{turned_b, Motion::kHand, pair.at, {}}, {pair.a, Motion::kHand, Vec3d::Zero(), {}}});
    swapped.settings.contact.tolerance = kTolerance;
    swapped.run_with_regions();
    EXPECT_EQ(depth_of(swapped), depth) << what;
    EXPECT_EQ(swapped.regions.pair.size(), base.regions.pair.size()) << what;
    EXPECT_NEAR(overlap_volume(swapped), volume, 1e-13) << what;
    if (depth > 0) {
        EXPECT_EQ(Vec3d(-swapped.penetrations.direction[0]), base.penetrations.direction[0]) << what;
    }

    const ContactScene moved = scene_of(pair.a, pair.b, pair.at, pair.turn_b, 1, Vec3d(3, -7, 11), turn({1, 2, 3}, 0.1 + seed));
    EXPECT_NEAR(depth_of(moved), depth, 2 * kTolerance) << what;
    EXPECT_NEAR(overlap_volume(moved), volume, 1e-12) << what;
    for (const double scale : {0x1p-20, 0x1p10}) {
        const ContactScene scaled = scene_of(pair.a, pair.b, pair.at, pair.turn_b, scale);
        EXPECT_NEAR(depth_of(scaled) / scale, depth, 2 * kTolerance) << what << " scale " << scale;
        EXPECT_NEAR(overlap_volume(scaled) / (scale * scale * scale), volume, 1e-12) << what << " scale " << scale;
    }

    // other orders of vertices, of faces and of the corners in a face
    std::mt19937 random(seed);
    Mesh permuted = pair.a;
    std::vector<uint32_t> to(permuted.position.size());
    std::iota(to.begin(), to.end(), 0u);
    std::shuffle(to.begin(), to.end(), random);
    for (uint32_t v = 0; v < to.size(); ++v) permuted.position[to[v]] = pair.a.position[v];
    for (Triangle& t : permuted.triangle) t = {to[t[1]], to[t[2]], to[t[0]]};
    std::shuffle(permuted.triangle.begin(), permuted.triangle.end(), random);
    const ContactScene other = scene_of(permuted, pair.b, pair.at, pair.turn_b);
    EXPECT_NEAR(depth_of(other), depth, 2 * kTolerance) << what;
    EXPECT_NEAR(overlap_volume(other), volume, 1e-13) << what;

    // 1-Lipschitz; a translation slightly shorter than the depth cannot separate, in any direction
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int i = 0; i < 4; ++i) {
        const Vec3d step = 0.05 * Vec3d(unit(random), unit(random), unit(random));
        const ContactScene stepped = scene_of(pair.a, pair.b, pair.at + step, pair.turn_b);
        EXPECT_LE(std::abs(depth_of(stepped) - depth), step.norm() + 2 * kTolerance) << what;
    }
    if (!(depth > 1e-3)) return depth > 0;
    for (int i = 0; i < 4; ++i) {
        const Vec3d direction = Vec3d(unit(random), unit(random), unit(random)).normalized();
        const ContactScene pushed = scene_of(pair.a, pair.b, pair.at + (depth - 1e-5) * direction, pair.turn_b);
        EXPECT_FALSE(pushed.contours.curve.empty()) << what << ": free by less than the depth";
    }
    return true;
}

TEST(Metamorphic, FixedSeeds) {
    uint32_t overlapping = 0;
    for (uint32_t seed = 1; seed <= 12; ++seed) overlapping += check_pair(seed);
    EXPECT_GE(overlapping, 8u);
}

TEST(Metamorphic, FreshSeed) {
    const uint32_t seed = std::random_device()();
    std::printf("[          ] fresh seed %u\n", seed);
    check_pair(seed);
}

// The support of a shape above a plane is exact: slightly more than the depth frees it, slightly less not.
TEST(Metamorphic, PushedOutOfAPlaneByTheDepth) {
    for (uint32_t seed = 1; seed <= 6; ++seed) {
        const Mesh shape = make_noisy_sphere(8, 0.4, 0.3, seed);
        ContactScene scene({{make_box({40, 40, 20}, {7, 7, 1}), Motion::kHand, Vec3d(3, -2, -10), {}},
                            {shape, Motion::kHand, Vec3d(0, 0, 0.25), turn({1, 0.3, 2}, seed)}});
        scene.run_with_regions();
        const double depth = depth_of(scene);
        ASSERT_GT(depth, 0.01);
        const Vec3d home = scene.poses.origin[1], direction = scene.penetrations.direction[0];
        EXPECT_NEAR(direction.z(), 1, 1e-12);
        for (const double more : {1e-9, -1e-9}) {
            scene.poses.origin[1] = home + (depth + more) * direction;
            scene.run_with_regions();
            EXPECT_EQ(scene.contours.curve.empty() && scene.penetrations.pair.empty(), more > 0) << seed;
        }
    }
}

// Subdividing faces in their own plane adds samples: the depth of the surface never falls. (That of vertices
// and edges may: an edge entirely inside is not searched.)
TEST(Metamorphic, FlatSubdivisionNeverLowersTheDepth) {
    double before = 0;
    for (const uint32_t n : {1u, 2u, 4u, 8u}) {
        ContactScene scene({{make_box({2, 2, 2}, {n, n, n}), Motion::kHand, Vec3d::Zero(), {}},
                            {make_box({2, 1.5, 1.2}, {n, n, n}), Motion::kHand, Vec3d(0.7, 0.4, 0.5), turn({1, 2, 1}, 0.5)}});
        scene.settings.contact.tolerance = kTolerance;
        scene.settings.contact.faces = true;
        scene.run();
        EXPECT_GE(scene.penetrations.surface_depth[0], before - kTolerance) << n;
        before = scene.penetrations.surface_depth[0];
    }
    EXPECT_GT(before, 0.3);
}

// A needle of 120 mm slides through a ball of 50 mm: the depth changes by at most the displacement.
TEST(Metamorphic, NeedleSlidingThroughABall) {
    const Mesh needle = make_sphere(6, [](const Vec3d& p) { return Vec3d(5e-4 * p.x(), 5e-4 * p.y(), 0.06 * p.z()); });
    for (const Vec3d& step : {Vec3d(0, 0, 7e-4), Vec3d(7e-4, 0, 0), Vec3d(3e-4, 2e-4, 5e-4)}) {
        ContactScene scene({{make_sphere(10, [](const Vec3d& p) { return Vec3d(0.025 * p); }), Motion::kDeformable, Vec3d::Zero(), {}},
                            {needle, Motion::kHand, Vec3d::Zero(), turn({1, 2, 0}, 0.1)}});
        scene.settings.contact.tolerance = 1e-5;
        double before = -1, deepest = 0;
        for (int i = -60; i <= 20; ++i) {
            scene.poses.origin[1] = Vec3d(1e-4, 2e-4, 0) + 2.0 * i * step;
            scene.run();
            const double depth = depth_of(scene);
            if (before >= 0) {
                EXPECT_LE(std::abs(depth - before), 2 * step.norm() + 2e-5) << i;
            }
            before = depth;
            deepest = std::max(deepest, depth);
        }
        EXPECT_GT(deepest, 0.022);
    }
}

// ---- named cases ----

// P20: a ball that only grazes a plane: contact exactly if its lowest vertex is below, to the last bit.
TEST(HardCases, P20_TangentialGraze) {
    const Mesh ball = make_sphere(8, [](const Vec3d& p) { return Vec3d(0.5 * p); });
    double lowest = 0;
    for (const Vec3d& p : ball.position) lowest = std::min(lowest, p.z());
    for (const double gap : {1e-3, 1e-12, 0x1p-52, 0.0, -0x1p-52, -1e-12, -1e-3}) {
        ContactScene scene(
            {{make_box({4, 4, 2}), Motion::kHand, Vec3d(0, 0, -1), {}}, {ball, Motion::kHand, Vec3d(0.3, 0.2, gap - lowest), {}}});
        scene.run_with_regions();
        const double height = (gap - lowest) + lowest;  // as rounded
        EXPECT_EQ(!scene.penetrations.pair.empty(), height <= 0) << "P20 gap " << gap;
        EXPECT_NEAR(depth_of(scene), std::max(0.0, -height), 1e-15) << "P20 gap " << gap;
    }
}

// P23: a single body has no contacts, however its own faces touch.
TEST(HardCases, P23_FacesOfOneBodyDoNotMeet) {
    ContactScene scene({{make_noisy_sphere(10, 0.1, 0.3, 1), Motion::kDeformable, Vec3d::Zero(), {}}});
    scene.run_with_regions();
    EXPECT_TRUE(scene.pairs.a.empty() && scene.contacts.pair.empty() && scene.contours.point.empty()) << "P23";
}

// P25: a ball a million times smaller than the one it presses into is as exact, in its own units.
TEST(HardCases, P25_SizeRatioOfAMillion) {
    const Mesh ball = make_sphere(6, [](const Vec3d& p) { return p; });
    double lowest = 0;
    for (const Vec3d& p : ball.position) lowest = std::min(lowest, p.z());
    for (const double radius : {1.0, 1e-3, 1e-6}) {
        Mesh small = ball;
        for (Vec3d& p : small.position) p *= radius;
        // onto the flat top of a box of 2
        ContactScene scene({{make_box({2, 2, 2}), Motion::kHand, Vec3d(0, 0, -1), {}},
                            {small, Motion::kHand, Vec3d(0, 0, -0.75 * radius * lowest), turn({0, 0, 1}, 0.3)}});
        scene.settings.contact.tolerance = 1e-4 * radius;
        scene.run_with_regions();
        EXPECT_NEAR(depth_of(scene) / radius, -0.25 * lowest, 1e-9) << "P25 radius " << radius;
        ASSERT_EQ(scene.regions.pair.size(), 1u) << "P25 radius " << radius;
        const double cap = M_PI * 0.25 * 0.25 * (1 - 0.25 / 3);
        EXPECT_NEAR(scene.regions.volume[0] / std::pow(radius, 3), cap, 0.15 * cap) << "P25 radius " << radius;
    }
}

// P26: millimetres or metres: told by size, and an organ of 170 is not read as one of 170 m.
TEST(HardCases, P26_MillimetresAndMetres) {
    EXPECT_STREQ(guess_unit(0.17).unit, "m") << "P26";
    EXPECT_STREQ(guess_unit(170).unit, "mm") << "P26";
    EXPECT_EQ(guess_unit(170).metres, 1e-3) << "P26";
    EXPECT_FALSE(guess_unit(170).rule.empty()) << "P26";
}

// Vertices inside two bodies have constraints against each, for any order of the bodies: of the rod's four
// corners the two inverted contacts with the hand-held body have none.
TEST(HardCases, VertexInTwoBodiesObeysBoth) {
    const std::array<BodyInput, 3> input{{{make_box({1, 1, 1}, {2, 2, 2}), Motion::kDeformable, Vec3d(-0.4, 0, 0), {}},
                                          {make_box({1, 1, 1}, {2, 2, 2}), Motion::kHand, Vec3d(0.4, 0, 0), {}},
                                          {make_box({0.1, 0.1, 2}), Motion::kDeformable, Vec3d(0.02, 0.01, 1.2), {}}}};
    std::array<uint32_t, 3> order{0, 1, 2};
    do {
        std::vector<BodyInput> bodies;
        for (const uint32_t i : order) bodies.push_back(input[i]);
        ContactScene scene(bodies);
        scene.run();
        const uint32_t rod = uint32_t(std::find(order.begin(), order.end(), 2u) - order.begin());
        uint32_t rows[3] = {0, 0, 0};
        for (uint32_t i = 0; i < scene.contact_constraints.body.size(); ++i) {
            if (scene.contact_constraints.body[i] != rod ||
                scene.contact_constraints.vertex[i][0] != scene.contact_constraints.vertex[i][1])
                continue;
            if (scene.contact_constraints.distance[i] < 0) ++rows[order[scene.contact_constraints.other[i]]];
        }
        EXPECT_EQ(rows[0], 4u);
        EXPECT_EQ(rows[1], 2u);
    } while (std::next_permutation(order.begin(), order.end()));
}

// Every face contact names a face and a point on it, whose distance is the brute force's.
uint32_t expect_face_rows_true(const ContactScene& scene) {
    const Contacts& c = scene.contacts;
    uint32_t rows = 0;
    for (uint32_t i = 0; i < c.pair.size(); ++i) {
        if (c.third[i] == kNone) continue;
        ++rows;
        const auto position = [&](uint32_t v) { return vertex_position(scene.surfaces(), c.body[i], v); };
        const Vec3d p = position(c.vertex[i][0]), q = position(c.vertex[i][1]), r = position(c.third[i]);
        const double along = c.along[i], across = c.across[i];
        EXPECT_GE(std::min({along, across, 1 - along - across}), 0);
        EXPECT_LT((c.point[i] - (1 - along - across) * p - along * q - across * r).norm(), 1e-12);
        const Triangle face{c.vertex[i][0], c.vertex[i][1], c.third[i]};
        const auto faces = mesh_view(scene.meshes, scene.bodies.mesh[c.body[i]]).triangle;
        EXPECT_EQ(std::count(faces.begin(), faces.end(), face), 1);
        EXPECT_LT(c.distance[i], 0);
        EXPECT_NEAR(c.distance[i], reference::Surface(scene.surfaces(), c.other[i]).signed_distance(c.point[i]), 1e-12);
        const auto row = std::find(scene.contact_constraints.contact.begin(), scene.contact_constraints.contact.end(), i);
        if (row == scene.contact_constraints.contact.end()) {
            ADD_FAILURE() << "a face contact without a row";
            continue;
        }
        EXPECT_EQ(scene.contact_constraints.third[size_t(row - scene.contact_constraints.contact.begin())], c.third[i]);
        EXPECT_EQ(scene.contact_constraints.across[size_t(row - scene.contact_constraints.contact.begin())], c.across[i]);
    }
    return rows;
}

// Depth of faces finds what vertices and edges miss, to the tolerance, against samples of the surface.
TEST(FaceDepth, FindsWhatVerticesAndEdgesMiss) {
    for (const double tolerance : {1e-2, 1e-3, 1e-4}) {
        // one huge face of a tetrahedron over a ball: the deepest point is at its centre
        ContactScene scene({{make_sphere(12, [](const Vec3d& p) { return p; }), Motion::kHand, Vec3d::Zero(), turn({1, 2, 3}, 1)},
                            {make_tetrahedron({Vec3d(-9, -8, 0.4), Vec3d(10, -9, 0.5), Vec3d(0, 11, 0.3), Vec3d(0, 0, 9)}),
                             Motion::kHand,
                             Vec3d::Zero(),
                             {}}});
        scene.settings.contact.tolerance = tolerance;
        scene.run();
        const double without = scene.penetrations.depth[0];
        scene.settings.contact.faces = true;
        scene.run();
        ASSERT_EQ(scene.penetrations.pair.size(), 1u);
        const double found = scene.penetrations.surface_depth[0];
        EXPECT_EQ(found, scene.penetrations.depth[0]) << "a contact has it";
        expect_face_rows_true(scene);
        // samples: the ball's vertices below the face, in the tetrahedron; the face's points, in the ball
        const reference::Surface ball(scene.surfaces(), 0), tetrahedron(scene.surfaces(), 1);
        double want = without;
        for (int i = 0; i <= 20; ++i)
            for (int j = 0; j <= 20; ++j) {
                const double x = -0.5 + i / 20.0, y = -0.5 + j / 20.0;
                const Vec3d &p = tetrahedron.position[0], &q = tetrahedron.position[1], &r = tetrahedron.position[2];
                const Vec3d n = (q - p).cross(r - p);
                const Vec3d at(x, y, p.z() - (n.x() * (x - p.x()) + n.y() * (y - p.y())) / n.z());
                want = std::max(want, -ball.signed_distance(at));
            }
        EXPECT_GE(found, want - tolerance) << tolerance;
        EXPECT_LE(found, want + 0.005) << tolerance;
        EXPECT_LT(scene.frame.scratch.faces.queries[0], 20'000u) << tolerance;
        std::printf("[          ] tolerance %g: depth %.5f, %u queries\n", tolerance, found, scene.frame.scratch.faces.queries[0]);
    }
    // a face in the middle of another: its edges do not detect it
    ContactScene cubes(
        {{make_box({2, 2, 2}), Motion::kHand, Vec3d::Zero(), {}}, {make_box({3, 3, 3}), Motion::kHand, Vec3d(0, 0, 1.9), {}}});
    cubes.settings.contact.faces = true;
    cubes.run();
    EXPECT_NEAR(cubes.penetrations.surface_depth[0], 0.6, 1e-4);
    EXPECT_LT(cubes.frame.scratch.faces.queries[0], 2000u);
}

// ---- saturation and the remembered separation direction ----

TEST(Saturation, ShallowIsNotDeepIs) {
    const Mesh ball = make_sphere(10, [](const Vec3d& p) { return Vec3d(0.5 * p); });
    for (const double d : {0.95, 0.9, 0.8, 0.5}) {
        ContactScene scene({{ball, Motion::kHand, Vec3d::Zero(), {}}, {ball, Motion::kHand, Vec3d(0, d, 0), turn({1, 2, 3}, 1)}});
        scene.run();
        mark_saturated(scene.inputs(), scene.contacts, scene.penetrations);
        // the deepest point reaches the other's centre at d = 0.5
        EXPECT_EQ(scene.penetrations.saturated[0], d <= 0.5) << d;
    }
}

// Two balls of radii R and r at distance d: the depth is max(0, r - |d - R|, R - |d - r|) and the separating
// translation R + r - d, equal while d >= min(R, r). Below that the depth does not separate them, and the
// pair is marked saturated; above, farther from that limit than the meshes deviate from balls, it is not.
TEST(Saturation, P06_BallsPastEachOthersCentres) {
    for (const double small : {0.5, 0.4, 0.2}) {
        const double big = 0.5;
        const Quat turned = turn({1, 2, 3}, 1);
        uint32_t deep = 0, shallow = 0;
        for (double d = 0.01; d < big + small - 0.01; d += 0.0173) {
            const Vec3d direction = Vec3d(1, 0.3 * std::sin(40 * d), 0.5 * std::cos(30 * d)).normalized();
            ContactScene scene({{make_sphere(10, [&](const Vec3d& p) { return Vec3d(big * p); }), Motion::kHand, Vec3d::Zero(), {}},
                                {make_sphere(10, [&](const Vec3d& p) { return Vec3d(small * p); }), Motion::kHand, d * direction, turned}});
            scene.run();
            ASSERT_EQ(scene.penetrations.pair.size(), 1u) << d;
            mark_saturated(scene.inputs(), scene.contacts, scene.penetrations);
            const double least = std::min(big, small), depth = std::max({0.0, small - std::abs(d - big), big - std::abs(d - small)});
            const double mesh = 0.5 * scene.meshes.info[0].max_edge;
            EXPECT_NEAR(depth_of(scene), depth, mesh) << "P06 radius " << small << " distance " << d;
            if (d < least - mesh) {
                EXPECT_LT(depth, big + small - d);
                EXPECT_TRUE(scene.penetrations.saturated[0]) << "P06 radius " << small << " distance " << d;
                ++deep;
            } else if (d > least + 2 * mesh) {
                EXPECT_FALSE(scene.penetrations.saturated[0]) << "P06 radius " << small << " distance " << d;
                ++shallow;
            }
        }
        EXPECT_GT(deep, small > 0.3 ? 10u : 5u);
        EXPECT_GT(shallow, 5u);
    }
}

// No false alarms: shallow pairs of every kind are not marked; if one is, moving by one and a half times the
// depth must leave an overlap.
TEST(Saturation, NoFalseAlarmsOnShallowPairs) {
    uint32_t pairs = 0, saturated = 0;
    for (uint32_t seed = 1; seed <= 60; ++seed) {
        std::mt19937 random(seed);
        std::uniform_real_distribution<double> unit(-1, 1);
        const Mesh a = make_noisy_sphere(8, 1, 0.1, unit(random));
        const Mesh b = seed % 3 == 0   ? make_box({1, 0.7, 0.9}, {3, 2, 3})
                       : seed % 3 == 1 ? make_noisy_sphere(7, 0.7, 0.1, 3 * unit(random))
                                       : make_torus(0.6, 0.25, 24, 12);
        const Vec3d direction = Vec3d(unit(random), unit(random), unit(random)).normalized();
        ContactScene scene({{a, Motion::kHand, Vec3d::Zero(), {}},
                            {b, Motion::kHand, 3 * direction, turn({unit(random), 1, unit(random)}, 3 * unit(random))}});
        // until b is a twentieth deep
        for (double at = 2.2; at > 0; at -= 0.01) {
            scene.poses.origin[1] = at * direction;
            scene.run();
            if (depth_of(scene) > 0.03) break;
        }
        ASSERT_LT(depth_of(scene), 0.07);
        mark_saturated(scene.inputs(), scene.contacts, scene.penetrations);
        ++pairs;
        if (!scene.penetrations.saturated[0]) continue;
        ++saturated;
        scene.poses.origin[1] += 1.5 * scene.penetrations.depth[0] * scene.penetrations.direction[0];
        scene.run_with_regions();
        EXPECT_FALSE(scene.penetrations.pair.empty() && scene.contours.curve.empty()) << "seed " << seed << ": the depth does part them";
    }
    EXPECT_EQ(saturated, 0u) << "of " << pairs;
}

// A thin plate pushed through past its middle: the shortest separation now leads out at the far side; with
// the memory, the pair's constraints lead back.
TEST(Saturation, RowsLeadBackTheWayTheyCame) {
    ContactScene scene({{make_box({1, 1, 0.1}, {8, 8, 1}), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_box({0.2, 0.2, 0.2}, {2, 2, 2}), Motion::kHand, Vec3d(0.01, 0.02, 0.13), {}}});
    scene.settings.contact.deep = DeepResponse::kLastFree;
    PairMemory before, memory;
    uint32_t remembered = 0;
    for (const double z : {0.13, 0.11, 0.095, 0.08}) {
        scene.poses.origin[1].z() = z;
        scene.run();
        ASSERT_EQ(scene.penetrations.pair.size(), 1u);
        mark_saturated(scene.inputs(), scene.contacts, scene.penetrations);
        remember_separation_directions(scene.inputs(), scene.contacts, before, memory, scene.penetrations);
        make_contact_constraints(scene.inputs(), scene.contacts, scene.penetrations, scene.frame.scratch.constraints, scene.report,
                                 scene.contact_constraints);
        if (!scene.penetrations.saturated[0]) continue;
        ++remembered;
        EXPECT_NEAR(scene.penetrations.separation_direction[0].z(), 1, 1e-9) << z;
        for (uint32_t i = 0; i < scene.contact_constraints.body.size(); ++i) {
            if (!(scene.contacts.distance[scene.contact_constraints.contact[i]] < 0)) continue;
            EXPECT_NEAR(scene.contact_constraints.normal[i].z(), scene.contact_constraints.body[i] == 1 ? 1 : -1, 1e-6) << z;
            // as far as the plate's or the box's own face along that direction
            const uint32_t contact = scene.contact_constraints.contact[i];
            const double exit = scene.contact_constraints.body[i] == 1 ? 0.05 - scene.contacts.point[contact].z()
                                                                       : scene.contacts.point[contact].z() - (z - 0.1);
            EXPECT_NEAR(scene.contact_constraints.distance[i], -exit, 1e-7) << z;
        }
    }
    EXPECT_GE(remembered, 1u) << "never saturated: nothing was shown";
    scene.poses.origin[1].z() = 1;
    scene.run();
    remember_separation_directions(scene.inputs(), scene.contacts, before, memory, scene.penetrations);
    EXPECT_TRUE(memory.a.empty()) << "apart: forgotten";
}

// ---- organs ----

// Vertices inside or near, of both bodies, against every vertex and every triangle in double.
void expect_equal_brute_force(const ContactScene& scene, const std::string& what, double tolerance) {
    ASSERT_EQ(scene.pairs.a.size(), 1u) << what;
    const auto want = reference::near_vertices(scene.surfaces(), 0, 1, scene.boxes.margin[0] + scene.boxes.margin[1]);
    size_t at = 0;
    uint32_t inside = 0;
    for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
        if (scene.contacts.vertex[i][0] != scene.contacts.vertex[i][1]) continue;
        ASSERT_LT(at, want.size()) << what;
        ASSERT_EQ(scene.contacts.body[i], want[at].body) << what;
        ASSERT_EQ(scene.contacts.vertex[i][0], want[at].vertex) << what;
        ASSERT_NEAR(scene.contacts.distance[i], want[at].distance, tolerance) << what;
        inside += want[at++].distance < 0;
    }
    EXPECT_EQ(at, want.size()) << what;
    EXPECT_GT(inside, 3u) << what;
}

Vec3d some_vertex(const Mesh& mesh, double share) { return mesh.position[size_t(share * double(mesh.position.size()))]; }

TEST(Organs, MadeOnesEqualBruteForceAtAnyDepth) {
    const Mesh liver = make_shape("liver", 1200), kidney = make_shape("kidney", 1000);
    Vec3d centre = Vec3d::Zero();
    for (const Vec3d& p : kidney.position) centre += p / double(kidney.position.size());
    for (const double deeper : {0.0, 0.02, 0.05}) {
        const Vec3d touched = some_vertex(liver, 0.37);
        const Vec3d at = touched + deeper * (-touched).normalized() - centre;
        ContactScene scene({{liver, Motion::kDeformable, Vec3d::Zero(), {}}, {kidney, Motion::kHand, at, {}}});
        scene.run_with_regions();
        expect_equal_brute_force(scene, "deeper by " + std::to_string(deeper), 1e-9);
        // regions account for every inside vertex and contain the pair's depth
        const auto& r = scene.regions;
        EXPECT_EQ(std::accumulate(r.vertices_a.begin(), r.vertices_a.end(), 0u), scene.penetrations.vertices_a_in_b[0]);
        EXPECT_EQ(std::accumulate(r.vertices_b.begin(), r.vertices_b.end(), 0u), scene.penetrations.vertices_b_in_a[0]);
        EXPECT_EQ(*std::max_element(r.depth.begin(), r.depth.end()), scene.penetrations.depth[0]);
        for (uint32_t i = 0; i < scene.contours.curve.size(); ++i) EXPECT_TRUE(scene.contours.closed[i]);
    }
}

// Over a sweep of organs into each other, and of a bent needle through one, the depth changes by at most the
// motion, in translation and in rotation (angle times the farthest point).
TEST(Organs, DepthIsLipschitzOverASweep) {
    const Mesh liver = make_shape("liver", 900);
    for (const char* name : {"kidney", "needle", "gallbladder"}) {
        const Mesh moving = make_shape(name, 700);
        double reach = 0;
        for (const Vec3d& p : moving.position) reach = std::max(reach, p.norm());
        Vec3d centre = Vec3d::Zero();
        for (const Vec3d& p : moving.position) centre += p / double(moving.position.size());
        const Vec3d from = some_vertex(liver, 0.37) * 1.1 - centre, direction = (-some_vertex(liver, 0.37)).normalized();
        ContactScene scene({{liver, Motion::kDeformable, Vec3d::Zero(), {}}, {moving, Motion::kHand, from, {}}});
        scene.settings.contact.tolerance = 1e-6;
        double before = -1, deepest = 0;
        const double step = 6e-4, angle = 2e-3;
        for (int i = 0; i < 110; ++i) {
            scene.poses.origin[1] = from + i * step * direction;
            scene.poses.orientation[1] = turn({1, 2, 3}, 1e-12 + i * angle);
            scene.run();
            const double depth = depth_of(scene);
            if (before >= 0) {
                EXPECT_LE(std::abs(depth - before), step + angle * reach + 2e-6) << name << " step " << i;
            }
            before = depth;
            deepest = std::max(deepest, depth);
        }
        EXPECT_GT(deepest, 5e-4) << name;
    }
}

// Files of real organs and instruments, if the folder exists.
TEST(Organs, SharedFilesEqualBruteForce) {
    const std::vector<std::array<std::string, 2>> files{{"organs/Kidney_left.stl", "organs/gallbladder_collision.stl"},
                                                        {"organs-lgpl/liver.obj", "instruments/scissors_jaw_left.stl"},
                                                        {"organs/gallbladder_collision.stl", "instruments/instrument_shaft.stl"}};
    for (const auto& pair : files) {
        Meshes scratch;
        std::array<Mesh, 2> mesh;
        std::array<Admission, 2> admission{};
        for (int k = 0; k < 2; ++k) {
            const std::string path = reference::shared_data(pair[k]);
            if (reference::read_plain_mesh(path).position.empty()) GTEST_SKIP() << pair[k] << " is not there";
            const Prototype made = make_prototype(scratch, load_mesh(path).mesh, {});
            ASSERT_NE(made.row, kNone) << pair[k];
            const MeshView view = mesh_view(scratch, made.row);
            mesh[k].position.assign(view.position.begin(), view.position.end());
            mesh[k].triangle.assign(view.triangle.begin(), view.triangle.end());
            admission[k] = made.judgement.admitted_as;
        }
        if (admission[0] == Admission::kSheet || admission[1] == Admission::kSheet) continue;
        const double size = (scratch.info[1].box.max - scratch.info[1].box.min).norm();
        ContactScene scene({{mesh[0], Motion::kHand, Vec3d::Zero(), {}, admission[0]},
                            {mesh[1], Motion::kHand, some_vertex(mesh[0], 0.4) - some_vertex(mesh[1], 0.6), {}, admission[1]}});
        scene.poses.origin[1] += 0.05 * size * (Vec3d(-some_vertex(mesh[0], 0.4))).normalized();
        scene.run_with_regions();
        expect_equal_brute_force(scene, pair[0] + " and " + pair[1], 1e-9 * size);
    }
}

}  // namespace
}  // namespace trocar::test
