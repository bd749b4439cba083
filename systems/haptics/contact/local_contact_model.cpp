#include "systems/haptics/contact/local_contact_model.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/geometry/vec4.hpp"
#include "engine/haptics/point_shell.hpp"
#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "engine/motion/keyframe_path.hpp"
#include "systems/haptics/contact/push_out.hpp"
#include "systems/haptics/contact/surface_feel.hpp"
namespace trocar {
namespace {

struct BoxLanes {
    Vec4d min, max;  // m
};
BoxLanes lanes_of(const Box& box) { return {to_vec4(box.min), to_vec4(box.max)}; }

// Position of a vertex in the frame of its body, m, and bound on its displacement along each axis.
struct VertexRoom {
    Vec4d position, slack;
};

// Sides of the box that a vertex stays beyond for all displacements within its bound, one bit each.
uint8_t sides_beyond(const BoxLanes& box, const VertexRoom& room) {
    const auto mask_of = [](auto lanes) { return static_cast<uint32_t>(_mm256_movemask_pd((__m256d)lanes)) & 7; };
    return static_cast<uint8_t>(mask_of(room.position + room.slack < box.min) | mask_of(room.position - room.slack > box.max) << 3);
}

// box around a segment
Box segment_box(const Vec3d& a, const Vec3d& b, double reach) { return {a.cwiseMin(b).array() - reach, a.cwiseMax(b).array() + reach}; }

// m/s, bound on the speed of a rigid body's surface
double rigid_speed(const Surfaces& s, uint32_t body) {
    return s.poses.velocity[body].norm() + s.poses.angular_velocity[body].norm() * s.meshes.info[s.bodies.mesh[body]].radius;
}

// Calls with(room) where room(v) is that of vertex v in `seconds`.
template <typename With>
void with_rooms(const Surfaces& s, uint32_t body, double seconds, const With& with) {
    const MeshInfo& info = s.meshes.info[s.bodies.mesh[body]];
    if (!is_deformable(s.bodies, body)) {
        const double speed = rigid_speed(s, body);
        const Vec4d slack = make_vec4(speed * seconds, speed * seconds, speed * seconds);
        with([&](uint32_t v) { return VertexRoom{to_vec4(s.meshes.position[info.vertices.first + v]), slack}; });
        return;
    }
    const uint32_t first = s.bodies.particles[body].first;
    const Float4* position = s.particles.offset.data() + first;
    const float *x = s.particles.velocity_x.data() + first, *y = s.particles.velocity_y.data() + first,
                *z = s.particles.velocity_z.data() + first;
    with([=](uint32_t v) {
        const __m128 magnitude = _mm_andnot_ps(_mm_set1_ps(-0.0f), _mm_setr_ps(x[v], y[v], z[v], 0));
        return VertexRoom{float_vec4(_mm_load_ps(&position[v].x)), seconds * float_vec4(magnitude)};
    });
}

bool has_zero_byte(uint64_t x) { return ((x - 0x0101010101010101u) & ~x & 0x8080808080808080u) != 0; }

// Marks the triangles that may come to one of up to eight boxes (frame of the body) within `seconds`: those
// without a side of the box that all their corners are beyond. A box around all of them selects the triangles
// to test against each.
void mark_triangles(const Surfaces& s, uint32_t body, std::span<const Box> boxes, double seconds, LocalContactScratch& scratch) {
    constexpr uint64_t kNotAsked = 0, kEveryBox = 0x4040404040404040u;  // a bit that is no side
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    Box all;
    for (const Box& box : boxes) all.min = all.min.cwiseMin(box.min), all.max = all.max.cwiseMax(box.max);
    scratch.beyond.resize(mesh.position.size());
    scratch.beyond_each.assign(mesh.position.size(), kNotAsked);
    scratch.wanted.assign(mesh.triangle.size(), 0);
    const BoxLanes around = lanes_of(all);
    std::array<BoxLanes, 8> each;
    for (size_t k = 0; k < each.size(); ++k) each[k] = lanes_of(boxes[std::min(k, boxes.size() - 1)]);
    with_rooms(s, body, seconds, [&](const auto& room_of) {
        for (uint32_t v = 0; v < mesh.position.size(); ++v) scratch.beyond[v] = sides_beyond(around, room_of(v));
        const auto beyond_each = [&](uint32_t v) {
            uint64_t& sides = scratch.beyond_each[v];
            if (sides != kNotAsked) return sides;
            const VertexRoom room = room_of(v);
            sides = kEveryBox;
            for (size_t k = 0; k < each.size(); ++k) sides |= uint64_t{sides_beyond(each[k], room)} << (8 * k);
            return sides;
        };
        for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
            const Triangle& c = mesh.triangle[t];
            if (scratch.beyond[c[0]] & scratch.beyond[c[1]] & scratch.beyond[c[2]]) continue;
            scratch.wanted[t] =
                boxes.size() == 1 || has_zero_byte((beyond_each(c[0]) & beyond_each(c[1]) & beyond_each(c[2])) & ~kEveryBox);
        }
    });
}

// m, of a sheet; 0 for closed bodies
double thickness_of(const Surfaces& s, uint32_t body) {
    return s.meshes.info[s.bodies.mesh[body]].admission == Admission::kSheet ? s.bodies.thickness[body] : 0;
}

// Replaces the velocities of the vertices of a tissue, from index `first` on, by the mean over the triangles
// around each, twice; before that, velocities relative to the rest are limited to `most` (m/s). Motion of a
// vertex against its neighbours, or when it snaps back, ends within a fraction of a contact pass;
// extrapolated to the next one, it would only make the surface pass through itself.
void smooth_velocities(uint32_t first, uint32_t first_triangle, double most, LocalContactScratch& scratch, LocalContactModel& out) {
    const std::span<Vec3d> velocity = std::span(out.velocity).subspan(first);
    const std::span<const Triangle> triangles = std::span<const Triangle>(out.triangle).subspan(first_triangle);
    Vec3d mean = Vec3d::Zero();
    for (const Vec3d& v : velocity) mean += v / static_cast<double>(velocity.size());
    for (Vec3d& v : velocity)
        if (const double speed = (v - mean).norm(); speed > most) v = mean + most / speed * (v - mean);
    for (int round = 0; round < 2; ++round) {
        scratch.around.assign(velocity.size(), RingSum{});
        for (const Triangle& t : triangles) {
            const Vec3d sum = velocity[t[0] - first] + velocity[t[1] - first] + velocity[t[2] - first];
            for (const uint32_t v : t) scratch.around[v - first].sum += sum, scratch.around[v - first].count += 3;
        }
        for (size_t v = 0; v < velocity.size(); ++v) velocity[v] = scratch.around[v].sum / scratch.around[v].count;
    }
}

uint32_t add_vertex(const Surfaces& s, uint32_t body, uint32_t vertex, LocalContactScratch& scratch, LocalContactModel& out) {
    uint32_t& index = scratch.vertex_index[vertex];
    if (index == kNone) {
        index = static_cast<uint32_t>(out.position.size());
        out.position.push_back(vertex_position(s, body, vertex));
        out.velocity.push_back(vertex_velocity(s, body, vertex));
    }
    return index;
}

void add_body(const Surfaces& s, uint32_t body, double half_thickness, double fastest, LocalContactScratch& scratch,
              LocalContactModel& out) {
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const uint32_t first = static_cast<uint32_t>(out.position.size()), first_triangle = static_cast<uint32_t>(out.triangle.size());
    scratch.triangle_used.clear();
    if (scratch.vertex_index.size() < mesh.position.size()) scratch.vertex_index.resize(mesh.position.size(), kNone);
    if (scratch.triangle_index.size() < mesh.triangle.size()) scratch.triangle_index.resize(mesh.triangle.size(), kNone);
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        if (!scratch.wanted[t]) continue;
        const Triangle& corner = mesh.triangle[t];
        scratch.triangle_index[t] = static_cast<uint32_t>(out.triangle.size());
        scratch.triangle_used.push_back(t);
        Triangle index;
        for (int k = 0; k < 3; ++k) index[k] = add_vertex(s, body, corner[k], scratch, out);
        out.triangle.push_back(index);
        out.body.push_back(body);
        out.source.push_back(t);
        out.half_thickness.push_back(half_thickness);
    }
    for (const uint32_t t : scratch.triangle_used) {
        std::array<uint32_t, 3> index;
        for (int k = 0; k < 3; ++k) {
            const uint32_t across = mesh.neighbour[t][k];
            index[k] = across == kNone ? kNone : scratch.triangle_index[across];
        }
        out.neighbour.push_back(index);
    }
    // only the used elements are reset to kNone: cheaper than clearing the maps for every body
    for (const uint32_t t : scratch.triangle_used) {
        scratch.triangle_index[t] = kNone;
        for (const uint32_t v : mesh.triangle[t]) scratch.vertex_index[v] = kNone;
    }
    if (is_deformable(s.bodies, body)) smooth_velocities(first, first_triangle, fastest, scratch, out);
}

