#pragma once
#include <cstdint>
#include <vector>

#include "components/bodies.hpp"
#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Bodies that come and go while a scene runs, in slots made at load: coming and going move no row of any array. All
// slots of a pool are deformable bodies. Constant.
struct Pools {
    std::vector<Range> slots;       // per pool: bodies
    std::vector<double> rate;       // per pool, 1/s: body k comes at k / rate, or as soon as a slot is free
    std::vector<double> life;       // per pool, s, from coming to going
    std::vector<Quat> orientation;  // per body: in which it comes, at its place; empty without pools
    TROCAR_FIELDS(slots, "rows of bodies", rate, "1/s", life, "s", orientation);
};

// Who is there. One row per body, or all empty where everybody always is.
struct Lives {
    std::vector<uint8_t> away;         // 1 = the slot is empty: asleep at its place at rest, without a box, not drawn
    std::vector<uint32_t> generation;  // bodies that have left the slot
    std::vector<uint64_t> since;       // ms, when the present one came
    std::vector<uint64_t> came;        // per pool: bodies so far
    TROCAR_FIELDS(away, generation, since, "ms", came);
};

// What Sleep::still says of an empty slot, ms: enough for any settings.
inline constexpr uint32_t kAsleepForLong = uint32_t{1} << 30;

inline bool is_away(const Lives& lives, uint32_t body) { return body < lives.away.size() && lives.away[body] != 0; }

// The name of whoever is in a slot now, and whether somebody so named is still there.
inline Entity entity_of(const Lives& lives, uint32_t body) { return {body, body < lives.generation.size() ? lives.generation[body] : 0}; }
inline bool is_there(const Bodies& bodies, const Lives& lives, Entity entity) {
    return entity.index < bodies.mesh.size() && !is_away(lives, entity.index) && entity_of(lives, entity.index) == entity;
}

}  // namespace trocar
