#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/reference/sample_count.hpp"
#include "tests/systems/detect/contact_scene.hpp"

// Hard cases of contact, each against a closed form or a known count.
namespace trocar::test {
namespace {

Mesh ball(double radius, uint32_t n) {
    return make_sphere(n, [=](const Vec3d& p) { return Vec3d(radius * p); });
}

// ---- H: the occupancy grid ----

// Two bodies of n small boxes each in one cell, box i of one on box i of the other and on no other.
struct Crowd {
    ContactScene scene{{}};
    ScreenedTriangles screened;
    Occupancy occupancy;

    explicit Crowd(const std::vector<std::array<float, 3>>& position, float half) {
        const uint32_t n = uint32_t(position.size());
        screened.body = {{0, n}, {n, n}};
        scene.pairs.a = {0};
        scene.pairs.b = {1};
        occupancy.cell_size = 1;
        occupancy.cell_key = {pack_cell(0, 0, 0)};
        occupancy.object_first = {0, 2};
        occupancy.object = {0, 1};
        occupancy.primitive_first = {0, n, 2 * n};
        for (uint32_t body = 0; body < 2; ++body) {
            for (uint32_t i = 0; i < n; ++i) {
                const auto& [x, y, z] = position[i];
                screened.triangle.push_back(i);
                screened.box.push_back({{x - half, y - half, z - half, 0}, {-x - half, -y - half, -z - half, 0}});
                screened.tight.push_back(screened.box.back());
                occupancy.primitive.push_back(i);
                occupancy.primitive_row.push_back(body * n + i);
            }
        }
    }
    CandidateTriangles run() {
        CandidateCellsScratch scratch;
        CandidateTriangles found;
        find_candidate_triangles(scene.inputs(), {}, screened, occupancy, scratch, found);
        return found;
    }
};

// Cells whose keys agree in their low 12 bits, counted by sorted references: every shared cell once, every pair, no other.
TEST(HardCases, H11_CellsOfEqualHashes) {
    // keys pack 21 bits a coordinate: all cells of one column x = 0 mod 4096 end in the same bits; most lie far apart
    std::vector<std::array<uint32_t, 3>> cell;
    for (uint32_t j = 0; j < 40; ++j)
        for (uint32_t k = 0; k < 38; ++k) cell.push_back({0, j, k});
    cell.push_back({4096, 41, 39});
    constexpr double kEdge = 1e-3, kCell = 10 * kEdge;
    const auto make = [&](const Vec3d& shift) {
        Mesh mesh;
        for (const auto& c : cell) {
            const Vec3d p = kCell * Vec3d(c[0] + 0.5, c[1] + 0.5, c[2] + 0.5) + shift;
            const uint32_t v = static_cast<uint32_t>(mesh.position.size());
            for (int k = 0; k < 3; ++k)
                mesh.position.push_back(p +
                                        kEdge / std::sqrt(3.0) * Vec3d(std::cos(2 * M_PI * k / 3), std::sin(2 * M_PI * k / 3), 0.1 * k));
            mesh.triangle.push_back({v, v + 1, v + 2});
        }
        return mesh;
    };
    ContactScene scene(
        {{make(Vec3d::Zero()), Motion::kHand, Vec3d::Zero(), {}}, {make(Vec3d(1e-5, 2e-5, 3e-5)), Motion::kDeformable, Vec3d::Zero(), {}}});
    scene.frame.scratch.rasterise.most_words = 0;  // no bits: references are sorted
    scene.find_triangles();
    EXPECT_FALSE(scene.frame.scratch.rasterise.keyed.empty());
    const Occupancy& o = scene.occupancy;
    EXPECT_TRUE(std::is_sorted(o.cell_key.begin(), o.cell_key.end()));
    EXPECT_EQ(std::adjacent_find(o.cell_key.begin(), o.cell_key.end()), o.cell_key.end());
    ASSERT_EQ(scene.candidates.triangle.size(), cell.size());
    for (uint32_t i = 0; i < cell.size(); ++i) ASSERT_EQ(scene.candidates.triangle[i], (std::array<uint32_t, 2>{i, i}));
}

// A million triangles in one cell (100,000 in debug): testing all against all would be 2.5e11 boxes, minutes.
// Boxes are on a lattice in x, so that exactly n pairs overlap.
TEST(HardCases, H05_AMillionTinyTrianglesInOneCell) {
    const uint32_t count = sample_count(500'000, 10);
    std::mt19937 random(5);
    std::uniform_real_distribution<float> anywhere(0.1f, 0.9f);
    std::vector<std::array<float, 3>> position(count);
    // 1000 slots of x per line, boxes half as wide as a slot; lines and columns differ in y
    for (uint32_t i = 0; i < count; ++i) {
        position[i] = {0.1f + 0.8e-3f * float(i % 1000), 0.1f + 1.6e-3f * float(i / 1000), anywhere(random)};
    }
    std::shuffle(position.begin(), position.end(), random);
    for (const bool flat_in_x : {false, true}) {
        if (flat_in_x) {
            for (auto& p : position) p = {0.5f, p[1], p[0]};
        }
        const CandidateTriangles found = Crowd(position, 0.2e-3f).run();
        ASSERT_EQ(found.triangle.size(), count);
        for (uint32_t i = 0; i < count; ++i) ASSERT_EQ(found.triangle[i], (std::array<uint32_t, 2>{i, i}));
    }
}

// ---- P: pairs and depth ----

// Prism with a V-shaped groove along y; apex at the origin, walls at `angle` from the vertical, `deep` deep.
Mesh make_groove(double angle, double deep, double length) {
    const double open = deep * std::tan(angle), wide = open + 0.02, bottom = -0.02;
    const std::array<Vec3d, 7> outline{Vec3d(-wide, 0, bottom), Vec3d(wide, 0, bottom), Vec3d(wide, 0, deep), Vec3d(open, 0, deep),
                                       Vec3d(0, 0, 0),          Vec3d(-open, 0, deep),  Vec3d(-wide, 0, deep)};
    Mesh mesh;
    for (const double y : {-0.5 * length, 0.5 * length})
        for (const Vec3d& p : outline) mesh.position.push_back(p + Vec3d(0, y, 0));
    for (uint32_t i = 0; i < 7; ++i) {
        const uint32_t j = (i + 1) % 7;
        mesh.triangle.push_back({i, j, j + 7});
        mesh.triangle.push_back({i, j + 7, i + 7});
    }
    for (const Triangle& t : {Triangle{0, 1, 4}, {1, 2, 3}, {1, 3, 4}, {0, 4, 5}, {0, 5, 6}}) {
        mesh.triangle.push_back(t);
        mesh.triangle.push_back({t[0] + 7, t[2] + 7, t[1] + 7});
    }
    for (Triangle& t : mesh.triangle) std::swap(t[1], t[2]);
    return mesh;
}

double depth_of(const ContactScene& scene) { return scene.penetrations.depth.empty() ? 0 : scene.penetrations.depth[0]; }

// A ball that presses delta into both walls of a groove: the thesis depth is delta; to separate them it must
// rise by delta / sin(a). The depth is a lower bound: moving by it does not separate the two.
TEST(HardCases, P13_BallInAVGroove) {
    const double radius = 0.01, delta = 1e-3;
    for (const double degrees : {5.0, 10.0, 30.0}) {
        const double a = degrees * M_PI / 180, height = (radius - delta) / std::sin(a);
        // one of its poles faces a wall
        const Quat pole = turn({0, 1, 0}, a);
        ContactScene scene({{make_groove(a, 1.5 * height, 0.1), Motion::kStatic, Vec3d::Zero(), {}},
                            {ball(radius, 24), Motion::kHand, Vec3d(0, 0, height), pole}});
        ASSERT_GT(scene.meshes.info[0].volume, 0);
        const double sagitta = std::pow(scene.meshes.info[1].max_edge, 2) / (6 * radius);
        scene.run();
        ASSERT_EQ(scene.penetrations.pair.size(), 1u) << degrees;
        EXPECT_NEAR(depth_of(scene), delta, 1e-12) << degrees;
        // straight away from one of the walls
        const Vec3d direction = scene.penetrations.direction[0];
        EXPECT_NEAR(std::abs(direction.x()), std::cos(a), 0.02) << degrees;
        const double rise = delta / std::sin(a);
        EXPECT_LT(depth_of(scene), rise);
        scene.poses.origin[1] = Vec3d(0, 0, height) + 1.001 * depth_of(scene) * direction;
        scene.run();
        EXPECT_GT(depth_of(scene), 0.5 * delta) << degrees << ": the other wall is still pressed";
        scene.poses.origin[1] = Vec3d(0, 0, height + rise + 1e-9);
        scene.run();
        EXPECT_EQ(depth_of(scene), 0) << degrees;
        scene.poses.origin[1] = Vec3d(0, 0, height + rise - 2 * sagitta / std::sin(a));
        scene.run();
        EXPECT_GT(depth_of(scene), 0) << degrees;
    }
}

// Two equal tori linked like a chain, each core through the centre of the other: every point of one core is R
// from the other. They touch all around a ring, so the corrections cancel.
TEST(HardCases, P15_HopfLinkedToriTouchAllAround) {
    const double ring = 1, tube = 0.52, want = 2 * tube - ring;
    ContactScene scene({{make_torus(ring, tube, 160, 96), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_torus(ring, tube, 160, 96), Motion::kHand, Vec3d(ring, 0, 0), turn({1, 0, 0}, M_PI / 2)}});
    scene.run();
    ASSERT_EQ(scene.penetrations.pair.size(), 1u);
    // chords of the ring and of the tube
    const double sagitta = std::pow(2 * M_PI * (ring + tube) / 160, 2) / (8 * ring) + std::pow(2 * M_PI * tube / 96, 2) / (8 * tube);
    EXPECT_NEAR(depth_of(scene), want, 2 * sagitta);
    EXPECT_LT(2 * sagitta, 0.25 * want);
    for (uint32_t body = 0; body < 2; ++body) {
        // the deepest of each of the 160 cross sections of the ring
        std::array<uint32_t, 160> deepest;
        deepest.fill(kNone);
        const Contacts& c = scene.contacts;
        for (uint32_t i = 0; i < c.pair.size(); ++i) {
            if (c.body[i] != body || c.vertex[i][0] != c.vertex[i][1]) continue;
            uint32_t& row = deepest[c.vertex[i][0] / 96];
            if (row == kNone || c.distance[i] < c.distance[row]) row = i;
        }
        Vec3d sum = Vec3d::Zero();
        for (const uint32_t row : deepest) {
            ASSERT_NE(row, kNone) << "body " << body;
            EXPECT_NEAR(-c.distance[row], want, 2 * sagitta) << "constant along the ring";
            sum -= c.distance[row] * c.normal[row];
        }
        EXPECT_LT(sum.norm(), 160 * sagitta) << "body " << body;
    }
}

// A rotating bar: its box contains the arc of every vertex through the period, and every vertex that is
// inside the other body at the end has a constraint at the start - as long as no vertex moves farther than a
// margin's maximum of three edges (DESIGN 6.7).
TEST(HardCases, P22_ArcOfARotatingToolTip) {
    const Mesh bar = make_box({0.2, 0.01, 0.01}, {40, 2, 2});
    for (const double speed : {0.2, 1.0, 4.0, 6.0}) {  // rad/s
        ContactScene scene({{bar, Motion::kKinematic, Vec3d::Zero(), {}},
                            {make_box({0.1, 0.04, 0.1}, {10, 4, 10}), Motion::kDeformable, Vec3d(0.08, 0.028, 0), {}}});
        scene.poses.angular_velocity[0] = Vec3d(0, 0, speed);
        const double displacement = speed * scene.period * scene.meshes.info[0].radius;
        ASSERT_LT(displacement, 3 * scene.meshes.info[0].mean_edge);
        scene.run();
        std::vector<uint8_t> has_row(scene.meshes.info[0].vertices.count, 0);
        for (uint32_t i = 0; i < scene.contact_constraints.body.size(); ++i)
            if (scene.contact_constraints.body[i] == 0 && scene.contact_constraints.vertex[i][0] == scene.contact_constraints.vertex[i][1])
                has_row[scene.contact_constraints.vertex[i][0]] = 1;
        const Box target{{0.03, 0.008, -0.05}, {0.13, 0.048, 0.05}};
        uint32_t arrived = 0;
        for (int step = 0; step <= 200; ++step) {
            const Quat q = turn({0, 0, 1}, 1e-12 + speed * scene.period * step / 200);
            for (uint32_t v = 0; v < bar.position.size(); ++v) {
                const Vec3d p = rotate(q, bar.position[v]);
                ASSERT_TRUE((p.array() >= scene.boxes.box[0].min.array() - 1e-12).all()) << speed;
                ASSERT_TRUE((p.array() <= scene.boxes.box[0].max.array() + 1e-12).all()) << speed;
                const bool inside = (p.array() > target.min.array()).all() && (p.array() < target.max.array()).all();
                arrived += inside;
                ASSERT_TRUE(!inside || has_row[v]) << "vertex " << v << " at " << speed << " rad/s";
            }
        }
        if (speed >= 4) {
            EXPECT_GT(arrived, 0u) << speed;
        }
    }
}

}  // namespace
}  // namespace trocar::test
