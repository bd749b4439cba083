#pragma once
#include <cstdint>
namespace trocar {

// The tuned numbers of advance_island. Behind each: where it comes from. "Trial" means chosen by trial on the scenes named: no figure of
// its own is kept, and the state hashes of the scenes depend on it.

// ---- contact constraints: what acts, and how it is seen ----

// Below this cosine between a constraint's normal and its triangle's, the foot along the normal is too far away to be used. Trial:
// ball_on_liver, probe_on_liver.
inline constexpr double kLeastCosine = 0.2;
// Two constraints press a node from both sides when the cosine of their directions is below this: beyond 120 degrees. From geometry: no
// displacement then serves both by half.
inline constexpr double kOpposed = -0.5;
// Two directions within 60 degrees of a third are within 120 of each other, which is kOpposed.
inline constexpr double kLean = 0.5;
// m, overlap left alone: far below anything seen or felt, above what rounding of float positions makes of a resting contact.
inline constexpr double kRestingOverlap = 1e-6;
// m, a free body this near to what carries it rests on it: above kRestingOverlap. Trial: rigid_stack.
inline constexpr double kRestingGap = 5e-6;
// m/s, slower approach does not bounce, whatever the restitution: bodies come to rest. Some steps of gravity: 5 ms of free fall.
inline constexpr double kLeastBounce = 0.05;

// ---- sweeps ----

// Sweeps with tools that turn in the hand. Trial: grasp_by_hand, shaft_on_liver.
inline constexpr uint32_t kHeldSweeps = 4;
// Many constraints of a skin share few nodes. Measured: with one sweep the speeds left make 20 times the work of damping in a press of
// 20 mm (tet_liver_press with a skin).
inline constexpr uint32_t kSkinSweeps = 4;
// Sweeps over a group before the next one: its constraints are still in the cache then. Measured: a tenth of the time of a heap's
// advance (stress_rain). Groups hear of each other in the next substep at the latest.
inline constexpr uint32_t kSweepsAtOnce = 4;
// Parts into which long lists are dealt, and constraints of a part. Trial: stress_large; short lists converge better in order.
inline constexpr uint32_t kMostParts = 8, kRowsPerPart = 32;

// ---- wide constraints and groups ----

// Fewer constraints than this converge better one after the other, in the order of the surface; with static planes, this. Trial:
// stress_large, stress_rain.
inline constexpr uint32_t kFewestRows = 64, kFewestWithFixed = 2048;
// Unfinished blocks that constraints are dealt to. Trial: stress_large.
inline constexpr uint32_t kOpenBlocks = 16;
// Constraints and blocks that are fetched before they are asked for. Trial on the machine of docs/figures.md: stress_large.
inline constexpr uint32_t kRowsAhead = 8, kBlocksAhead = 3;
// Fewer constraints than this are done before other threads have heard of them. Trial: stress_large.
inline constexpr uint32_t kFewestRowsToSplit = 2048;
// A strip must be wider than bodies are, so that most bodies touch their own strip and the next alone. Trial: stress_large, stress_rain.
inline constexpr uint32_t kBodiesPerStrip = 96, kMostStrips = 32;

// ---- constraints of free rigid bodies: solved to convergence ----

// m/s, sweeps end when no relative velocity changes by more. Measured: towers of eleven boxes sway at 0.1 mm/s with what 128 sweeps leave
// above it (docs/figures.md, free bodies).
inline constexpr double kSettledChange = 3e-6;
// Most sweeps; with direct solutions between them. Trial: columns of eleven boxes.
inline constexpr uint32_t kMostSweeps = 128, kMostSweepsSolved = 48;
// Bodies that move need not agree as well as those that rest: sweeps also end when the change is below the first share of what the first
// sweep changed, or the second share of what it changed beyond kLeastBounce. Measured: 200 boxes that rain among 400 soft balls overlap
// as little in half the time.
inline constexpr double kSettledShare = 1e-3, kHitShare = 1e-2;
// Larger components are swept with the groups, which run in parallel. Trial: stress_rain of rigid bodies.
inline constexpr uint32_t kMostRowsAlone = 2048;
// Most direct solutions in one substep. The first kSolutionsInARow + 1 follow on one sweep each, the later ones on kSweepsBetween + 1;
// so do all after one that had to be undone. Trial: columns of eleven boxes; what they leave the next substep solves at its start.
inline constexpr uint32_t kMostSolutions = 16, kSolutionsInARow = 4, kSweepsBetween = 3;
// How much softer than its own response a constraint is solved: those that share faces are linearly dependent. Trial: columns of eleven
// boxes; the sweeps that follow take what it leaves.
inline constexpr double kSoftness = 1e-5;
// Friction below this share of its limit, squared, sticks. From rounding.
inline constexpr double kSticks = 1 - 1e-6;
// Multiplications that a factorisation may cost for each constraint: some ten sweeps.
inline constexpr double kMostWorkPerRow = 2000;

// ---- constraints within implicit steps ----

// How much stiffer a constraint is than the nodes it holds are in the step. What is left to the impulses, which see single masses, is one
// over this; more costs conjugate gradients. Trial: tet_liver_press at 10 ms.
inline constexpr double kHeldStiffness = 30;
// m, constraints nearer than this act until they turn out to pull. Trial: tet_liver_press.
inline constexpr double kHeldSlack = 1e-5;
// Friction beyond its limit by less than this share stays as it is. Trial: tet_liver_press.
inline constexpr double kMoreFriction = 1.05;
// Solves of a step with such constraints; in the last two none joins, those that pull let go. Trial: tet_liver_press.
inline constexpr uint32_t kMostSolves = 6;

// ---- finer steps ----

// Explicit steps that go for one of a solid with crushed tetrahedra, and the share of an edge that nodes may move in a step before
// volumes are looked at. Trial: the hard cases M04 of the tests.
inline constexpr uint32_t kFiner = 4;
inline constexpr double kFarWay = 0.25;
// Shells: steps that go for one where the ends of a spring move by more than kApart of its rest length against each other in a step;
// where nothing moves by kShortWay of the mean rest length no spring is looked at. Measured: finer_steps (advance_fine.hpp).
inline constexpr uint32_t kFinerShell = 2;
inline constexpr float kApart = 0.05f;
inline constexpr double kShortWay = 0.02;
// Solids that something touches: volume ratios below which more steps go for one, now or in the middle of the pass. Measured:
// finer_steps (advance_fine.hpp).
inline constexpr double kPressed = 0.45, kPressedFlat = 0.3;
inline constexpr uint32_t kFinerPressed = 2, kFinerPressedFlat = 4;

// ---- bodies that fail ----

// m, a particle farther than this from its origin counts as lost, like one that is not finite.
inline constexpr float kLost = 1e6f;
// A stable leapfrog near its limit may show this many times its energy, seen a moment later. Trial: the tests of runaway bodies.
inline constexpr double kGrowth = 8;
// J/kg, rounding makes no more than this of what rests: about 1.4 mm/s.
inline constexpr double kNoise = 1e-6;

}  // namespace trocar
