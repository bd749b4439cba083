#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/springs.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// Inner pressure of a closed shell: energy U = K (V - V0)^2 / (2 V0) of the enclosed volume V, V0 that of the
// rest shape. Force on vertex i: p dV/dx_i with p = K (V0 - V) / V0 and dV/dx_i = 1/6 sum over its triangles
// (x_i, x_j, x_k) of (x_j - x_i) x (x_k - x_i), the exact gradient of the polyhedron's volume: forces and
// torques sum to zero. One pressure per body, also for disconnected pieces.

inline bool has_pressure(const Bodies& bodies, uint32_t body) { return bodies.tissue[body].pressure_modulus > 0; }

// Makes the triangle fans of a prototype if missing: of the surface that its springs are on, whose vertices
// are the nodes; with an embedded surface that is not the surface of the prototype. Needs its springs.
void add_fans(Springs& springs, const MeshView& mesh, uint32_t prototype);

// Writes dV/dx (m^2, indexed like offset) of particles at `offset` and returns V (m^3), taken about the first
// of them: V = 1/3 sum of x_i . dV/dx_i, as V is homogeneous of degree three. Gather, fixed order, sums in
// double: same bits for any number of threads. `sums` is reused memory.
double find_volume_gradient(const Springs& springs, uint32_t prototype, const Float4* offset, std::vector<double>& sums, float* gradient_x,
                            float* gradient_y, float* gradient_z);

// p of a body (Pa) whose volume is V, and U (J).
double find_pressure(const Springs& springs, const Bodies& bodies, uint32_t body, double volume);
double find_pressure_energy(const Springs& springs, const Bodies& bodies, uint32_t body, double volume);

// Bound of omega^2 (1/s^2) that pressure adds to the stiffest mode of a body in its present shape (offsets
// from `particles`). K / V0 sum |dV/dx_i|^2 / m_i of the rank-one part of the Hessian, exact; and of |p|
// d2V/dx2, whose blocks are cross products with (x_k - x_l) / 6 of the two corners opposite an edge, the
// largest row sum. Both with the reserve below, and p for a volume error of the same size.
double pressure_omega_squared(const Springs& springs, const Bodies& bodies, const Particles& particles, uint32_t body);
inline constexpr double kStretchReserve = 1.3;  // stretch allowed for by the limit of the step
inline constexpr double kVolumeReserve = 0.3;   // and change of volume

}  // namespace trocar
