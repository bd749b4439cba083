#pragma once
#include <cstdint>
namespace trocar {

// The tuned constants of advance_island and their origins. "By trial": chosen by trying values on scenes of
// this kind; no figure is kept, and the state hashes of the scenes depend on it.

// ---- contact constraints: which act ----

// Below this cosine between a constraint's normal and its triangle's, the projection along the normal is too
// far away to be used. By trial.
inline constexpr double kLeastCosine = 0.2;
// Two constraints press a node from opposite sides if the cosine between their directions is below this, that
// is beyond 120 degrees: no displacement then resolves half of both.
inline constexpr double kConflictCosine = -0.5;
// Two directions within 60 degrees of a third are within 120 degrees of each other: kConflictCosine.
inline constexpr double kLean = 0.5;
// Cosine of 30 degrees, from one line: what presses a node within it meets midway. Measured on jaw_grasp with break_strain 0.2, whose
// tissue tears out of closed jaws: 87 mJ enter, corrections add 1.5 mJ (1.3 with 15 degrees); 1,800 mJ where all meet midway.
inline constexpr double kOneLine = 0.87;
// m, overlap that is not corrected: not perceptible, but above the rounding of a resting contact's float
// positions.
inline constexpr double kRestingOverlap = 1e-6;
// m, a free body this near to its support rests on it; above kRestingOverlap. By trial.
inline constexpr double kRestingGap = 5e-6;
// m/s, slower approach does not bounce, whatever the restitution, so that bodies come to rest: 5 ms of free
// fall.
inline constexpr double kLeastBounce = 0.05;
// s, over which the normal load that limits the friction of a soft contact is averaged, if the contact is that old: of the order of the
// period of the modes that flutter. Measured on solid crates of 5e4 Pa that slide at 0.95 of the friction that
// holds them, 6, 12 and 20 cells, damping 20 and 60 1/s: acceleration within 0.2 to 1.8 % of Coulomb's; without it
// +9 to +137 %.
inline constexpr double kFrictionLag = 3e-3;

// ---- sweeps ----

// Sweeps if tools rotate in the hand. By trial.
inline constexpr uint32_t kHeldSweeps = 4;
// Sweeps with embedded surfaces, whose constraints share few nodes. Measured: with one sweep the remaining
// velocities multiply the work of damping by 20 in a press of 20 mm (tet_liver_press with an embedded
// surface).
inline constexpr uint32_t kEmbeddedSweeps = 4;
// Sweeps if hands press tissue against something on its other side: between heavy bodies light tissue passes little of an
// impulse on in a sweep. Measured on 24 sheets of 0.2 to 1 mm between two tips: the force ripples by more than 3 % in 10 with 2
// sweeps, in 3 with 8 or 16, in 2 with 32.
inline constexpr uint32_t kPinchedSweeps = 32;
// Consecutive sweeps over a group while it is in the cache. Measured: saves a tenth of the time of a heap's
// advance (stress_rain). Groups see each other's impulses in the next substep at the latest.
inline constexpr uint32_t kSweepsAtOnce = 4;
// Parts into which long lists are interleaved, and constraints per part; short lists converge better in
// order. By trial.
inline constexpr uint32_t kMostParts = 8, kConstraintsPerPart = 32;

// ---- wide constraints and groups ----

// Below these counts constraints converge better one by one, in surface order; the second with static planes.
// By trial.
inline constexpr uint32_t kFewestConstraints = 64, kFewestWithFixed = 2048;
// Unfinished wide constraints that constraints are distributed to. By trial.
inline constexpr uint32_t kOpenWide = 16;
// Prefetch distances: constraints and wide constraints. By trial on the machine of docs/figures.md.
inline constexpr uint32_t kConstraintsAhead = 8, kWideAhead = 3;
// Fewer constraints than this are solved faster than other threads start. By trial.
inline constexpr uint32_t kFewestConstraintsToSplit = 2048;
// A slab must be wider than bodies, so that most bodies touch only their own slab and the next. By trial.
inline constexpr uint32_t kBodiesPerSlab = 96, kMostSlabs = 32;

// ---- constraints of free rigid bodies: solved to convergence ----

// m/s, sweeps end when no relative velocity changes by more. Measured: with what 128 sweeps leave above it,
// towers of eleven boxes sway at 0.1 mm/s (docs/figures.md, free bodies).
inline constexpr double kConvergedChange = 3e-6;
// Most sweeps without and with direct solutions between them. By trial.
inline constexpr uint32_t kMostSweeps = 128, kMostSweepsSolved = 48;
// Most solutions of single constraints in a millisecond of an island, and of all in a substep at least: by estimate some seconds of a
// processor in a pass. What is left is solved from the impulses so far in the next substep.
inline constexpr uint64_t kMostWork = uint64_t{1} << 20;
inline constexpr uint32_t kFewestSweeps = 8;
// Sweeps that cost as much as a direct solution: kMostWorkPerConstraint.
inline constexpr uint32_t kSweepsPerSolution = 10;
// Moving bodies need less accuracy than resting ones: sweeps also end when the change is below the first
// share of the first sweep's change, or the second share of its excess over kLeastBounce. Measured: 200 boxes
// that rain among 400 soft balls overlap as little in half the time.
inline constexpr double kConvergedShare = 1e-3, kHitShare = 1e-2;
// Larger components are swept with the groups, which run in parallel. By trial.
inline constexpr uint32_t kMostConstraintsAlone = 2048;
// Most direct solutions in one substep. The first kSolutionsInSequence + 1 follow one sweep each, the later
// ones kSweepsBetween + 1, as do all after a solution that had to be undone. The next substep solves the
// remainder at its start. By trial.
inline constexpr uint32_t kMostSolutions = 16, kSolutionsInSequence = 4, kSweepsBetween = 3;
// Compliance of a constraint in direct solutions, relative to its own response: constraints that share faces
// are linearly dependent. The following sweeps remove the error. By trial.
inline constexpr double kSoftness = 1e-5;
// Friction above this share of its limit, squared, slides. From rounding.
inline constexpr double kSticks = 1 - 1e-6;
// Multiplications per constraint that a factorisation may cost: some ten sweeps.
inline constexpr double kMostWorkPerConstraint = 2000;

// ---- finer steps ----

// Explicit steps that replace one of a solid with crushed tetrahedra, and the share of an edge that nodes may
// move in a step before volumes are tested. By trial.
inline constexpr uint32_t kFiner = 4;
inline constexpr double kFarDisplacement = 0.25;
// Shells: steps that replace one if the ends of a spring move relative to each other by more than kApart of
// its rest length in a step; springs are not tested if no node moves by kShortDisplacement of the mean rest
// length. Measured: finer_steps (fine_steps.hpp).
inline constexpr uint32_t kFinerShell = 2;
// and of a body that loses a link (fine_steps.hpp)
inline constexpr uint32_t kFinerLosing = 4;
inline constexpr float kApart = 0.05f;
inline constexpr double kShortDisplacement = 0.02;
// Solids: volume ratios, now or in the middle of the pass, below which more steps replace one.
// Measured: finer_steps (fine_steps.hpp).
inline constexpr double kPressed = 0.45, kPressedFlat = 0.3;
inline constexpr uint32_t kFinerPressed = 2, kFinerPressedFlat = 4;

// s, shorter steps are counted: more than 50 a millisecond. A round number.
inline constexpr double kShortStep = 0.02e-3;

// ---- bodies that fail ----

// m, a particle farther than this from its origin counts as lost, like a non-finite one.
inline constexpr float kLost = 1e6f;
// Energy growth that a stable leapfrog near its limit may show shortly after. By trial on the tests of
// runaway bodies.
inline constexpr double kGrowth = 8;
// J/kg, bound on the energy that rounding gives a body at rest: about 1.4 mm/s.
inline constexpr double kNoise = 1e-6;

}  // namespace trocar
