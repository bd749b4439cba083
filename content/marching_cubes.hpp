#pragma once
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Samples of a function at the points origin + (x, y, z) * spacing, x fastest. Values are finite; below the contour
// value is inside (the sign of a signed distance).
struct ScalarGrid {
    Vec3d origin = Vec3d::Zero();   // m, of sample (0, 0, 0)
    Vec3d spacing = Vec3d::Ones();  // m, all positive
    uint32_t nx = 0;
    uint32_t ny = 0;
    uint32_t nz = 0;
    std::vector<float> values;  // nx * ny * nz rows
};

// Triangulates the surface where the grid takes the value `iso`, oriented outward (towards larger values). Whatever the
// signs, the surface is closed, every edge has two triangles and every vertex one fan, provided that the outermost
// samples are outside (pad by one sample; a surface that leaves the grid is left open there). Vertices are shared, in
// order of first use by rising z, y, x. They keep a thousandth of a cell from the samples, so that no triangle is
// degenerate. Fills position and triangle only. Method: marching cubes (Lorensen and Cline 1987) with a case table
// derived from one rule a face, so that neighbouring cells always agree.
Mesh contour(const ScalarGrid& grid, double iso);

}  // namespace trocar