void clear_model(LocalContactModel& model) {
    model.position.clear();
    model.velocity.clear();
    model.triangle.clear();
    model.neighbour.clear();
    model.body.clear();
    model.source.clear();
    model.half_thickness.clear();
    model.compliance = {};
    model.point_shell.node.clear();
    model.point_shell.tree.clear();
    model.point_shell.clear.clear();
    model.point_shell.nearest.clear();
    model.point_shell.found.clear();
    model.point_shell.speed.clear();
    model.point_shell.position.clear();
}

// Region of a shell between its pose and that of its device: boxes around runs of its points at both.
constexpr uint32_t kShellRuns = 8;
constexpr double kAround = 4e-3;     // m, around a point of a shell: the point does not come to surfaces that stay farther away
constexpr double kShared = 4e-3;     // m, points this far from a surface and this near to each other share a bound on its speed
constexpr double kSoon = 0.05;       // s, longer than a model is in use
constexpr double kBeside = 1e-3;     // m, beyond the nearest triangle of a point: further triangles found along with it
constexpr double kFarEnough = 4e-3;  // m, from a surface: the ticks of the next pass will hardly evaluate this point
struct ShellPlaces {
    Vec3d tip, device;
    Quat turn, device_turn;
};
ShellPlaces shell_places(const ToolState& state, const LocalContactModel& model) {
    const DeviceState& device = state.device;
    const ProxyStart start = proxy_start(model, state);
    if (!state.proxy_valid) return {start.tip, device.position, start.turn, device.orientation};
    return {state.proxy, device.position, state.proxy_turn, device.orientation};
}
Box shell_box(const Surfaces& s, uint32_t body, std::span<const ShellPoint> points, const ShellPlaces& at, uint32_t run, double reach) {
    const size_t count = points.size(), begin = count * run / kShellRuns, end = count * (run + 1) / kShellRuns;
    Box box;
    for (size_t k = begin; k < end; ++k) {
        const Vec3d p = world_to_frame(s, body, at.tip + rotate(at.turn, points[k].arm));
        const Vec3d q = world_to_frame(s, body, at.device + rotate(at.device_turn, points[k].arm));
        box.min = box.min.cwiseMin(p.cwiseMin(q));
        box.max = box.max.cwiseMax(p.cwiseMax(q));
    }
    return {box.min.array() - reach, box.max.array() + reach};
}

