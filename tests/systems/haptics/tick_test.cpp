#include "systems/haptics/tick.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "systems/haptics/tool.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/brute_force_proxy.hpp"
#include "tests/reference/haptic_rig.hpp"
#include "tests/reference/local_patches.hpp"
#include "tests/reference/sample_meshes.hpp"

// Cases T06 to T16: the force that a hand must feel, from closed forms and from slow references.
namespace trocar {
namespace {

using reference::make_ground;
using reference::make_patch;
using reference::make_plane;

using reference::FreeDevice;
using reference::still_rig;
using Rig = reference::HapticRig;
constexpr double kTick = reference::kRigTick;
constexpr double kRadius = reference::kRigRadius;

// m, of the proxy's sphere from the surface
double clearance(const Rig& rig) {
    return brute_force_distance(rig.model.position, rig.model.triangle, rig.state.proxy).distance - rig.tool.tip_radius;
}

// ---- motion with the surface ----

// Triangles of every shape around the origin: well shaped, needles down to zero width, specks, all of them
// moving and deforming.
LocalContactModel any_triangles(std::mt19937& random) {
    std::uniform_real_distribution<double> any(-1, 1);
    const auto vector = [&] { return Vec3d(any(random), any(random), any(random)); };
    Mesh mesh;
    for (uint32_t t = 0; t < 400; ++t) {
        // in groups of four: of zero width, needles, slivers of all widths, any
        const uint32_t shape = t % 4;
        const Vec3d a = 6e-3 * vector(), b = a + (shape == 1 ? 2e-3 : std::pow(10, -3 - 1.5 * (1 + any(random)))) * vector();
        const double width = shape == 0 ? 0 : shape == 1 ? std::pow(10, -6 + any(random)) : std::pow(10, -3 - 3.0 * (1 + any(random)));
        const Vec3d c = shape == 3 ? Vec3d(a + 1e-3 * vector()) : Vec3d(a + 0.5 * (1 + any(random)) * (b - a) + width * vector());
        for (const Vec3d& p : {a, b, c}) mesh.position.push_back(p);
        mesh.triangle.push_back({3 * t, 3 * t + 1, 3 * t + 2});
    }
    LocalContactModel model = make_patch(mesh);
    const Vec3d going = 0.3 * vector();
    for (size_t v = 0; v < model.position.size(); ++v) model.velocity[v] = going + 0.05 * vector();
    group_triangles(model);
    return model;
}

// The float evaluation of a tip, also for nearby positions and steps, misses no triangle in contact and
// reports none later or farther than it is: against every triangle in doubles. Breaks without the error bound
// of float rounding, or when tangents at the tip's old position are used without the displacement since.
TEST(HapticNear, NoTriangleAheadIsLeftOut) {
    std::mt19937 random(11);
    std::uniform_real_distribution<double> any(-1, 1);
    const auto vector = [&] { return Vec3d(any(random), any(random), any(random)); };
    uint64_t told = 0, within = 0, asked_ahead = 0, hit = 0;
    for (int round = 0; round < 60; ++round) {
        const LocalContactModel model = any_triangles(random);
        HandTool tool;
        tool.tip_radius = round % 2 == 0 ? 4e-3 : 2e-5;
        const SurfaceTime at{0.01 * any(random), Vec3d::Zero()};
        const auto distance_from = [&](uint32_t t, const Vec3d& p) {
            const auto corner = [&](size_t k) {
                return Vec3d(model.position[model.triangle[t][k]] + at.age * model.velocity[model.triangle[t][k]]);
            };
            return std::sqrt(closest_point_on_triangle(p, corner(0), corner(1), corner(2)).squared_distance);
        };
        Vec3d centre = Vec3d::Zero();
        NearSurface near;
        for (int position = 0; position < 24; ++position) {
            if (position % 4 == 0) {  // over the face of a triangle, however narrow
                const Triangle& t = model.triangle[static_cast<size_t>(199.9 * (1 + any(random)))];
                const auto corner = [&](size_t k) { return Vec3d(model.position[t[k]] + at.age * model.velocity[t[k]]); };
                const Vec3d normal = (corner(1) - corner(0)).cross(corner(2) - corner(0)).stableNormalized();
                centre = (corner(0) + corner(1) + corner(2)) / 3 + (tool.tip_radius + 1e-7 * any(random)) * normal;
                gather_near(model, at, tool, centre, 2e-3, near);
            }
            const double beyond = position % 3 == 0 ? 2e-4 : 0;
            find_within(beyond, near);
            std::vector<double> least(model.triangle.size(), -1);
            for (const TriangleAhead& one : near.ahead) least[one.triangle] = one.least;
            told += near.ahead.size();
            for (uint32_t t = 0; t < model.triangle.size(); ++t) {
                const double distance = distance_from(t, centre);
                ASSERT_LE(least[t], distance) << round << ' ' << t;
                if (distance > tool.tip_radius + beyond) continue;
                ++within;
                ASSERT_TRUE(std::any_of(near.ahead.begin(), near.ahead.end(), [&](const TriangleAhead& one) { return one.triangle == t; }))
                    << round << ' ' << t;
            }
            const Vec3d step = (position % 2 == 0 ? 3e-4 : 5e-5) * vector();
            find_ahead(step, near);
            asked_ahead += near.ahead.size();
            std::vector<double> from(model.triangle.size(), 2);
            for (const TriangleAhead& one : near.ahead) from[one.triangle] = one.from;
            for (uint32_t t = 0; t < model.triangle.size(); ++t) {
                if (distance_from(t, centre) < tool.tip_radius) continue;
                for (double share = 0; share <= 1; share += 1.0 / 16) {
                    if (distance_from(t, centre + share * step) > tool.tip_radius) continue;
                    ASSERT_LE(from[t], share) << round << ' ' << t;
                    ++hit;
                    break;
                }
            }
            centre += 0.4 * step;
            go_to(centre, near);
        }
    }
    EXPECT_GT(hit, 400u);
    EXPECT_GT(within, 5000u);
    EXPECT_LT(static_cast<double>(told), 1.05 * static_cast<double>(within));
    EXPECT_LT(static_cast<double>(asked_ahead), 3.0 * static_cast<double>(hit));
}

// The velocity of the surface at a tip is that of its closest point among all triangles in contact, else
// among all near ones: against every triangle, with a sheet next to a solid so that the nearest is not always
// the first in contact.
TEST(HapticNear, MotionIsOfTheNearestSurface) {
    constexpr double kMost = 2e-4;  // m
    Rig rig(make_patch(
        make_ground(40, 0.012, [](const Vec3d& p) { return Vec3d(p.x(), p.y(), 2e-4 * std::sin(700 * p.x()) * std::cos(600 * p.y())); })));
    LocalContactModel& model = rig.model;
    for (size_t v = 0; v < model.position.size(); ++v) {
        const Vec3d& p = model.position[v];
        model.velocity[v] = Vec3d(std::sin(300 * p.x()), std::cos(200 * p.y()), 10 * p.x());
    }
    for (size_t t = model.triangle.size() / 2; t < model.triangle.size(); ++t) model.body[t] = 1, model.half_thickness[t] = 1.5e-4;
    group_triangles(model);
    std::mt19937 random(4);
    std::uniform_real_distribution<double> any(-1, 1);
    NearSurface near;
    uint32_t touched = 0, beside = 0, none = 0, sheets = 0;
    for (int k = 0; k < 3000; ++k) {
        const double across = k % 2 == 0 ? 5e-4 : 8e-3;  // many of them where the two meet
        const Vec3d centre(8e-3 * any(random), across * any(random), kRadius + 2.2e-4 + 3.5e-4 * any(random));
        double best = 1, best_touched = 1;
        uint32_t nearest = kNone, nearest_touched = kNone;
        bool doubtful = false;
        for (uint32_t t = 0; t < model.triangle.size(); ++t) {
            const Triangle& c = model.triangle[t];
            const double distance = std::sqrt(
                closest_point_on_triangle(centre, model.position[c[0]], model.position[c[1]], model.position[c[2]]).squared_distance);
            const double gap = distance - kRadius - model.half_thickness[t];
            doubtful = doubtful || std::abs(gap) < 5e-9 || std::abs(gap - kMost) < 5e-9;
            if (gap < kMost && distance < best) best = distance, nearest = t;
            if (gap < 0 && distance < best_touched) best_touched = distance, nearest_touched = t;
        }
        if (doubtful) continue;
        touched += nearest_touched != kNone;
        if (nearest_touched != kNone) nearest = nearest_touched;
        gather_near(model, {}, rig.tool, centre, 1e-3, near);
        const SurfaceMotion motion = surface_motion(centre, kMost, near);
        none += nearest == kNone;
        ASSERT_EQ(motion.body, nearest == kNone ? kNone : model.body[nearest]) << k;
        if (nearest == kNone) continue;
        beside += nearest_touched == kNone;
        sheets += model.body[nearest] == 1;
        const Triangle& c = model.triangle[nearest];
        const Vec3d &a = model.position[c[0]],
                    q = centre + closest_point_on_triangle(centre, a, model.position[c[1]], model.position[c[2]]).offset;
        Eigen::Matrix<double, 3, 2> sides;
        sides << model.position[c[1]] - a, model.position[c[2]] - a;
        const Eigen::Vector2d share = sides.colPivHouseholderQr().solve(q - a);
        const Vec3d wanted = (1 - share.sum()) * model.velocity[c[0]] + share[0] * model.velocity[c[1]] + share[1] * model.velocity[c[2]];
        ASSERT_LT((motion.velocity - wanted).norm(), 1e-9) << k;
    }
    EXPECT_GT(touched, 300u);
    EXPECT_GT(beside, 300u);
    EXPECT_GT(none, 100u);
    EXPECT_GT(sheets, 300u);
}

// ---- plane ----

// Breaks when the proxy is not on the offset plane, when neighbouring triangles hold it back, or when
// stiffness is scaled.
TEST(HapticTick, PlaneAnswersStiffnessTimesPenetration) {
    Rig rig = still_rig(make_patch(make_plane()));
    rig.at({0, 0, 0.01});
    for (const double z : {2.9e-3, 2e-3, 0.0, -3e-3, -9e-3}) {
        rig.go({0.0, 0.0, z}, 0.05);
        const Vec3d force = rig.rest(20);
        EXPECT_NEAR(force.z(), rig.tool.coupling_stiffness * (kRadius - z), 1e-6);
        EXPECT_NEAR(force.head<2>().norm(), 0, 1e-6);
        EXPECT_NEAR(rig.state.proxy.z(), kRadius, 1e-9);
    }
}

// Sliding over the inner edges of a flat surface in many directions: catching on an edge would show as a
// sideways force.
TEST(HapticTick, InnerEdgesOfAFlatSurfaceAreNotFelt) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> angle(0, 2 * M_PI);
    for (int path = 0; path < 15; ++path) {
        Rig rig = still_rig(make_patch(make_plane(20)));
        const double a = angle(random);
        const Vec3d along(std::cos(a), std::sin(a), 0);
        rig.at(Vec3d(-0.04 * along + Vec3d(0, 0, 5e-3)));
        rig.go(Vec3d(-0.04 * along + Vec3d(0, 0, -2e-3)), 0.05);
        for (int k = 0; k < 400; ++k) {
            const Vec3d device = (-0.04 + 2e-4 * k) * along - Vec3d(0, 0, 2e-3);
            const Vec3d force = rig.at(device);
            ASSERT_NEAR(force.head<2>().norm(), 0, 1e-5) << "path " << path << " tick " << k;
            ASSERT_NEAR(force.z(), rig.tool.coupling_stiffness * (kRadius + 2e-3), 1e-5);
        }
    }
    // exactly along an edge of the grid and over its corners
    Rig rig = still_rig(make_patch(make_plane(20)));
    rig.at({-0.04, 0, 5e-3});
    rig.go({-0.04, 0, -2e-3}, 0.05);
    for (int k = 0; k < 800; ++k) ASSERT_NEAR(rig.at({-0.04 + 1e-4 * k, 0, -2e-3}).head<2>().norm(), 0, 1e-5);
}

TEST(HapticTick, FreeMotionIsWithoutForce) {
    Rig rig = still_rig(make_patch(make_plane()));
    rig.at({0, 0, 0.02});
    rig.go({0.02, 0.01, kRadius + 1e-6}, 0.2);
    EXPECT_EQ(rig.state.command.force.norm(), 0);
    EXPECT_EQ(rig.state.contacts, 0u);
    EXPECT_EQ((rig.state.proxy - rig.state.device.position).norm(), 0);
}

// ---- sphere ----

// Radial to within the accuracy of flat triangles: for edges up to L the normals deviate by at most about L /
// R.
TEST(HapticTick, SphereAnswersRadially) {
    const double big = 0.03;
    const Mesh mesh = reference::make_sphere(Vec3d::Zero(), big, 4);
    double longest = 0;
    for (const Triangle& t : mesh.triangle)
        for (int k = 0; k < 3; ++k) longest = std::max(longest, (mesh.position[t[k]] - mesh.position[t[(k + 1) % 3]]).norm());
    const double sag = longest * longest / (6 * big);  // of a flat triangle below the sphere, circumradius L / sqrt 3
    std::mt19937 random(2);
    std::normal_distribution<double> normal;
    for (int k = 0; k < 50; ++k) {
        const Vec3d direction = Vec3d(normal(random), normal(random), normal(random)).normalized();
        Rig rig = still_rig(make_patch(mesh));
        rig.at(direction * (big + 2 * kRadius));
        const double depth = 2e-3;
        rig.go(direction * (big + kRadius - depth), 0.05);
        const Vec3d force = rig.rest(30);
        EXPECT_GT(force.normalized().dot(direction), std::cos(longest / big));
        EXPECT_NEAR(force.norm(), rig.tool.coupling_stiffness * depth, rig.tool.coupling_stiffness * sag);
        EXPECT_GT(clearance(rig), -2e-9);
    }
}

// Pressed in and drawn around the sphere, over many edges: a proxy still on its path around one keeps its
// force. Breaks when the force is dropped in the ticks in which it hovers.
TEST(HapticTick, RubbingRoundASphereIsNeverWithoutForce) {
    const double big = 0.03, depth = 3e-3;
    Rig rig = still_rig(make_patch(reference::make_sphere(Vec3d::Zero(), big, 5)));
    rig.at({big + 2 * kRadius, 0, 0});
    rig.go({big + kRadius - depth, 0, 0}, 0.05);
    for (int k = 0; k < 4000; ++k) {
        const double a = 2 * M_PI * k / 4000, b = 0.6 * std::sin(3 * a);
        const Vec3d out(std::cos(a) * std::cos(b), std::sin(a) * std::cos(b), std::sin(b));
        const Vec3d force = rig.at((big + kRadius - depth) * out);
        ASSERT_NEAR(force.norm(), rig.tool.coupling_stiffness * depth, 0.02 * rig.tool.coupling_stiffness * depth) << k;
    }
}

// ---- reference proxy on convex patches ----

Mesh random_ellipsoid(std::mt19937& random, int level, bool inward) {
    std::uniform_real_distribution<double> stretch(0.6, 1.4);
    std::normal_distribution<double> normal;
    Mesh mesh = reference::make_sphere(Vec3d::Zero(), 0.02, level);
    const Vec3d s(stretch(random), stretch(random), stretch(random));
    const Eigen::AngleAxisd turn(normal(random), Vec3d(normal(random), normal(random), normal(random)).normalized());
    for (Vec3d& p : mesh.position) p = turn * p.cwiseProduct(s);
    if (inward)
        for (Triangle& t : mesh.triangle) std::swap(t[0], t[1]);
    return mesh;
}

// Bowl: the free space is convex, so the nearest point is unique, whatever the path.
TEST(HapticTick, BowlAgreesWithBruteForce) {
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    for (int k = 0; k < 8; ++k) {
        const Mesh mesh = random_ellipsoid(random, 2, true);
        Rig rig = still_rig(make_patch(mesh));
        const Vec3d goal = 0.03 * Vec3d(normal(random), normal(random), normal(random)).normalized();
        rig.at(Vec3d::Zero());
        rig.go(goal, 0.2);
        rig.rest(40);
        const Vec3d slow = reference::brute_force_proxy(mesh.position, mesh.triangle, Vec3d::Zero(), goal, kRadius, 1e-4);
        EXPECT_NEAR((rig.state.proxy - goal).norm(), (slow - goal).norm(), 2e-6) << k;
        EXPECT_LE((rig.state.proxy - goal).norm(), (slow - goal).norm() + 1e-9) << k;  // ours is the minimum
        EXPECT_GT(clearance(rig), -2e-9) << k;
    }
}

// Convex body: both slide to the local minimum nearest to their starting points.
TEST(HapticTick, ConvexBodyAgreesWithBruteForce) {
    std::mt19937 random(4);
    std::normal_distribution<double> normal;
    for (int k = 0; k < 8; ++k) {
        const Mesh mesh = random_ellipsoid(random, 2, false);
        Rig rig = still_rig(make_patch(mesh));
        const Vec3d direction = Vec3d(normal(random), normal(random), normal(random)).normalized();
        const Vec3d start = 0.04 * direction;
        const Vec3d goal = 0.015 * (direction + 0.2 * Vec3d(normal(random), normal(random), normal(random)));
        rig.at(start);
        rig.go(goal, 0.2);
        rig.rest(60);
        const Vec3d slow = reference::brute_force_proxy(mesh.position, mesh.triangle, start, goal, kRadius, 1e-4);
        EXPECT_NEAR((rig.state.proxy - slow).norm(), 0, 1e-5) << k;
        EXPECT_GT(clearance(rig), -2e-9) << k;
    }
}

// ---- corners ----

// T08. Two walls that meet in the y axis at an opening angle; the device goes below the edge. The sphere
// rests on both walls: its centre is at radius / sin(half angle) above the edge. Breaks when planes are lost
// or conflict.
TEST(HapticTick, T08RestsInGrooves) {
    for (const double degrees : {30.0, 60.0, 90.0, 120.0, 150.0}) {
        const double half = degrees * M_PI / 360;
        const Mesh mesh = make_ground(20, 0.05, [&](const Vec3d& p) {
            return Vec3d(std::abs(p.x()) * std::sin(half) * (p.x() < 0 ? -1 : 1), p.y(), std::abs(p.x()) * std::cos(half));
        });
        Rig rig = still_rig(make_patch(mesh));
        const double height = kRadius / std::sin(half);
        rig.at({0.001, 0.0013, height + 0.01});
        rig.go({0.0004, 0.0013, height - 4e-3}, 0.1);
        rig.rest(5);
        Vec3d last = rig.state.proxy;
        EXPECT_NEAR((last - Vec3d(0, 0.0013, height)).norm(), 0, 1e-8) << degrees;
        EXPECT_EQ(rig.state.contacts, 2u) << degrees;
        for (int k = 0; k < 100; ++k) {
            rig.at(rig.state.device.position);
            EXPECT_LT((rig.state.proxy - last).norm(), 1e-9) << degrees;  // no chatter
            last = rig.state.proxy;
        }
        // sliding along the groove needs no force
        rig.go({0.0004, 0.02, height - 4e-3}, 0.1);
        EXPECT_NEAR((rig.rest(5) / rig.tool.coupling_stiffness - Vec3d(-0.0004, 0, 4e-3)).norm(), 0, 1e-8) << degrees;
    }
}

// T08. Inner corner of a box: three planes.
TEST(HapticTick, T08RestsInABoxCorner) {
    Mesh mesh = reference::make_box(Vec3d::Zero(), Vec3d::Constant(0.05));
    for (Triangle& t : mesh.triangle) std::swap(t[0], t[1]);
    Rig rig = still_rig(make_patch(mesh));
    rig.at(Vec3d::Constant(0.02));
    rig.go({-0.004, -0.002, -0.006}, 0.1);
    rig.rest(5);
    EXPECT_NEAR((rig.state.proxy - Vec3d::Constant(kRadius)).norm(), 0, 1e-9);
    EXPECT_EQ(rig.state.contacts, 3u);
}

// ---- walls ----

// T07. A sheet of negligible thickness, crossed by the device for 20 mm: the proxy stays on its side and the
// force points there, from either side.
TEST(HapticTick, T07StaysOnTheEntrySideOfASheet) {
    for (const double side : {1.0, -1.0}) {
        Rig rig = still_rig(make_patch(make_plane(), 1e-4));
        rig.at({0.003, 0.002, 0.01 * side});
        const Vec3d force = rig.go({0.003, 0.002, -0.02 * side}, 0.1);
        EXPECT_NEAR(rig.state.proxy.z(), side * (kRadius + 1e-4), 1e-8);
        EXPECT_NEAR(force.z(), side * rig.tool.coupling_stiffness * (kRadius + 1e-4 + 0.02), 1e-5);
    }
}

// T07. A closed wall 1 mm thick, reached at up to 0.5 m/s (and at the highest speed that samples may have):
// never through.
TEST(HapticTick, T07FastDeviceDoesNotTunnelThroughAMillimetre) {
    const Mesh wall = reference::make_box(Vec3d(-0.05, -0.05, -1e-3), Vec3d(0.05, 0.05, 0));
    for (const double radius : {3e-3, 0.5e-3, 0.1e-3}) {
        for (const double speed : {0.05, 0.5, 1.9}) {
            // samples are at other points each time: above, inside and beyond the wall
            for (const double start : {0.02, 0.0203, 0.0206, 0.0209, 0.0212, 0.0215, 0.0218}) {
                Rig rig = still_rig(make_patch(wall));
                rig.tool.tip_radius = radius;
                rig.at({0.0031, 0.0017, start});
                rig.go({0.0031, 0.0017, -0.02}, speed);
                EXPECT_NEAR(rig.state.proxy.z(), radius, 1e-8) << radius << " " << speed << " " << start;
                EXPECT_GT(rig.state.command.force.z(), 0);
            }
        }
    }
}

// T09. Triangles that share no vertices, with cracks of 1 um between them: a point would fall through, a
// sphere does not.
TEST(HapticTick, T09CracksDoNotLetThrough) {
    const Mesh whole = make_plane(20);
    Mesh cracked;
    for (const Triangle& t : whole.triangle) {
        const uint32_t first = static_cast<uint32_t>(cracked.position.size());
        Vec3d centre = Vec3d::Zero();
        for (const uint32_t v : t) centre += whole.position[v] / 3;
        for (const uint32_t v : t) cracked.position.push_back(whole.position[v] + 1e-6 * (centre - whole.position[v]).normalized());
        cracked.triangle.push_back({first, first + 1, first + 2});
    }
    Rig rig = still_rig(make_patch(cracked));
    rig.at({-0.02, 0, 0.01});
    rig.go({-0.02, 0, -0.004}, 0.1);
    for (int k = 0; k <= 400; ++k) {
        rig.at({-0.02 + 1e-4 * k, 0, -0.004});
        ASSERT_GT(rig.state.proxy.z(), kRadius - 1e-7) << k;
        // the crack may be felt, but only in proportion to its size
        ASSERT_LT(rig.state.command.force.head<2>().norm(), 0.05 * rig.state.command.force.z()) << k;
    }
}

// T10. Over a convex edge of 90 degrees the sphere rolls around: the direction of the force changes by at
// most the displacement of the proxy over the radius, never at once.
TEST(HapticTick, T10ForceTurnsSteadilyOverAConvexEdge) {
    const Mesh box = reference::make_box(Vec3d(-0.05, -0.05, -0.1), Vec3d(0, 0.05, 0));
    Rig rig = still_rig(make_patch(box));
    rig.at({-0.01, 0.001, 0.01});
    const double depth = 1e-3;  // the device stays this far inside the offset surface, so it does not slide off
    rig.go({-0.01, 0.001, kRadius - depth}, 0.05);
    Vec3d last = rig.state.command.force.normalized();
    double turned = 0;
    const double step = 5e-5, inner = kRadius - depth;
    const auto visit = [&](const Vec3d& device) {
        const Vec3d now = rig.at(device).normalized();
        const double angle = std::atan2(last.cross(now).norm(), last.dot(now));
        EXPECT_LE(angle, 1.05 * step / inner + 1e-7);
        turned += angle;
        last = now;
        EXPECT_NEAR(rig.state.command.force.norm(), rig.tool.coupling_stiffness * depth, 1e-4);
    };
    for (double x = -0.01; x < 0; x += step) visit({x, 0.001, inner});
    for (double a = 0; a < M_PI / 2; a += step / inner) visit({inner * std::sin(a), 0.001, inner * std::cos(a)});
    for (double z = 0; z > -0.01; z -= step) visit({inner, 0.001, z});
    EXPECT_NEAR(turned, M_PI / 2, 1e-3);
}

// ---- friction ----

// T11. Pressed in and dragged: the tangential force is at most mu times the normal force, exactly at the cone
// while sliding, and the proxy does not move while the coupling force is inside the cone.
TEST(HapticTick, T11FrictionCone) {
    for (const double mu : {0.0, 0.3, 1.0, 1e6}) {
        Rig rig = still_rig(make_patch(make_plane(20)));
        rig.tool.friction = mu;
        rig.at({0, 0, 0.01});
        const double depth = 2e-3;
        rig.go({0, 0, kRadius - depth}, 0.05);
        const Vec3d stuck = rig.state.proxy;
        const double normal_force = rig.tool.coupling_stiffness * depth;
        for (int k = 1; k <= 200; ++k) {
            const double drag = 5e-5 * k;
            const Vec3d force = rig.at({drag, 0, kRadius - depth});
            EXPECT_NEAR(force.z(), normal_force, 1e-6);
            EXPECT_LE(force.head<2>().norm(), mu * force.z() + 1e-6);
            if (drag < mu * depth - 1e-9) {
                ASSERT_NEAR((rig.state.proxy - stuck).norm(), 0, 1e-9) << mu << " " << drag;
                ASSERT_NEAR(force.x(), -rig.tool.coupling_stiffness * drag, 1e-6);
            } else {
                ASSERT_NEAR(force.x(), -mu * normal_force, 1e-5) << mu << " " << drag;
            }
        }
        // a resting hand feels a constant force: no creep
        const Vec3d proxy = rig.state.proxy;
        rig.rest(1000);
        EXPECT_NEAR((rig.state.proxy - proxy).norm(), 0, 1e-8) << mu;
    }
}

// Friction begins at the point of contact, not before: an oblique approach gives no tangential force beyond
// the slip after contact.
TEST(HapticTick, FrictionHoldsOnlyFromTheTouchOn) {
    Rig rig = still_rig(make_patch(make_plane(20)));
    rig.tool.friction = 1e6;
    rig.at({-5e-3, 0, kRadius + 5e-3});
    rig.go({1e-3, 0, kRadius - 1e-3}, 0.1);  // touches at x = 0
    EXPECT_NEAR(rig.state.proxy.x(), 0, 1e-7);
    EXPECT_NEAR(rig.state.command.force.x(), -rig.tool.coupling_stiffness * 1e-3, 1e-4);
}

// ---- moving surfaces ----

LocalContactModel moving(LocalContactModel model, const Vec3d& velocity, double time) {
    model.velocity.assign(model.position.size(), velocity);
    for (Vec3d& p : model.position) p += time * velocity;
    group_triangles(model);
    model.time = time;
    return model;
}

// T12. A surface that rises under a resting device, or that reaches it in free space, carries the proxy; a
// new model every 17 ticks, small tips included, up to 1 m/s.
TEST(HapticTick, T12RisingSurfaceCarriesTheProxy) {
    for (const double radius : {3e-3, 0.5e-3}) {
        for (const double speed : {0.02, 0.2, 1.0}) {
            const LocalContactModel base = make_patch(reference::make_box({-0.05, -0.05, -1e-3}, {0.05, 0.05, 0}));
            Rig rig = still_rig(base);
            rig.tool.tip_radius = radius;
            const double start = radius + 2e-3;
            for (int k = 0; k < 60; ++k) {
                if (k % 17 == 0) rig.model = moving(base, {0, 0, speed}, rig.time());
                const double top = speed * rig.time();
                rig.at({0.003, 0.002, start});
                const double expected = std::max(start, top + radius);
                ASSERT_NEAR(rig.state.proxy.z(), expected, 1e-8) << radius << " " << speed << " " << k;
                ASSERT_TRUE(rig.state.proxy_valid);
            }
        }
    }
}

// A new model whose surface lies up to 6 mm farther than the last one said, through a tip of any size: the proxy stays
// on its side of a closed plate of 1 mm and of a sheet. Breaks when the tip looks only its radius around itself.
TEST(HapticTick, ASurfaceThatJumpsBetweenModelsKeepsTheTip) {
    std::mt19937 random(12);
    std::uniform_real_distribution<double> any(-1, 1);
    for (const double radius : {5e-5, 3e-4, 3e-3, 1e-2}) {
        for (const double half_thickness : {0.0, 2e-4}) {
            const Mesh plate = half_thickness > 0 ? make_plane(20, 0.08) : reference::make_box({-0.08, -0.08, -1e-3}, {0.08, 0.08, 0});
            Rig rig = still_rig(make_patch(plate, half_thickness));
            rig.tool.tip_radius = radius;
            const double contact = radius + half_thickness;
            rig.at({0.001, 0.002, contact + 0.01});
            rig.go({0.001, 0.002, contact - 1e-3}, 0.1);
            for (int k = 0; k < 60; ++k) {
                const double up = 6e-3 * any(random), rise = 0.2 * any(random);
                rig.model.position = plate.position;
                for (Vec3d& p : rig.model.position) p.z() += up;
                for (Vec3d& v : rig.model.velocity) v = Vec3d(0, 0, rise);
                ++rig.model.sequence, rig.model.time = rig.time();
                group_triangles(rig.model);
                for (int n = 0; n < 8; ++n) {
                    rig.at({0.001, 0.002, contact - 8e-3});
                    const double top = up + rise * rig.state.model_age;
                    ASSERT_TRUE(rig.state.proxy_valid);
                    ASSERT_NEAR(rig.state.proxy.z(), top + contact, 2e-8) << radius << ' ' << half_thickness << ' ' << k << ' ' << n;
                }
            }
        }
    }
}

// A body that passes over a still tip within a tick, at up to 30 m/s, and stops around it: stiffness times the way back
// to its front. Breaks when surfaces are not swept.
TEST(HapticTick, ABodyThatPassesWithinATickTakesTheTipAlong) {
    std::mt19937 random(13);
    std::uniform_real_distribution<double> any(0, 1);
    for (const double radius : {5e-5, 3e-4, 3e-3}) {
        for (const double thickness : {1e-3, 0.02}) {
            for (const double speed : {0.5, 3.0, 30.0}) {
                const LocalContactModel base = make_patch(reference::make_box({-0.05, -0.05, -thickness}, {0.05, 0.05, 0}));
                Rig rig = still_rig(base);
                rig.tool.tip_radius = radius;
                const double away = 1e-3 + 0.04 * any(random), depth = 1e-4 + 5e-3 * any(random);
                rig.params.greatest_age = (away + depth) / speed;  // then it stands still
                rig.model = moving(base, {0, 0, speed}, 0);
                for (Vec3d& p : rig.model.position) p.z() -= radius + away;
                group_triangles(rig.model);
                for (int k = 0; k < 3 + static_cast<int>(1e3 * (away + depth) / speed); ++k) rig.at({0.003, 0.002, 0});
                rig.rest(20);
                EXPECT_NEAR(rig.state.command.force.z(), rig.tool.coupling_stiffness * depth, 1e-5)
                    << radius << ' ' << thickness << ' ' << speed;
            }
        }
    }
}

// T12. With friction that sticks, the proxy moves sideways with the surface.
TEST(HapticTick, T12SidewaysSurfaceDragsAStuckProxy) {
    const LocalContactModel base = make_patch(make_plane(20));
    Rig rig = still_rig(base);
    rig.tool.friction = 1e6;
    rig.at({0, 0, 0.01});
    rig.go({0, 0, kRadius - 1e-3}, 0.1);
    const double begin = rig.time();
    for (int k = 0; k < 50; ++k) {
        rig.model = moving(base, {0.05, 0, 0}, rig.time() - begin + 0.0);
        rig.model.time = rig.time();
        rig.at({0, 0, kRadius - 1e-3});
    }
    // with the positions of the surface: at rest in the first of 50 ticks, then 50 um a tick
    EXPECT_NEAR(rig.state.proxy.x(), 49 * 0.05 * kTick, 1e-9);
    EXPECT_NEAR(rig.state.command.force.x(), rig.tool.coupling_stiffness * 49 * 0.05 * kTick, 1e-3);
}

// Between two models a surface at constant velocity gives the force at its present position, not at that of
// its publication.
TEST(HapticTick, PositionsAreAdvancedByTheirAge) {
    const LocalContactModel base = make_patch(make_plane());
    Rig rig = still_rig(base);
    rig.model = moving(base, {0, 0, 0.1}, 0);
    for (int k = 0; k < 30; ++k) {
        const double top = 0.1 * rig.time();
        const Vec3d force = rig.at({0, 0, kRadius + 1e-3});
        EXPECT_NEAR(force.z(), rig.tool.coupling_stiffness * std::max(0.0, top - 1e-3), 1e-6);
        EXPECT_DOUBLE_EQ(rig.state.model_age, rig.time() - kTick);
    }
    // not for longer than its publishing period: then it stands still
    for (int k = 0; k < 30; ++k) rig.at({0, 0, kRadius + 1e-3});
    const double top = 0.1 * rig.params.greatest_age;
    EXPECT_NEAR(rig.state.command.force.z(), rig.tool.coupling_stiffness * (top - 1e-3), 1e-6);
    EXPECT_DOUBLE_EQ(rig.state.model_age, 59 * kTick);
}

// A pressed surface that, according to the model, follows 0.4 of the device's displacement: the hand feels
// the other 0.6 times the coupling, in and out, and nothing out of contact. Another body in the same model
// stays at its position.
TEST(HapticTick, ASurfaceThatGivesWayGoesWithTheDevice) {
    for (const uint32_t body : {0u, 7u}) {
        Rig rig = still_rig(make_patch(make_plane()));
        rig.at({0, 0, 0.01});
        rig.go({0, 0, kRadius - 1e-3}, 0.05);
        rig.model.compliance = {body, 0.4, Vec3d::UnitZ(), rig.state.device.position, Vec3d::Zero(), rig.model.time, 0};
        const double share = body == 0 ? 0.4 : 0;
        for (const double more : {5e-4, 2e-3, -5e-4, 1e-3}) {
            rig.go({0, 0, kRadius - 1e-3 - more}, 0.05);
            EXPECT_NEAR(rig.rest(5).z(), rig.tool.coupling_stiffness * (1e-3 + (1 - share) * more), 1e-6) << more;
            EXPECT_EQ(rig.state.touched, 0u);
        }
        rig.go({0, 0, kRadius + 3e-3}, 0.05);
        EXPECT_EQ(rig.rest(5).norm(), 0);
        EXPECT_EQ(rig.state.touched, kNone);
    }
    // displacement by the surface's own velocity is not counted twice: device and surface continue unchanged
    Rig rig = still_rig(make_patch(make_plane()));
    rig.at({0, 0, 0.01});
    rig.go({0, 0, kRadius - 1e-3}, 0.05);
    rig.model.time = rig.time();
    for (Vec3d& v : rig.model.velocity) v = Vec3d(0, 0, -0.02);
    group_triangles(rig.model);
    rig.model.compliance = {0, 0.4, Vec3d::UnitZ(), rig.state.device.position, Vec3d(0, 0, -0.05), rig.model.time, 0};
    for (int k = 0; k < 20; ++k) {
        const double age = rig.time() - rig.model.time;
        EXPECT_NEAR(rig.at({0, 0, kRadius - 1e-3 - 0.05 * age}).z(), rig.tool.coupling_stiffness * (1e-3 + 0.03 * age), 1e-6);
    }
}

// ---- trouble ----

// T13. A tip that starts inside gets no force until it is out, and the full force when it comes back.
TEST(HapticTick, T13StartInsideGivesNoForceUntilOut) {
    const Mesh box = reference::make_box(Vec3d(-0.05, -0.05, -0.1), Vec3d(0.05, 0.05, 0));
    for (const double start : {-0.05, -2e-3, -1e-4, 1e-3}) {
        Rig rig = still_rig(make_patch(box));
        rig.at({0.003, 0.001, start});
        for (double z = start; z < kRadius - 1e-6; z += 2e-4) {
            ASSERT_EQ(rig.at({0.003, 0.001, z}).norm(), 0) << start << " " << z;
        }
        rig.go({0.003, 0.001, kRadius + 1e-3}, 0.05);
        EXPECT_EQ(rig.state.command.force.norm(), 0);
        rig.go({0.003, 0.001, kRadius - 1e-3}, 0.05);
        EXPECT_NEAR(rig.rest(10).z(), rig.tool.coupling_stiffness * 1e-3, 1e-6) << start;
    }
}

// T14. NaN and a glitch of 100 mm in one tick: rejected, counted, zero force at once, restored by a ramp.
TEST(HapticTick, T14BadSamplesAreRefused) {
    for (const int kind : {0, 1, 2, 3}) {
        Rig rig = still_rig(make_patch(make_plane()));
        rig.at({0, 0, 0.01});
        rig.go({0, 0, kRadius - 2e-3}, 0.05);
        const Vec3d before = rig.rest(60);
        EXPECT_GT(before.z(), 0.9);
        DeviceState bad = rig.state.device;
        bad.time = rig.time();
        if (kind == 0) bad.position.x() = std::nan("");
        if (kind == 1) bad.position.z() += 0.1;
        if (kind == 2) bad.velocity.y() = std::numeric_limits<double>::infinity();
        if (kind == 3) bad.time -= 0.01;
        EXPECT_EQ(rig.with(bad).norm(), 0) << kind;
        EXPECT_EQ(rig.state.rejected_samples, 1u) << kind;
        EXPECT_TRUE(rig.state.device.position.allFinite());
        Vec3d last = Vec3d::Zero();
        for (int k = 0; k < 60; ++k) {
            const Vec3d force = rig.at({0, 0, kRadius - 2e-3});
            // never steeper than full force in rise_time plus the free slew
            EXPECT_LE((force - last).norm(), before.norm() * kTick / rig.params.rise_time + 1e-9) << kind;
            last = force;
        }
        EXPECT_NEAR((last - before).norm(), 0, 1e-6) << kind;
    }
}

// T14. A device that has really moved is accepted once a hand could have reached that position.
TEST(HapticTick, T14ALastingJumpIsAcceptedInTime) {
    Rig rig = still_rig(make_patch(make_plane()));
    rig.at({0, 0, 0.01});
    rig.at({0.04, 0.0, 0.06});
    EXPECT_EQ(rig.state.rejected_samples, 1u);
    for (int k = 0; k < 40; ++k) rig.at({0.04, 0.0, 0.06});
    EXPECT_EQ((rig.state.device.position - Vec3d(0.04, 0.0, 0.06)).norm(), 0);
}

// T15. No new models: the force is gone 20 ms after they count as stale; the same for a device whose samples
// stop; both come back by a ramp.
TEST(HapticTick, T15StaleModelOrDeviceFadesTheForce) {
    Rig rig(make_patch(make_plane()));
    const auto press = [&](int ticks, bool fresh_model, bool fresh_device) {
        for (int k = 0; k < ticks; ++k) {
            if (fresh_model) rig.model.time = rig.time();
            DeviceState sample;
            sample.time = fresh_device ? rig.time() : rig.state.device.time;
            sample.position = {0, 0, kRadius - 2e-3};
            if (rig.tick == 0) sample.position.z() = 0.01;
            if (rig.tick > 0 && rig.tick < 5) sample.position.z() = 0.01 - 2e-3 * double(rig.tick);
            rig.with(sample);
        }
    };
    press(80, true, true);
    const double full = rig.tool.coupling_stiffness * 2e-3;
    EXPECT_NEAR(rig.state.command.force.z(), full, 1e-6);
    press(99, false, true);
    EXPECT_NEAR(rig.state.command.force.z(), full, 1e-6);
    press(22, false, true);
    EXPECT_EQ(rig.state.command.force.norm(), 0);
    press(1, true, true);
    EXPECT_LT(rig.state.command.force.norm(), 0.05 * full);
    press(60, true, true);
    EXPECT_NEAR(rig.state.command.force.z(), full, 1e-6);
    press(22, true, false);
    EXPECT_EQ(rig.state.command.force.norm(), 0);
    press(60, true, true);
    EXPECT_NEAR(rig.state.command.force.z(), full, 1e-6);
}

// T16. Scaled to the device's maximum, direction kept.
TEST(HapticTick, T16ClampKeepsTheDirection) {
    const double half = M_PI / 4;
    const Mesh mesh =
        make_ground(20, 0.05, [&](const Vec3d& p) { return Vec3d(p.x() * std::sin(half), p.y(), std::abs(p.x()) * std::cos(half)); });
    Rig rig = still_rig(make_patch(mesh));
    rig.at({0, 0, 0.02});
    const Vec3d free_force = rig.go({2e-3, 0, -0.01}, 0.1);
    rig.tool.max_force = 3.3;
    const Vec3d force = rig.rest(200);
    EXPECT_NEAR(force.norm(), 3.3, 1e-9);
    EXPECT_NEAR(force.normalized().dot(free_force.normalized()), 1, 1e-12);
    EXPECT_NEAR(rig.state.largest_wanted, free_force.norm(), 1e-6);
}

// Outside the model's region surfaces are unknown: no force there, and none without a model.
TEST(HapticTick, OutsideTheModelThereIsNoForce) {
    LocalContactModel model = make_patch(make_plane());
    model.reach = 0;
    Rig rig = still_rig(model);
    rig.at({0, 0, 0.01});
    rig.go({0, 0, 0.0}, 0.05);
    EXPECT_EQ(rig.state.command.force.norm(), 0);
    EXPECT_FALSE(rig.state.proxy_valid);
}

// ---- smoothness and energy ----

// T06. On smooth paths over a bumpy bowl the force changes by at most stiffness * displacement of the device
// (the residual of a projection on a convex set is non-expansive).
TEST(HapticTick, T06ForceStepsAreBoundedByTheMotion) {
    std::mt19937 random(6);
    std::uniform_real_distribution<double> rate(2, 9), phase(0, 2 * M_PI);
    for (int path = 0; path < 4; ++path) {
        Rig rig = still_rig(make_patch(random_ellipsoid(random, 3, true)));
        const Vec3d w(rate(random), rate(random), rate(random)), f(phase(random), phase(random), phase(random));
        const auto where = [&](double t) -> Vec3d { return 0.018 * (w * t + f).array().sin() * std::min(1.0, 5 * t); };
        rig.at(where(0));
        Vec3d last_force = rig.state.command.force, last = where(0);
        double largest = 0, worst = 0;
        for (int k = 1; k < 2000; ++k) {
            const Vec3d device = where(rig.time());
            const Vec3d force = rig.at(device);
            const double explained = rig.tool.coupling_stiffness * (device - last).norm();
            EXPECT_LE((force - last_force).norm(), 1.05 * explained + 1e-6);
            worst = std::max(worst, (force - last_force).norm() / explained);
            largest = std::max(largest, force.norm());
            last_force = force, last = device;
        }
        EXPECT_GT(largest, 0.5);  // it did press
        EXPECT_GT(worst, 0.5);
    }
}

// A sudden change of the surface at the tip ramps in at the slew limit.
TEST(HapticTick, T06NewSurfaceRampsIn) {
    Rig rig = still_rig(make_patch(make_plane()));
    rig.at({0, 0, 0.01});
    rig.go({0, 0, kRadius - 1e-3}, 0.05);
    rig.rest(5);
    for (Vec3d& p : rig.model.position) p.z() += 2e-3;  // 2 mm at once: 1 N more
    group_triangles(rig.model);
    Vec3d last = rig.state.command.force;
    int ticks = 0;
    for (; ticks < 100; ++ticks) {
        const Vec3d force = rig.at({0, 0, kRadius - 1e-3});
        EXPECT_LE((force - last).norm(), rig.params.force_slew * kTick + 1e-9);
        if ((force - last).norm() == 0) break;
        last = force;
    }
    EXPECT_NEAR(last.z(), rig.tool.coupling_stiffness * 3e-3, 1e-6);
    EXPECT_GE(ticks, 5);
}

// Damping acts along the normal only, against the motion, starts from zero and never pulls.
TEST(HapticTick, DampingIsNormalBoundedAndNeverPulls) {
    Rig rig = still_rig(make_patch(make_plane()));
    rig.tool.coupling_damping = 5;
    rig.params.force_slew = 1e9;
    rig.at({0, 0, 0.01});
    rig.go({0, 0, kRadius - 2e-3}, 0.05);
    const double spring = rig.tool.coupling_stiffness * 2e-3;
    const Vec3d device(0, 0, kRadius - 2e-3);
    EXPECT_NEAR(rig.at(device, {0.3, 0.2, -0.1}).z(), spring + 0.5, 1e-6);
    EXPECT_NEAR(rig.at(device, {0.3, 0.2, -0.1}).head<2>().norm(), 0, 1e-6);
    EXPECT_NEAR(rig.at(device, {0, 0, 0.1}).z(), spring - 0.5, 1e-6);
    EXPECT_NEAR(rig.at(device, {0, 0, 1.0}).z(), 0, 1e-6);
    EXPECT_NEAR(rig.at(device, {0, 0, -1.0}).z(), 2 * spring, 1e-6);
    rig.go({0, 0, kRadius - 1e-9}, 0.05);
    EXPECT_NEAR(rig.at({0, 0, kRadius - 1e-9}, {0, 0, -0.1}).z(), 0, 1e-5);
}

// A device of 0.1 kg and 0.5 N s/m, pushed against a wall with 1 N and disturbed by a light impulse once it
// rests.
struct WallTrial {
    std::array<double, 3> swing{};  // m, peak to peak in each second after the impulse
};
WallTrial push_against_wall(double stiffness, double damping) {
    Rig rig = still_rig(make_patch(make_plane()));
    rig.tool.coupling_stiffness = stiffness;
    rig.tool.coupling_damping = damping;
    rig.params.force_slew = 1e9;
    constexpr double kPush = -1.0;
    rig.at({0, 0, 0.01});
    FreeDevice device;
    device.x = kRadius + kPush / stiffness, device.v = 0.01;
    rig.go({0, 0, device.x}, 0.1);
    WallTrial trial;
    for (int second = 0; second < 3; ++second) {
        double low = 1, high = -1;
        for (int k = 0; k < 1000; ++k) {
            device.step(rig.at({0, 0, device.x}, {0, 0, device.v}).z() + kPush);
            low = std::min(low, device.x), high = std::max(high, device.x);
        }
        trial.swing[second] = high - low;
    }
    return trial;
}

// T01. A spring sampled at period T takes K T / 2 from the damping b of the device (Colgate & Schenkel 1997):
// oscillations decay at the rate (b - K T / 2) / 2 m, and persist or grow beyond K = 2 b / T.
TEST(HapticTick, T01WallRingsAsSampledSpringsDo) {
    const double limit = 2 * 0.5 / kTick;
    for (const double share : {0.5, 0.9}) {
        const WallTrial trial = push_against_wall(share * limit, 0);
        const double rate = (0.5 - share * limit * kTick / 2) / (2 * 0.1);
        EXPECT_NEAR(std::log(trial.swing[0] / trial.swing[1]), rate, 0.03 * rate + 0.01) << share;
        EXPECT_NEAR(std::log(trial.swing[1] / trial.swing[2]), rate, 0.03 * rate + 0.01) << share;
    }
    const WallTrial wild = push_against_wall(1.1 * limit, 0);
    EXPECT_GT(wild.swing[2], wild.swing[0]);
    // the coupling's own damping adds to it
    EXPECT_LT(push_against_wall(0.9 * limit, 0.2).swing[2], 0.5 * push_against_wall(0.9 * limit, 0).swing[2]);
}

// Largest energy (J) that a wall and the damping of the device that pokes it have returned beyond the energy
// stored in the wall's spring: the passivity observer of Hannaford & Ryu (2002) including the device's b.
double leaked_energy(double stiffness) {
    Rig rig = still_rig(make_patch(make_plane()));
    rig.tool.coupling_stiffness = stiffness;
    rig.params.force_slew = 1e9;
    FreeDevice device;
    device.x = kRadius + 5e-3;
    double given = 0, most = 0, leaked = 0;
    for (int k = 0; k < 10000; ++k) {
        const double push = 1.0 * std::sin(2 * M_PI * 1.7 * rig.time()) - 0.5;
        const double force = rig.at({0, 0, device.x}, {0, 0, device.v}).z();
        given += force * device.step(force + push);
        const double stored = 0.5 * stiffness * std::pow(std::max(0.0, kRadius - device.x), 2);
        const double taken = device.lost - given - stored;
        most = std::max(most, taken);
        leaked = std::max(leaked, most - taken);
    }
    return leaked;
}
TEST(HapticTick, PokingAWallBelowTheLimitGivesNoEnergy) {
    const double limit = 2 * 0.5 / kTick;
    EXPECT_LT(leaked_energy(0.9 * limit), 1e-9);
    EXPECT_GT(leaked_energy(1.5 * limit), 1e-3);
}

// ---- promises ----

// Random strokes through a closed bumpy body: the tip never goes in (proxy clear of the surface), whatever
// the device does.
TEST(HapticTick, ProxyStaysOutsideUnderRandomStrokes) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> in_box(-0.03, 0.03);
    Mesh mesh = reference::make_sphere(Vec3d::Zero(), 0.02, 4);
    for (Vec3d& p : mesh.position) p *= 1 + 0.15 * std::sin(400 * p.x()) * std::cos(300 * p.y());
    Rig rig = still_rig(make_patch(mesh));
    rig.tool.friction = 0.3;
    rig.at({0, 0, 0.04});
    double worst = 0;
    int touching = 0;
    for (int stroke = 0; stroke < 30; ++stroke) {
        const Vec3d target(in_box(random), in_box(random), in_box(random));
        const Vec3d begin = rig.state.device.position;
        for (int k = 1; k <= 60; ++k) {
            rig.at(begin + (target - begin) * (k / 60.0));
            ASSERT_TRUE(rig.state.proxy_valid);
            worst = std::min(worst, clearance(rig));
            touching += rig.state.contacts > 0;
            ASSERT_TRUE(rig.state.command.force.allFinite());
        }
    }
    EXPECT_GT(worst, -5e-9);
    EXPECT_GT(touching, 500);
    EXPECT_GT(brute_force_winding(mesh.position, mesh.triangle, rig.state.proxy), -0.5);
    EXPECT_LT(brute_force_winding(mesh.position, mesh.triangle, rig.state.proxy), 0.5);
}

