#include "systems/fluid/smoke.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar {
namespace {

// m, standard deviation of a puff as it leaves: chosen, about the radius of the jaws of an instrument of 5 mm.
constexpr double kFirstSpread = 3e-3;
// kg: an extinction of 1e-10 m^2, which nothing can see.
constexpr double kLeastMass = 2e-14;

// Whether the tissue near a point of a heated body has coagulated.
bool is_burnt(const FluidPass& pass, const HeatBody& heat, const Vec3d& at, double reach) {
    const Surfaces& s = pass.surfaces;
    const uint32_t prototype = s.bodies.mesh[heat.body];
    const uint32_t skin = prototype < pass.solids.info.size() ? (pass.solids.info[prototype].skin.count + 15) / 16 * 16 : 0;
    const Float4* offset = s.particles.offset.data() + s.bodies.particles[heat.body].first + skin;
    const Vec3d local = at - s.poses.origin[heat.body];
    for (uint32_t v = 0; v < heat.nodes.count; ++v)
        if (pass.action_state.heat.damage[heat.nodes.first + v] >= 1 &&
            (Vec3d(offset[v].x, offset[v].y, offset[v].z) - local).squaredNorm() <= reach * reach)
            return true;
    return false;
}

// A puff leaves; without room it joins the newest one: mass, centre and variance of both together.
void add_puff(const Vec3d& at, double mass, uint32_t most, Puffs& puffs) {
    if (puffs.mass.size() < most) {
        puffs.position.push_back(at), puffs.mass.push_back(mass), puffs.age.push_back(0);
        puffs.variance.push_back(kFirstSpread * kFirstSpread);
        return;
    }
    Vec3d& centre = puffs.position.back();
    const double all = puffs.mass.back() + mass, part = mass / all;
    const double apart = part * (1 - part) * (at - centre).squaredNorm() / 3;
    puffs.variance.back() = (1 - part) * puffs.variance.back() + part * kFirstSpread * kFirstSpread + apart;
    centre += part * (at - centre);
    puffs.age.back() *= 1 - part;
    puffs.mass.back() = all;
}

void emit(const FluidPass& pass, FluidState& state) {
    for (const auto& [index, body] : pass.actions.heats) {
        const ToolAction& action = pass.actions.action[index];
        const double joules = pass.action_state.progress[index].heat - state.heat[index];
        if (!(joules > 0)) continue;
        const Vec3d at = frame_to_world(pass.surfaces, pass.tools[action.tool].body, action.point);
        if (!is_burnt(pass, pass.actions.heat_body[body], at, action.reach + 2 * action.spot)) continue;
        const double mass = pass.fluids.params.smoke_yield * joules;
        state.heat[index] += joules;  // an action that heats several bodies emits once
        state.smoke.emitted += mass;
        add_puff(at, mass, pass.fluids.most_puffs, state.puffs);
    }
    for (size_t i = 0; i < state.heat.size(); ++i) state.heat[i] = pass.action_state.progress[i].heat;
}

void suck_smoke(const Vec3d& nozzle, double gas, FluidState& state) {
    Puffs& puffs = state.puffs;
    for (size_t i = 0; i < puffs.mass.size(); ++i) {
        const Vec3d apart = puffs.position[i] - nozzle;
        const double distance = apart.norm();
        const double taken = -puffs.mass[i] * std::expm1(-gas * puff_density(puffs.variance[i], distance * distance));
        puffs.mass[i] -= taken, state.smoke.sucked += taken;
        const double nearer = std::cbrt(std::max(0.0, distance * distance * distance - 3 * gas / (4 * std::numbers::pi)));
        if (distance > 0) puffs.position[i] = nozzle + nearer / distance * apart;
    }
}

void drift(const FluidPass& pass, FluidState& state) {
    const FluidParams& p = pass.fluids.params;
    const Vec3d up = p.gravity.norm() > 0 ? Vec3d(-p.gravity.normalized()) : Vec3d(Vec3d::UnitZ());
    Puffs& puffs = state.puffs;
    const double fades = -std::expm1(-p.smoke_clearing * pass.seconds), cools = -std::expm1(-pass.seconds / p.smoke_cooling);
    for (size_t i = 0; i < puffs.mass.size(); ++i) {
        // the integral of the rise over the pass
        puffs.position[i] += p.smoke_rise * p.smoke_cooling * std::exp(-puffs.age[i] / p.smoke_cooling) * cools * up;
        puffs.age[i] += pass.seconds;
        puffs.variance[i] += 2 * p.smoke_diffusion * pass.seconds;
        const double gone = fades * puffs.mass[i];
        puffs.mass[i] -= gone, state.smoke.cleared += gone;
    }
}

void drop_thin(const Box& inside, FluidState& state) {
    Puffs& puffs = state.puffs;
    size_t kept = 0;
    for (size_t i = 0; i < puffs.mass.size(); ++i) {
        const Vec3d& at = puffs.position[i];
        if (puffs.mass[i] < kLeastMass || (at.array() < inside.min.array()).any() || (at.array() > inside.max.array()).any()) {
            state.smoke.cleared += puffs.mass[i];
            continue;
        }
        puffs.position[kept] = puffs.position[i], puffs.variance[kept] = puffs.variance[i];
        puffs.mass[kept] = puffs.mass[i], puffs.age[kept] = puffs.age[i];
        ++kept;
    }
    puffs.position.resize(kept), puffs.variance.resize(kept), puffs.mass.resize(kept), puffs.age.resize(kept);
}

}  // namespace

double puff_density(double variance, double squared_distance) {
    return std::exp(-squared_distance / (2 * variance)) / std::pow(2 * std::numbers::pi * variance, 1.5);
}

void move_smoke(const FluidPass& pass, std::span<const double> gas, FluidState& state) {
    drift(pass, state);
    emit(pass, state);
    for (size_t i = 0; i < gas.size(); ++i)
        if (gas[i] > 0)
            suck_smoke(frame_to_world(pass.surfaces, pass.tools[pass.actions.action[i].tool].body, pass.actions.action[i].point), gas[i],
                       state);
    drop_thin(pass.fluids.params.inside, state);
}

}  // namespace trocar
