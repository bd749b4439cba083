#include "systems/prepare/spawning.hpp"

#include "engine/geometry/quaternion.hpp"
#include "engine/tissue/embedded_surface.hpp"
namespace trocar {
namespace {

// An empty slot has the rest shape of its prototype, rotated to the spawn orientation.
void rest_at_place(const Meshes& meshes, const Solids& solids, const Bodies& bodies, uint32_t body, const Quat& turn, Particles& p) {
    const uint32_t mesh = bodies.mesh[body];
    const Range range = bodies.particles[body], surface = meshes.info[mesh].vertices;
    const auto put = [&](uint32_t index, const Vec3d& rest) {
        const Vec3d placed = rotate(turn, rest);
        Float4& o = p.offset[index];
        o = {static_cast<float>(placed.x()), static_cast<float>(placed.y()), static_cast<float>(placed.z()), o.w};
    };
    for (uint32_t v = 0; v < surface.count; ++v) put(range.first + v, meshes.position[surface.first + v]);
    if (has_own_nodes(solids, mesh)) {
        const Range inner = solids.info[mesh].inner;
        const uint32_t before = embedded_count(solids, mesh) > 0 ? embedded_count(solids, mesh) : surface.count;
        for (uint32_t i = 0; i < inner.count; ++i) put(range.first + before + i, solids.position[inner.first + i]);
    }
    for (uint32_t index = range.first; index < range.end(); ++index) p.velocity_x[index] = p.velocity_y[index] = p.velocity_z[index] = 0;
    p.last_dt[body] = 0;
}

uint32_t free_slot(const SpawnState& spawning, Range slots, uint32_t from) {
    for (uint32_t slot = from; slot < slots.end(); ++slot)
        if (spawning.away[slot]) return slot;
    return kNone;
}

// Bodies whose lifetime has ended at `tick` (ms), ascending.
void find_leaving(const Pools& pools, const SpawnState& spawning, uint64_t tick, std::vector<uint32_t>& leaving) {
    leaving.clear();
    for (size_t pool = 0; pool < pools.slots.size(); ++pool) {
        const double life = pools.life[pool] * 1e3;
        for (uint32_t slot = pools.slots[pool].first; slot < pools.slots[pool].end(); ++slot)
            if (!spawning.away[slot] && static_cast<double>(tick - spawning.since[slot]) >= life) leaving.push_back(slot);
    }
}

void spawn_bodies(const Pools& pools, uint64_t tick, SpawnState& spawning, Sleep& sleep) {
    sleep.still.resize(spawning.away.size(), 0);
    sleep.group.resize(spawning.away.size(), kNone);
    for (size_t pool = 0; pool < pools.slots.size(); ++pool) {
        uint32_t slot = pools.slots[pool].first;
        while (static_cast<double>(spawning.came[pool]) * 1e3 <= static_cast<double>(tick) * pools.rate[pool]) {  // exact for whole rates
            slot = free_slot(spawning, pools.slots[pool], slot);
            if (slot == kNone) break;
            spawning.away[slot] = 0;
            spawning.since[slot] = tick;
            sleep.still[slot] = 0;
            sleep.group[slot] = kNone;
            ++spawning.came[pool];
        }
    }
}

void send_away(const Meshes& meshes, const Solids& solids, const Bodies& bodies, const Pools& pools, const std::vector<uint32_t>& leaving,
               SpawnState& spawning, Poses& poses, Particles& particles, Sleep& sleep) {
    for (const uint32_t body : leaving) {
        spawning.away[body] = 1;
        ++spawning.generation[body];
        poses.orientation[body] = pools.orientation[body];
        rest_at_place(meshes, solids, bodies, body, pools.orientation[body], particles);
        sleep.still[body] = kAsleepForLong;
        sleep.group[body] = body;
    }
}

}  // namespace

void spawning(const ComeAndGoInputs& in, ComeAndGoScratch& scratch, ComeAndGoState state) {
    auto& [spawning, poses, particles, sleep, energy] = state;
    const EnergyInputs inputs{in.springs, in.bodies, state.poses, state.particles, in.anchors, in.gravity, {&in.solids}};
    const auto energies = [&] {
        Energy sum;
        for (const uint32_t body : scratch.leaving) add_body_energy(inputs, body, scratch.energy, sum);
        return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity;
    };
    find_leaving(in.pools, spawning, in.tick, scratch.leaving);
    spawn_bodies(in.pools, in.tick, spawning, sleep);
    const double before = energies();
    send_away(in.meshes, in.solids, in.bodies, in.pools, scratch.leaving, spawning, poses, particles, sleep);
    if (in.account_energy) energy.work_numeric += energies() - before;
}

}  // namespace trocar
