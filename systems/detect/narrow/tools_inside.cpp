#include "systems/detect/narrow/tools_inside.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "engine/contact/tool_parts.hpp"
#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

constexpr double kDeepAtStart = 1e-4, kDeep = 2e-3;  // m, contacts resolve shallower overlaps
constexpr double kClear = 2e-4;                      // m, from the surface, where a tool counts as outside
constexpr double kLeastStep = 1e-4;                  // m, of sphere tracing
constexpr uint32_t kMostSteps = 400;
constexpr size_t kMostPoints = 48;

// A point of one side of an overlap that moves along sign * direction, and how far from the other body it ends.
struct InsidePoint {
    Vec3d position;  // m, world
    uint32_t other = kNone;
    double sign = 1, clear = kClear;
};

// How far a tool goes along `direction` until a point is outside (m); more than `most` if it is farther.
double distance_out(const ContactInputs& in, const InsidePoint& point, const Vec3d& direction, double most) {
    const ClosestPointTree& tree = *in.trees[in.surfaces.bodies.tree[point.other]];
    double gone = 0;
    for (uint32_t step = 0; step < kMostSteps && gone <= most; ++step) {
        const SurfacePoint at = tree.query(world_to_frame(in.surfaces, point.other, point.position + point.sign * gone * direction));
        if (at.distance >= point.clear) return gone;
        gone += std::max(point.clear - at.distance, kLeastStep);
    }
    return std::numeric_limits<double>::infinity();
}

double distance_out(const ContactInputs& in, std::span<const InsidePoint> points, const Vec3d& direction, double most) {
    double farthest = 0;
    for (const InsidePoint& point : points)
        if (farthest <= most) farthest = std::max(farthest, distance_out(in, point, direction, most));
    return farthest;
}

// Points of the contacts of a tool that are inside, every n-th of many, the deepest first; and its tip's sphere.
std::vector<InsidePoint> inside_points(const ContactInputs& in, const Contacts& contacts, const Haptics& haptics, const HandTool& tool,
                                       uint32_t& deepest) {
    std::vector<uint32_t> inside;
    deepest = kNone;
    for (uint32_t i = 0; i < contacts.body.size(); ++i) {
        if (!(contacts.distance[i] < 0) || !has_inside(in.surfaces, contacts.other[i])) continue;
        if (is_part_of_tool(haptics, tool, contacts.body[i]) == is_part_of_tool(haptics, tool, contacts.other[i])) continue;
        inside.push_back(i);
        if (deepest == kNone || contacts.distance[i] < contacts.distance[deepest]) deepest = i;
    }
    std::vector<InsidePoint> points;
    const auto add = [&](uint32_t i) {
        points.push_back({contacts.point[i], contacts.other[i], is_part_of_tool(haptics, tool, contacts.body[i]) ? 1.0 : -1.0});
    };
    if (deepest == kNone) return points;
    add(deepest);
    for (size_t k = 0, step = inside.size() / kMostPoints + 1; k < inside.size(); k += step) add(inside[k]);
    if (tool.point_shell.empty() && points[0].sign > 0)
        points.push_back({in.surfaces.poses.origin[tool.body] + rotate(in.surfaces.poses.orientation[tool.body], tool.tip), points[0].other,
                          1, tool.tip_radius + kClear});
    return points;
}

// Shortest separating translation; the contact's own normal if no direction leads out.
ToolExit shortest_exit(const ContactInputs& in, std::span<const InsidePoint> points, const Vec3d& normal, double depth,
                       const ToolExit& before) {
    double best = std::numeric_limits<double>::infinity();
    ToolExit exit{kNone, normal, {}};
    const auto try_direction = [&](const Vec3d& direction) {
        const double out = distance_out(in, points, direction, best);
        if (out < best) best = out, exit.direction = direction;
    };
    if (before.body != kNone) try_direction(before.direction);  // a tool that is leaving does not turn
    if (std::isinf(best)) {
        try_direction(normal);
        for (int code = 0; code < 27; ++code)
            if (code != 13) try_direction(Vec3d(code % 3 - 1, code / 3 % 3 - 1, code / 9 - 1).normalized());
    }
    exit.goal = (std::isinf(best) ? depth + kClear : best) * exit.direction;
    return exit;
}

}  // namespace

void find_tools_inside(const ContactInputs& in, const Contacts& contacts, Haptics& haptics, Report& report) {
    for (size_t t = 0; t < haptics.tool.size(); ++t) {
        const HandTool& tool = haptics.tool[t];
        ToolState& state = haptics.state[t];
        const ToolExit before = state.exit;
        state.exit = {};
        if (state.proxy_valid) continue;
        uint32_t deepest = kNone;
        const std::vector<InsidePoint> points = inside_points(in, contacts, haptics, tool, deepest);
        if (deepest == kNone) continue;
        const double depth = -contacts.distance[deepest];
        if (before.body == kNone && !(depth > (state.ticks == 0 ? kDeepAtStart : kDeep))) continue;
        report.tools_inside += before.body == kNone;
        const Vec3d normal = points[0].sign * contacts.normal[deepest];
        state.exit = shortest_exit(in, points, normal, depth, before);
        state.exit.body = points[0].sign > 0 ? contacts.other[deepest] : contacts.body[deepest];
        state.exit.goal += state.pushed;
    }
}

}  // namespace trocar
