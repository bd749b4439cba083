#include "systems/haptics/contact/local_contact_model.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <random>
#include <set>

#include "engine/mesh/mesh_topology.hpp"
#include "systems/haptics/tick.hpp"
#include "tests/reference/brute_force_distance.hpp"
#include "tests/reference/local_patches.hpp"
#include "tests/reference/sample_meshes.hpp"
namespace trocar {
namespace {

// Bodies without springs or trees: the inputs of a model.
struct Scene {
    Meshes meshes;
    Bodies bodies;
    Poses poses;
    Particles particles;

    uint32_t add(const Mesh& mesh, Motion motion, Admission admission, const Vec3d& origin, const Quat& turn = {}, double thickness = 0) {
        const uint32_t row = static_cast<uint32_t>(bodies.mesh.size());
        bodies.mesh.push_back(add_prototype(meshes, mesh, admission));
        bodies.motion.push_back(motion);
        bodies.thickness.push_back(thickness);
        bodies.tissue.emplace_back();
        poses.origin.push_back(origin);
        poses.orientation.push_back(turn);
        poses.velocity.push_back(Vec3d::Zero());
        poses.angular_velocity.push_back(Vec3d::Zero());
        Range rows{static_cast<uint32_t>(particles.offset.size()), 0};
        if (motion == Motion::kDeformable) {
            rows.count = (static_cast<uint32_t>(mesh.position.size()) + 15) / 16 * 16;
            for (const Vec3d& p : mesh.position) particles.offset.push_back({float(p.x()), float(p.y()), float(p.z()), 1});
            particles.offset.resize(rows.first + rows.count);
            for (auto* v : {&particles.velocity_x, &particles.velocity_y, &particles.velocity_z}) v->resize(particles.offset.size());
        }
        bodies.particles.push_back(rows);
        return row;
    }
    Surfaces surfaces() const { return {meshes, bodies, poses, particles}; }
};

// A tool among a vibrating organ, a rotated static box, a rotating box, a sheet far and near.
Scene busy_scene() {
    Scene s;
    std::mt19937 random(11);
    std::normal_distribution<float> normal;
    s.add(reference::make_sphere(Vec3d::Zero(), 0.004, 2), Motion::kHand, Admission::kSolid, {0, 0, 0.03});
    s.add(reference::make_sphere(Vec3d::Zero(), 0.03, 4), Motion::kDeformable, Admission::kSolid, {0.001, -0.002, 0});
    s.add(reference::make_box(Vec3d::Constant(-0.01), Vec3d::Constant(0.01)), Motion::kStatic, Admission::kSolid, {0.03, 0.01, 0.03},
          from_rotation_vector({0.3, 0.4, -0.2}));
    const uint32_t turning = s.add(reference::make_sphere(Vec3d(0.01, 0, 0), 0.01, 3), Motion::kKinematic, Admission::kWinding,
                                   {-0.03, 0, 0.04}, from_rotation_vector({0, 0, 1}));
    s.poses.velocity[turning] = {0.05, 0.01, -0.02};
    s.poses.angular_velocity[turning] = {1, -2, 3};
    s.add(reference::make_ground(12, 0.03, [](const Vec3d& p) { return p; }), Motion::kStatic, Admission::kSheet, {0, 0, 0.05}, {}, 1e-3);
    s.add(reference::make_sphere(Vec3d::Zero(), 0.03, 3), Motion::kDeformable, Admission::kSolid, {1, 0, 0});
    s.add(reference::make_sphere(Vec3d::Zero(), 0.03, 1), Motion::kStatic, Admission::kRefused, {0, 0, 0.03});
    for (size_t k = 0; k < s.particles.velocity_x.size(); ++k) {
        s.particles.velocity_x[k] = 0.05f * normal(random);
        s.particles.velocity_y[k] = 0.05f * normal(random);
        s.particles.velocity_z[k] = 0.05f * normal(random);
    }
    return s;
}

ToolState holding(const Vec3d& device, const Vec3d& proxy, const Vec3d& velocity = Vec3d::Zero()) {
    ToolState state;
    state.device.position = device;
    state.device.velocity = velocity;
    state.proxy = proxy;
    state.proxy_valid = true;
    return state;
}
HandTool tool_of(uint32_t body) {
    HandTool tool;
    tool.body = body;
    tool.tip_radius = 3e-3;
    return tool;
}

// Triangle of a body in the model by its world corners: its identity in the tests.
using Key = std::pair<uint32_t, std::array<double, 9>>;
Key key_of(uint32_t body, const std::array<Vec3d, 3>& c) {
    return {body, {c[0].x(), c[0].y(), c[0].z(), c[1].x(), c[1].y(), c[1].z(), c[2].x(), c[2].y(), c[2].z()}};
}
std::map<Key, uint32_t> rows_of(const LocalContactModel& m) {
    std::map<Key, uint32_t> rows;
    for (uint32_t t = 0; t < m.triangle.size(); ++t) {
        const Triangle& v = m.triangle[t];
        rows[key_of(m.body[t], {m.position[v[0]], m.position[v[1]], m.position[v[2]]})] = t;
    }
    return rows;
}
std::array<Vec3d, 3> corners(const Surfaces& s, uint32_t body, uint32_t t) {
    const Triangle& v = mesh_view(s.meshes, s.bodies.mesh[body]).triangle[t];
    return {vertex_position(s, body, v[0]), vertex_position(s, body, v[1]), vertex_position(s, body, v[2])};
}
// distance of a triangle from a segment, by many points of the segment
double distance_to_segment(const std::array<Vec3d, 3>& c, const Vec3d& a, const Vec3d& b) {
    double least = 1e300;
    for (int k = 0; k <= 40; ++k) least = std::min(least, exact_triangle_distance(a + k / 40.0 * (b - a), c[0], c[1], c[2]));
    return least;
}

// The model contains everything within reach and nothing far away; neither the tool itself nor rejected
// bodies.
TEST(LocalContactModel, HoldsAllTrianglesWithinReach) {
    const Scene scene = busy_scene();
    const Surfaces s = scene.surfaces();
    LocalContactScratch scratch;
    LocalContactModel model;
    const Vec3d device(0.001, 0.002, 0.025), proxy(0.002, 0.001, 0.033);
    publish_local_contact({}, s, {}, tool_of(0), holding(device, proxy), {1.5, 90}, scratch, model);
    EXPECT_EQ(model.time, 1.5);
    EXPECT_EQ(model.sequence, 90u);
    EXPECT_DOUBLE_EQ(model.reach, 3e-3 + 0.5 * 35e-3 + 5e-3);
    const std::map<Key, uint32_t> rows = rows_of(model);
    EXPECT_EQ(rows.size(), model.triangle.size());  // each once
    std::set<uint32_t> present(model.body.begin(), model.body.end());
    EXPECT_EQ(present, (std::set<uint32_t>{1, 2, 3, 4}));
    size_t near = 0, all = 0;
    for (const uint32_t body : {1u, 2u, 3u, 4u, 5u}) {
        for (uint32_t t = 0; t < mesh_view(s.meshes, s.bodies.mesh[body]).triangle.size(); ++t) {
            const std::array<Vec3d, 3> c = corners(s, body, t);
            const double distance = distance_to_segment(c, device, proxy);
            const bool found = rows.count(key_of(body, c)) > 0;
            near += distance < model.reach, ++all;
            if (distance < model.reach) {
                EXPECT_TRUE(found) << body << " " << t;
            }
            // a box that vibrates: not farther than its corner
            if (distance > 2 * model.reach + 0.02) {
                EXPECT_FALSE(found) << body << " " << t;
            }
        }
    }
    EXPECT_GT(near, 100u);
    EXPECT_LT(model.triangle.size(), all);
}

// A tool at its greatest speed meets no surface outside the model, while everything moves, up to its greatest
// age.
TEST(LocalContactModel, NothingUnseenIsMetInTime) {
    const Scene scene = busy_scene();
    const Surfaces s = scene.surfaces();
    const HapticParams params;
    std::mt19937 random(12);
    std::uniform_real_distribution<double> in_box(-0.03, 0.03), unit(0, 1);
    std::normal_distribution<double> normal;
    LocalContactScratch scratch;
    LocalContactModel model;
    size_t met = 0;
    for (int k = 0; k < 30; ++k) {
        const Vec3d device(in_box(random), in_box(random), 0.03 + in_box(random));
        ToolState state = holding(device, device);
        state.proxy_valid = k % 2;
        publish_local_contact(params, s, {}, tool_of(0), state, {0, 0}, scratch, model);
        const std::map<Key, uint32_t> rows = rows_of(model);
        for (int j = 0; j < 10; ++j) {
            const double age = params.greatest_age * unit(random);
            const Vec3d displacement = Vec3d(normal(random), normal(random), normal(random)).normalized() * params.tool_speed * age;
            for (const uint32_t body : {1u, 2u, 3u, 4u}) {
                const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
                for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
                    std::array<Vec3d, 3> moved = corners(s, body, t);
                    const Key key = key_of(body, moved);
                    for (int c = 0; c < 3; ++c) moved[c] += age * vertex_velocity(s, body, mesh.triangle[t][c]);
                    if ((moved[0] - device - displacement).norm() > 0.03) continue;
                    const double distance = exact_triangle_distance(device + displacement, moved[0], moved[1], moved[2]);
                    if (distance > 3e-3 + (body == 4 ? 0.5e-3 : 0)) continue;
                    ++met;
                    ASSERT_TRUE(rows.count(key)) << k << " " << body << " " << t;
                }
            }
        }
    }
    EXPECT_GT(met, 100u);
}

// For each vertex the mean over the triangles around it of the mean over their corners.
std::map<uint32_t, Vec3d> means_around(const LocalContactModel& m, const std::map<uint32_t, Vec3d>& value) {
    std::map<uint32_t, Vec3d> means;
    for (const auto& [vertex, v] : value) {
        std::vector<Vec3d> around;
        for (const Triangle& t : m.triangle)
            if (std::find(t.begin(), t.end(), vertex) != t.end()) around.push_back((value.at(t[0]) + value.at(t[1]) + value.at(t[2])) / 3);
        for (const Vec3d& a : around) means.try_emplace(vertex, Vec3d::Zero()).first->second += a / static_cast<double>(around.size());
    }
    return means;
}

// Positions are the surface's own; velocities too for rigid bodies, else means over the surrounding
// triangles, twice; vertices are shared, neighbours are those of the mesh, the half thickness is the sheet's.
TEST(LocalContactModel, RowsAreTheSurfaces) {
    const Scene scene = busy_scene();
    const Surfaces s = scene.surfaces();
    LocalContactScratch scratch;
    LocalContactModel model;
    publish_local_contact({}, s, {}, tool_of(0), holding({0, 0, 0.03}, {0, 0, 0.03}), {0, 0}, scratch, model);
    ASSERT_EQ(model.position.size(), model.velocity.size());
    ASSERT_EQ(model.triangle.size(), model.neighbour.size());
    ASSERT_EQ(model.triangle.size(), model.half_thickness.size());
    const std::map<Key, uint32_t> rows = rows_of(model);
    std::map<uint32_t, Vec3d> raw;  // velocities of the tissue's vertices
    double fastest = 0;
    uint32_t last_body = 0, inner = 0, rim = 0;
    for (const uint32_t body : model.body) {
        EXPECT_GE(body, last_body);
        last_body = body;
    }
    for (const uint32_t body : {1u, 2u, 3u, 4u}) {
        const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
        for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
            const auto at = rows.find(key_of(body, corners(s, body, t)));
            if (at == rows.end()) continue;
            const uint32_t row = at->second;
            EXPECT_EQ(model.half_thickness[row], body == 4 ? 0.5e-3 : 0);
            for (int k = 0; k < 3; ++k) {
                const Vec3d v = vertex_velocity(s, body, mesh.triangle[t][k]);
                const uint32_t vertex = model.triangle[row][k];
                if (body == 1)
                    raw[vertex] = v;
                else
                    EXPECT_EQ(model.velocity[vertex], v);
                fastest = std::max(fastest, model.velocity[vertex].norm());
                const uint32_t across = mesh.neighbour[t][k], found = model.neighbour[row][k];
                const auto expected = across == kNone ? rows.end() : rows.find(key_of(body, corners(s, body, across)));
                EXPECT_EQ(found, expected == rows.end() ? kNone : expected->second);
                (found == kNone ? rim : inner) += 1;
                // the shared edge is shared by index
                if (found != kNone) {
                    const Triangle& other = model.triangle[found];
                    for (const uint32_t v2 : {model.triangle[row][k], model.triangle[row][(k + 1) % 3]})
                        EXPECT_NE(std::find(other.begin(), other.end(), v2), other.end());
                }
            }
        }
    }
    const std::map<uint32_t, Vec3d> tissue = means_around(model, means_around(model, raw));
    EXPECT_GT(tissue.size(), 100u);
    for (const auto& [vertex, v] : tissue) EXPECT_LT((model.velocity[vertex] - v).norm(), 1e-14) << vertex;
    EXPECT_EQ(model.fastest, fastest);
    EXPECT_GT(inner, 300u);
    EXPECT_GT(rim, 10u);
}

