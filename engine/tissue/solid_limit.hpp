#pragma once
#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
namespace trocar {

// Sets bodies.stable_dt[body] of a solid; call it after fixing particles or changing masses. kSolidShare of
// the limit of the leapfrog, (sqrt(c^2 + 4 omega^2) - c) / omega^2 with the damping c, where omega^2 is the
// largest eigenvalue of M^-1 K. Terms of K:
// - springs: k (n n^T + kStretched (I - n n^T)), n along the edge at rest: exact at rest for kStretched = 0;
//   a spring stretched to s of its length adds 1 - 1 / s across, 0.23 for 30 % more. (k I, valid for any
//   shape, would cost sqrt(3) of the step: springs of an isotropic solid share every direction between
//   three.)
// - volumes: kStretchRoom * bulk V g g^T, g the gradient of J at rest: the square of cof F is 3 at rest, 4
//   stretched by 1.9 along one axis or by 1.3 along two at constant volume; where a tetrahedron is pressed
//   flat it falls to 1, which compensates for the branch of crush. kSqueezeRoom * squeeze likewise: its
//   stiffness, 2 squeeze (1 - J), is 0 at rest and largest at half the volume, where it acts as a bulk modulus of
//   0.7 squeeze; the rest is left to the reserve
// - anchors: their stiffness
// - neo-Hookean tetrahedra instead: kLawRoom times the stiffness at rest, that of Lame's constants. Stretching by 2 along
//   one axis makes twisting modes and the square of cof F 1.56 times as large, pressing flat makes volumes softer by more than shear
//   gets stiffer. Measured (NeoHookean.StepsAreStableInEveryShape): of shapes with stretches of 2, of 1.3 along two axes, of 0.5, 0.1 and
//   -0.5, the least stable one takes 0.97 of the step that its own stiffness allows; with 4/3 it took 1.03
// - Maxwell elements: their stiffness next to that of the springs, as if nothing relaxed
// No bound is valid for every shape: volume forces grow with the area of faces. For shapes beyond these there
// is the reserve of kSolidShare, 1.56 in omega^2; a body that still becomes unstable is restored and counted.
// The eigenvalue is found by kLanczosSteps steps of Lanczos' method (1950) without reorthogonalisation, which
// converges to extreme values from below (Parlett, "The symmetric eigenvalue problem", 1980, chapter 13).
// Double, fixed order: the same bits everywhere.
void update_solid_dt(const Meshes& meshes, const Springs& springs, const Solids& solids, uint32_t body, const Particles& particles,
                     const Anchors& anchors, Bodies& bodies);

// The same for a solid that may lose tetrahedra, a limit valid for every remainder: the largest eigenvalue of
// single tetrahedra with their own share of springs and masses bounds that of any assembly of them (Irons,
// Treharne, "A bound theorem in eigenvalues and its practical applications", 1971). Losing a soft, heavy
// neighbour may make a mode stiffer, so the limit of the whole body is not valid then.
void update_tearing_solid_dt(const Meshes& meshes, const Springs& springs, const Solids& solids, uint32_t body, const Particles& particles,
                             const Anchors& anchors, Bodies& bodies);

inline constexpr double kSolidShare = 0.8;
inline constexpr double kStretched = 0.23;
inline constexpr double kStretchRoom = 4.0 / 3;
inline constexpr double kSqueezeRoom = 0.5;
inline constexpr double kLawRoom = 1.5;

}  // namespace trocar
