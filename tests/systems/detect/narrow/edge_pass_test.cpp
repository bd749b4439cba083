#include "systems/detect/narrow/edge_pass.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "engine/contact/pair_sides.hpp"
#include "tests/reference/brute_force_contact.hpp"
#include "tests/reference/sample_count.hpp"
#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

double deepest(const ContactScene& scene) {
    double depth = 0;
    for (const double d : scene.contacts.distance) depth = std::max(depth, -d);
    return depth;
}
uint32_t edge_rows(const ContactScene& scene) {
    uint32_t rows = 0;
    for (const auto& v : scene.contacts.vertex) rows += v[0] != v[1];
    return rows;
}

// P08: only edges cross. Breaks when only vertices are tested.
TEST(EdgePass, P08_CrossedBars) {
    ContactScene scene(
        {{make_box({10, 1, 1}), Motion::kDeformable, Vec3d::Zero(), {}}, {make_box({1, 10, 1}), Motion::kHand, Vec3d(0, 0, 0.6), {}}});
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    EXPECT_EQ(scene.penetrations.vertices_a_in_b[0] + scene.penetrations.vertices_b_in_a[0], 0u);
    EXPECT_GT(scene.penetrations.edge_contacts[0], 3u);
    EXPECT_NEAR(scene.penetrations.depth[0], 0.4, 1e-4 + 1e-7);
    EXPECT_NEAR(scene.penetrations.direction[0].z(), 1, 1e-9);  // separation direction of b
}

// P07: two 2x2x2 boxes offset by half an edge: the faces' diagonals are 0.5 deep, vertices at most 0.001.
TEST(EdgePass, P07_AlignedCubesOverlappingByThreeQuarters) {
    ContactScene scene({{make_box({2, 2, 2}), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_box({2, 2, 2}), Motion::kHand, Vec3d(0.5, 0.001, 0.001), {}}});
    scene.run();
    EXPECT_NEAR(deepest(scene), 0.5, scene.settings.contact.tolerance);
    for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
        if (scene.contacts.vertex[i][0] != scene.contacts.vertex[i][1]) continue;
        EXPECT_GT(scene.contacts.distance[i], -0.0011);
    }
}

// P10: a needle with sides of two long triangles through a slab: both ends outside, half the thickness deep.
TEST(EdgePass, P10_NeedleThroughASlab) {
    ContactScene scene({{make_box({1, 1, 0.1}), Motion::kStatic, Vec3d::Zero(), turn({1, 2, 3}, 0.4)},
                        {make_box({0.002, 0.002, 2}), Motion::kHand, Vec3d(0.05, 0.02, 0), turn({1, 2, 3}, 0.4)}});
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    EXPECT_NEAR(scene.penetrations.depth[0], 0.05, scene.settings.contact.tolerance);
    EXPECT_EQ(scene.penetrations.vertices_a_in_b[0] + scene.penetrations.vertices_b_in_a[0], 0u);
    EXPECT_GE(scene.penetrations.edge_contacts[0], 4u);  // the needle's long edges
}

// P11: a blade's edge dips into a dome between two of its vertices.
TEST(EdgePass, P11_BladeOnADome) {
    ContactScene scene({{make_sphere(12, [](const Vec3d& p) { return p; }), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_box({0.001, 4, 0.5}), Motion::kHand, Vec3d(0.013, 0.017, 1.25 - 0.02), {}}});
    scene.run();
    const reference::Surface dome(scene.surfaces(), 0);
    double want = 0;
    for (const double x : {-0.0005, 0.0005}) {
        want = std::max(want, reference::deepest_on_edge(dome, Vec3d(0.013 + x, -0.3, 0.98), Vec3d(0.013 + x, 0.3, 0.98), 600));
    }
    double found = 0;
    for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
        if (scene.contacts.body[i] == 1) found = std::max(found, -scene.contacts.distance[i]);
    }
    EXPECT_GT(want, 0.015);
    EXPECT_NEAR(found, want, scene.settings.contact.tolerance + 0.6 / (2 * 600));  // plus half a sample
}