// The common motion of a tissue is kept, the motion of single vertices is smoothed away, and one that snaps
// back hardly affects others: a surface extrapolated over a pass keeps its shape.
TEST(LocalContactModel, TissueGoesOnWithoutItsRipples) {
    Scene scene = busy_scene();
    LocalContactScratch scratch;
    LocalContactModel model;
    std::mt19937 random(3);
    std::normal_distribution<float> normal;
    const Vec3d whole(0.3, -0.2, 0.1);
    const Range rows = scene.bodies.particles[1];
    const auto publish = [&](float ripple, float snap) {
        for (uint32_t k = rows.first; k < rows.end(); ++k) {
            scene.particles.velocity_x[k] = float(whole.x()) + ripple * normal(random);
            scene.particles.velocity_y[k] = float(whole.y()) + ripple * normal(random);
            scene.particles.velocity_z[k] = float(whole.z()) + ripple * normal(random) + (k % 97 == 0 ? snap : 0);
        }
        publish_local_contact({}, scene.surfaces(), {}, tool_of(0), holding({0, 0, 0.03}, {0, 0, 0.03}), {0, 0}, scratch, model);
        double sum = 0, most = 0;
        size_t vertices = 0;
        for (size_t t = 0; t < model.triangle.size() && model.body[t] == 1; ++t) {
            for (const uint32_t v : model.triangle[t]) {
                const double off = (model.velocity[v] - whole).norm();
                sum += off * off, most = std::max(most, off), ++vertices;
            }
        }
        EXPECT_GT(vertices, 300u);
        return std::pair{std::sqrt(sum / static_cast<double>(vertices)), most};
    };
    EXPECT_LT(publish(0, 0).second, 1e-7);
    EXPECT_LT(publish(0.1f, 0).first, 0.37 * 0.1 * std::sqrt(3.0));
    // 100 m/s: limited to the speed of tools, 0.5 m/s beyond the mean, and distributed
    EXPECT_LT(publish(0, 100).second, 0.5 + 100.0 / 97 + 0.5);
}

