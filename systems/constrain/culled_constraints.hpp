#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/contacts.hpp"
#include "components/external_displacement.hpp"
#include "components/nodes.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

struct CulledConstraintsScratch {
    std::vector<uint8_t> dropped;   // per constraint
    std::vector<double> travel;     // m, per rigid body
    std::vector<double> vibration;  // m/s, per body of a constraint
};

// The coming period, and everything that may move bodies in it.
struct ComingPeriod {
    double seconds;
    Vec3d gravity;  // m/s^2
    const Surfaces& surfaces;
    std::span<const ExternalDisplacement> external;     // per body; may be empty
    std::span<const uint8_t> pressed;                   // per constraint, 1: stays; may be empty
    std::span<const std::array<uint32_t, 2>> joined{};  // linked bodies
    std::span<const NodeDrive> drive{};                 // bodies with driven nodes
};

// Drops contact constraints that cannot act in the coming period T (s). With v the point's velocity relative
// to the plane (m/s) and n the normal, one of deformable bodies, or of one and a static one, stays if
//   distance <= max(0, -v.n) T + 0.25 |v| T          approach, and its possible rotation
//               + 0.5 g T^2                          fall of one of them alone
//               + external(body, -n) + external(other, n)   external displacement bounds
//               + sum over both of 0.05 mean edge and vibration (deformable) + half the thickness
// and one of two rigid bodies if
//   distance <= travel(body) + travel(other) + g T^2   half of it for overhanging bodies that rotate
// travel, a free body's displacement bound, is the largest of twice its displacement with rotation, twice its
// overlap, and a neighbour's bound less the separation: it moves no farther than the body that hits it, but
// its ends may be twice as fast. Constraints of bodies moved by scripts, hands, links, drives or tissue stay,
// as do those in `pressed`. Keeps the order.
void cull_constraints(const ComingPeriod& coming, CulledConstraintsScratch& scratch, ContactConstraints& constraints);

}  // namespace trocar