// Marks in scratch.wanted the triangles of a body that a tool may touch.
void mark_within_reach(const HapticParams& params, const Surfaces& s, uint32_t body, const HandTool& tool, const ToolState& state,
                       double reach, LocalContactScratch& scratch, const LocalContactModel& out) {
    if (tool.point_shell.empty()) {
        const Box box = segment_box(world_to_frame(s, body, out.from), world_to_frame(s, body, out.to), reach);
        mark_triangles(s, body, {&box, 1}, params.greatest_age, scratch);
        return;
    }
    const ShellPlaces at = shell_places(state, out);
    const auto points = points_at_grip(tool, state.device.grip, scratch.open);
    std::array<Box, kShellRuns> boxes;
    for (uint32_t run = 0; run < kShellRuns; ++run) boxes[run] = shell_box(s, body, points, at, run, reach);
    mark_triangles(s, body, boxes, params.greatest_age, scratch);
}

// Ball around the corners of a triangle, and its velocity.
struct TriangleBall {
    Vec3d centre, velocity;
    double radius, spread;
};

TriangleBall ball_around(const LocalContactModel& model, const Triangle& t) {
    const auto mean_and_farthest = [&](const std::vector<Vec3d>& of, Vec3d& mean, double& farthest) {
        const Vec3d &a = of[t[0]], &b = of[t[1]], &c = of[t[2]];
        mean = (a + b + c) / 3;
        farthest = std::sqrt(std::max({(a - mean).squaredNorm(), (b - mean).squaredNorm(), (c - mean).squaredNorm()}));
    };
    TriangleBall ball;
    mean_and_farthest(model.position, ball.centre, ball.radius);
    mean_and_farthest(model.velocity, ball.velocity, ball.spread);
    return ball;
}

// Ball around parts (triangles, groups), and its velocity.
template <typename Part>
void bound_parts(std::span<const Part> parts, TriangleGroup& group) {
    group.centre.setZero(), group.velocity.setZero();
    for (const Part& p : parts) group.centre += p.centre, group.velocity += p.velocity;
    group.centre /= static_cast<double>(parts.size()), group.velocity /= static_cast<double>(parts.size());
    group.radius = group.spread = 0;
    for (const Part& p : parts) {
        group.radius = std::max(group.radius, (p.centre - group.centre).norm() + p.radius);
        group.spread = std::max(group.spread, (p.velocity - group.velocity).norm() + p.spread);
    }
}

template <size_t count>
void set_lane(std::array<std::array<float, count>, 3>& lanes, uint32_t lane, const Vec3d& v) {
    for (size_t axis = 0; axis < 3; ++axis) lanes[axis][lane] = static_cast<float>(v[static_cast<long>(axis)]);
}

