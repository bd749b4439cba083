#pragma once
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Samples of a function at origin + (x, y, z) * spacing, x fastest. Finite values; below the contour value is
// inside (the sign of a signed distance).
struct ScalarGrid {
    Vec3d origin = Vec3d::Zero();   // m, of sample (0, 0, 0)
    Vec3d spacing = Vec3d::Ones();  // m, all positive
    uint32_t nx = 0;
    uint32_t ny = 0;
    uint32_t nz = 0;
    std::vector<float> values;  // nx * ny * nz values
};

// Triangulates the surface where the grid has the value `iso`, oriented outward (towards larger values). For
// any signs the surface is closed, every edge has two triangles and every vertex one fan, provided that the
// outermost samples are outside (pad by one sample; a surface that leaves the grid is open there). Vertices
// are shared, in order of first use by rising z, y, x, and at least a thousandth of a cell from the samples,
// so that no triangle is degenerate. Fills only position and triangle. Marching cubes (Lorensen and Cline
// 1987) with a case table derived from one rule per face, so that neighbouring cells always agree.
Mesh contour(const ScalarGrid& grid, double iso);

}  // namespace trocar