// World boxes skip bodies, but no triangles within reach; a fast device has a larger reach.
TEST(LocalContactModel, BoxesAndSpeed) {
    const Scene scene = busy_scene();
    const Surfaces s = scene.surfaces();
    std::vector<Box> boxes(s.bodies.mesh.size());
    for (uint32_t body = 0; body < boxes.size(); ++body) {
        for (uint32_t v = 0; v < mesh_view(s.meshes, s.bodies.mesh[body]).position.size(); ++v) {
            boxes[body].min = boxes[body].min.cwiseMin(vertex_position(s, body, v));
            boxes[body].max = boxes[body].max.cwiseMax(vertex_position(s, body, v));
        }
    }
    LocalContactScratch scratch;
    LocalContactModel with, without, fast;
    const ToolState state = holding({0, 0.01, 0.03}, {0, 0, 0.03});
    publish_local_contact({}, s, {}, tool_of(0), state, {0, 0}, scratch, without);
    publish_local_contact({}, s, boxes, tool_of(0), state, {0, 0}, scratch, with);
    EXPECT_EQ(with.triangle, without.triangle);
    EXPECT_EQ(with.body, without.body);
    publish_local_contact({}, s, boxes, tool_of(0), holding({0, 0.01, 0.03}, {0, 0, 0.03}, {0, 1, 0}), {0, 0}, scratch, fast);
    EXPECT_DOUBLE_EQ(fast.reach, 3e-3 + 1.5 * 35e-3 + 5e-3);
    EXPECT_GT(fast.triangle.size(), with.triangle.size());
}