// Computes the bounds of the triangles of a group, and of the group.
void bound_triangles(const LocalContactModel& model, TriangleGroup& group, TriangleLanes& lanes) {
    std::array<TriangleBall, kGroupTriangles> each;
    const Range triangles = group.triangles;
    for (uint32_t k = 0; k < triangles.count; ++k) each[k] = ball_around(model, model.triangle[triangles.first + k]);
    bound_parts(std::span<const TriangleBall>(each).first(triangles.count), group);
    for (uint32_t lane = 0; lane < kGroupTriangles; ++lane) {
        for (size_t k = 0; k < 3; ++k) {
            const bool here = lane < triangles.count;
            const uint32_t v = here ? model.triangle[triangles.first + lane][k] : 0;
            set_lane(lanes.corner[k], lane, here ? Vec3d(model.position[v] - group.centre) : Vec3d::Constant(kFarLane));
            set_lane(lanes.velocity[k], lane, here ? Vec3d(model.velocity[v] - group.velocity) : Vec3d::Zero());
        }
    }
}

// Computes the bounds of a run of parts (groups of a block, blocks of a cluster), and of each part.
void bound_run(std::span<const TriangleGroup> parts, TriangleGroup& run, GroupBalls& balls) {
    bound_parts(parts, run);
    for (uint32_t k = 0; k < kBlockGroups; ++k) {
        balls.radius[k] = -std::numeric_limits<float>::infinity();
        if (k >= parts.size()) continue;
        const TriangleGroup& part = parts[k];
        set_lane(balls.centre, k, part.centre - run.centre);
        set_lane(balls.velocity, k, part.velocity - run.velocity);
        balls.radius[k] = static_cast<float>(part.radius);
        balls.spread[k] = static_cast<float>(part.spread);
        balls.speed[k] = static_cast<float>((1 + kLaneRounding) * (part.velocity.norm() + part.spread));
    }
}

// Computes the bounds of the runs of one body, or of all.
void bound_runs(uint32_t body, const std::vector<TriangleGroup>& parts, std::vector<TriangleGroup>& runs, std::vector<GroupBalls>& balls) {
    balls.resize(runs.size());
    for (size_t r = 0; r < runs.size(); ++r)
        if (body == kNone || runs[r].body == body)
            bound_run(std::span(parts).subspan(runs[r].triangles.first, runs[r].triangles.count), runs[r], balls[r]);
}

// Computes the bounds of triangles, groups, blocks and clusters of one body, or of all.
void bound_groups(LocalContactModel& model, uint32_t body) {
    model.lanes.resize(model.group.size());
    for (size_t g = 0; g < model.group.size(); ++g)
        if (body == kNone || model.group[g].body == body) bound_triangles(model, model.group[g], model.lanes[g]);
    bound_runs(body, model.group, model.block, model.ball);
    bound_runs(body, model.block, model.cluster, model.cluster_ball);
    double fastest2 = 0;
    for (const Vec3d& v : model.velocity) fastest2 = std::max(fastest2, v.squaredNorm());
    model.fastest = std::sqrt(fastest2);
}

// Collects consecutive parts of one body into runs of at most kBlockGroups.
void find_runs(std::span<const TriangleGroup> parts, std::vector<TriangleGroup>& runs) {
    runs.clear();
    for (uint32_t first = 0, end = 0; first < parts.size(); first = end) {
        for (end = first + 1; end < parts.size() && end < first + kBlockGroups && parts[end].body == parts[first].body;) ++end;
        TriangleGroup run;
        run.triangles = {first, end - first}, run.body = parts[first].body, run.half_thickness = parts[first].half_thickness;
        runs.push_back(run);
    }
}

// Height (m) of a point above the surface of a body in contact: the nearest within 60 degrees of its force; infinite
// if none is nearer than `most`. Negative where a sharp tip sank in between the vertices in contact.
double height_above(const LocalContactModel& model, uint32_t body, const Vec3d& point, const Vec3d& normal, double most) {
    double nearest = most, height = std::numeric_limits<double>::infinity();
    for (const TriangleGroup& group : model.group) {
        if (group.body != body || (group.centre - point).norm() - group.radius > nearest) continue;
        for (uint32_t t = group.triangles.first; t < group.triangles.end(); ++t) {
            const auto corner = [&](int k) { return model.position[model.triangle[t][k]]; };
            const TrianglePoint q = closest_point_on_triangle(point, corner(0), corner(1), corner(2));
            const double distance = std::sqrt(q.squared_distance), up = -q.offset.dot(normal);
            if (distance <= nearest && std::abs(up) >= 0.5 * distance) nearest = distance, height = std::copysign(distance, up);
        }
    }
    return height;
}

