#include "systems/detect/narrow/overlap.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include "engine/jobs/thread_pool.hpp"
#include "tests/reference/brute_force_contact.hpp"
#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

// Vertex contacts of one pair equal brute force in set, order, distance, points and normals.
void expect_equal_brute_force(const ContactScene& scene, const std::string& what, double tolerance = 1e-12) {
    for (uint32_t pair = 0; pair < scene.pairs.a.size(); ++pair) {
        const uint32_t a = scene.pairs.a[pair], b = scene.pairs.b[pair];
        const double margin = scene.boxes.margin[a] + scene.boxes.margin[b];
        const auto want = reference::near_vertices(scene.surfaces(), a, b, margin);
        std::vector<uint32_t> found;
        for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
            const Contacts& c = scene.contacts;
            if (c.pair[i] == pair && c.vertex[i][0] == c.vertex[i][1]) found.push_back(i);
        }
        ASSERT_EQ(found.size(), want.size()) << what;
        for (size_t i = 0; i < want.size(); ++i) {
            const Contacts& c = scene.contacts;
            const uint32_t row = found[i];
            ASSERT_EQ(c.body[row], want[i].body) << what;
            ASSERT_EQ(c.other[row], want[i].other) << what;
            ASSERT_EQ(c.vertex[row][0], want[i].vertex) << what;
            EXPECT_NEAR(c.distance[row], want[i].distance, tolerance) << what;
            EXPECT_NEAR((c.point[row] - c.closest[row]).norm(), std::abs(want[i].distance), tolerance) << what;
            EXPECT_NEAR((c.point[row] - c.closest[row]).dot(c.normal[row]), want[i].distance, tolerance) << what;
            EXPECT_NEAR(c.normal[row].norm(), 1, 1e-12) << what;
        }
    }
}

uint32_t inside_count(const ContactScene& scene) {
    return uint32_t(std::count_if(scene.contacts.distance.begin(), scene.contacts.distance.end(), [](double d) { return d < 0; }));
}

template <typename T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}
bool same(const Contacts& a, const Contacts& b) {
    return same_bits(a.pair, b.pair) && same_bits(a.body, b.body) && same_bits(a.other, b.other) && same_bits(a.vertex, b.vertex) &&
           same_bits(a.along, b.along) && same_bits(a.point, b.point) && same_bits(a.closest, b.closest) && same_bits(a.normal, b.normal) &&
           same_bits(a.distance, b.distance) && same_bits(a.triangle, b.triangle);
}

ContactScene two_balls(uint32_t n, double overlap_in_cells, double cell_edges = 2.5) {
    const Mesh a = make_noisy_sphere(n, 0.1, 0.04, 0), b = make_noisy_sphere(n, 0.09, 0.04, 2);
    const double edge = 0.1 * 1.6 / n;
    return ContactScene({{a, Motion::kDeformable, Vec3d::Zero(), {}},
                         {b, Motion::kDeformable, Vec3d(0.19 - overlap_in_cells * cell_edges * edge, 0.01, 0), {}}});
}

// Breaks when the depth is limited by the cells that the surfaces share.
TEST(Overlap, NoisySpheresAtAnyDepthEqualBruteForce) {
    for (const double cells : {0.5, 1.0, 2.0, 4.0}) {
        ContactScene scene = two_balls(15, cells);
        scene.run();
        EXPECT_GT(inside_count(scene), 5u) << cells;
        expect_equal_brute_force(scene, std::to_string(cells) + " cells");
    }
}