// A used scratch and a used model change nothing, and once warm no buffer is reallocated.
TEST(LocalContactModel, WarmBuffersStayAndChangeNothing) {
    const Scene scene = busy_scene();
    const Surfaces s = scene.surfaces();
    LocalContactScratch scratch;
    LocalContactModel model;
    for (double x = -0.03; x <= 0.03; x += 0.01)
        publish_local_contact({}, s, {}, tool_of(0), holding({x, 0, 0.02}, {x, 0, 0.03}), {0, 0}, scratch, model);
    const void* const buffers[] = {model.position.data(),  model.velocity.data(),       model.triangle.data(),
                                   model.neighbour.data(), scratch.vertex_index.data(), scratch.beyond.data()};
    for (double x = -0.03; x <= 0.03; x += 0.01) {
        publish_local_contact({}, s, {}, tool_of(0), holding({x, 0, 0.02}, {x, 0, 0.03}), {0, 0}, scratch, model);
        const void* const now[] = {model.position.data(),  model.velocity.data(),       model.triangle.data(),
                                   model.neighbour.data(), scratch.vertex_index.data(), scratch.beyond.data()};
        for (int k = 0; k < 6; ++k) EXPECT_EQ(now[k], buffers[k]);
        LocalContactScratch fresh_scratch;
        LocalContactModel fresh;
        publish_local_contact({}, s, {}, tool_of(0), holding({x, 0, 0.02}, {x, 0, 0.03}), {0, 0}, fresh_scratch, fresh);
        EXPECT_EQ(fresh.triangle, model.triangle);
        EXPECT_EQ(fresh.neighbour, model.neighbour);
        EXPECT_EQ(fresh.position, model.position);
    }
}