// Mean separation (m) between a body's surface and the contact points of a shell placed at the simulated
// tool, minus the compression of their springs, weighted by force: with this offset the springs bear the
// forces of the contacts.
double shell_gap(const HandTool& tool, const ToolState& state, uint32_t body, const Vec3d& tip, const Quat& turn,
                 LocalContactScratch& scratch, const LocalContactModel& model) {
    const auto tree =
        std::find_if(model.point_shell.tree.begin(), model.point_shell.tree.end(), [&](const SurfaceTree& t) { return t.body == body; });
    if (tree == model.point_shell.tree.end()) return 0;
    begin_moment(model, {}, scratch.placed);
    const auto points = points_at_grip(tool, state.device.grip, scratch.open);
    double sum = 0, force = 0;
    for (const ShellContact& c : state.contact) {
        if (c.body != body) continue;
        const NearestTriangle nearest =
            find_nearest(model, *tree, tip + rotate(turn, points[c.point].arm), kNone, model.reach, scratch.placed);
        if (nearest.triangle == kNone) return 0;
        const double press = c.depth * tool.surface_stiffness;
        sum += press * (side_of(model, nearest, c.side, scratch.placed).distance + c.depth);
        force += press;
    }
    return force > 0 ? sum / force : 0;
}

// Sets the surface of a body within `near` (m) of a tool to the tool's velocity, decreasing up to twice as far.
template <typename SquaredDistance, typename VelocityAt>  // m2 and m/s, at a place
void take_along(uint32_t body, double near, const SquaredDistance& distance2_to, const VelocityAt& velocity_at, LocalContactModel& out) {
    const auto first = std::find(out.body.begin(), out.body.end(), body);
    if (first == out.body.end()) return;
    // vertices are stored in the order of first use, so those of a body are contiguous
    const auto vertex_of = [&](auto triangle) -> size_t {
        return triangle == out.body.end() ? out.position.size() : out.triangle[static_cast<size_t>(triangle - out.body.begin())][0];
    };
    const size_t end = vertex_of(std::find_if(first, out.body.end(), [&](uint32_t b) { return b != body; }));
    for (size_t v = vertex_of(first); v < end; ++v) {
        const double share = std::clamp((2 * near - std::sqrt(distance2_to(out.position[v]))) / near, 0.0, 1.0);
        if (share > 0) out.velocity[v] += share * (velocity_at(out.position[v]) - out.velocity[v]);
    }
}

// Tissue that a point shell presses moves with it, not as its vertices do before a contact has stopped or taken them.
void take_along_with_shell(const Surfaces& surfaces, const HandTool& tool, const ToolState& state, LocalContactModel& out) {
    const Vec3d velocity = surfaces.poses.velocity[tool.body], spin = surfaces.poses.angular_velocity[tool.body],
                origin = surfaces.poses.origin[tool.body];
    const auto velocity_at = [&](const Vec3d& place) { return Vec3d(velocity + spin.cross(place - origin)); };
    for (size_t begin = 0, end = 0; begin < state.contact.size(); begin = end) {
        const uint32_t body = state.contact[begin].body;
        while (end < state.contact.size() && state.contact[end].body == body) ++end;
        if (!is_deformable(surfaces.bodies, body)) continue;
        const auto distance2_to = [&](const Vec3d& place) {
            double least = std::numeric_limits<double>::infinity();
            for (size_t k = begin; k < end; ++k) least = std::min(least, (place - out.tip - state.contact[k].arm).squaredNorm());
            return least;
        };
        take_along(body, 1.5 * surfaces.meshes.info[surfaces.bodies.mesh[body]].mean_edge, distance2_to, velocity_at, out);
    }
}

// Stiffness (N/m) of tissue against a tip of a radius that begins to touch it and goes in by `depth` (m) until the next
// pass: a lower bound, so that first contact never feels harder than the tissue is.
double stiffness_at_first_touch(const Surfaces& surfaces, uint32_t body, double radius, double depth) {
    const Tissue& tissue = surfaces.bodies.tissue[body];
    const MeshInfo& info = surfaces.meshes.info[surfaces.bodies.mesh[body]];
    const double edge = info.mean_edge;
    constexpr uint32_t kLanes = 16;  // particles come in multiples of it
    if (surfaces.bodies.particles[body].count > (info.vertices.count + kLanes - 1) / kLanes * kLanes) {
        // solid: a half-space under a flat end as wide as an edge (Boussinesq) or a ball (Hertz)
        const double modulus = tissue.youngs_modulus / (1 - tissue.poisson * tissue.poisson);
        return modulus * std::max(edge, 4.0 / 3 * std::sqrt(radius * depth));
    }
    // shell: the elastic foundation of the vertices taken along, 2.4 to 15 on 19 organs with tips of 0.1 to 5 mm, and
    // below the cap of the tip, half way in
    const double area = 3 * 0.5 * std::sqrt(3.0) * edge * edge + M_PI * radius * std::min(depth, radius);
    return area * tissue.youngs_modulus / tissue.depth;
}

