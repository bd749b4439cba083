#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
#include "components/tears.hpp"
#include "engine/base/raw_vector.hpp"
#include "engine/geometry/vec4.hpp"
#include "engine/kernels/tet_kernels.hpp"
namespace trocar {

// Moduli of the springs and volume forces of a solid for an isotropic material of Young's modulus E and
// Poisson ratio nu. Springs alone make Lame's two constants equal (Cauchy: nu = 1/4), so springs give the
// shear modulus mu and the volume force gives the missing part of lambda as bulk modulus.
// - springs: a material of nu = 1/4 with this mu, E_s = 5/2 mu. The six edges of a tetrahedron are equal
//   springs of k = 6 E_s V / (sum of their L^2): then the sum of k L^2 per volume, the invariant C_iijj, is
//   that of the isotropic material, 15 mu, in any mesh (Lloyd, Szekely, Harders, IEEE TVCG 13(5), 2007, find
//   0.943 of it for regular tetrahedra). On the body-centred lattice, short edges shared by six and long ones
//   by four tetrahedra, every direction is exact too: its cubic constants satisfy the condition of isotropy.
//   Distorted tetrahedra at the surface satisfy only the average over directions
// - volume: bulk = lambda - mu, see tet_kernels.hpp; below kCrushed additionally crush = kCrushShare * bulk:
//   at half the volume the square of cof F is half of 3, so that the limit of solid_limit.hpp remains valid
// - squeeze: springs alone yield under pressure: at 40 to 50 % strain their stress has a maximum of 0.23 to
//   0.36 E, beyond which a tetrahedron folds flat. So bulk and squeeze are together at least kLeastSqueeze * mu.
//   Measured on the lattice at nu = 1/4, uniaxial stress over E * strain in four directions: 0.93 to 1.01 at
//   10 %, 0.80 to 1.11 at 30 %, 0.81 to 1.01 at 50 %, then growing; with 2 mu it falls again at 50 %. In first
//   order squeeze changes nothing
// - inverted springs are at rest, so crush is at least that of kLeastCrush * mu (nu = 0.45), which unfolds them;
//   and the pressure of bulk is at most kMostPressure * mu, from 1 - J = yield on: inverted tetrahedra of
//   nu = 0.499 would fly apart faster than any step follows. Measured: solid_recovery_test.cpp
struct SolidModuli {
    double springs = 0;  // Pa, E_s
    double bulk = 0;     // Pa
    double crush = 0;    // Pa
    double squeeze = 0;  // Pa
    double yield = 1;    // 1 - J
    double shear = 0;    // Pa, of the neo-Hookean law; 0 = springs and volume
};
// With TissueLaw::kNeoHookean shear = 4/3 mu and bulk = lambda + 5/6 mu, with which the law has Lame's constants lambda and mu at small
// strain (Smith, de Goes, Kim 2018, section 3.4), and `springs` is the stiffness of the Maxwell elements alone.
SolidModuli solid_moduli(const Tissue& tissue, TissueLaw law = TissueLaw::kSprings);
// Of a body, by its own law.
SolidModuli solid_moduli(const Bodies& bodies, uint32_t body);

inline constexpr double kCrushShare = 5.0 / 3;
inline constexpr double kLeastSqueeze = 4, kLeastCrush = 8, kMostPressure = 24;

inline bool is_solid(const Solids& solids, uint32_t prototype) {
    return prototype < solids.info.size() && solids.info[prototype].count > 0;
}
// Whether a body has volume forces: a solid.
bool has_tets(const Solids* solids, const Bodies& bodies, uint32_t body);

// The tetrahedra of a body at given offsets, for the kernels; no outputs. With `torn`, the remaining ones.
TetStep bind_tets(const Solids& solids, const Bodies& bodies, const Particles& particles, uint32_t body, const TornSprings* torn = nullptr);

// Energy (J) of one tetrahedron of six-fold rest volume `rest` and present `volume`, by springs and volume: of the volume alone.
double tet_energy(const SolidModuli& moduli, double rest, double volume);
// The same of tetrahedron t of a body with its corners at these places (m), by any law; without its factor.
double tet_energy(const SolidModuli& moduli, const TetStep& step, uint32_t t, const std::array<Vec3d, 4>& corner);
// Six times the signed volume of four corners.
double six_volumes(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d);

// Number of elements of TissueScratch::corner_force that a body needs.
uint32_t corner_rows(const TetStep& body);

// Adds the volume forces to the body's forces (force_x, force_y, force_z: all its nodes). Same bits for any number of
// threads. Returns the least J.
float add_tet_forces(const TetStep& body, uint32_t slices);

struct TetEnergyScratch {
    RawVector<Vec4d> position;  // m, one per node
    std::vector<double> sums;   // J, one per chunk of tetrahedra
};
struct NodeVelocities {
    const float *x, *y, *z;  // m/s
};
// Volume energy of a body at offset - back * velocity, J; fixed order.
double tet_energy(const Solids& solids, const Bodies& bodies, const Particles& particles, uint32_t body, double back,
                  TetEnergyScratch& scratch, const TornSprings* torn = nullptr);

// The same at step.offset - back * velocity; `nodes`: number of nodes that corners refer to. Elements of rest
// 0 have no energy.
double tet_energy(const TetStep& step, uint32_t nodes, const SolidModuli& moduli, const NodeVelocities& velocity, double back,
                  TetEnergyScratch& scratch);

// The least signed volume / rest volume of the tetrahedra at step.offset; at most 1. Needs no outputs bound.
float least_volume_ratio(const TetStep& step);
// The number of tetrahedra that are flat or inside out at step.offset.
uint32_t inverted_tetrahedra(const TetStep& step);

}  // namespace trocar
