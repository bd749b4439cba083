#include "systems/come_and_go.hpp"

#include "engine/geometry/quaternion.hpp"
#include "engine/skin.hpp"
namespace trocar {
namespace {

// The shape in which a slot waits: that of its prototype, turned.
void rest_at_place(const Meshes& meshes, const Solids& solids, const Bodies& bodies, uint32_t body, const Quat& turn, Particles& p) {
    const uint32_t mesh = bodies.mesh[body];
    const Range rows = bodies.particles[body], surface = meshes.info[mesh].vertices;
    const auto put = [&](uint32_t row, const Vec3d& rest) {
        const Vec3d placed = rotate(turn, rest);
        Float4& o = p.offset[row];
        o = {static_cast<float>(placed.x()), static_cast<float>(placed.y()), static_cast<float>(placed.z()), o.w};
    };
    for (uint32_t v = 0; v < surface.count; ++v) put(rows.first + v, meshes.position[surface.first + v]);
    if (has_own_nodes(solids, mesh)) {
        const Range inner = solids.info[mesh].inner;
        const uint32_t before = skin_rows(solids, mesh) > 0 ? skin_rows(solids, mesh) : surface.count;
        for (uint32_t i = 0; i < inner.count; ++i) put(rows.first + before + i, solids.position[inner.first + i]);
    }
    for (uint32_t row = rows.first; row < rows.end(); ++row) p.velocity_x[row] = p.velocity_y[row] = p.velocity_z[row] = 0;
    p.last_dt[body] = 0;
}

uint32_t free_slot(const Lives& lives, Range slots, uint32_t from) {
    for (uint32_t slot = from; slot < slots.end(); ++slot)
        if (lives.away[slot]) return slot;
    return kNone;
}

// Bodies whose life is over at `tick` (ms), ascending.
void find_leaving(const Pools& pools, const Lives& lives, uint64_t tick, std::vector<uint32_t>& leaving) {
    leaving.clear();
    for (size_t pool = 0; pool < pools.slots.size(); ++pool) {
        const double life = pools.life[pool] * 1e3;
        for (uint32_t slot = pools.slots[pool].first; slot < pools.slots[pool].end(); ++slot)
            if (!lives.away[slot] && static_cast<double>(tick - lives.since[slot]) >= life) leaving.push_back(slot);
    }
}

void let_come(const Pools& pools, uint64_t tick, Lives& lives, Sleep& sleep) {
    sleep.still.resize(lives.away.size(), 0);
    sleep.group.resize(lives.away.size(), kNone);
    for (size_t pool = 0; pool < pools.slots.size(); ++pool) {
        uint32_t slot = pools.slots[pool].first;
        while (static_cast<double>(lives.came[pool]) * 1e3 <= static_cast<double>(tick) * pools.rate[pool]) {  // exact for whole rates
            slot = free_slot(lives, pools.slots[pool], slot);
            if (slot == kNone) break;
            lives.away[slot] = 0;
            lives.since[slot] = tick;
            sleep.still[slot] = 0;
            sleep.group[slot] = kNone;
            ++lives.came[pool];
        }
    }
}

void send_away(const Meshes& meshes, const Solids& solids, const Bodies& bodies, const Pools& pools, const std::vector<uint32_t>& leaving,
               Lives& lives, Poses& poses, Particles& particles, Sleep& sleep) {
    for (const uint32_t body : leaving) {
        lives.away[body] = 1;
        ++lives.generation[body];
        poses.orientation[body] = pools.orientation[body];
        rest_at_place(meshes, solids, bodies, body, pools.orientation[body], particles);
        sleep.still[body] = kAsleepForLong;
        sleep.group[body] = body;
    }
}

}  // namespace

void come_and_go(const ComeAndGoInputs& in, ComeAndGoScratch& scratch, ComeAndGoState state) {
    auto& [lives, poses, particles, sleep, energy] = state;
    const EnergyInputs inputs{in.springs, in.bodies, state.poses, state.particles, in.anchors, in.gravity, {&in.solids}};
    const auto energies = [&] {
        Energy sum;
        for (const uint32_t body : scratch.leaving) add_body_energy(inputs, body, scratch.energy, sum);
        return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity;
    };
    find_leaving(in.pools, lives, in.tick, scratch.leaving);
    let_come(in.pools, in.tick, lives, sleep);
    const double before = energies();
    send_away(in.meshes, in.solids, in.bodies, in.pools, scratch.leaving, lives, poses, particles, sleep);
    if (in.account_energy) energy.work_numeric += energies() - before;
}

}  // namespace trocar
