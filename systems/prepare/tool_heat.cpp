#include "systems/prepare/tool_heat.hpp"

#include <algorithm>
#include <cmath>

#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/heat.hpp"
#include "systems/prepare/tear_bodies.hpp"
namespace trocar {
namespace {

// Adds the power of an action to the nodes of a body around a point.
void add_cautery_power(const ActionPass& pass, const ToolAction& action, const HeatBody& body, const Vec3d& point,
                       const HeatState& state, std::vector<double>& power) {
    const Surfaces& s = pass.world.surfaces;
    const uint32_t first = s.bodies.particles[body.body].first + embedded_count(pass.world.solids, s.bodies.mesh[body.body]);
    const Vec3d local = point - s.poses.origin[body.body];
    const auto distance2 = [&](uint32_t v) {
        const Float4& o = s.particles.offset[first + v];
        return (Vec3d(o.x, o.y, o.z) - local).squaredNorm();
    };
    const auto takes_heat = [&](uint32_t v) {
        return pass.actions.heat_volume[body.nodes.first + v] > 0 && !(body.parts && has_boiled_away(body, pass.actions, state, v));
    };
    double nearest = std::numeric_limits<double>::infinity(), sum = 0;
    for (uint32_t v = 0; v < body.nodes.count; ++v)
        if (takes_heat(v)) nearest = std::min(nearest, distance2(v));
    const auto share = [&](uint32_t v) {
        if (!takes_heat(v)) return 0.0;
        return pass.actions.heat_volume[body.nodes.first + v] * std::exp((nearest - distance2(v)) / (2 * action.spot * action.spot));
    };
    for (uint32_t v = 0; v < body.nodes.count; ++v) sum += share(v);
    for (uint32_t v = 0; sum > 0 && v < body.nodes.count; ++v) power[v] += action.power / sum * share(v);
}

double energy_of_heated(const ActionPass& pass, uint32_t body, ActionState& state, HeatWorld& w) {
    Energy energy;
    BodyEnergyScratch scratch;
    OtherForces other{&w.solids};
    if (!w.tears.body.empty()) other.tears = &w.tears, other.torn = &w.torn, other.torn_springs = &w.torn_springs;
    other.actions = &pass.actions, other.action_state = &state;
    const Surfaces& s = pass.world.surfaces;
    add_body_energy({w.springs, s.bodies, s.poses, s.particles, w.anchors, w.gravity, other}, body, scratch, energy);
    return energy.elastic;
}

void stiffen_body(const ActionPass& pass, const HeatBody& body, ActionState& state, HeatWorld& w) {
    const Bodies& bodies = pass.world.surfaces.bodies;
    if (!stiffen(body, bodies, pass.actions, state.heat, true, w.springs, w.solids)) return;
    const auto copy_torn = [&] {
        w.torn_springs.neighbour.clear();  // copies of the factors: made anew
        copy_torn_springs(w.springs, w.solids, bodies, w.tears, w.torn, w.torn_springs);
    };
    const bool tears = std::ranges::any_of(w.tears.body, [&](const TearBody& t) { return t.body == body.body; });
    if (tears) copy_torn();
    const double before = energy_of_heated(pass, body.body, state, w);
    stiffen(body, bodies, pass.actions, state.heat, false, w.springs, w.solids);
    if (tears) copy_torn();
    w.energy.work_links += energy_of_heated(pass, body.body, state, w) - before;
    wake_body(w.sleep, body.body);
}

bool cautery_touches(const ActionPass& pass, uint32_t index, uint32_t body, const ActionState& state, Vec3d& point) {
    const ToolAction& action = pass.actions.action[index];
    if (!state.progress[index].on) return false;
    point = frame_to_world(pass.world.surfaces, pass.tools[action.tool].body, action.point);
    return nearest_surface(pass.world, body, point, action.reach).body != kNone;
}

}  // namespace

void heat_with_tools(const ActionPass& pass, ActionState& state, HeatWorld world) {
    state.burnt.clear();
    std::vector<double> power, flow, before;
    for (uint32_t index = 0; index < pass.actions.heat_body.size(); ++index) {
        const HeatBody& body = pass.actions.heat_body[index];
        power.assign(body.nodes.count, 0.0);
        uint32_t by = kNone;  // the action that what coagulates is counted with: the last that heated the body
        for (const auto& [action, heated] : pass.actions.heats) {
            if (heated != index) continue;
            Vec3d point;
            ActionProgress& progress = state.progress[action];
            if (by == kNone) by = action;
            if (!cautery_touches(pass, action, body.body, state, point)) {
                if (!progress.on) progress.stroke = false;
                continue;
            }
            by = action;
            if (!progress.stroke) progress.stroke = true, ++progress.done;
            add_cautery_power(pass, pass.actions.action[action], body, point, state.heat, power);
            progress.heat += pass.actions.action[action].power * pass.period;
        }
        const auto damage = state.heat.damage.begin() + body.nodes.first;
        before.assign(damage, damage + body.nodes.count);
        step_heat(pass.actions, body, pass.period, power, state.heat, flow);
        for (uint32_t v = 0; v < body.nodes.count; ++v) {
            if (before[v] >= 1 || state.heat.damage[body.nodes.first + v] < 1) continue;
            state.progress[by].burnt += pass.actions.heat_area[body.nodes.first + v];
            state.burnt.push_back({body.body, v, by});
        }
        stiffen_body(pass, body, state, world);
    }
}

}  // namespace trocar