// Every edge contact names an edge and a point on it, at the brute-force distance, in order.
TEST(EdgePass, RowsAreTrueAndInOrder) {
    ContactScene scene({{make_noisy_sphere(8, 0.1, 0.15, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_noisy_sphere(8, 0.1, 0.15, 2), Motion::kHand, Vec3d(0.15, 0.01, 0), turn({1, 1, 0}, 1)},
                        {make_box({0.3, 0.02, 0.02}), Motion::kDeformable, Vec3d(0.05, 0.08, 0), {}}});
    scene.run();
    const Contacts& c = scene.contacts;
    ASSERT_GT(edge_rows(scene), 10u);
    for (uint32_t i = 0; i < c.pair.size(); ++i) {
        const Vec3d p = vertex_position(scene.surfaces(), c.body[i], c.vertex[i][0]),
                    q = vertex_position(scene.surfaces(), c.body[i], c.vertex[i][1]);
        EXPECT_LT((c.point[i] - p - double(c.along[i]) * (q - p)).norm(), 1e-12);
        if (i > 0) {
            const auto key = [&](uint32_t row) {
                return std::array<uint32_t, 5>{c.pair[row], c.body[row] != scene.pairs.a[c.pair[row]], c.vertex[row][0] != c.vertex[row][1],
                                               c.vertex[row][0], c.vertex[row][1]};
            };
            EXPECT_LT(key(i - 1), key(i));
        }
        if (c.vertex[i][0] == c.vertex[i][1]) continue;
        EXPECT_LT(c.vertex[i][0], c.vertex[i][1]);
        const reference::Surface other(scene.surfaces(), c.other[i]);
        EXPECT_LT(c.distance[i], 0);
        EXPECT_NEAR(c.distance[i], other.signed_distance(c.point[i]), 1e-12);
    }
}

// Every edge of both bodies by dense sampling: edges with both ends outside and an inside part have a contact
// as deep as their deepest sample; edges with an inside end have one if it can matter.
void expect_edges_equal_sampling(const ContactScene& scene, uint32_t samples, uint32_t& checked) {
    const double tolerance = scene.settings.contact.tolerance;
    for (uint32_t side = 0; side < 2 * scene.pairs.a.size(); ++side) {
        const auto [pair, body, other, reversed] = pair_side(scene.pairs, side);
        const reference::Surface own(scene.surfaces(), body), surface(scene.surfaces(), other);
        for (const auto& [v, w] : mesh_view(scene.meshes, scene.bodies.mesh[body]).edge) {
            const Vec3d p = own.position[v], q = own.position[w];
            const double at_p = -surface.signed_distance(p), at_q = -surface.signed_distance(q);
            const double most = reference::deepest_on_edge(surface, p, q, samples);
            const double ends = std::max({at_p, at_q, 0.0}), step = (q - p).norm() / (2 * samples);
            double found = -1;
            for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
                const Contacts& c = scene.contacts;
                if (c.pair[i] == pair && c.body[i] == body && c.vertex[i] == std::array<uint32_t, 2>{v, w}) {
                    found = -c.distance[i];
                }
            }
            if (found >= 0) {
                EXPECT_LE(found, most + step + 1e-12);
                EXPECT_GT(found, ends);
                if (at_p <= 0 && at_q <= 0) {
                    EXPECT_GE(found, most - tolerance);
                    ++checked;
                }
            } else if (at_p <= 0 && at_q <= 0) {
                EXPECT_LT(most, 0.02 * tolerance) << "missed edge " << v << "-" << w;
            } else if (at_p <= 0 || at_q <= 0) {
                EXPECT_LE(most, ends + tolerance) << "missed half-inside edge " << v << "-" << w;
            }
        }
    }
}

Mesh random_shape(std::mt19937& random) {
    std::normal_distribution<double> normal(0, 0.5);
    const auto point = [&] { return Vec3d(normal(random), normal(random), normal(random)); };
    if (random() % 3 == 0) {
        std::uniform_real_distribution<double> size(0.1, 1.5);
        return make_box({size(random), size(random), size(random)});
    }
    for (;;) {
        const std::array<Vec3d, 4> p{point(), point(), point(), point()};
        if (std::abs((p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0])) > 0.02) return make_tetrahedron(p);
    }
}