// From bodies to the hand: a model published every 17 ms, the tip pressed on a rotated box, the force is that
// of its face.
TEST(LocalContactModel, FeedsTheTick) {
    Scene scene;
    scene.add(reference::make_sphere(Vec3d::Zero(), 0.004, 1), Motion::kHand, Admission::kSolid, Vec3d::Zero());
    const Quat turn = from_rotation_vector({0.3, -0.5, 0.2});
    scene.add(reference::make_box(Vec3d(-0.05, -0.05, -0.1), Vec3d(0.05, 0.05, 0)), Motion::kStatic, Admission::kSolid, {0.1, 0.2, 0.3},
              turn);
    const Vec3d up = rotate(turn, {0, 0, 1}), spot = Vec3d(0.1, 0.2, 0.3) + rotate(turn, {0.003, 0.002, 0});
    HandTool tool = tool_of(0);
    tool.coupling_damping = 0;
    tool.friction = 0;
    const HapticParams params;
    LocalContactScratch scratch;
    LocalContactModel model;
    HapticScratch tick_scratch;
    ToolState state;
    state.device.position = spot + 0.03 * up;
    for (int k = 0; k < 400; ++k) {
        const double time = 1e-3 * k, height = std::max(0.03 - 0.2 * time, 1e-3);
        if (k % 17 == 0)
            publish_local_contact(params, scene.surfaces(), {}, tool, state, {time, static_cast<uint64_t>(k / 17)}, scratch, model);
        DeviceState sample;
        sample.time = time;
        sample.position = spot + height * up;
        haptic_tick(params, model, time, tool, sample, tick_scratch, state);
        ASSERT_TRUE(state.proxy_valid) << k;
        EXPECT_NEAR((state.command.force - tool.coupling_stiffness * std::max(0.0, 3e-3 - height) * up).norm(), 0, 1e-5) << k;
    }
    EXPECT_GT(state.command.force.norm(), 0.99);
}

