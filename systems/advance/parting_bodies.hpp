#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "components/nodes.hpp"
#include "systems/advance/island/call.hpp"
namespace trocar {

// A contact of a body that is moved as a whole with one that it is not parted from.
struct PartingNeighbour {
    uint32_t a, b;               // bodies
    std::array<double, 2> mass;  // kg, of a and b; 0 = cannot be moved as a whole
    Vec3d direction;             // unit, from a to b
    double gap;                  // m, between them there; 0 where they overlap
};

// Reused memory.
struct PartingBodiesScratch {
    std::vector<uint8_t> left;                // per contact constraint: see AdvanceInputs::left
    std::vector<double> depth;                // m, per pair: of its deepest constraint
    std::vector<std::array<double, 2>> mass;  // kg, per pair, of a and b; 0 = cannot be moved as a whole
    std::vector<PartingNeighbour> neighbours;
    std::vector<double> mass_of_body;  // kg, per body of a pair; else 0
    std::vector<double> step;          // m, per pair: what a pass parts
    std::vector<Vec3d> shift;          // m, per body
};

// Pairs that start inside each other (find_parting_pairs) are parted by moving whole bodies: their shapes stay, so that it
// stores no energy, and they leave at no more than ContactParams::push_speed and not into others that they touch: what stands on a table
// stays there, and the other body goes. Their contacts keep the bodies from
// approaching, but corrections leave them alone. A body that something holds - anchors in the world, fixed nodes, links, jaws,
// a drive - is not moved. Of a pair of such bodies the contacts are corrected along the pair's direction, as long as pressing both flat
// takes. What overlaps by more than half the smaller one's size, or still does when its travel is used up, is left as it is: its
// contacts only keep it from getting deeper, so that no correction feeds it energy.
struct PartingBodies {
    const PairMemory& pairs;
    std::span<const std::array<uint32_t, 2>> joined;  // bodies connected by links and jaws
    const Nodes& nodes;
};

// Before the advance of a pass: finds the contacts that corrections shall leave alone (scratch.left; empty = none).
void find_parting_contacts(const AdvanceInputs& inputs, const PartingBodies& parting, const Particles& particles, const Poses& poses,
                           const ContactConstraints& constraints, PartingBodiesScratch& scratch);
// After it: moves the bodies by what a pass of `seconds` allows, shortens the travel that is left to the pairs, and adds the work
// against gravity to work_push (J). Returns the deepest overlap that is left where corrections had none to do (m).
double part_bodies(const AdvanceInputs& inputs, const AdvanceParams& params, double seconds, PartingBodiesScratch& scratch,
                   PairMemory& pairs, Particles& particles, Poses& poses, double& work_push);

}  // namespace trocar
