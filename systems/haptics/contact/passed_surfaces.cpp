#include "systems/haptics/contact/passed_surfaces.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/quaternion.hpp"
#include "systems/haptics/contact/surface_crossing.hpp"
namespace trocar {
namespace {

constexpr double kContactError = 2e-4;  // m, twice the depth at which a start counts as inside
constexpr size_t kCoreBalls = 16;

// m, radius of the largest ball that touches the shell at a point from within and has no other point of it inside.
double inner_radius(std::span<const ShellPoint> points, const ShellPoint& at) {
    double radius = std::numeric_limits<double>::infinity();
    for (const ShellPoint& other : points) {
        if (other.jaw != kNone) continue;
        const Vec3d apart = other.arm - at.arm;
        const double depth = apart.dot(at.inward);
        if (depth > 0) radius = std::min(radius, apart.squaredNorm() / (2 * depth));
    }
    return radius;
}

// Positions of the model's vertices at the end of the pass and, if `normals`, unit normals at both ends; those of rigid bodies are
// left out.
void place_vertices(const Surfaces& s, const LocalContactModel& model, bool normals, PassedSurfacesScratch& scratch) {
    scratch.end.assign(model.position.begin(), model.position.end());
    scratch.normal.assign(model.position.size(), Vec3d::Zero());
    scratch.end_normal.assign(model.position.size(), Vec3d::Zero());
    for (size_t t = 0; t < model.triangle.size(); ++t) {
        const uint32_t body = model.body[t];
        if (!is_deformable(s.bodies, body)) continue;
        const Triangle& own = mesh_view(s.meshes, s.bodies.mesh[body]).triangle[model.source[t]];
        const Triangle& index = model.triangle[t];
        for (int k = 0; k < 3; ++k) scratch.end[index[k]] = vertex_position(s, body, own[k]);
        if (!normals) continue;
        const auto add = [&](const std::vector<Vec3d>& position, std::vector<Vec3d>& sum) {
            const Vec3d normal = triangle_normal(position[index[0]], position[index[1]], position[index[2]]);
            for (const uint32_t v : index) sum[v] += normal;
        };
        add(model.position, scratch.normal);
        add(scratch.end, scratch.end_normal);
    }
    for (std::vector<Vec3d>* sum : {&scratch.normal, &scratch.end_normal})
        for (Vec3d& n : *sum)
            if (normals) n.normalize();
}

struct BallMotion {
    Vec3d from, to;  // m, of the centre
    double beyond;   // m, that the surface must pass beyond it
};
double contact_error(const CoreBall& ball) { return std::max(0.0, kContactError - ball.radius); }

// Whether a triangle of the model passes over the ball, which was in front of it (side = 1) or behind (-1).
bool passes(const LocalContactModel& model, size_t triangle, const BallMotion& ball, double side, const PassedSurfacesScratch& scratch) {
    PassingTriangle p;
    const double beyond_it = model.half_thickness[triangle] > 0 ? 0 : side * ball.beyond;
    for (size_t k = 0; k < 3; ++k) {
        const uint32_t v = model.triangle[triangle][k];
        const Vec3d from = model.position[v] - beyond_it * scratch.normal[v], to = scratch.end[v] - beyond_it * scratch.end_normal[v];
        p.corner[k] = from - ball.from;
        p.displacement[k] = to - from - (ball.to - ball.from);
        if (!p.corner[k].allFinite() || !p.displacement[k].allFinite()) return false;
    }
    for (int axis = 0; axis < 3; ++axis) {
        const auto apart = [&](double sign) {
            return std::ranges::all_of(std::array{0, 1, 2}, [&](int k) {
                const auto i = static_cast<size_t>(k);
                return sign * p.corner[i][axis] > 0 && sign * (p.corner[i] + p.displacement[i])[axis] > 0;
            });
        };
        if (apart(1) || apart(-1)) return false;
    }
    return first_passing(p, side < 0, 1 + 1e-12).side == side;
}

// Body whose surface went over the tool in the pass; kNone: none.
uint32_t passed_body(const Surfaces& s, const LocalContactModel& model, const HandTool& tool, const ToolState& state,
                     std::span<const CoreBall> core, PassedSurfacesScratch& scratch) {
    const Quat& turn = s.poses.orientation[tool.body];
    const Vec3d tip = s.poses.origin[tool.body] + rotate(turn, tool.tip);
    const bool leaves = state.exit.body != kNone || state.pushed != Vec3d::Zero();
    place_vertices(s, model, std::ranges::any_of(core, [](const CoreBall& ball) { return contact_error(ball) > 0; }), scratch);
    for (const CoreBall& ball : core) {
        const BallMotion motion{model.tip + rotate(model.turn, ball.arm), tip + rotate(turn, ball.arm), contact_error(ball)};
        for (size_t t = 0; t < model.triangle.size(); ++t) {
            const uint32_t body = model.body[t];
            if (!is_deformable(s.bodies, body) || body == state.pierce.body || leaves) continue;
            // a small ball may be behind a closed surface by contact's error, and come back
            const bool both_sides = model.half_thickness[t] > 0 || motion.beyond == 0;
            if (passes(model, t, motion, 1, scratch) || (both_sides && passes(model, t, motion, -1, scratch))) return body;
        }
    }
    return kNone;
}

}  // namespace

void find_core(const HandTool& tool, std::vector<CoreBall>& core) {
    core.clear();
    const std::span<const ShellPoint> points = tool.point_shell;
    if (points.empty()) {
        core.push_back({Vec3d::Zero(), tool.tip_radius});
        return;
    }
    double largest = 0;
    for (size_t k = 0; k < kCoreBalls; ++k) {
        const ShellPoint& point = points[points.size() * k / kCoreBalls];
        const double radius = point.jaw == kNone ? inner_radius(points, point) : 0;
        if (!(radius > 0 && std::isfinite(radius))) continue;
        largest = std::max(largest, radius);
        core.push_back({point.arm + radius * point.inward, radius});
    }
    std::erase_if(core, [&](const CoreBall& ball) { return ball.radius < 0.5 * largest; });
}

void find_passed_surfaces(double begin, const Surfaces& s, std::span<const LocalContactModel> models, const Haptics& haptics,
                          PassedSurfacesScratch& scratch, PassedSurfaces& passed, Report& report) {
    const size_t tools = haptics.tool.size();
    passed.body.resize(tools, kNone), passed.times.resize(tools);
    scratch.core.resize(tools), scratch.core_of.resize(tools);
    for (size_t t = 0; t < tools && t < models.size(); ++t) {
        const HandTool& tool = haptics.tool[t];
        const LocalContactModel& model = models[t];
        if (!model.in_hand || !model.placed || model.time != begin || model.triangle.empty()) continue;
        if (scratch.core[t].empty() || scratch.core_of[t] != tool.point_shell.data()) find_core(tool, scratch.core[t]);
        scratch.core_of[t] = tool.point_shell.data();
        const uint32_t body = passed_body(s, model, tool, haptics.state[t], scratch.core[t], scratch);
        if (body == kNone) continue;
        passed.body[t] = body;
        ++passed.times[t];
        ++report.passed_surfaces;
    }
}

}  // namespace trocar
