#include "systems/level_of_detail.hpp"

#include <algorithm>

#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

// Row of the rules that a body has, or kNone.
uint32_t rule_of(const DetailRules& rules, uint32_t body) {
    const auto found = std::lower_bound(rules.body.begin(), rules.body.end(), body);
    return found != rules.body.end() && *found == body ? static_cast<uint32_t>(found - rules.body.begin()) : kNone;
}

bool is_far(const DetailRules& rules, uint32_t rule, const Box& box, const Poses& poses, std::span<const HandTool> tools) {
    // a place that is no number counts as near
    const auto beyond = [&](const Vec3d& place) { return (place - place.cwiseMax(box.min).cwiseMin(box.max)).norm() > rules.beyond[rule]; };
    if (rules.seen[rule] && !beyond(rules.eye.front())) return false;
    return std::all_of(tools.begin(), tools.end(), [&](const HandTool& tool) {
        return beyond(poses.origin[tool.body] + rotate(poses.orientation[tool.body], tool.tip));
    });
}

}  // namespace

void choose_detail(const DetailRules& rules, const Islands& islands, const BodyBoxes& boxes, const Poses& poses,
                   std::span<const HandTool> tools, std::span<Stepping> stepping) {
    for (const Range range : islands.bodies) {
        const std::span bodies = std::span(islands.body).subspan(range.first, range.count);
        const bool far = std::all_of(bodies.begin(), bodies.end(), [&](uint32_t body) {
            const uint32_t rule = rule_of(rules, body);
            return rule != kNone && is_far(rules, rule, boxes.box[body], poses, tools);
        });
        for (const uint32_t body : bodies) {
            if (const uint32_t rule = rule_of(rules, body); rule != kNone) stepping[body] = far ? rules.far[rule] : rules.near[rule];
        }
    }
}

}  // namespace trocar