// Height (m) of a tip above the surface that it rests on; infinite if that is farther than most_gap.
constexpr double kMostGap = 5e-4;   // m
constexpr double kMostFacet = 0.1;  // of the radius: facets of a ball of 80 triangles lie 7 % inside it
double most_gap(double radius) { return std::max(kMostGap, kMostFacet * radius); }
double gap_to(const Surfaces& surfaces, uint32_t body, double radius, const Vec3d& tip, const Vec3d& normal, const LocalContactModel& out) {
    const double offset = radius + thickness_of(surfaces, body) / 2;
    return height_above(out, body, tip, normal, offset + most_gap(radius)) - offset;
}

// Gap (m) with which the proxy rests as high as the simulated tip, along a force: the surface is shown so much higher. Starts from
// the gap of the nearest surface, which is not that of all that bears the tip - further places in a dent, facets and corners of its
// mesh. Off by that height a hand held still would feel stiffness times that too much.
double resting_gap(const HandTool& tool, const ToolState& state, const Vec3d& tip, double most, LocalContactScratch& scratch,
                   const LocalContactModel& model) {
    constexpr uint32_t kTries = 3;     // the proxy rises by what the surface does, but for where it slides to
    constexpr double kResting = 1e-7;  // m
    const SurfaceCompliance& c = model.compliance;
    const double friction = feel_of(tool, model, state.touched, state.sliding).friction;
    double gap = c.gap;
    for (uint32_t k = 0; k < kTries; ++k) {
        const SurfaceTime now{0, gap * c.normal};
        const Vec3d start = state.proxy + c.slip;
        const double travel = (start - tip).norm() + (state.device.position - tip).norm() + most;
        gather_surface(model, now, tool, tip, travel, scratch.proxy);
        const ProxySearch rest = find_proxy(start, state.device.position, {tip, travel}, friction, true, scratch.proxy);
        if (rest.inside || rest.active == 0 || rest.unfinished) break;
        const double height = c.normal.dot(tip - rest.proxy);
        gap = std::clamp(gap + height, -most, most);
        if (std::abs(height) < kResting) break;
    }
    return gap;
}

// The body that a tip presses: if that is another hand's tool with tissue between both, the tissue, which moves with the tip.
uint32_t pressed_body(const Surfaces& surfaces, const HandTool& tool, const ToolState& state, const Vec3d& tip,
                      const LocalContactModel& out) {
    const double force = state.command.force.norm();
    if (state.contacts == 0 || state.touched == kNone || !(force > 0)) return kNone;
    if (!tool.point_shell.empty() || surfaces.bodies.motion[state.touched] != Motion::kHand) return state.touched;
    for (uint32_t body = state.touched; const TriangleGroup& group : out.group) {
        if (group.body == body || !is_deformable(surfaces.bodies, group.body)) continue;
        body = group.body;
        if (std::abs(gap_to(surfaces, body, tool.tip_radius, tip, state.command.force / force, out)) <= most_gap(tool.tip_radius))
            return body;
    }
    return state.touched;
}

