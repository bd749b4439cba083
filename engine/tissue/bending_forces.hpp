#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/springs.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// Bending across edges after discrete shells (Grinspun, Hirani, Desbrun, Schroeder, SCA 2003): an edge of
// length l at rest between triangles of areas A0 and A1 has the energy U = k (1 - cos(theta - rest angle)),
// theta the angle between the triangles' normals and k = D l^2 / (A0 + A1); for small angles this is theirs
// (3 l^2 / A times angle^2). The cosine instead of the square needs no inverse trigonometry and bounds the
// moment by k for every shape. Rest angles are those of the mesh: an organ's roundness is not bending. If a
// triangle's height over the edge is below a quarter of the mesh's mean edge, k is reduced by the square of
// the ratio (our addition): otherwise the stiffest sliver would set the step of the whole mesh.
//   D = E w^3 / (12 (1 - nu^2)) with E = tissue.bending, w = tissue.wall, nu = 1/3 as for the springs.
// On a lattice of equilateral triangles the energy per area is D / 6 (3 (c1 + c2)^2 - 8 c1 c2), c1, c2 the
// principal curvatures (sum of k / 2 (h (3 b_nn - b_tt) / (2 sqrt 3))^2 over the three edge directions): a
// cylinder and a strip bend as the plate does (D / 2 c^2; strip D (1 - 1/9) c^2 / 2), but the ratio of
// curvatures is -1/3 instead of +1/3: a spherical cap needs half the energy of a plate, a saddle twice.
// Forces act along the normals of the two triangles; force and torque sum to zero.

inline bool has_bending(const Bodies& bodies, uint32_t body) { return bodies.tissue[body].bending > 0; }

// D of a material, N m.
double bending_rigidity(const Tissue& tissue);

// Makes the hinges of a prototype (inner edges) if missing; `mesh` as add_fans. Needs its springs.
void add_hinges(Springs& springs, const MeshView& mesh, uint32_t prototype);

// Adds the bending forces (N, indexed like offset) of particles at `offset`. Hinges write their four forces,
// then every vertex gathers its own in fixed order: same bits for any number of threads. hinge_force:
// scratch.
void add_bending_forces(const Springs& springs, uint32_t prototype, double rigidity, const Float4* offset, std::vector<Float4>& hinge_force,
                        float* force_x, float* force_y, float* force_z);

// U of all hinges, J, summed in double in fixed order. `sums` is reused memory.
double find_bending_energy(const Springs& springs, uint32_t prototype, double rigidity, const Float4* offset, std::vector<double>& sums);

// Bound of omega^2 (1/s^2) that bending adds to the stiffest mode: the largest row sum of k |dtheta/dx_i| |dtheta/dx_j| /
// m_i at rest, with the reserve below for flattened triangles (the forces of flatter ones are capped, see Hinges::cap)
// and for the curvature of theta itself at angles of 0.3 rad.
double bending_omega_squared(const Springs& springs, const Bodies& bodies, const Particles& particles, uint32_t body);
inline constexpr double kFlatReserve = 1.3;
inline constexpr double kAngleReserve = 1.3;

}  // namespace trocar