// Random strokes over a body that moves, deforms and yields.
struct CrumplingBall {
    std::mt19937 random{23};
    std::uniform_real_distribution<double> in_box{-0.026, 0.026};
    Mesh mesh = reference::make_sphere(Vec3d::Zero(), 0.02, 4);
    LocalContactModel model;

    CrumplingBall() {
        for (Vec3d& p : mesh.position) p *= 1 + 0.15 * std::sin(400 * p.x()) * std::cos(300 * p.y());
        model = make_patch(mesh);
    }
    // Makes the surface of a stroke that starts at a position and time; returns the end of the stroke.
    Vec3d next(int stroke, const Vec3d& begin, double time) {
        const auto anywhere = [&] {
            const double x = in_box(random), y = in_box(random), z = in_box(random);
            return Vec3d(x, y, z);
        };
        const Vec3d target = anywhere(), drift = anywhere();
        model.time = time;
        const double crumple = 6.0 * (stroke % 3);
        for (size_t v = 0; v < mesh.position.size(); ++v)
            model.velocity[v] = drift + 4 * drift.cross(mesh.position[v]) + crumple * anywhere();
        group_triangles(model);
        model.compliance = {0, 0.5, Vec3d::UnitZ(), begin, Vec3d::Zero(), time, 1e-4 * (stroke % 3 - 1)};
        return target;
    }
};

