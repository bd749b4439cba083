#pragma once
#include "tests/reference/solid_double.hpp"
// Errors of both solid models on static cases with closed-form solutions.
namespace trocar::reference::cases {

inline constexpr double kE = 1e4;  // Pa

// A box of nx x ny x nz lattice cubes of edge h, corner at the origin, modulus kE.
DoubleSolid box_solid(int nx, int ny, int nz, double h, double nu, double jitter = 0);

// Modulus (Pa) and Poisson ratio of a bar pulled by its end faces, which may slide sideways: kE and nu are
// correct.
struct Uniaxial {
    double modulus, poisson;
};
Uniaxial pull_bar(SolidModel model, int n, double nu);

// End displacement of a bar of n x n x 4n cells hung by its upper end, which may slide sideways, relative to
// the closed form rho g L^2 / (2 E).
double hang_bar(SolidModel model, int n, double nu);

// Tip deflection of a cantilever under its own weight, n cells high, relative to 3 rho g L^4 / (2 E h^2) plus
// the shear part rho g L^2 / (2 kappa G), kappa = 5/6 (Timoshenko).
double sag_cantilever(SolidModel model, int n, double nu);

// Force that presses a sphere of radius R by depth d into a half-space, relative to Hertz's 4/3 E* sqrt(R)
// d^1.5. Under the contact the surface gets Hertz's shape; far away the body gets the displacements of a
// point load of the exact force (Boussinesq; Timoshenko, Goodier, "Theory of elasticity", art. 138), so that
// only the mesh causes errors. A quarter of the body, cells of 1 mm.
double press_sphere(SolidModel model, int cells, int contact_cells, double nu);

}  // namespace trocar::reference::cases