template <typename Lanes>
Vec3d lane_of(const std::array<Lanes, 3>& lanes, uint32_t lane) {
    return {lanes[0][lane], lanes[1][lane], lanes[2][lane]};
}
// Every bound of a model contains its triangles at every age it may reach: groups, blocks; and lanes give the
// positions of corners.
TEST(LocalContactModel, BoundsHoldTheirTrianglesAsTheyMove) {
    const Scene s = busy_scene();
    LocalContactScratch scratch;
    LocalContactModel m;
    publish_local_contact({}, s.surfaces(), {}, tool_of(0), holding({0, 0, 0.03}, {0, 0, 0.03}), {0, 0}, scratch, m);
    ASSERT_GT(m.triangle.size(), 200u);
    std::vector<uint32_t> seen(m.triangle.size());
    const auto outside = [](const auto& ball, const Vec3d& p, double age) {
        return (p - ball.centre - age * ball.velocity).norm() - ball.radius - ball.spread * std::abs(age);
    };
    for (const TriangleGroup& block : m.block) {
        for (uint32_t g = block.triangles.first; g < block.triangles.end(); ++g) {
            for (uint32_t t = m.group[g].triangles.first; t < m.group[g].triangles.end(); ++t) {
                ++seen[t];
                EXPECT_EQ(m.body[t], block.body);
                EXPECT_EQ(m.body[t], m.group[g].body);
                const uint32_t lane = t - m.group[g].triangles.first;
                for (const double age : {-0.03, 0.0, 0.01, 0.035}) {
                    for (size_t k = 0; k < 3; ++k) {
                        const uint32_t v = m.triangle[t][k];
                        const Vec3d p = m.position[v] + age * m.velocity[v];
                        ASSERT_LT(outside(m.group[g], p, age), 1e-12);
                        ASSERT_LT(outside(block, p, age), 1e-12);
                        const Vec3d told = m.group[g].centre + lane_of(m.lanes[g].corner[k], lane) +
                                           age * (m.group[g].velocity + lane_of(m.lanes[g].velocity[k], lane));
                        ASSERT_LT((told - p).norm(), 1e-6 * (m.group[g].radius + m.group[g].spread * std::abs(age)));
                    }
                }
            }
            for (uint32_t k = m.group[g].triangles.count; k < kGroupTriangles; ++k) EXPECT_GT(lane_of(m.lanes[g].corner[0], k).norm(), 1e8);
        }
    }
    const auto expect_balls = [](const std::vector<TriangleGroup>& runs, const std::vector<GroupBalls>& balls,
                                 const std::vector<TriangleGroup>& parts) {
        size_t held = 0;
        ASSERT_EQ(runs.size(), balls.size());
        for (uint32_t r = 0; r < runs.size(); ++r) {
            const TriangleGroup& run = runs[r];
            const GroupBalls& ball = balls[r];
            held += run.triangles.count;
            for (uint32_t k = 0; k < kBlockGroups; ++k) {
                if (k >= run.triangles.count) {
                    EXPECT_EQ(ball.radius[k], -INFINITY);
                    continue;
                }
                const TriangleGroup& part = parts[run.triangles.first + k];
                const double rounding = kLaneRounding * (run.radius + run.spread);
                EXPECT_EQ(part.body, run.body);
                EXPECT_LT((part.centre - run.centre).norm() + part.radius, run.radius + rounding);
                EXPECT_NEAR((run.centre + lane_of(ball.centre, k) - part.centre).norm(), 0, rounding);
                EXPECT_NEAR((run.velocity + lane_of(ball.velocity, k) - part.velocity).norm(), 0, rounding);
                EXPECT_NEAR(ball.radius[k], part.radius, rounding);
                EXPECT_NEAR(ball.spread[k], part.spread, rounding);
                EXPECT_GE(ball.speed[k], part.velocity.norm() + part.spread);
            }
        }
        EXPECT_EQ(held, parts.size());
    };
    expect_balls(m.block, m.ball, m.group);
    expect_balls(m.cluster, m.cluster_ball, m.block);
    EXPECT_GT(m.block.size(), m.cluster.size());
    EXPECT_EQ(std::count(seen.begin(), seen.end(), 1u), static_cast<int64_t>(seen.size()));
}

// A tool on an organ (a ball of 30 mm): its tip 3 mm above the surface, minus an amount given by the test.
struct Pressing {
    Scene scene = busy_scene();
    HandTool tool = tool_of(0);
    ToolState state;
    LocalContactScratch scratch;
    LocalContactModel model;
    Vec3d tip = Vec3d(0.001, -0.002, 0.033);

    explicit Pressing(uint32_t touched) {
        state = holding(tip, tip);
        state.contacts = 1, state.touched = touched, state.command.force = {0, 0, 2};
    }
    void pass() {
        scene.poses.origin[0] = tip;
        publish_local_contact({}, scene.surfaces(), {}, tool, state, {0, 0}, scratch, model);
        publish_compliance(scene.surfaces(), tool, state, scratch, model);
    }
};