// Sleeping groups and skipped triangles change no bit: against ticks that evaluate every triangle of the
// model at every step.
TEST(HapticTick, AskingEveryTriangleChangesNoBit) {
    CrumplingBall ball;
    Rig quick = still_rig(ball.model), whole = still_rig(ball.model);
    whole.scratch.near.ask_all = true;
    quick.tool.friction = whole.tool.friction = 0.3;
    quick.at({0, 0, 0.04}), whole.at({0, 0, 0.04});
    int touching = 0;
    size_t fewest = ball.mesh.triangle.size();
    for (int stroke = 0; stroke < 25; ++stroke) {
        const Vec3d begin = quick.state.device.position, target = ball.next(stroke, begin, quick.time());
        quick.model = whole.model = ball.model;
        for (int k = 1; k <= 30; ++k) {
            const Vec3d device = begin + (target - begin) * (k / 30.0);
            ASSERT_EQ((quick.at(device) - whole.at(device)).norm(), 0) << stroke << ' ' << k;
            ASSERT_EQ((quick.state.proxy - whole.state.proxy).norm(), 0) << stroke << ' ' << k;
            ASSERT_EQ(quick.state.contacts, whole.state.contacts) << stroke << ' ' << k;
            touching += quick.state.contacts > 0;
            fewest = std::min(fewest, quick.scratch.near.triangle.size());
        }
    }
    EXPECT_GT(touching, 200);
    EXPECT_LT(fewest, ball.mesh.triangle.size() / 20);
    EXPECT_EQ(whole.scratch.near.triangle.size(), ball.mesh.triangle.size());
}

