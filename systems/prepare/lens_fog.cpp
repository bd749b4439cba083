#include "systems/prepare/lens_fog.hpp"

#include <algorithm>
#include <cmath>

#include "systems/prepare/tool_actions.hpp"
namespace trocar {
namespace {

constexpr double kWater = 1000;        // kg/m^3
constexpr double kVapourGas = 461.52;  // J/(kg K)

bool touches_tissue(const LinkWorld& world, const SpawnState& spawning, const NodeState& node_state, const Lens& lens) {
    const Bodies& bodies = world.surfaces.bodies;
    const Vec3d point = frame_to_world(world.surfaces, lens.body, lens.point);
    for (uint32_t body = 0; body < bodies.mesh.size(); ++body) {
        if (bodies.mesh[body] == kNone || !is_deformable(bodies, body)) continue;
        if (body < spawning.away.size() && is_away(spawning, body)) continue;
        if (body < node_state.off.size() && is_off(node_state, body)) continue;
        if (nearest_surface(world, body, point, lens.wipe).body != kNone) return true;
    }
    return false;
}

}  // namespace

double saturated_vapour(double celsius) {
    return 610.94 * std::exp(17.625 * celsius / (celsius + 243.04)) / (kVapourGas * (celsius + 273.15));
}

double fog_of(const Lens& lens) { return lens.film > 0 ? 1 - std::exp2(-lens.film / lens.half_clear) : 0.0; }

void fog_lenses(double period, const LinkWorld& world, const SpawnState& spawning, const NodeState& node_state, std::span<Lens> lenses) {
    for (Lens& lens : lenses) {
        // the vapour of the mean temperature of the pass: second order in its length
        const double before = lens.temperature;
        lens.temperature = lens.cavity + (before - lens.cavity) * std::exp(-period / lens.time_constant);
        const double excess = lens.humidity * saturated_vapour(lens.cavity) - saturated_vapour(0.5 * (before + lens.temperature));
        lens.film = std::max(0.0, lens.film + period * lens.transfer * excess / kWater);
        const bool touched = lens.touching;
        lens.touching = lens.wipe > 0 && touches_tissue(world, spawning, node_state, lens);
        if (!lens.touching) continue;
        lens.film = 0;
        lens.wipes += !touched;
    }
}

}  // namespace trocar
