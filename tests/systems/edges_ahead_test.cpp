#include "systems/edges_ahead.hpp"

#include <gtest/gtest.h>

#include "tests/systems/contact_scene.hpp"
namespace trocar::test {
namespace {

constexpr double kHalfWidth = 0.1;  // m, from the axis of a bar to its edges

// A bar 1 m long along x whose cross-section is a square on its corner, cut into `parts`: an edge along its top, one along its bottom.
Mesh make_bar(uint32_t parts) {
    Mesh mesh;
    for (uint32_t i = 0; i <= parts; ++i) {
        const double x = double(i) / parts - 0.5;
        for (const auto& [y, z] : {std::pair{1.0, 0.0}, {0.0, 1.0}, {-1.0, 0.0}, {0.0, -1.0}})
            mesh.position.push_back({x, kHalfWidth * y, kHalfWidth * z});
    }
    for (uint32_t i = 0; i < parts; ++i)
        for (uint32_t k = 0; k < 4; ++k) {
            const uint32_t a = 4 * i + k, b = 4 * i + (k + 1) % 4;
            mesh.triangle.push_back({a, b, a + 4});
            mesh.triangle.push_back({b, b + 4, a + 4});
        }
    const uint32_t last = 4 * parts;
    mesh.triangle.insert(mesh.triangle.end(), {{0, 2, 1}, {0, 3, 2}, {last, last + 1, last + 2}, {last, last + 2, last + 3}});
    return mesh;
}

constexpr double kGap = 0.01, kPeriod = 0.02;  // m, s
constexpr double kAtX = 0.03, kAtY = -0.05;    // m: where the bars cross, as seen by the lower one

// A bar that moves, and a standing one above and across it.
ContactScene crossed_bars(const Vec3d& velocity, Motion upper = Motion::kStatic) {
    ContactScene scene({{make_bar(8), Motion::kDeformable, Vec3d::Zero(), {}},
                        {make_bar(8), upper, Vec3d(kAtX, -kAtY, 2 * kHalfWidth + kGap), turn({0, 0, 1}, 0.5 * M_PI)}});
    scene.period = kPeriod;
    for (size_t i = 0; i < scene.particles.offset.size(); ++i) {
        scene.particles.velocity_x[i] = float(velocity.x());
        scene.particles.velocity_y[i] = float(velocity.y());
        scene.particles.velocity_z[i] = float(velocity.z());
    }
    return scene;
}

ContactRows edges_ahead(ContactScene& scene) {
    scene.run();
    ContactRows rows;
    EdgesAheadScratch scratch;
    add_edges_ahead(scene.inputs(), scene.candidates, scene.near, scene.contacts, scratch, rows);
    return rows;
}

// Two ridges across each other: no vertex comes near a face. Breaks when the nearest points, the side or the weights are wrong.
TEST(EdgesAhead, RidgesThatComeTogetherHaveOneRow) {
    ContactScene scene = crossed_bars({0, 0, 1});
    const ContactRows rows = edges_ahead(scene);
    ASSERT_EQ(rows.body.size(), 1u);
    EXPECT_EQ(rows.body[0], 0u);
    EXPECT_EQ(rows.other[0], 1u);
    EXPECT_EQ(rows.contact[0], kNone);
    EXPECT_NEAR(rows.distance[0], kGap, 1e-7);  // places are floats
    const Vec3d a = vertex_position(scene.surfaces(), 0, rows.vertex[0][0]), b = vertex_position(scene.surfaces(), 0, rows.vertex[0][1]);
    const Vec3d point = a + double(rows.along[0]) * (b - a);
    EXPECT_NEAR((point - Vec3d(kAtX, 0, kHalfWidth)).norm(), 0, 1e-6);
    Vec3d plane = Vec3d::Zero();
    for (int k = 0; k < 3; ++k) plane += double(rows.weight[0][k]) * vertex_position(scene.surfaces(), 1, rows.triangle[0][k]);
    EXPECT_NEAR((plane - Vec3d(kAtX, 0, kHalfWidth + kGap)).norm(), 0, 1e-6);
    EXPECT_NEAR((rotate(scene.poses.orientation[1], rows.normal[0]) - Vec3d(0, 0, -1)).norm(), 0, 1e-6);
    EXPECT_EQ(rows.impulse.size(), 1u);
}

// Standing, parting, too slow, and beside the edge before they meet. Breaks when rows are made for all edges that are near.
TEST(EdgesAhead, NoRowWithoutAMeeting) {
    for (const Vec3d& velocity : {Vec3d(0, 0, 0), Vec3d(0, 0, -1), Vec3d(0, 0, 0.1), Vec3d(0, 20, 1)}) {
        ContactScene scene = crossed_bars(velocity);
        EXPECT_TRUE(edges_ahead(scene).body.empty()) << velocity.transpose();
    }
}

// Tools and free bodies would sink into folds; edges that cross have contacts, whose way out is another one.
TEST(EdgesAhead, NoneForFreeBodiesAndForWhatHasCrossed) {
    for (const Motion motion : {Motion::kHand, Motion::kFree}) {
        ContactScene free = crossed_bars({0, 0, 1}, motion);
        EXPECT_TRUE(edges_ahead(free).body.empty());
    }
    ContactScene crossed = crossed_bars({0, 0, -1});  // a row of the edges' own would hold back what parts
    crossed.poses.origin[1].z() -= 1.5 * kGap;
    EXPECT_TRUE(edges_ahead(crossed).body.empty());
    EXPECT_GT(crossed.penetrations.edge_contacts.at(0), 0u);
}

}  // namespace
}  // namespace trocar::test