// Whether and when a surface is rehearsed changes no later bit, and a rehearsal follows the path of the tick.
TEST(HapticTick, ARehearsalChangesNoBit) {
    CrumplingBall ball;
    Rig plain = still_rig(ball.model), rehearsed = still_rig(ball.model);
    plain.at({0, 0, 0.04}), rehearsed.at({0, 0, 0.04});
    int touching = 0;
    for (int stroke = 0; stroke < 25; ++stroke) {
        const Vec3d begin = plain.state.device.position, target = ball.next(stroke, begin, plain.time());
        plain.model = rehearsed.model = ball.model;
        for (int k = 1; k <= 30; ++k) {
            if (k % 7 == 1) rehearse_tick(rehearsed.params, rehearsed.model, rehearsed.tool, rehearsed.state, rehearsed.scratch);
            if (k == 1) {
                EXPECT_EQ(rehearsed.scratch.near.model, &rehearsed.model);
            }
            const Vec3d device = begin + (target - begin) * (k / 30.0);
            ASSERT_EQ((plain.at(device) - rehearsed.at(device)).norm(), 0) << stroke << ' ' << k;
            ASSERT_EQ((plain.state.proxy - rehearsed.state.proxy).norm(), 0) << stroke << ' ' << k;
            touching += plain.state.contacts > 0;
        }
        EXPECT_EQ(plain.state.ticks, rehearsed.state.ticks);
    }
    EXPECT_GT(touching, 200);
}