// P09: random tetrahedra and boxes in random poses: vertex sets and edges equal the exact tests, and a pair
// is reported as overlapping exactly if part of one is inside the other.
void compare_random_pairs(uint32_t pairs, uint32_t seed, uint32_t samples) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, 0.4);
    uint32_t overlapping = 0, without_vertex = 0, checked = 0;
    for (uint32_t i = 0; i < pairs; ++i) {
        const auto position = [&] { return Vec3d(normal(random), normal(random), normal(random)); };
        const auto pose = [&] { return from_rotation_vector(4 * position()); };
        ContactScene scene(
            {{random_shape(random), Motion::kHand, position(), pose()}, {random_shape(random), Motion::kHand, position(), pose()}});
        scene.run();
        if (scene.pairs.a.empty()) continue;
        const reference::Surface a(scene.surfaces(), 0), b(scene.surfaces(), 1);
        const double margin = scene.boxes.margin[0] + scene.boxes.margin[1];
        const auto want = reference::near_vertices(scene.surfaces(), 0, 1, margin);
        const size_t vertices = scene.contacts.pair.size() - edge_rows(scene);
        ASSERT_EQ(vertices, want.size()) << i;
        size_t row = 0;
        bool inside = false;
        for (uint32_t k = 0; k < scene.contacts.pair.size(); ++k) {
            if (scene.contacts.vertex[k][0] != scene.contacts.vertex[k][1]) continue;
            EXPECT_EQ(scene.contacts.vertex[k][0], want[row].vertex) << i;
            EXPECT_NEAR(scene.contacts.distance[k], want[row].distance, 1e-12) << i;
            inside = inside || want[row].distance < 0;
            ++row;
        }
        const auto edges_cross = [&](uint32_t body, const reference::Surface& own, const reference::Surface& other) {
            for (const auto& [v, w] : mesh_view(scene.meshes, body).edge) {
                if (reference::surely_crosses(other, own.position[v], own.position[w], 1e-5)) return true;
            }
            return false;
        };
        if (inside || edges_cross(0, a, b) || edges_cross(1, b, a)) {
            ++overlapping;
            without_vertex += !inside;
            EXPECT_GT(deepest(scene), 0) << i;
        }
        expect_edges_equal_sampling(scene, samples, checked);
    }
    EXPECT_GT(overlapping, pairs / 5);
    EXPECT_GT(without_vertex, pairs / 50);
    EXPECT_GT(checked, pairs / 5);
}

TEST(EdgePass, P09_RandomTetrahedraAndBoxesEqualExactTests) { compare_random_pairs(sample_count(2000, 8), 11, 60); }
TEST(LongEdgePass, P09_RandomTetrahedraAndBoxesEqualExactTests) { compare_random_pairs(sample_count(20000, 160), 12, 200); }

// A ball whose lower cap was pushed out through its top: the space in the cap, now a cup, is outside, while
// the pseudonormals around it say inside. Breaks when the winding number does not decide sides: of edges
// across the cup, of a vertex in it with long edges, of a face that covers it.
TEST(EdgePass, PointsInTheCupOfAFoldedBallAreOutside) {
    const std::pair<const char*, BodyInput> others[] = {
        {"edges", {make_box({6, 0.02, 0.02}), Motion::kStatic, Vec3d(0.1, 0.03, 1.5), {}}},
        {"vertices", {make_box({4, 0.02, 0.02}), Motion::kStatic, Vec3d(2.1, 0.03, 1.5), {}}},
        {"faces", {make_box({6, 6, 0.02}), Motion::kStatic, Vec3d(0.1, 0.03, 1.5), {}}}};
    for (const auto& [what, other] : others) {
        ContactScene scene({{make_sphere(9, [](const Vec3d& p) { return p; }), Motion::kDeformable, Vec3d::Zero(), {}}, other});
        scene.settings.contact.faces = true;
        for (Float4& p : scene.particles.offset)
            if (p.z < -0.6f) p.z += 2.2f;
        scene.run();
        EXPECT_GT(scene.report.sign_disagreements, 0u) << what;
        const reference::Surface folded(scene.surfaces(), 0);
        const double deep = 0.1 * scene.meshes.info[0].mean_edge;
        uint32_t inside = 0;
        for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
            if (scene.contacts.body[i] != 1 || !(scene.contacts.distance[i] < -deep)) continue;
            EXPECT_GT(folded.winding_number(scene.contacts.point[i]), 0.5) << what << " " << scene.contacts.point[i].transpose();
            ++inside;
        }
        EXPECT_EQ(inside, 0u) << what << ": nothing at this height is inside the ball";
    }
}

// P02, P03: coplanar faces: touching is not overlapping.
TEST(EdgePass, P02_P03_CubesSharingAFacePlane) {
    for (const double shift : {0.0, 0.25, 1.0}) {
        ContactScene scene({{make_box({1, 1, 1}, {3, 3, 3}), Motion::kDeformable, Vec3d::Zero(), {}},
                            {make_box({1, 1, 1}, {3, 3, 3}), Motion::kHand, Vec3d(1, shift, shift), {}}});
        scene.run();
        EXPECT_LT(deepest(scene), 1e-15) << shift;
        for (const double d : scene.contacts.distance) EXPECT_TRUE(std::isfinite(d));
        for (const Vec3d& n : scene.contacts.normal) EXPECT_NEAR(n.norm(), 1, 1e-9);
    }
}

}  // namespace
}  // namespace trocar::test
