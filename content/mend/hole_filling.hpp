#pragma once
#include "components/mesh.hpp"
namespace trocar {

struct HoleLimits {
    uint32_t edges = 256;   // of a rim; the time grows with their third power
    double diagonal = 0.2;  // of the box of a rim, relative to the mesh's
};

struct HoleReport {
    uint32_t filled = 0, faces_added = 0;
    uint32_t left = 0;           // rims beyond the limits, or that cannot be triangulated
    uint32_t largest_edges = 0;  // of the remaining rims
    double largest_diagonal = 0;
};

// Closes the rims of a surface whose edges have at most two faces and whose vertices one fan. New faces use rim
// vertices only and minimise first the largest dihedral angle, rim included, then area: dynamic programming over all
// triangulations (Barequet and Sharir, "Filling gaps in the boundary of a polyhedron", 1995) with the weights of Liepa,
// "Filling holes in meshes" (2003), section 3. No edge gets a third face. Texture coordinates are extrapolated.
HoleReport fill_holes(Mesh& mesh, const HoleLimits& limits);

}  // namespace trocar