// Same inputs, same bits; unrelated content of the scratch changes nothing.
TEST(HapticTick, AnswersDependOnArgumentsAlone) {
    const LocalContactModel model = make_patch(reference::make_sphere(Vec3d::Zero(), 0.02, 4));
    Rig a = still_rig(model), b = still_rig(model), other = still_rig(make_patch(make_plane()));
    other.at({0, 0, 0.01});
    other.go({0, 0, 0}, 0.1);
    b.scratch = other.scratch;
    a.tool.friction = b.tool.friction = 0.2;
    for (int k = 0; k < 500; ++k) {
        const double t = 0.005 * k;
        const Vec3d device = 0.022 * Vec3d(std::sin(t), std::cos(1.3 * t), std::sin(0.7 * t + 1));
        ASSERT_EQ((a.at(device) - b.at(device)).norm(), 0);
        ASSERT_EQ((a.state.proxy - b.state.proxy).norm(), 0);
    }
}

TEST(HapticTick, CountersAddUp) {
    Haptics haptics;
    haptics.state.resize(2);
    haptics.state[0].ticks = 5, haptics.state[1].ticks = 7;
    haptics.state[0].rejected_samples = 1, haptics.state[1].rejected_samples = 2;
    haptics.state[0].largest_force = 3, haptics.state[1].largest_force = 2;
    sum_tool_counters(haptics);
    EXPECT_EQ(haptics.ticks, 12u);
    EXPECT_EQ(haptics.rejected_samples, 3u);
    EXPECT_EQ(haptics.max_force, 3);
}

}  // namespace
}  // namespace trocar
