#pragma once
#include <cmath>
#include <limits>
#include <span>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/springs.hpp"
namespace trocar {

// Appends the particles and anchors of a deformable body at its pose, from its prototype and
// bodies.tissue[body], and sets bodies.particles, spring_stiffness, inv_mass (0) and stable_dt of that body.
// Needs springs of the prototype, and its fans for a body that keeps its volume, its hinges for one with
// bending stiffness.
// - spring stiffness k = sqrt(3)/2 * E * wall: a triangular lattice of equal springs is a plane-stress sheet
//   of modulus 2 k / sqrt(3) per unit thickness and Poisson ratio 1/3 (Kot, Nagahashi, Szymczak, The Visual
//   Computer 31, 2015; Ostoja-Starzewski, Applied Mechanics Reviews 55(1), 2002)
// - mass_i = density * |volume| * share_i / area (a sheet: density * area * thickness, else wall)
// - anchor_i = E * share_i / depth: an elastic foundation (Winkler 1867) of that depth behind the membrane
// A vertex of no triangle gets no anchor and is fixed. Throws InputError naming body and quantity if a
// material value is not finite and positive (damping and friction may be zero), or the body has no mass. With
// `nodes`, the body is a solid: more nodes, other masses and stiffness (solid_setup.hpp); stable_dt is not
// set.
struct BodyNodes {
    std::span<const Vec3d> inner;    // m, body frame, numbered after the vertices
    std::span<const double> volume;  // m^3, of every node
    double spring_stiffness = 0;     // N/m
    uint32_t skin = 0;               // particles before them; then no vertex is a node
};
void add_deformable(const Meshes& meshes, const Springs& springs, const Poses& poses, uint32_t body, Bodies& bodies, Particles& particles,
                    Anchors& anchors, const BodyNodes* nodes = nullptr);

// Recomputes bodies.stable_dt[body]: call it after fixing particles (inverse mass 0) or changing masses.
// Largest step of the leapfrog for any shape the body may take, kStableShare of (sqrt(c^2 + 4 omega^2) - c) /
// omega^2 with the damping c and omega of stiffest_mode (engine/tissue/stable_step.hpp). A best-fit anchor energy is
// a minimum over rigid motions, hence also at most anchor_i I (the same split as Liu, Bargteil, O'Brien,
// Kavan, ACM TOG 32(6), 2013). Contact constraints act on velocities and positions, not by stiffness, so they
// do not change the limit. Other forces add their own bounds (pressure_omega_squared, bending_omega_squared).
void update_stable_dt(const Springs& springs, uint32_t body, const Particles& particles, const Anchors& anchors, Bodies& bodies);

// Fraction of the limit above that is used: sqrt(1 - 0.04), for the error of the search for omega.
inline constexpr double kStableShare = 0.98;
// The share of bodies that rounding heats: a mode at the limit answers noise with 1 / (1 - share^2) of its energy.
inline constexpr double kStiffShare = 0.88;

// Whether rounding positions at `radius` (m) to floats heats a body at rest: forces of positions rounded by ulp / sqrt(12) kick by
// 0.74 ulp / dt in each step near the stable one, omega dt = 1.6. kRoundingHeat is a walk to 7 mm/s in a second, in m / s^1.5.
inline constexpr double kRoundingHeat = 0.01;
inline bool is_heated_by_rounding(double radius, double dt) {
    const float at = static_cast<float>(radius);
    return std::nextafter(at, std::numeric_limits<float>::infinity()) - at > kRoundingHeat * dt * std::sqrt(dt);
}

// Smallest number (>= 1) of substeps in `seconds` of which none is longer than `stable_dt` or `largest`.
uint32_t substeps_for(double seconds, double stable_dt, double largest);

}  // namespace trocar