// Two passes of a tool that presses an organ: the fraction of the device's displacement that the simulated
// tip covered, and zero where that is undetermined.
TEST(LocalContactModel, SaysHowTheSurfaceGivesWay) {
    const auto compliance = [&](uint32_t touched, const Vec3d& device_way, const Vec3d& tip_way) {
        Pressing p(touched);
        p.pass();
        EXPECT_EQ(p.model.compliance.share, 0);  // there was no preceding pass
        p.state.device.position += device_way, p.tip += tip_way;
        p.pass();
        EXPECT_EQ(p.model.compliance.body, touched == 1 ? 1u : kNone);
        return p.model.compliance.share;
    };
    EXPECT_NEAR(compliance(1, {0, 0, -1e-3}, {0, 0, -3e-4}), 0.3, 1e-9);
    EXPECT_NEAR(compliance(1, {2e-4, 0, -1e-3}, {5e-4, 0, -3e-4}), 0.3, 1e-9);
    EXPECT_EQ(compliance(1, {0, 0, -1e-3}, {0, 0, 3e-4}), 0);  // against the hand
    EXPECT_EQ(compliance(1, {0, 0, -2e-4}, {0, 0, -4e-4}), 0.95);
    EXPECT_EQ(compliance(1, {0, 0, -5e-5}, {0, 0, -3e-5}), 0);     // hardly moved
    EXPECT_EQ(compliance(1, {1e-3, 0, -2e-4}, {0, 0, -1e-4}), 0);  // rubbed
    EXPECT_EQ(compliance(2, {0, 0, -1e-3}, {0, 0, -3e-4}), 0);     // rigid
}

// The separation is that of the surface in contact with the tip; zero without contact.
TEST(LocalContactModel, SaysWhatContactsLeftUnderTheTip) {
    for (const double up : {-3e-4, 0.0, 2e-4, 4e-4, 8e-4}) {
        Pressing p(1);
        p.tip.z() += up;
        p.pass();
        if (up > 5e-4) {
            EXPECT_EQ(p.model.compliance.body, kNone);
            EXPECT_EQ(p.model.compliance.gap, 0);
            continue;
        }
        EXPECT_EQ(p.model.compliance.body, 1u);
        double nearest = 1;
        for (uint32_t t = 0; t < p.model.triangle.size(); ++t) {
            const Triangle& v = p.model.triangle[t];
            if (p.model.body[t] == 1)
                nearest = std::min(nearest,
                                   exact_triangle_distance(p.tip, p.model.position[v[0]], p.model.position[v[1]], p.model.position[v[2]]));
        }
        EXPECT_NEAR(p.model.compliance.gap, nearest - p.tool.tip_radius, 1e-12) << up;
        EXPECT_NEAR(p.model.compliance.gap, up, 1e-4);
    }
    // a wall beside the tip is not in contact with it
    Pressing p(1);
    p.state.command.force = {2, 0, 0};
    p.pass();
    EXPECT_EQ(p.model.compliance.body, kNone);
}

// Around the tip the surface moves with the tip, farther away it keeps its motion, and no other body changes.
TEST(LocalContactModel, ThePressedSurfaceGoesWithTheTip) {
    Pressing p(1);
    p.scene.poses.velocity[0] = {-0.05, 0.02, 0.01};
    p.scene.poses.origin[0] = p.tip;
    LocalContactModel before;
    publish_local_contact({}, p.scene.surfaces(), {}, p.tool, p.state, {0, 0}, p.scratch, before);
    p.pass();
    const double near = p.tool.tip_radius + 1.5 * p.scene.meshes.info[p.scene.bodies.mesh[1]].mean_edge;
    ASSERT_EQ(p.model.position.size(), before.position.size());
    std::vector<bool> organ(before.position.size());
    for (uint32_t t = 0; t < before.triangle.size(); ++t)
        for (const uint32_t v : before.triangle[t]) organ[v] = before.body[t] == 1;
    std::array<int, 4> count{};
    double fastest = 0;
    for (size_t v = 0; v < organ.size(); ++v) {
        const double away = (before.position[v] - p.tip).norm();
        const Vec3d &was = before.velocity[v], &is = p.model.velocity[v];
        fastest = std::max(fastest, is.norm());
        if (!organ[v]) {
            ++count[0];
            EXPECT_EQ((is - was).norm(), 0);
        } else if (away <= near) {
            ++count[1];
            EXPECT_LT((is - p.scene.poses.velocity[0]).norm(), 1e-15);
        } else if (away < 2 * near) {
            ++count[2];
            const double share = (2 * near - away) / near;
            EXPECT_LT((is - was - share * (p.scene.poses.velocity[0] - was)).norm(), 1e-15);
        } else {
            ++count[3];
            EXPECT_EQ((is - was).norm(), 0);
        }
    }
    for (const int n : count) EXPECT_GT(n, 10);
    EXPECT_NEAR(p.model.fastest, fastest, 1e-15);
}

}  // namespace
}  // namespace trocar
