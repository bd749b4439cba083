#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// One step of backward Euler of a shell or sheet, and its energy accounting: the displacement u that minimises
// |u - h v|^2_M / 2 h^2 + energy(x + u), with springs, anchors, bending, pressure and gravity at the end of the step.
// Every iteration adds A^-1 force, A the constant matrix of engine/tissue/implicit_factor.hpp, pressure by the
// Sherman-Morrison formula beside it. Anderson's acceleration in A's norm ("Iterative procedures for nonlinear integral
// equations", J. ACM 12(4), 1965; for projective dynamics Peng et al., ACM TOG 37(4), 2018) combines the last
// iterates. The first is h v: at rest it is the solution, so that equilibria do not depend on the iterations.
// The step takes energy from motion, mostly from modes faster than it, never from rest.
void step_backward_euler(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state,
                         AdvanceBody& b, AdvanceResult& result);

// ---- bodies that contact constraints touch ----
//
// The same minimum under the constraints: their impulses J act as forces J / h at the end of the step. Every iteration
//   1. proposes a change (A^-1 + (2 D)^-1) / 2 (force + J / h), D each particle's own block of the Hessian H. H is at most A and
//      at most 2 D, so this is at most H^-1 times the force: it never overshoots. A^-1 moves what is smooth, D^-1 what is local;
//   2. lets the sweeps over the constraints change the velocities u / h of contact nodes by (2 D)^-1 / h^2 times impulses,
//      which is the constrained minimum in the metric 2 D;
//   3. combines the iterates by Anderson's acceleration, in the metric 2 D.
// The last iterate is not combined: its contact nodes have the velocities that the constraints ask for.

// Writes provisional positions and velocities, without impulses, by which constraints become active.
void begin_touched_step(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state,
                        AdvanceBody& b, AdvanceResult& result);
// Sets the responses of the body's contact nodes.
void set_responses(const AdvanceCall& call, const AdvanceBody& b, const TissueScratch& scratch, AdvanceIsland& island);
// Finds the forces, and moves each particle alone by (2 D)^-1 (force + J / h). Sets the velocities of contact nodes.
void relax_touched_step(const AdvanceCall& call, AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                        AdvanceResult& result);
// Moves all particles together instead, with the impulses that sweeps have found since.
void smooth_touched_step(const AdvanceCall& call, AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                         AdvanceResult& result);
// Takes the velocities of contact nodes back after more sweeps, and combines the iterates. Returns whether they have converged.
bool accept_touched_step(const AdvanceCall& call, AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b,
                         AdvanceResult& result);
// Writes positions and velocities of the last iterate, after its sweeps. Returns whether the step has added no energy, as the
// minimum adds none; if it has, more iterations from here may.
bool finish_touched_step(const AdvanceCall& call, const AdvanceIsland& island, TissueScratch& scratch, const AdvanceState& state,
                         AdvanceBody& b, AdvanceResult& result);
// Accounts for the energy of the finished step.
void account_touched_step(const AdvanceCall& call, const TissueScratch& scratch, AdvanceBody& b, AdvanceResult& result);
// Books what position corrections have added to the energy of a touched body.
void account_corrections(const AdvanceCall& call, TissueScratch& scratch, const AdvanceState& state, AdvanceBody& b, AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
