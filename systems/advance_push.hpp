#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// One sweep of push_out over a group.
struct PushSweep {
    double least, most;  // m: overlap that is left alone; longest correction, and after the first sweep also the deepest overlap corrected
    uint8_t stamp;       // from 1, ascending: see ContactNodeSet::moved_in
    uint8_t since;       // constraints none of whose nodes has moved in this sweep or a later one are passed over; 0: none is
};

// Position correction: moves what overlap is left out, in substeps in which a millisecond begins; after move_hands. Velocities stay as
// they are, but for the spin of free bodies, whose angular momentum stays while they turn.
// One sweep. If bodies share corrections by mass and no hand leads one: ContactParams::iterations sweeps while anything is corrected;
// with more than one iteration then up to fifteen times as many while a constraint is deeper than ContactParams::tolerance, but no
// deeper than push_speed removes in the substep.
void push_out(const AdvanceCall& call, ContactSolver& solver, AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result);
// Share of a correction that the side of the point takes, unless bodies share it by mass.
double share_of_point(const AdvanceCall& call, const ContactRows& rows, uint32_t row);

}  // namespace trocar
#pragma GCC diagnostic pop
