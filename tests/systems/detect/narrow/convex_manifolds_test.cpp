#include "systems/detect/narrow/convex_manifolds.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "engine/contact/convex_pairs.hpp"
#include "engine/mesh/convex_contact.hpp"
#include "tests/reference/hull_depth.hpp"
#include "tests/systems/detect/contact_scene.hpp"

// Contacts of convex hulls, against brute force over all directions and against the contact of the triangles.
namespace trocar::test {
namespace {

constexpr double kPreferred = 1e-5;  // m

// Hull of points on a ball of 50 mm, pulled apart along z by `stretch` (m).
Mesh stone(std::mt19937& random, double stretch) {
    std::normal_distribution<double> normal;
    std::vector<Vec3d> points;
    for (int i = 0; i < 16; ++i) {
        const Vec3d p = Vec3d(normal(random), normal(random), normal(random)).normalized();
        points.push_back(0.05 * p + Vec3d(0, 0, p.z() > 0 ? stretch : -stretch));
    }
    return reference::hull_of(points);
}

Mesh moved(Mesh mesh, const Quat& turn, const Vec3d& shift) {
    for (Vec3d& p : mesh.position) p = rotate(turn, p) + shift;
    return mesh;
}

ConvexHull hull_of_mesh(const Mesh& mesh) {
    Meshes meshes;
    ConvexHull hull;
    EXPECT_TRUE(make_convex_hull(meshes, add_prototype(meshes, mesh, Admission::kSolid), hull));
    return hull;
}

// A pair of random shapes; b touches or overlaps a, or is a little apart.
struct Pair {
    std::array<Mesh, 2> mesh;
    Quat turn;
    Vec3d shift;
};
Pair random_pair(std::mt19937& random) {
    std::uniform_real_distribution<double> unit(-1, 1);
    std::normal_distribution<double> normal;
    const auto shape = [&] {
        switch (random() % 3) {
            case 0:
                return make_box({0.04 + 0.03 * unit(random), 0.06, 0.05}, {1, 2, 3});
            case 1:
                return stone(random, 0.02);
            default:
                return stone(random, 0);
        }
    };
    Pair pair{{shape(), shape()}, {}, Vec3d(normal(random), normal(random), normal(random)).normalized()};
    pair.turn = random() % 4 == 0 ? Quat{} : from_rotation_vector(2 * Vec3d(unit(random), unit(random), unit(random)));
    pair.shift *= 0.075 + 0.03 * unit(random);
    return pair;
}

TEST(ConvexHull, FacesAreMergedAndDentsRefused) {
    const ConvexHull box = hull_of_mesh(make_box({0.1, 0.2, 0.3}, {3, 4, 5}));
    EXPECT_EQ(box.face.size(), 6u);
    EXPECT_EQ(box.edge.size(), 12u);
    EXPECT_EQ(box.point.size(), 8u);
    for (const HullFace& face : box.face) EXPECT_NEAR(face.offset, 0.5 * face.normal.cwiseAbs().dot(Vec3d(0.1, 0.2, 0.3)), 1e-15);
    std::mt19937 random(3);
    const ConvexHull ball = hull_of_mesh(stone(random, 0));
    EXPECT_EQ(ball.point.size() + ball.face.size(), ball.edge.size() + 2) << "Euler";

    Meshes meshes;
    ConvexHull none;
    const auto refuses = [&](const Mesh& mesh) { return !make_convex_hull(meshes, add_prototype(meshes, mesh, Admission::kSolid), none); };
    EXPECT_TRUE(refuses(make_torus(0.1, 0.03, 12, 8)));
    EXPECT_TRUE(refuses(make_noisy_sphere(4, 0.1, 0.2, 1)));
    Mesh dented = make_box({0.1, 0.1, 0.1}, {2, 2, 2});
    const double radius = 0.05 * std::sqrt(3.0);
    for (Vec3d& p : dented.position)
        if (p.x() == 0 && p.y() == 0 && p.z() > 0) p.z() -= 0.5 * kConvexTolerance * radius;
    EXPECT_FALSE(refuses(dented));
    for (Vec3d& p : dented.position)
        if (p.x() == 0 && p.y() == 0 && p.z() > 0) p.z() -= 2 * kConvexTolerance * radius;
    EXPECT_TRUE(refuses(dented));
    Mesh two = make_box({0.1, 0.1, 0.1});
    const Mesh second = moved(two, {}, {1, 0, 0});
    const uint32_t first = uint32_t(two.position.size());
    two.position.insert(two.position.end(), second.position.begin(), second.position.end());
    for (const Triangle& t : second.triangle) two.triangle.push_back({t[0] + first, t[1] + first, t[2] + first});
    EXPECT_TRUE(refuses(two)) << "two pieces";
}

// The separation of hulls that overlap is the largest over the normals of all faces and of all pairs of edges, up to the preference; of
// others the direction separates them. Breaks when the bound leaves out directions that it must not.
TEST(ConvexManifolds, SeparateAlongTheBestOfAllDirections) {
    std::mt19937 random(7);
    HullContactScratch scratch;
    int inside = 0, outside = 0;
    for (int i = 0; i < 100; ++i) {
        const Pair pair = random_pair(random);
        HullManifold manifold;
        find_hull_contacts(hull_of_mesh(pair.mesh[0]), hull_of_mesh(pair.mesh[1]), pair.turn, pair.shift, 1, kPreferred, scratch, manifold);
        const double exact = -reference::hull_depth(pair.mesh[0], moved(pair.mesh[1], pair.turn, pair.shift), Vec3d::Zero());
        ASSERT_LE(manifold.separation, exact + 1e-12) << i;
        ASSERT_GE(manifold.separation, exact < 0 ? exact - 2 * kPreferred : -kPreferred) << i;
        ASSERT_GE(manifold.count, 1u) << i;
        ++(exact < 0 ? inside : outside);
    }
    EXPECT_GT(inside, 30);
    EXPECT_GT(outside, 15);
}

// Hulls of very different sizes, faces and edges exactly or almost parallel, deep in each other or apart: the sign of the separation is
// right, and the depth that of brute force. Every contact of hulls that are apart is open. Breaks when pairs of edges
// are left out.
TEST(ConvexManifolds, AlmostParallelAndApart) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::normal_distribution<double> normal;
    const auto any_direction = [&] { return Vec3d(normal(random), normal(random), normal(random)).normalized(); };
    const Mesh round = stone(random, 0.02);
    const auto shape = [&](int kind) {
        if (kind == 0) return round;
        const double size = 0.1 * std::pow(10.0, 0.7 * unit(random));
        return make_box(size * Vec3d(1 + 0.5 * unit(random), 1, 1 + 0.8 * unit(random)));
    };
    HullContactScratch scratch;
    int apart = 0, inside = 0, by_edges = 0;
    for (int i = 0; i < 500; ++i) {
        const std::array mesh = {shape(i % 8), shape((i / 2) % 8)};
        const std::array hull = {hull_of_mesh(mesh[0]), hull_of_mesh(mesh[1])};
        const double tilt = std::pow(10.0, -5 + 5 * unit(random));  // 1e-10 to 1 rad
        const Quat quarter = from_rotation_vector(0.5 * std::numbers::pi * Vec3d(random() % 2, 0, 0));
        const Quat turn =
            i % 3 == 0 ? from_rotation_vector(3 * any_direction()) : multiply(from_rotation_vector(tilt * any_direction()), quarter);
        const Mesh turned = moved(mesh[1], turn, Vec3d::Zero());
        const Vec3d direction = any_direction();
        // about as far apart, along a random direction, as they touch
        double reach = 0.02;
        while (reach < 1 && reference::hull_depth(mesh[0], turned, reach * direction) > 0) reach *= 1.4;
        const Vec3d shift = reach * (0.9 + 0.2 * unit(random)) * direction;
        const double exact = -reference::hull_depth(mesh[0], turned, shift);
        HullManifold manifold;
        find_hull_contacts(hull[0], hull[1], turn, shift, 1, 0, scratch, manifold);
        ASSERT_LE(manifold.separation, exact + 1e-9) << i << " tilt " << tilt;
        ASSERT_GE(manifold.separation, std::min(exact, 0.0) - 1e-7) << i << " tilt " << tilt;
        ASSERT_GE(manifold.count, 1u) << i;
        for (uint32_t k = 0; k < manifold.count && exact > 1e-7; ++k) ASSERT_GT(manifold.contact[k].distance, 0) << i << ' ' << k;
        ++(exact < 0 ? inside : apart);
        by_edges += manifold.count == 1;
    }
    EXPECT_GT(apart, 100);
    EXPECT_GT(inside, 100);
    EXPECT_GT(by_edges, 50);
}

// Two boxes of a falling pile, 7 mm apart or more: only two edges that cross beside their ends separate them. Breaks when edges must
// cross within them: the boxes then seem to overlap by a seventh.
TEST(ConvexManifolds, BoxesSideBySide) {
    const Mesh box = make_box({0.1, 0.1, 0.1});
    const Quat turn_a{-0.38851010837393002, -0.20648993643049862, 0.82463268391607669, -0.35553162793424403},
        turn_b{0.37315262292541829, -0.23202444713214324, 0.87779193339226202, 0.19079595805042229};
    const Vec3d apart(0.180222018418003, 0.00088982623, 0.0026114461);
    HullContactScratch scratch;
    HullManifold manifold;
    find_hull_contacts(hull_of_mesh(box), hull_of_mesh(box), multiply(conjugate(turn_a), turn_b), rotate_back(turn_a, apart), 1, 4e-5,
                       scratch, manifold);
    const double least = apart.norm() - 0.1 * std::sqrt(3.0);  // between the balls around both
    ASSERT_EQ(manifold.count, 1u);
    EXPECT_GT(manifold.separation, 0);
    EXPECT_GE(manifold.contact[0].distance, least);
}

// Judged by the triangles: moved apart by the separation, the bodies no longer overlap; by a hair less, they still do. Every
// contact's point is on its body's surface, none is deeper than the depth, and one is as deep.
TEST(ConvexManifolds, AgreeWithTheContactOfTriangles) {
    std::mt19937 random(11);
    HullContactScratch scratch;
    int overlapping = 0;
    for (int i = 0; i < 120; ++i) {
        const Pair pair = random_pair(random);
        HullManifold manifold;
        const ConvexHull a = hull_of_mesh(pair.mesh[0]), b = hull_of_mesh(pair.mesh[1]);
        find_hull_contacts(a, b, pair.turn, pair.shift, 0.002, 0, scratch, manifold);
        if (!(manifold.separation < 0)) continue;
        ++overlapping;
        ContactScene scene({{pair.mesh[0], Motion::kFree, Vec3d::Zero(), {}}, {pair.mesh[1], Motion::kFree, pair.shift, pair.turn}});
        const auto depth_at = [&](double apart) {
            scene.poses.origin[1] = pair.shift + apart * manifold.direction;
            scene.run();
            return scene.penetrations.pair.empty() ? 0.0 : scene.penetrations.depth[0];
        };
        EXPECT_EQ(depth_at(-manifold.separation + 1e-9), 0) << i;
        EXPECT_GT(depth_at(-manifold.separation - 1e-6), 0) << i;
        double deepest = 0;
        for (uint32_t k = 0; k < manifold.count; ++k) {
            const HullContact& c = manifold.contact[k];
            const auto in_b = [&](const Vec3d& p) { return rotate_back(pair.turn, p - pair.shift); };
            const Vec3d own = c.of_b ? in_b(c.point) : c.point, across = c.of_b ? c.point : in_b(c.point);
            EXPECT_NEAR(scene.trees[c.of_b]->query(own).distance, 0, 1e-12) << i;
            const double exact = scene.trees[!c.of_b]->query(across).distance;
            EXPECT_LE(std::abs(exact), std::abs(c.distance) + 1e-12) << i << ' ' << k;
            EXPECT_LE(-c.distance, -manifold.separation + 1e-12) << i << ' ' << k;
            deepest = std::max(deepest, -c.distance);
        }
        EXPECT_NEAR(deepest, -manifold.separation, 1e-9) << i;
    }
    EXPECT_GT(overlapping, 40);
}

// A box half over the rim of another, turned: the contacts are the corners of the overlap of both faces.
TEST(ConvexManifolds, BoxOnARim) {
    HullContactScratch scratch;
    HullManifold manifold;
    const ConvexHull table = hull_of_mesh(make_box({1, 1, 0.1}, {4, 4, 1})), box = hull_of_mesh(make_box({0.2, 0.2, 0.2}));
    find_hull_contacts(table, box, {}, {0.5, 0.1, 0.149}, 0.01, kPreferred, scratch, manifold);
    ASSERT_EQ(manifold.count, 4u);
    EXPECT_NEAR(manifold.separation, -0.001, 1e-12);
    for (uint32_t k = 0; k < 4; ++k) {
        const HullContact& c = manifold.contact[k];
        EXPECT_NEAR(c.distance, -0.001, 1e-12);
        EXPECT_NEAR((c.of_b ? 1 : -1) * c.normal.z(), 1, 1e-12);
        EXPECT_NEAR(std::abs(c.point.y() - 0.1), 0.1, 1e-12);
        EXPECT_TRUE(std::abs(c.point.x() - 0.4) < 1e-12 || std::abs(c.point.x() - 0.5) < 1e-12) << c.point.x();
    }
    // far beyond the rim, a corner of it is nearest
    find_hull_contacts(table, box, {}, {0.605, 0.1, 0.155}, 0.02, kPreferred, scratch, manifold);
    ASSERT_EQ(manifold.count, 1u);
    EXPECT_NEAR(manifold.contact[0].distance, 0.005 * std::sqrt(2.0), 1e-12);
    // and farther than asked there is none
    find_hull_contacts(table, box, {}, {0.65, 0.1, 0.155}, 0.02, kPreferred, scratch, manifold);
    EXPECT_EQ(manifold.count, 0u);
}

// In the frame's stages a pair of hulls has the same contacts as by itself; no triangles are searched for it, unless it moves past each
// other farther than rounds let it.
TEST(ConvexManifolds, StageLeavesTrianglesAlone) {
    ContactScene scene({{make_box({0.1, 0.1, 0.1}, {2, 2, 2}), Motion::kFree, Vec3d::Zero(), {}},
                        {make_box({0.1, 0.1, 0.1}, {2, 2, 2}), Motion::kFree, {0.03, 0.02, 0.099}, {}}});
    scene.bodies.rigid_mass.resize(2);
    for (uint32_t body = 0; body < 2; ++body) scene.bodies.rigid_mass[body].body = body;
    scene.settings.contact.hulls = true;
    scene.frame.hulls = make_convex_hulls(scene.meshes, scene.bodies);
    scene.run();
    EXPECT_TRUE(scene.candidates.near.empty());
    EXPECT_TRUE(scene.near.vertex.empty());
    ASSERT_EQ(scene.contacts.pair.size(), 4u);
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    EXPECT_NEAR(scene.penetrations.depth[0], 0.001, 1e-12);
    EXPECT_NEAR(scene.penetrations.direction[0].z(), 1, 1e-12);
    EXPECT_EQ(scene.contact_constraints.body.size(), 4u);
    const auto moves = [&](double ways) {
        const double radius = scene.meshes.info[scene.bodies.mesh[0]].radius;
        scene.poses.velocity[0].x() = ways * longest_motion(scene.settings.contact.tolerance, radius) / scene.period;
        scene.run();
    };
    moves(0.9);
    EXPECT_TRUE(scene.candidates.near.empty());
    moves(1.1);
    EXPECT_FALSE(scene.candidates.near.empty());
    moves(0);
    scene.settings.contact.faces = true;  // asks for what only triangles answer
    scene.run();
    EXPECT_FALSE(scene.candidates.near.empty());
}

}  // namespace
}  // namespace trocar::test
