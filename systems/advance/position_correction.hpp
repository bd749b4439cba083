#pragma once
#include "systems/advance/call.hpp"
#include "systems/advance/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// One sweep of correct_positions over a group.
struct CorrectionSweep {
    double least,
        most;       // m: overlap that is not corrected; longest correction, and after the first sweep also the deepest overlap corrected
    uint8_t stamp;  // from 1, ascending: see ContactNodeSet::moved_in
    uint8_t since;  // skips constraints none of whose nodes has moved in this sweep or a later one; 0: skips none
};

// Position correction: removes remaining overlap, in substeps in which a millisecond begins; after
// move_hands. Velocities do not change, except the spin of free bodies, which keep their angular momentum
// while they rotate. One sweep. If bodies share corrections by mass and no hand leads one:
// ContactParams::iterations sweeps while anything is corrected; with more than one iteration then up to
// fifteen times as many while a constraint is deeper than ContactParams::tolerance, but no deeper than
// push_speed removes in the substep.
void correct_positions(const AdvanceCall& call, ContactSolver& solver, AdvanceIsland& island, const AdvanceState& state,
                       AdvanceResult& result);
// Share of a correction that the side of the point takes, unless bodies share it by mass.
double share_of_point(const AdvanceCall& call, const ContactConstraints& constraints, uint32_t constraint);

}  // namespace trocar
#pragma GCC diagnostic pop
