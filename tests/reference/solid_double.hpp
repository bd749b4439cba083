#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "components/math.hpp"
namespace trocar::reference {

// A tetrahedral solid under dead loads, in double, in static equilibrium.
struct DoubleSolid {
    std::vector<Vec3d> rest;                           // m
    std::vector<std::array<uint32_t, 4>> tetrahedron;  // positive volume
    std::vector<std::array<bool, 3>> held;             // per node and axis: fixed at `place`
    std::vector<Vec3d> position;                       // m, initial guess; afterwards the solution
    std::vector<Vec3d> load;                           // N
    double youngs_modulus = 1e4;                       // Pa
    double poisson = 0.45;
};

DoubleSolid make_double_solid(std::vector<Vec3d> rest, std::vector<std::array<uint32_t, 4>> tetrahedron);
// Adds the weight of every tetrahedron, a quarter to each corner.
void add_weight(DoubleSolid& solid, const Vec3d& weight_density);  // N/m^3

enum class SolidModel {
    kSprings,       // the product's model: edge springs and a penalty on each tetrahedron's volume
    kCorotational,  // corotational linear FEM (Mueller, Gross, "Interactive virtual materials", 2004)
};

// Internal forces at solid.place, N: minus the gradient of the elastic energy (kCorotational: rotations kept
// fixed).
std::vector<Vec3d> solid_forces(const DoubleSolid& solid, SolidModel model);
// Energy of the kSprings model, J.
double spring_energy(const DoubleSolid& solid);
// Moves `place` into equilibrium by Newton's method. Returns the largest remaining force on a free axis, N.
double solve_statics(DoubleSolid& solid, SolidModel model, int most_rounds = 60);
// Largest eigenvalue of M^-1 H for the springs model at `place`, free axes only, 1/s^2: dense, for small
// bodies.
double stiffest_mode(const DoubleSolid& solid, double density);

// A box of nx x ny x nz cubes of edge h with a node at each corner and each centre: the body-centred lattice,
// cut flat at its faces by half octahedra. `jitter` displaces inner nodes randomly by that fraction of h.
void lattice_box(int nx, int ny, int nz, double h, double jitter, std::vector<Vec3d>& position,
                 std::vector<std::array<uint32_t, 4>>& tetrahedron);

}  // namespace trocar::reference
