#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "components/math.hpp"
namespace trocar::reference {

// A solid of tetrahedra under dead loads, in double, held in static equilibrium.
struct DoubleSolid {
    std::vector<Vec3d> rest;                           // m
    std::vector<std::array<uint32_t, 4>> tetrahedron;  // positive volume
    std::vector<std::array<bool, 3>> held;             // per node and axis: stays at `place`
    std::vector<Vec3d> place;                          // m, start; the answer afterwards
    std::vector<Vec3d> load;                           // N
    double youngs_modulus = 1e4;                       // Pa
    double poisson = 0.45;
};

DoubleSolid make_double_solid(std::vector<Vec3d> rest, std::vector<std::array<uint32_t, 4>> tetrahedron);
// Adds the weight of every tetrahedron, a quarter to each corner.
void add_weight(DoubleSolid& solid, const Vec3d& weight_density);  // N/m^3

enum class SolidModel {
    kSprings,       // the product's: springs on the edges of each tetrahedron and a penalty on its volume
    kCorotational,  // linear finite elements turned with the rotation of each (Mueller, Gross, "Interactive virtual materials", 2004)
};

// Internal forces at solid.place, N: minus the gradient of the elastic energy (kCorotational: rotations kept fixed).
std::vector<Vec3d> solid_forces(const DoubleSolid& solid, SolidModel model);
// Energy of the kSprings model, J.
double spring_energy(const DoubleSolid& solid);
// Moves `place` into equilibrium by Newton's method. Returns the largest force left on a free axis, N.
double solve_statics(DoubleSolid& solid, SolidModel model, int most_rounds = 60);
// Largest eigenvalue of M^-1 H for the springs model at `place`, free axes only, 1/s^2: dense, small bodies.
double stiffest_mode(const DoubleSolid& solid, double density);

// A box of nx x ny x nz cubes of edge h with a node in each corner and in each middle: the body-centred lattice, cut flat
// at its faces by halves of octahedra. `jitter` shakes inner nodes by that share of h.
void lattice_box(int nx, int ny, int nz, double h, double jitter, std::vector<Vec3d>& position,
                 std::vector<std::array<uint32_t, 4>>& tetrahedron);

}  // namespace trocar::reference
