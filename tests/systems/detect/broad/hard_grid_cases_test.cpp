#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/jobs/thread_pool.hpp"
#include "tests/systems/detect/contact_scene.hpp"

// Hard cases of the occupancy grid, each against a closed form or brute force.
namespace trocar::test {
namespace {

using PairList = std::vector<std::array<uint32_t, 2>>;

// Triangle pairs with overlapping boxes per pair of bodies, by comparing all triangles.
std::vector<size_t> meeting_by_brute_force(const ContactScene& scene) {
    struct Bounds {  // plain numbers: tested a thousand million times, in debug too
        double low[3], high[3];
    };
    const auto bounds_of = [&](uint32_t body) {
        std::vector<Bounds> bounds;
        for (const Triangle& t : mesh_view(scene.meshes, scene.bodies.mesh[body]).triangle) {
            Box box;
            for (const uint32_t v : t) {
                const Vec3d p = vertex_position(scene.surfaces(), body, v);
                box.min = box.min.cwiseMin(p);
                box.max = box.max.cwiseMax(p);
            }
            bounds.push_back({{box.min.x(), box.min.y(), box.min.z()}, {box.max.x(), box.max.y(), box.max.z()}});
        }
        return bounds;
    };
    const auto meeting = [](const std::vector<Bounds>& all, const std::vector<Bounds>& others) {
        size_t met = 0;
        for (const Bounds& a : all) {
            const Bounds *b = others.data(), *end = b + others.size();
            for (; b != end; ++b) {
                met += a.low[0] <= b->high[0] && b->low[0] <= a.high[0] && a.low[1] <= b->high[1] && b->low[1] <= a.high[1] &&
                       a.low[2] <= b->high[2] && b->low[2] <= a.high[2];
            }
        }
        return met;
    };
    std::vector<std::vector<Bounds>> bounds;
    for (uint32_t body = 0; body < scene.bodies.mesh.size(); ++body) bounds.push_back(bounds_of(body));
    std::vector<size_t> count;
    for (uint32_t pair = 0; pair < scene.pairs.a.size(); ++pair)
        count.push_back(meeting(bounds[scene.pairs.a[pair]], bounds[scene.pairs.b[pair]]));
    return count;
}

// Sixty overlapping balls, all in one cell: every pair of bodies gets the pairs of brute force.
TEST(HardCases, H06_AllObjectsInOneCell) {
    std::vector<BodyInput> balls;
    for (uint32_t i = 0; i < 60; ++i) {
        const Vec3d at(0.0137 * (i % 5), 0.0171 * (i / 5 % 4), 0.0193 * (i / 20));
        balls.push_back({make_noisy_sphere(2, 0.05, 0.1, 0.3 * i), Motion::kDeformable, at, {}});
    }
    ContactScene scene(balls);
    scene.settings.contact.cell_edges = 1000;
    scene.find_triangles();
    ASSERT_EQ(scene.occupancy.cell_key.size(), 1u);
    EXPECT_EQ(scene.occupancy.object.size(), 60u);
    ASSERT_EQ(scene.pairs.a.size(), 60u * 59 / 2);
    const std::vector<size_t> want = meeting_by_brute_force(scene);
    // boxes may overlap by rounding of the packed floats: a few extra pairs, none fewer
    size_t found = 0, least = 0;
    for (uint32_t pair = 0; pair < want.size(); ++pair) {
        EXPECT_GE(scene.candidates.pair[pair].count, want[pair]);
        found += scene.candidates.pair[pair].count;
        least += want[pair];
    }
    EXPECT_LE(double(found), 1.0001 * double(least));
}

// Cells 30 and up, where a signed product of the usual hash primes overflows (seen by the sanitizers).
TEST(HardCases, H07_CellIndicesBeyondThirty) {
    ContactScene scene({{make_noisy_sphere(40, 1, 0.05, 0), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_noisy_sphere(40, 1, 0.05, 1), Motion::kDeformable, Vec3d(0.4, 0.1, 0), {}}});
    scene.settings.contact.cell_edges = 1;
    scene.find_triangles();
    uint64_t largest = 0;
    for (const uint64_t key : scene.occupancy.cell_key) {
        for (const uint32_t shift : {0u, 21u, 42u}) largest = std::max(largest, key >> shift & ((1u << 21) - 1));
    }
    EXPECT_GE(largest, 30u);
    const std::vector<size_t> want = meeting_by_brute_force(scene);
    EXPECT_GE(scene.candidates.triangle.size(), want[0]);
    EXPECT_LE(double(scene.candidates.triangle.size()), 1.001 * double(want[0]));
}

// A body at 1e30 m and one without a finite position beside a touching pair, which is found.
TEST(HardCases, H08_PlacesNoCellCanName) {
    const Mesh ball = make_noisy_sphere(6, 0.1, 0, 0);
    const double inf = std::numeric_limits<double>::infinity();
    ContactScene scene({{ball, Motion::kDeformable, Vec3d(0, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(0.15, 0, 0), {}},
                        {ball, Motion::kHand, Vec3d(1e30, -1e30, 1e30), {}},
                        {ball, Motion::kHand, Vec3d(inf, 0, 0), {}},
                        {ball, Motion::kHand, Vec3d(std::nan(""), 0, 0), {}}});
    scene.find_triangles();
    ASSERT_EQ(scene.pairs.a.size(), 1u);
    EXPECT_GE(scene.candidates.pair[0].count, meeting_by_brute_force(scene)[0]);
    EXPECT_GT(scene.candidates.pair[0].count, 0u);
}

// Two shells about the origin, in cells with coordinates of both signs: the pairs of brute force, the same by bits and by sorted
// references. Breaks when a cell coordinate is truncated towards zero instead of down.
TEST(HardCases, H12_ASceneSymmetricAboutZero) {
    const Mesh ball = make_noisy_sphere(3, 0.1, 0.02, 1);
    ContactScene scene({{ball, Motion::kDeformable, Vec3d::Zero(), {}}, {ball, Motion::kHand, Vec3d(1e-3, -1e-3, 2e-3), {}}});
    scene.find_triangles();
    const std::vector<std::array<uint32_t, 2>> by_bits = scene.candidates.triangle;
    ASSERT_EQ(scene.pairs.a.size(), 1u);
    EXPECT_GE(by_bits.size(), meeting_by_brute_force(scene)[0]);
    EXPECT_GT(meeting_by_brute_force(scene)[0], 100u);
    scene.frame.scratch.rasterise.most_words = 0;
    scene.find_triangles();
    EXPECT_EQ(scene.candidates.triangle, by_bits);
}

// Three hundred small bodies, screened several at a time: the pairs of brute force, and the same layers for
// any number of threads and with warm scratch.
TEST(HardCases, H19_LayersForAnyNumberOfThreads) {
    std::vector<BodyInput> balls;
    for (uint32_t i = 0; i < 300; ++i) {
        const Vec3d at(0.093 * (i % 7), 0.091 * (i / 7 % 7), 0.094 * (i / 49));
        balls.push_back({make_noisy_sphere(2 + i % 2, 0.05, 0.1, 0.3 * i), Motion::kDeformable, at, {}});
    }
    const auto run = [&](uint32_t threads, ContactScene& scene) {
        ThreadPool pool(threads);
        pool.run([&] { scene.find_triangles(); });
    };
    ContactScene first(balls);
    run(1, first);
    const std::vector<size_t> want = meeting_by_brute_force(first);
    ASSERT_GT(want.size(), 300u);
    for (uint32_t pair = 0; pair < want.size(); ++pair) EXPECT_GE(first.candidates.pair[pair].count, want[pair]);
    for (const uint32_t threads : {1u, 2u, 3u, 8u, 64u}) {
        ContactScene scene(balls);
        run(threads, scene);
        run(threads, scene);
        EXPECT_EQ(scene.screened.triangle, first.screened.triangle) << threads;
        EXPECT_EQ(scene.occupancy.cell_key, first.occupancy.cell_key) << threads;
        EXPECT_EQ(scene.occupancy.object, first.occupancy.object) << threads;
        EXPECT_EQ(scene.occupancy.primitive, first.occupancy.primitive) << threads;
        EXPECT_EQ(scene.candidates.triangle, first.candidates.triangle) << threads;
    }
}

// No body, one body, a body without a near face: no cell, no pair, no crash.
TEST(HardCases, H14_NothingToMeet) {
    for (const uint32_t count : {0u, 1u}) {
        ContactScene scene(std::vector<BodyInput>(count, {make_noisy_sphere(4, 1, 0, 0), Motion::kDeformable, Vec3d::Zero(), {}}));
        scene.run();  // no stage is wanted: the systems by hand
        compute_body_boxes({scene.period, scene.surfaces()}, scene.boxes);
        rasterise(scene.inputs(), 0, scene.frame.scratch.rasterise, scene.report, scene.screened, scene.occupancy);
        find_candidate_triangles(scene.inputs(), {}, scene.screened, scene.occupancy, scene.frame.scratch.cells, scene.candidates);
        EXPECT_TRUE(scene.pairs.a.empty() && scene.occupancy.cell_key.empty() && scene.contacts.pair.empty());
        EXPECT_EQ(scene.occupancy.object_first, std::vector<uint32_t>{0});
        EXPECT_EQ(scene.occupancy.primitive_first, std::vector<uint32_t>{0});
    }
}

}  // namespace
}  // namespace trocar::test
