#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Whether the implicit bodies of an island take leapfrog in the coming pass: a contact constraint may act on one, and the
// island has what solve_with_implicit does not solve for: a free rigid body, a tool that contacts rotate, jaws; or the touched
// body has pressure, contact with itself, links that need steps as short as leapfrog's, or nothing that holds it to the world.
// (The iteration ends when displacements have settled; the momentum of a body that nothing holds is not exact by then.
// Impulses between implicit steps, on single masses, are given back many times over by stiff tissue: a hand's 6 mJ became 86 J.)
bool needs_leapfrog(const AdvanceInputs& inputs, const Particles& particles, const ContactConstraints& constraints,
                    std::span<const uint32_t> island_bodies, std::span<const uint32_t> island_constraints);

// Factor on the substeps of leapfrog bodies for the coming pass of `seconds` with substeps of dt (s):
//   undamped shells: 2, which keeps their energy to 0.5 % however they fold (23 % gained in 60 s without).
//   shells held by their surroundings: 2 if the ends of some spring move relative to each other by more
//     than a twentieth of its rest length in a step, else 1. Next to the limit leapfrog keeps the energy of
//     small oscillations, but springs that fold within a few steps gain energy: the step resonates with the
//     highest modes, in the third and fourth order at sqrt(3)/2 and sqrt(1/2) of the limit (Skeel, Srinivas,
//     "Nonlinear stability analysis of area-preserving integrators", SIAM J. Numer. Anal. 38(1), 2000). Not
//     free shells: every fall would need the check.
//   bodies with a link near its strength (nine tenths of it), or one that came out in the last pass or is let go of: 4 in scenes
//     where instruments act. What it held rings when it breaks, in the middle of a pass; with steps of the stable limit 2 % of
//     its energy got lost.
//   solids: 2 if some tetrahedron keeps less than 0.45 of its volume now or in the middle of
//     the pass, 4 below 0.3. Compressed springs and flat tetrahedra are stiffer than at rest
//     (solid_limit.hpp): a box of 10 kg on a soft pad of 0.9 kg would gain energy for ever; with finer steps
//     its energy balances to 0.05 % of the largest elastic energy, and presses by instruments cost none.
// `scratch`: the island's; uses the nodes of a solid.
uint32_t finer_steps(const AdvanceInputs& inputs, const Particles& particles, std::span<const uint32_t> island_bodies, double dt,
                     double seconds, AdvanceScratch& scratch);

// Subcycled bodies: solids with crushed tetrahedra and without constraints take several explicit steps per substep.
// When released, nodes cross a whole cell in a step, which no step limit covers. Springs and volumes have several rest
// shapes: nodes displaced at random may end in another one.

// Whether a body needs subcycling, given its present least volume ratio: fast, and below kCrushed or so a substep ago
// or from now.
bool needs_subcycling(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, double least, TissueScratch& scratch);
// The substep of a subcycled body, with the link forces at its start. Returns the work of damping, J.
double step_finely(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                   AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
