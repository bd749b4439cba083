#pragma once
#include <cstdint>
#include <vector>

#include "components/bodies.hpp"
#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Spawning from object pools: bodies enter and leave a running scene in slots made at load, so no array
// element moves. All slots of a pool are deformable bodies. Constant.
struct Pools {
    std::vector<Range> slots;       // per pool: bodies
    std::vector<double> rate;       // per pool, 1/s: body k is spawned at k / rate, or as soon as a slot is free
    std::vector<double> life;       // per pool, s, lifetime
    std::vector<Quat> orientation;  // per body: orientation when spawned at its rest position; empty without pools
    TROCAR_FIELDS(slots, "range of bodies", rate, "1/s", life, "s", orientation);
};

// Occupancy of the slots, one element per body; all empty if the scene has no pools.
struct SpawnState {
    std::vector<uint8_t> away;         // 1 = the slot is empty: sleeping at its rest position, without a box, not drawn
    std::vector<uint32_t> generation;  // bodies that have left the slot
    std::vector<uint64_t> since;       // ms, when the present body was spawned
    std::vector<uint64_t> came;        // per pool: bodies spawned so far
    TROCAR_FIELDS(away, generation, since, "ms", came);
};

// Value of Sleep::still for an empty slot, ms: exceeds any setting.
inline constexpr uint32_t kAsleepForLong = uint32_t{1} << 30;

inline bool is_away(const SpawnState& spawning, uint32_t body) { return body < spawning.away.size() && spawning.away[body] != 0; }

// Name of the body now in a slot, and whether a body of that name is still present.
inline Entity entity_of(const SpawnState& spawning, uint32_t body) {
    return {body, body < spawning.generation.size() ? spawning.generation[body] : 0};
}
inline bool is_there(const Bodies& bodies, const SpawnState& spawning, Entity entity) {
    return entity.index < bodies.mesh.size() && !is_away(spawning, entity.index) && entity_of(spawning, entity.index) == entity;
}

}  // namespace trocar
