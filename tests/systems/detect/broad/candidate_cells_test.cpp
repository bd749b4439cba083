#include "systems/detect/broad/candidate_cells.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "engine/jobs/thread_pool.hpp"
#include "systems/constrain/culled_constraints.hpp"
#include "systems/detect/broad/separating_axis_culling.hpp"
#include "tests/reference/brute_force_contact.hpp"
#include "tests/systems/detect/contact_scene.hpp"
namespace trocar::test {
namespace {

using PairList = std::vector<std::array<uint32_t, 2>>;

// Triangles of one side of a list of pairs, each once, ascending.
std::vector<uint32_t> one_side(const PairList& pairs, int side) {
    std::vector<uint32_t> out;
    for (const auto& pair : pairs) out.push_back(pair[side]);
    std::sort(out.begin(), out.end());
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
}

template <typename List>
void expect_between(const List& found, const List& least, const List& most, const std::string& what) {
    EXPECT_TRUE(std::is_sorted(found.begin(), found.end())) << what;
    EXPECT_TRUE(std::adjacent_find(found.begin(), found.end()) == found.end()) << what << ": reported twice";
    EXPECT_TRUE(std::includes(found.begin(), found.end(), least.begin(), least.end())) << what << ": missed";
    EXPECT_TRUE(std::includes(most.begin(), most.end(), found.begin(), found.end())) << what << ": too many";
}

// Every triangle pair with overlapping boxes, and every triangle whose enlarged box overlaps one of the other
// body, is found once, in order; extra results overlap within a rounding of the packed floats.
void expect_all_pairs(const ContactScene& scene, const std::string& what) {
    for (uint32_t pair = 0; pair < scene.pairs.a.size(); ++pair) {
        const uint32_t a = scene.pairs.a[pair], b = scene.pairs.b[pair];
        const reference::Surface of_a(scene.surfaces(), a), of_b(scene.surfaces(), b);
        double size = 0;
        for (const Vec3d& p : of_a.position) size = std::max(size, (p - scene.screened.origin).cwiseAbs().maxCoeff());
        const double slack = 1e-6 * size;
        const auto meeting = [&](double reach_a, double reach_b) { return reference::meeting_triangles(of_a, of_b, reach_a, reach_b); };
        const Range rows = scene.candidates.pair[pair];
        const auto* first = scene.candidates.triangle.data() + rows.first;
        expect_between(PairList(first, first + rows.count), meeting(0, 0), meeting(slack, slack), what + ", crossing");

        const double reach_a = reach_of(scene.bodies, scene.boxes, a), reach_b = reach_of(scene.bodies, scene.boxes, b);
        const PairList least = meeting(reach_a, reach_b), most = meeting(reach_a + slack, reach_b + slack);
        for (const uint32_t side : {0, 1}) {
            std::vector<uint32_t> near;
            for (uint32_t i = 0; i < scene.candidates.side[2 * pair + side].count; ++i) {
                const auto& [own, across] = scene.candidates.near[scene.candidates.side[2 * pair + side].first + i];
                near.push_back(own);
                const std::array<uint32_t, 2> partner{side == 0 ? own : across, side == 0 ? across : own};
                EXPECT_TRUE(std::binary_search(most.begin(), most.end(), partner)) << what << ": not near its partner";
            }
            expect_between(near, one_side(least, side), one_side(most, side), what + ", near");
        }
    }
}

// Any cell size, from many cells per triangle to all triangles in one cell.
TEST(CandidateCells, H16_H18_EqualBruteForceForAnyCellSize) {
    ContactScene scene({{make_noisy_sphere(10, 1, 0.1, 0), Motion::kDeformable, Vec3d(-0.9, -0.2, 0.1), {}},
                        {make_noisy_sphere(10, 1, 0.1, 1), Motion::kHand, Vec3d(0.9, 0, 0), turn({1, 1, 0}, 1)},
                        {make_noisy_sphere(14, 1, 0.1, 2), Motion::kDeformable, Vec3d(0, 0.8, -0.3), {}}});
    for (const double edges : {0.01, 0.3, 0.5, 1.0, 1.7, 2.5, 4.0, 8.0, 20.0, 100.0}) {
        scene.settings.contact.cell_edges = edges;
        scene.find_triangles();
        ASSERT_EQ(scene.pairs.a.size(), 3u);
        ASSERT_GT(scene.candidates.triangle.size(), 500u);
        expect_all_pairs(scene, "cell of " + std::to_string(edges) + " edges");
    }
}

// Breaks when a thread's record of one run of cells is used for the next.
TEST(CandidateCells, SameOnAnyNumberOfThreads) {
    CandidateTriangles first;
    for (const uint32_t threads : {1u, 2u, 3u, 8u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            ContactScene scene({{make_noisy_sphere(20, 1, 0.1, 0), Motion::kDeformable, Vec3d(-0.9, -0.2, 0.1), {}},
                                {make_noisy_sphere(20, 1, 0.1, 1), Motion::kHand, Vec3d(0.9, 0, 0), turn({1, 1, 0}, 1)},
                                {make_noisy_sphere(20, 1, 0.1, 2), Motion::kDeformable, Vec3d(0, 0.8, -0.3), {}}});
            scene.settings.contact.cell_edges = 1;
            scene.find_triangles();
            ASSERT_GT(scene.occupancy.cell_key.size(), 100u);
            const CandidateTriangles& found = scene.candidates;
            if (threads == 1) first = found;
            EXPECT_EQ(found.triangle, first.triangle) << threads;
            EXPECT_EQ(found.near, first.near) << threads;
            EXPECT_EQ(found.near_corners, first.near_corners) << threads;
        });
    }
    EXPECT_GT(first.near.size(), 500u);
}

// Breaks when rounding far from the origin loses a pair.
TEST(CandidateCells, EqualBruteForceFarFromTheOrigin) {
    const Vec3d far(1e4, -2e4, 3e4);
    ContactScene scene({{make_noisy_sphere(10, 0.1, 0.1, 0), Motion::kDeformable, far, {}},
                        {make_noisy_sphere(10, 0.1, 0.1, 1), Motion::kHand, far + Vec3d(0.15, 0.03, 0), turn({1, 1, 0}, 1)}});
    scene.find_triangles();
    ASSERT_GT(scene.candidates.triangle.size(), 100u);
    expect_all_pairs(scene, "far");
}

// Huge triangles against tiny ones, on the oversize path and on the normal one.
TEST(CandidateCells, OversizeTrianglesLoseNothing) {
    for (const double edges : {0.1, 0.3, 1.0, 2.5}) {
        ContactScene scene({{make_box({4, 4, 1}), Motion::kStatic, Vec3d(0, 0, -0.5), turn({1, 2, 3}, 0.1)},
                            {make_noisy_sphere(12, 0.3, 0.1, 0), Motion::kDeformable, Vec3d(0.1, 0.2, 0.2), {}},
                            {make_box({3, 0.1, 0.1}, {1, 1, 1}), Motion::kDeformable, Vec3d(0.1, 0.2, 0.02), {}}});
        scene.settings.contact.cell_edges = edges;
        scene.find_triangles();
        ASSERT_EQ(scene.pairs.a.size(), 3u);
        if (edges < 0.5) {
            ASSERT_GT(scene.occupancy.oversize.size(), 1u);
        }
        expect_all_pairs(scene, "oversize " + std::to_string(edges));
    }
}

// Flat boxes on each other's faces; the unit cubes share the plane x = 0.5.
TEST(CandidateCells, H15_FlatAndCoplanarTrianglesAreFound) {
    ContactScene scene({{make_box({1, 1, 1}, {4, 4, 4}), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_box({1, 1, 1}, {4, 4, 4}), Motion::kDeformable, Vec3d(1, 0.25, 0), {}}});
    scene.find_triangles();
    ASSERT_GT(scene.candidates.triangle.size(), 32u);
    expect_all_pairs(scene, "coplanar");
}

// Excluded pairs share cells but get no triangle pairs.
TEST(CandidateCells, OnlyCandidatePairsCount) {
    const Mesh ball = make_noisy_sphere(8, 1, 0.1, 0);
    ContactScene scene({{ball, Motion::kDeformable, Vec3d(0, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(0.5, 0, 0), {}},
                        {ball, Motion::kDeformable, Vec3d(0, 0.5, 0), {}}});
    scene.excluded_pairs = {{0, 2}};
    scene.find_triangles();
    ASSERT_EQ(scene.pairs.a.size(), 2u);
    expect_all_pairs(scene, "excluded");
}

void find_directly(ContactScene& scene, uint64_t most, double gravity = 0) {
    scene.settings.gravity = Vec3d(0, 0, -gravity);
    rasterise(scene.inputs(), most, scene.frame.scratch.rasterise, scene.report, scene.screened, scene.occupancy);
    find_candidate_triangles(scene.inputs(), {most}, scene.screened, scene.occupancy, scene.frame.scratch.cells, scene.candidates);
}

// The same results as with cells, also if only some pairs are direct. Breaks when a pair is handled by both
// methods or none, lanes beyond a list's end overlap something, or lists of different lengths are mixed up.
TEST(CandidateCells, DirectPairsLoseNothingAndRepeatNothing) {
    for (const uint64_t most : {uint64_t{1}, uint64_t{20'000}, uint64_t{1} << 30}) {
        ContactScene scene({{make_noisy_sphere(8, 0.3, 0.1, 0), Motion::kHand, Vec3d(0, 0, 0.1), {}},
                            {make_noisy_sphere(9, 0.3, 0.2, 1), Motion::kHand, Vec3d(0.5, 0.1, 0.1), turn({1, 2, 0}, 1)},
                            {make_noisy_sphere(7, 0.25, 0.1, 2), Motion::kHand, Vec3d(0.2, 0.4, 0.2), {}},
                            {make_box({4, 4, 1}, {9, 9, 3}), Motion::kStatic, Vec3d(0, 0, -0.6), turn({1, 2, 3}, 0.1)}});
        scene.find_triangles();
        ASSERT_EQ(scene.pairs.a.size(), 6u);
        const size_t cells = scene.occupancy.cell_key.size();
        find_directly(scene, most);
        expect_all_pairs(scene, "direct up to " + std::to_string(most));
        if (most == 1) {
            EXPECT_EQ(scene.occupancy.cell_key.size(), cells);
        } else if (most > 20'000) {
            EXPECT_EQ(scene.occupancy.cell_key.size(), 0u);
        } else {
            EXPECT_GT(scene.occupancy.cell_key.size(), 0u);
        }
    }
}

// For pairs with very many near triangles Embree's trees are traversed: they find the same as cells, next to pairs
// that use cells, for any number of threads. Breaks when a triangle is in no group, or is reported twice.
TEST(CandidateCells, TreesOfCrowdedPairsFindWhatCellsFind) {
    for (const uint32_t threads : {1u, 3u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            ContactScene scene({{make_noisy_sphere(32, 1, 0.02, 0), Motion::kDeformable, Vec3d(0, 0, 0), {}},
                                {make_noisy_sphere(31, 1, 0.02, 1), Motion::kHand, Vec3d(0.02, 0.01, 0), turn({1, 2, 0}, 1)},
                                {make_noisy_sphere(16, 0.5, 0.02, 2), Motion::kDeformable, Vec3d(1.4, 0, 0), {}}});
            scene.find_triangles();
            ASSERT_EQ(scene.pairs.a.size(), 3u);
            const CandidateTriangles cells = scene.candidates;
            const size_t shared = scene.occupancy.cell_key.size();
            find_directly(scene, 1);
            EXPECT_EQ(scene.frame.scratch.cells.search_of, (std::vector{PairSearch::kTrees, PairSearch::kCells, PairSearch::kCells}));
            EXPECT_LE(scene.occupancy.cell_key.size(), shared);
            const CandidateTriangles& trees = scene.candidates;
            EXPECT_EQ(trees.triangle, cells.triangle);
            EXPECT_EQ(trees.near_corners, cells.near_corners);
            ASSERT_EQ(trees.near.size(), cells.near.size());
            for (size_t i = 0; i < trees.near.size(); ++i) ASSERT_EQ(trees.near[i][0], cells.near[i][0]) << i;
            EXPECT_GT(trees.triangle.size(), 1000u);
        });
    }
}

// Edges that cross the other surface are as deep as if every corner near it were queried: corners of
// triangles that may cross are queried even if they stay away. Breaks when only corners that may arrive are.
TEST(CandidateCells, DirectPairsFindTheSameEdges) {
    uint64_t edges = 0;
    SeparatingAxisScratch parted_scratch;
    for (int round = 0; round < 20; ++round) {
        ContactScene scene({{make_noisy_sphere(3, 0.06, 0.1, round), Motion::kDeformable, Vec3d(1, 0, 0), {}},
                            {make_noisy_sphere(8, 0.05, 0.2, 1), Motion::kDeformable, Vec3d(1.095, 0.002 * round, 0.005), {}}});
        std::vector<std::array<double, 5>> found[2];
        for (const bool direct : {false, true}) {
            direct ? find_directly(scene, 1u << 30) : scene.find_triangles();
            if (direct) cull_by_separating_axis(scene.inputs(), parted_scratch, scene.candidates);
            find_overlap(scene.inputs(), scene.screened, scene.candidates, scene.frame.scratch.overlap, scene.report, scene.near,
                         scene.contacts);
            find_edge_contacts(scene.inputs(), scene.candidates, scene.near, scene.frame.scratch.edges, scene.report, scene.contacts);
            const Contacts& c = scene.contacts;
            for (uint32_t i = 0; i < c.body.size(); ++i) {
                const auto [v, w] = c.vertex[i];
                if (v != w) found[direct].push_back({double(c.body[i]), double(v), double(w), c.along[i], c.distance[i]});
            }
        }
        EXPECT_EQ(found[0], found[1]) << "round " << round;
        edges += found[0].size();
    }
    EXPECT_GT(edges, 50u);
}

struct Coming {
    uint64_t met = 0, idle = 0, asked_near = 0;
};

void give_velocity(ContactScene& scene, uint32_t body, const Vec3d& drift, double stray, std::mt19937_64& random) {
    std::uniform_real_distribution<double> unit(-1, 1);
    Particles& p = scene.particles;
    const Range rows = scene.bodies.particles[body];
    for (uint32_t i = rows.first; i < rows.end(); ++i) {
        p.velocity_x[i] = static_cast<float>(drift.x() + stray * unit(random));
        p.velocity_y[i] = static_cast<float>(drift.y() + stray * unit(random));
        p.velocity_z[i] = static_cast<float>(drift.z() + stray * unit(random));
    }
}

// Deformable vertices keep their velocity, those of `falling` accelerate by gravity: any vertex inside the
// other body within the period has a contact constraint at its start. Oracle: winding number of the moved
// surfaces.
void expect_all_that_comes(ContactScene& scene, uint32_t falling, const std::string& what, Coming& coming) {
    Particles& p = scene.particles;
    find_directly(scene, 1u << 30, 9.81);
    find_overlap(scene.inputs(), scene.screened, scene.candidates, scene.frame.scratch.overlap, scene.report, scene.near, scene.contacts);
    coming.asked_near += scene.near.vertex.size();
    make_contact_constraints(scene.inputs(), scene.contacts, scene.penetrations, scene.frame.scratch.constraints, scene.report,
                             scene.contact_constraints);
    coming.idle += scene.contact_constraints.body.size();
    CulledConstraintsScratch idle_rows;
    const Surfaces surfaces = scene.surfaces();
    cull_constraints({scene.period, Vec3d(0, 0, -9.81), surfaces, {}, {}}, idle_rows, scene.contact_constraints);
    coming.idle -= scene.contact_constraints.body.size();
    std::set<std::array<uint32_t, 2>> rows;
    for (uint32_t i = 0; i < scene.contact_constraints.body.size(); ++i)
        rows.insert({scene.contact_constraints.body[i], scene.contact_constraints.vertex[i][0]});
    // points within a smooth surface of a static body are found, but get no constraint
    for (uint32_t i = 0; i < scene.contacts.body.size(); ++i)
        if (scene.bodies.motion[scene.contacts.body[i]] == Motion::kStatic)
            rows.insert({scene.contacts.body[i], scene.contacts.vertex[i][0]});
    const std::vector<Float4> start = p.offset;
    for (const double part : {0.0, 0.3, 0.6, 1.0}) {
        const double t = part * scene.period;
        for (const uint32_t body : {0u, 1u}) {
            if (!is_deformable(scene.bodies, body)) continue;
            const Range range = scene.bodies.particles[body];
            for (uint32_t i = range.first; i < range.end(); ++i) {
                p.offset[i].x = static_cast<float>(start[i].x + t * p.velocity_x[i]);
                p.offset[i].y = static_cast<float>(start[i].y + t * p.velocity_y[i]);
                p.offset[i].z = static_cast<float>(start[i].z + t * p.velocity_z[i] - (body == falling ? 0.5 * 9.81 * t * t : 0));
            }
        }
        for (const reference::NearVertex& v : reference::near_vertices(scene.surfaces(), 0, 1, 0)) {
            ++coming.met;
            EXPECT_TRUE(rows.contains({v.body, v.vertex})) << what << ", after " << t << " s: vertex " << v.vertex << " of " << v.body;
        }
    }
}

// Breaks when the direction between the bodies is reversed, or speeds are ignored.
TEST(CandidateCells, DirectPairsSeeAllThatComesInThePeriod) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    uint64_t left_out = 0;
    Coming coming;
    for (int round = 0; round < 40; ++round) {
        const Vec3d direction = Vec3d(unit(random), unit(random), unit(random)).normalized();
        ContactScene scene(
            {{make_noisy_sphere(7, 0.06, 0.1, round), Motion::kDeformable, Vec3d(1, 0, 0), {}},
             {make_noisy_sphere(6, 0.05, 0.2, 1), Motion::kDeformable, Vec3d(1, 0, 0) + (0.105 + 0.012 * unit(random)) * direction, {}}});
        for (const uint32_t body : {0u, 1u})
            give_velocity(scene, body, (body ? -0.2 : 0.2) * direction + 0.3 * Vec3d(unit(random), unit(random), unit(random)), 0.1,
                          random);
        scene.find_triangles();
        const size_t with_cells = scene.candidates.near.size();
        expect_all_that_comes(scene, 1, "round " + std::to_string(round), coming);
        left_out += with_cells - scene.candidates.near.size();
    }
    EXPECT_GT(coming.met, 300u);
    EXPECT_GT(left_out, 300u);
    EXPECT_GT(coming.idle, 0u);  // few: vertices that move so differently may turn round
}

// A body that hits a face, an edge or a corner of a rotated static box, or grazes it. Corners that cannot
// arrive are not queried. Breaks when the box counts as moving with the body, or its sides are reversed.
TEST(CandidateCells, DirectPairsSeeAllThatComesOntoAStaticBody) {
    std::mt19937_64 random(9);
    std::uniform_real_distribution<double> unit(-1, 1);
    uint64_t with_cells = 0;
    Coming coming;
    for (int round = 0; round < 60; ++round) {
        const Vec3d direction = Vec3d(unit(random), unit(random), unit(random)).normalized();
        const Quat turned = turn(Vec3d(unit(random), unit(random), 1.5), round % 3 ? 3 * unit(random) : 0);
        const double size = 0.2, farthest = 0.5 * size / direction.cwiseAbs().maxCoeff();
        const Vec3d from = (farthest + 0.06 + 0.01 * unit(random)) * rotate(turned, direction);
        ContactScene scene({{make_noisy_sphere(7, 0.06, 0.1, round), Motion::kDeformable, Vec3d(1, 0, 0) + from, {}},
                            {make_box({size, size, size}, {3, 3, 3}), Motion::kStatic, Vec3d(1, 0, 0), turned}});
        give_velocity(scene, 0, -0.5 * rotate(turned, direction) + 0.3 * Vec3d(unit(random), unit(random), unit(random)), 0.1, random);
        scene.find_triangles();
        find_overlap(scene.inputs(), scene.screened, scene.candidates, scene.frame.scratch.overlap, scene.report, scene.near,
                     scene.contacts);
        with_cells += scene.near.vertex.size();
        expect_all_that_comes(scene, 0, "round " + std::to_string(round), coming);
    }
    EXPECT_GT(coming.met, 300u);
    EXPECT_LT(coming.asked_near, 0.9 * with_cells);
    EXPECT_GT(coming.idle, 0u);  // few: vertices that move so differently may turn round
}

}  // namespace
}  // namespace trocar::test