void predict_compliance(const Surfaces& surfaces, const HandTool& tool, ToolState& state, LocalContactScratch& scratch,
                        LocalContactModel& out) {
    out.compliance = {};
    out.pull = state.link_force, out.pull_before = state.link_force_before;
    const uint32_t body = tool.body;
    const Vec3d arm = rotate(surfaces.poses.orientation[body], tool.tip), tip = surfaces.poses.origin[body] + arm;
    const double force = state.command.force.norm();
    const ToolPass now{pressed_body(surfaces, tool, state, tip, out), tip, state.device.position};
    const ToolPass before = state.last_pass;
    state.last_pass = now;
    if (now.touched == kNone) return;
    const bool deformable = is_deformable(surfaces.bodies, now.touched);
    if (!deformable && surfaces.bodies.motion[now.touched] != Motion::kFree) return;
    const Vec3d normal = state.command.force / force;
    const double share = now.touched == before.touched ? give_share(normal, tip - before.tip, now.device - before.device) : 0;
    if (!tool.point_shell.empty()) {
        const double gap = shell_gap(tool, state, now.touched, tip, surfaces.poses.orientation[body], scratch, out);
        out.compliance = {
            now.touched, share, normal, now.device, state.motion.velocity(), state.device.time, std::abs(gap) <= kMostGap ? gap : 0,
            {0, 0, 0}};
        return;
    }
    const double gap = gap_to(surfaces, now.touched, tool.tip_radius, tip, normal, out), most = most_gap(tool.tip_radius);
    if (!(std::abs(gap) <= most)) return;
    Vec3d slip = tip - state.proxy - normal.dot(tip - state.proxy) * normal;
    if (!state.proxy_valid || slip.norm() > most) slip.setZero();
    out.compliance = {now.touched, share, normal, now.device, state.motion.velocity(), state.device.time, gap, slip};
    if (state.proxy_valid) out.compliance.gap = resting_gap(tool, state, tip, most, scratch, out);
    if (!deformable) return;  // its velocities describe its motion
    const double near = tool.tip_radius + 1.5 * surfaces.meshes.info[surfaces.bodies.mesh[now.touched]].mean_edge;
    const Vec3d velocity = surfaces.poses.velocity[body] + surfaces.poses.angular_velocity[body].cross(arm);
    take_along(
        now.touched, near, [&](const Vec3d& place) { return (place - tip).squaredNorm(); }, [&](const Vec3d&) { return velocity; }, out);
    bound_groups(out, now.touched);
}

}  // namespace

void publish_local_contact(const HapticParams& params, const Surfaces& surfaces, std::span<const Box> boxes, const HandTool& tool,
                           const ToolState& state, const ModelPass& pass, LocalContactScratch& scratch, LocalContactModel& out,
                           std::span<const ToolJaw> jaws) {
    const auto is_jaw = [&](uint32_t body) {
        return std::any_of(jaws.begin(), jaws.end(), [&](const ToolJaw& j) { return j.body == body; });
    };
    clear_model(out);
    out.time = pass.time;
    out.sequence = pass.sequence;
    out.period = pass.period;
    out.in_hand = pass.in_hand;
    out.exit = state.exit;
    out.placed = tool.body < surfaces.poses.origin.size();
    if (out.placed) {
        out.turn = surfaces.poses.orientation[tool.body];
        out.tip = surfaces.poses.origin[tool.body] + rotate(out.turn, tool.tip);
    }
    out.from = state.device.position;
    out.to = state.proxy_valid ? state.proxy : proxy_start(out, state).tip;
    const double turning = state.device_spin.norm() * tool.shell_radius;
    const double speed = std::max(params.tool_speed, 1.5 * (state.device.velocity.norm() + turning));
    out.reach = tool.tip_radius + speed * params.greatest_age + params.reach_margin;
    const Bodies& bodies = surfaces.bodies;
    for (uint32_t body = 0; body < bodies.mesh.size(); ++body) {
        const MeshInfo& info = surfaces.meshes.info[bodies.mesh[body]];
        if (body == tool.body || is_jaw(body) || info.admission == Admission::kRefused) continue;
        const double half_thickness = 0.5 * thickness_of(surfaces, body);
        const double reach = out.reach + half_thickness;
        const double way = bodies.motion[body] == Motion::kKinematic ? rigid_speed(surfaces, body) * params.greatest_age : 0;
        if (!boxes.empty() && !boxes_meet(boxes[body], segment_box(out.from, out.to, reach + way + tool.shell_radius))) continue;
        mark_within_reach(params, surfaces, body, tool, state, reach, scratch, out);
        add_body(surfaces, body, half_thickness, speed, scratch, out);
    }
    if (out.placed) take_along_with_shell(surfaces, tool, state, out);
    group_triangles(out);
    if (!tool.point_shell.empty()) publish_point_shell_cache(params, tool, state, scratch, out);
}

void foresee_paths(const Paths& paths, double time, double period, std::span<const uint8_t> off, Poses& poses) {
    for (uint32_t i = 0; i < paths.body.size(); ++i) {
        const uint32_t body = paths.body[i];
        const auto keys = std::span(paths.key).subspan(paths.keys[i].first, paths.keys[i].count);
        if (body == kNone || (body < off.size() && off[body]) || path_jumps(keys, time, time + period)) continue;
        const PathPoint to = sample_path(keys, time + period);
        poses.velocity[body] = (to.position - poses.origin[body]) / period;
        poses.angular_velocity[body] = rotation_vector(poses.orientation[body], to.orientation) / period;
    }
}

