#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/body_jolt.hpp"
#include "components/contacts.hpp"
#include "components/nodes.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

struct IdleRowsScratch {
    std::vector<uint8_t> dropped;  // per row
    std::vector<double> way;       // m, per rigid body
};

// The coming period, and what may happen to bodies in it.
struct ComingPeriod {
    double seconds;
    Vec3d gravity;  // m/s^2
    const Surfaces& surfaces;
    std::span<const BodyJolt> jolt;                     // per body; may be empty
    std::span<const uint8_t> pressed;                   // per row, 1: stays; may be empty
    std::span<const std::array<uint32_t, 2>> joined{};  // bodies that hold each other
    std::span<const NodeDrive> drive{};                 // bodies that springs of their own move
};

// Drops rows that cannot act in the coming period T (s). With v the velocity of the point beside the plane's (m/s) and n the normal
// a row of bodies that deform, or of one and a static one, stays when
//   distance <= max(0, -v.n) T + 0.25 |v| T          as they move, and as that may turn
//               + 0.5 g T^2                          the fall of one of them alone
//               + jolt(body, -n) + jolt(other, n)    what others may do to both
//               + sum over both of 0.05 mean edge (of what deforms) + half the thickness
// and one of two rigid bodies when
//   distance <= way(body) + way(other) + g T^2       half of it for what hangs over an edge and turns
// The way of a free body is the largest of twice what it moves and turns, or overlaps others, and of what is left of a
// neighbour's way beyond the gap to it: what is hit goes no farther than what hit it, but its ends may go twice as fast. Rows
// of bodies that scripts, hands, links, drives or tissue move stay, and so do those that are pressed. Order is kept.
void drop_idle_rows(const ComingPeriod& coming, IdleRowsScratch& scratch, ContactRows& rows);

}  // namespace trocar