// 20,000 triangles each, up to 20 cells deep, and one inside the other.
TEST(LongOverlap, NoisySpheresOf20kTrianglesEqualBruteForce) {
    for (const double cells : {0.5, 2.0, 5.0, 10.0, 20.0}) {
        ContactScene scene = two_balls(41, cells);
        scene.run();
        EXPECT_GT(inside_count(scene), 20u) << cells;
        expect_equal_brute_force(scene, std::to_string(cells) + " cells");
    }
    ContactScene nested({{make_noisy_sphere(41, 0.1, 0.04, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                         {make_noisy_sphere(41, 0.03, 0.04, 0), Motion::kHand, Vec3d(0.02, 0.03, 0), turn({1, 0, 2}, 1)}});
    nested.run();
    EXPECT_EQ(inside_count(nested), nested.meshes.info[1].vertices.count);
    expect_equal_brute_force(nested, "nested");
}

// A liver-like body (long, with a lobe) and a sphere pressed into it from the side.
TEST(Overlap, LiverAndSphereEqualBruteForce) {
    const Mesh liver = make_sphere(16, [](const Vec3d& p) {
        const double lobe = 1 + 0.35 * std::sin(2.5 * p.x() + 0.4) - 0.2 * p.y() * p.x();
        return Vec3d(0.1 * p.x() * lobe, 0.07 * p.y(), 0.045 * p.z() * lobe);
    });
    for (const double height : {0.03, 0.05, 0.07}) {
        ContactScene scene({{liver, Motion::kDeformable, Vec3d::Zero(), {}},
                            {make_noisy_sphere(10, 0.03, 0, 0), Motion::kDeformable, Vec3d(0.03, 0.01, height), {}}});
        scene.run();
        EXPECT_GT(inside_count(scene), 10u);
        expect_equal_brute_force(scene, std::to_string(height));
    }
}

// P16: the surfaces are not near each other; every vertex is still found with its distance to the surface.
TEST(Overlap, P16_SmallBodyDeepInsideALargeOne) {
    ContactScene scene({{make_noisy_sphere(14, 0.1, 0.03, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_noisy_sphere(6, 0.02, 0.03, 1), Motion::kHand, Vec3d(0.01, 0.02, 0), turn({1, 0, 0}, 2)}});
    scene.run();
    EXPECT_EQ(scene.candidates.triangle.size(), 0u);
    EXPECT_EQ(inside_count(scene), scene.meshes.info[1].vertices.count);
    expect_equal_brute_force(scene, "nested");
}

// Two pieces in one mesh, one inside the other body and one outside: each gets its own containment query.
TEST(Overlap, EveryPieceIsAskedFor) {
    Mesh two = make_noisy_sphere(5, 0.02, 0, 0);
    const Mesh second = make_noisy_sphere(5, 0.02, 0, 0);
    const uint32_t first = uint32_t(two.position.size());
    for (Vec3d& p : two.position) p += Vec3d(0.03, 0, 0);
    for (const Vec3d& p : second.position) two.position.push_back(p + Vec3d(-0.08, 0.08, 0.08));
    for (const Triangle& t : second.triangle) two.triangle.push_back({t[0] + first, t[1] + first, t[2] + first});
    ContactScene scene(
        {{make_noisy_sphere(14, 0.1, 0, 0), Motion::kDeformable, Vec3d::Zero(), {}}, {two, Motion::kDeformable, Vec3d::Zero(), {}}});
    scene.run();
    EXPECT_EQ(inside_count(scene), first);
    expect_equal_brute_force(scene, "pieces");
}

// Breaks when world coordinates are rounded before bodies are related: 10 km from the origin, rotated, rigid.
TEST(Overlap, TurnedRigidBodyFarFromTheOrigin) {
    const Vec3d far(1e4, -1e4, 1e4);
    ContactScene scene({{make_noisy_sphere(12, 0.1, 0.05, 0), Motion::kDeformable, far, {}},
                        {make_noisy_sphere(12, 0.1, 0.05, 1), Motion::kHand, far + Vec3d(0.13, 0.02, 0.01), turn({1, 2, 3}, 2.1)}});
    scene.run();
    EXPECT_GT(inside_count(scene), 20u);
    expect_equal_brute_force(scene, "far", 1e-10);  // the reference works in world doubles: 2e-12 m per coordinate
}

// Breaks when a third body at the same position disturbs a pair.
TEST(Overlap, ThreeBodiesInOnePlace) {
    ContactScene scene({{make_noisy_sphere(10, 0.1, 0.05, 0), Motion::kDeformable, Vec3d(0, 0, 0), {}},
                        {make_noisy_sphere(11, 0.1, 0.05, 1), Motion::kHand, Vec3d(0.05, 0, 0.02), turn({0, 1, 0}, 1)},
                        {make_noisy_sphere(9, 0.1, 0.05, 2), Motion::kDeformable, Vec3d(0, 0.06, 0.01), {}}});
    scene.run();
    EXPECT_EQ(scene.pairs.a.size(), 3u);
    expect_equal_brute_force(scene, "three");
}

// P24: the same bodies in another order give the same contacts.
TEST(Overlap, P24_OrderOfBodiesDoesNotMatter) {
    const std::vector<BodyInput> input{{make_noisy_sphere(10, 0.1, 0.05, 0), Motion::kDeformable, Vec3d(0, 0, 0), {}},
                                       {make_noisy_sphere(11, 0.1, 0.05, 1), Motion::kHand, Vec3d(0.15, 0, 0.02), turn({0, 1, 0}, 1)},
                                       {make_noisy_sphere(9, 0.1, 0.05, 2), Motion::kDeformable, Vec3d(0, 0.16, 0.01), {}}};
    using Key = std::array<uint32_t, 4>;
    const auto run = [&](const std::vector<uint32_t>& order) {
        std::vector<BodyInput> permuted;
        for (const uint32_t i : order) permuted.push_back(input[i]);
        ContactScene scene(permuted);
        scene.run();
        std::map<Key, std::array<double, 4>> rows;
        for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
            const Contacts& c = scene.contacts;
            rows[{order[c.body[i]], order[c.other[i]], c.vertex[i][0], c.vertex[i][1]}] = {c.distance[i], c.normal[i].x(), c.normal[i].y(),
                                                                                           double(c.along[i])};
        }
        return rows;
    };
    const auto rows = run({0, 1, 2});
    EXPECT_GT(rows.size(), 100u);
    EXPECT_EQ(rows, run({2, 0, 1}));
    EXPECT_EQ(rows, run({1, 2, 0}));
}

// Caches change time, never results: 50 passes of a moving, deforming scene, warm against cold, bit for bit;
// also with deliberately wrong hints.
TEST(Overlap, WarmCachesGiveTheBitsOfColdOnes) {
    const auto build = [] {
        return ContactScene({{make_noisy_sphere(12, 0.1, 0.05, 0), Motion::kDeformable, Vec3d(0, 0, 0), {}},
                             {make_noisy_sphere(8, 0.05, 0.05, 1), Motion::kHand, Vec3d(0.2, 0, 0.02), {}},
                             {make_noisy_sphere(9, 0.1, 0.05, 2), Motion::kDeformable, Vec3d(0, 0.16, 0.01), {}}});
    };
    ContactScene warm = build(), cold = build(), misled = build();
    uint32_t seed = 1, inside = 0;
    for (int pass = 0; pass < 50; ++pass) {
        for (ContactScene* scene : {&warm, &cold, &misled}) {
            scene->poses.origin[1] = Vec3d(0.2 - 0.008 * pass, 0.05 * std::sin(0.2 * pass), 0.02);
            scene->poses.orientation[1] = turn({1, 1, 0}, 0.05 * pass);
            for (uint32_t i = 0; i < scene->particles.offset.size(); ++i) {
                scene->particles.offset[i].z += 0.001f * std::sin(0.1f * float(i) + 0.3f * float(pass));
            }
        }
        cold.clear_caches();
        for (uint32_t& hint : misled.frame.scratch.overlap.hint_triangle) hint = (seed = seed * 1664525u + 1013904223u) % 900;
        for (ContactScene* scene : {&warm, &cold, &misled}) scene->run();
        ASSERT_TRUE(same(warm.contacts, cold.contacts)) << pass;
        ASSERT_TRUE(same(warm.contacts, misled.contacts)) << pass;
        inside += inside_count(warm);
    }
    EXPECT_GT(inside, 1000u);
}

// Same bits for 1, 2, 3 and 8 threads.
TEST(Overlap, H19_ThreadsDoNotShowInTheBits) {
    const auto run = [](uint32_t threads) {
        ContactScene scene = two_balls(15, 2);
        ThreadPool pool(threads);
        pool.run([&] {
            scene.run();
            scene.run();
        });
        return scene.contacts;
    };
    const Contacts one = run(1);
    for (const uint32_t threads : {2u, 3u, 8u}) EXPECT_TRUE(same(one, run(threads))) << threads;
}

// P28: a sheet has no inside; a vertex counts within half its thickness plus the margin, per side.
TEST(Overlap, P28_SheetsCountByThicknessOnBothSides) {
    for (const double side : {1.0, -1.0}) {
        ContactScene scene({{make_sheet(0.2, 10), Motion::kStatic, Vec3d::Zero(), {}, Admission::kSheet, 0.004},
                            {make_noisy_sphere(10, 0.03, 0, 0), Motion::kDeformable, Vec3d(0.013, 0.007, side * 0.031), {}}});
        scene.run();
        const double margin = scene.boxes.margin[0] + scene.boxes.margin[1];
        uint32_t expected = 0;
        for (uint32_t v = 0; v < scene.meshes.info[1].vertices.count; ++v) {
            expected += std::abs(vertex_position(scene.surfaces(), 1, v).z()) - 0.002 < margin;
        }
        uint32_t found = 0;
        for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
            if (scene.contacts.body[i] != 1) continue;
            const double z = scene.contacts.point[i].z();
            EXPECT_NEAR(scene.contacts.distance[i], std::abs(z) - 0.002, 1e-12);
            EXPECT_NEAR(scene.contacts.normal[i].z(), z > 0 ? 1 : -1, 1e-9);
            ++found;
        }
        EXPECT_EQ(found, expected);
        EXPECT_GT(found, 5u);
    }
}

// P17: interlocked C shapes: boxes overlap, surfaces do not, no vertex is inside.
TEST(Overlap, P17_InterlockedShapesWithoutContact) {
    // a C as an open torus of 300 degrees, closed at both ends
    Mesh c;
    const uint32_t around = 40, across = 10;
    for (uint32_t i = 0; i <= around; ++i) {
        for (uint32_t j = 0; j < across; ++j) {
            const double u = 5.2 * i / around, v = 2 * M_PI * j / across, r = 1 + 0.2 * std::cos(v);
            c.position.push_back(Vec3d(r * std::cos(u), r * std::sin(u), 0.2 * std::sin(v)));
        }
    }
    for (uint32_t i = 0; i < around; ++i) {
        for (uint32_t j = 0; j < across; ++j) {
            const uint32_t k = (j + 1) % across;
            c.triangle.push_back({i * across + j, (i + 1) * across + j, (i + 1) * across + k});
            c.triangle.push_back({i * across + j, (i + 1) * across + k, i * across + k});
        }
    }
    for (uint32_t j = 1; j + 1 < across; ++j) {
        c.triangle.push_back({0, j, j + 1});
        c.triangle.push_back({around * across, around * across + j + 1, around * across + j});
    }
    ContactScene scene({{c, Motion::kDeformable, Vec3d::Zero(), {}}, {c, Motion::kHand, Vec3d(1, 0, 0), turn({1, 0, 0}, M_PI / 2)}});
    ASSERT_GT(scene.meshes.info[0].volume, 0);
    scene.run();
    ASSERT_EQ(scene.pairs.a.size(), 1u);
    EXPECT_EQ(inside_count(scene), 0u);
    expect_equal_brute_force(scene, "C");
}

// A surface that folds over itself at run time: two crossing balls in one mesh, admitted as a solid, with
// wrong pseudonormals behind the inner walls. Breaks when the winding number does not decide where signs
// jump.
TEST(Overlap, FoldedSurfacesAreSettledByWinding) {
    Mesh two = make_noisy_sphere(9, 0.1, 0, 0);
    const Mesh second = make_noisy_sphere(9, 0.1, 0, 1);
    const uint32_t first = uint32_t(two.position.size());
    for (const Vec3d& p : second.position) two.position.push_back(p + Vec3d(0.1, 0.003, 0.002));
    for (const Triangle& t : second.triangle) two.triangle.push_back({t[0] + first, t[1] + first, t[2] + first});
    ContactScene scene({{two, Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_box({0.18, 0.03, 0.03}, {12, 2, 2}), Motion::kHand, Vec3d(0.03, 0.01, 0.09), turn({0, 1, 0}, 0.2)}});
    for (const auto& tree : scene.trees) tree->cross_check(true);
    scene.run();
    EXPECT_GT(scene.report.sign_disagreements, 0u);
    EXPECT_GE(scene.report.disagreements, scene.report.sign_disagreements) << "it sees all that was settled";
    const reference::Surface folded(scene.surfaces(), 0);
    const MeshView box = mesh_view(scene.meshes, 1);
    std::map<uint32_t, double> distance;
    const Range rows = scene.near.side[1];
    for (uint32_t i = rows.first; i < rows.end(); ++i) distance[scene.near.vertex[i]] = scene.near.distance[i];
    uint32_t edges = 0;
    for (const auto& [v, w] : box.edge) {
        if (!distance.count(v) || !distance.count(w)) continue;
        const double length = (box.position[v] - box.position[w]).norm();
        const bool right_v = (distance[v] < 0) == (folded.signed_distance(vertex_position(scene.surfaces(), 1, v)) < 0);
        const bool right_w = (distance[w] < 0) == (folded.signed_distance(vertex_position(scene.surfaces(), 1, w)) < 0);
        ++edges;
        // remaining jumps were decided: with inner walls the distance is no signed distance
        EXPECT_TRUE(std::abs(distance[v] - distance[w]) <= length * (1 + 1e-9) || (right_v && right_w));
    }
    EXPECT_GT(edges, 30u);
}

// A non-finite vertex is in no contact and does not carry the flood fill past the surface.
TEST(Overlap, H09_LostVerticesAreInNoContact) {
    ContactScene scene = two_balls(12, 3);
    scene.run();
    const uint32_t before = uint32_t(scene.contacts.pair.size());
    uint32_t lost = kNone;
    for (uint32_t i = 0; i < before; ++i) {
        if (scene.contacts.distance[i] < 0) lost = scene.contacts.vertex[i][0];
        if (lost != kNone) break;
    }
    scene.particles.offset[lost].x = std::numeric_limits<float>::quiet_NaN();
    for (int pass = 0; pass < 2; ++pass) {
        compute_body_boxes({scene.period, scene.surfaces()}, scene.boxes);
        rasterise(scene.inputs(), 0, scene.frame.scratch.rasterise, scene.report, scene.screened, scene.occupancy);
        find_candidate_triangles(scene.inputs(), {}, scene.screened, scene.occupancy, scene.frame.scratch.cells, scene.candidates);
        find_overlap(scene.inputs(), scene.screened, scene.candidates, scene.frame.scratch.overlap, scene.report, scene.near,
                     scene.contacts);
    }
    for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
        EXPECT_TRUE(scene.contacts.point[i].allFinite());
        EXPECT_FALSE(scene.contacts.body[i] == 0 && scene.contacts.vertex[i][0] == lost);
    }
    EXPECT_LT(scene.contacts.pair.size(), before);
    EXPECT_GT(scene.contacts.pair.size(), before / 2);
}

}  // namespace
}  // namespace trocar::test