void publish_point_shell_cache(const HapticParams& params, const HandTool& tool, const ToolState& state, LocalContactScratch& scratch,
                               LocalContactModel& out) {
    build_surface_trees(scratch.tree, out);
    const ShellPlaces at = shell_places(state, out);
    PointShellCache& point_shell = out.point_shell;
    point_shell.tip = at.tip;
    point_shell.turn = at.turn;
    point_shell.grip = state.device.grip;
    const auto points = points_at_grip(tool, point_shell.grip, scratch.open);
    point_shell.clear.clear();
    point_shell.nearest.clear();
    point_shell.found.clear();
    point_shell.speed.clear();
    point_shell.position.clear();
    for (const ShellPoint& point : points) point_shell.position.push_back(at.tip + rotate(at.turn, point.arm));
    point_shell.ahead = params.greatest_age;
    point_shell.around = kAround + kSoon * (state.device.velocity.norm() + state.device_spin.norm() * tool.shell_radius);
    begin_moment(out, {}, scratch.placed);
    for (const SurfaceTree& tree : point_shell.tree) {
        uint32_t hint = kNone;  // of the last point evaluated
        double clear = 0;       // m, of that point
        Vec3d asked = Vec3d::Zero();
        double speed = 0;               // m/s, around ...
        const Vec3d* shared = nullptr;  // ... there
        const double half = tree.half_thickness, reach = std::min(out.reach, 2 * kFarEnough + half);
        for (const Vec3d& position : point_shell.position) {
            // distances change no faster than positions: far points need no query of their own
            const double known = clear - (position - asked).norm();
            if (known > kFarEnough) {
                if (!shared || (position - *shared).norm() > kShared) {
                    shared = &position;
                    speed = fastest_around(out, tree, position, point_shell.around + kShared, point_shell.ahead);
                }
                point_shell.speed.push_back(speed);
                point_shell.nearest.push_back(hint);
                point_shell.found.push_back({});
                point_shell.clear.push_back(known);
                continue;
            }
            const NearestTriangle nearest =
                find_nearest_around(out, tree, position, hint, reach, kBeside, scratch.placed, point_shell.found.emplace_back());
            clear = reach - half;
            if (nearest.triangle != kNone) hint = nearest.triangle, clear = side_of(out, nearest, 0, scratch.placed).distance;
            asked = position;
            point_shell.nearest.push_back(hint);
            point_shell.clear.push_back(clear);
            point_shell.speed.push_back(fastest_around(out, tree, position, point_shell.around, point_shell.ahead));
        }
    }
}

double give_share(const Vec3d& normal, const Vec3d& tip_travel, const Vec3d& device_travel) {
    constexpr double kLeastWay = 1e-4;  // m
    constexpr double kMost = 0.95;      // below 1: the coupling alone is softer than a surface that yields completely
    const double along = normal.dot(device_travel);
    if (std::abs(along) < std::max(kLeastWay, 0.5 * device_travel.norm())) return 0;
    return std::clamp(normal.dot(tip_travel) / along, 0.0, kMost);
}

void publish_compliance(const Surfaces& surfaces, const HandTool& tool, ToolState& state, LocalContactScratch& scratch,
                        LocalContactModel& out) {
    const uint32_t before = state.last_pass.touched;
    predict_compliance(surfaces, tool, state, scratch, out);
    const uint32_t known = state.last_pass.touched == before ? out.compliance.body : kNone;
    for (uint32_t body = kNone; const TriangleGroup& group : out.group) {
        if (group.body == body || group.body == known) continue;
        body = group.body;
        if (!is_deformable(surfaces.bodies, body) || body == out.exit.body) continue;
        const double radius = tool.point_shell.empty() ? tool.tip_radius : 0;  // of a shell a corner may touch
        double stiffness = stiffness_at_first_touch(surfaces, body, radius, state.device.velocity.norm() * out.period);
        // where contacts leave no surface under the tip, the hand feels at least what the tissue bears
        if (body == state.last_pass.touched && state.proxy_valid) {
            const double series = state.coupling_force.norm() / (state.proxy - state.device.position).norm();
            if (series < tool.coupling_stiffness)
                stiffness = std::max(stiffness, series * tool.coupling_stiffness / (tool.coupling_stiffness - series));
        }
        HapticSurface& surface = own_surface(body, out);
        surface.deformable = true, surface.stiffness = stiffness;
    }
}

void group_triangles(LocalContactModel& model) {
    model.group.clear();
    const uint32_t count = static_cast<uint32_t>(model.triangle.size());
    for (uint32_t first = 0; first < count;) {
        uint32_t end = first + 1;
        while (end < count && end < first + kGroupTriangles && model.body[end] == model.body[first]) ++end;
        TriangleGroup group;
        group.triangles = {first, end - first}, group.body = model.body[first], group.half_thickness = model.half_thickness[first];
        model.group.push_back(group);
        first = end;
    }
    find_runs(model.group, model.block);
    find_runs(model.block, model.cluster);
    bound_groups(model, kNone);
}

}  // namespace trocar
