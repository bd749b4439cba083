#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// One sweep of correct_positions over a group.
struct CorrectionSweep {
    double least,   // m; smaller overlaps are left
        most;       // m; longest correction; sweeps after the first skip deeper overlaps
    double held;    // share of the overlap with a tool that rotates in the hand that is removed
    uint8_t stamp;  // from 1, ascending: see ContactNodeSet::moved_in
    uint8_t since;  // constraints without a node that moved in sweep `since` or later are skipped; 0: none
};

// Position correction: removes remaining overlap in substeps in which a millisecond begins. Runs after
// move_hands, move_free_bodies and carry_jaws. No velocity changes but the spin of free bodies, which keep
// their angular momentum. Overlap with a tool that rotates in the hand (its jaws excepted) is removed by 1 / ticks a millisecond, so
// over about one pass: its edges and corners touch other features in every pass, and moved out at once the tissue
// chatters. One sweep; if bodies share corrections by mass and no hand leads one, up to
// ContactParams::iterations sweeps, and if more than one, then up to 15 times as many for overlaps above
// ContactParams::tolerance but no deeper than push_speed removes in the substep. Constraints of a particle that jaws, hands, scripted or static
// bodies press from opposite sides and across are left (Report::opposing_planes counts them): impulses keep them from getting deeper. In the last substep it
// also accounts for the work, records the deepest residual and counts nodes pressed from opposite sides.
void correct_positions(const AdvanceCall& call, ContactSolver& solver, AdvanceIsland& island, const AdvanceState& state,
                       AdvanceResult& result);
// Share of a correction that the side of the point takes, unless bodies share it by mass.
double share_of_point(const AdvanceCall& call, const ContactConstraints& constraints, uint32_t constraint);

}  // namespace trocar
#pragma GCC diagnostic pop
