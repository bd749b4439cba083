#pragma once
#include "components/mesh.hpp"
namespace trocar {

// A piece of abdominal wall with a hernia, in metres: 0.2 x 0.16 x 0.018 m along the wall, bent about y
// (head) with a radius of 0.16 m, outside +z; an oval defect of 50 x 40 mm in the middle (medium width in the
// European Hernia Society's classification, Muysoms et al. 2009) with a rim of radius `rim`. Closed, one
// handle. Centred on the defect. No material; triangle_material is 0 on cut faces and in the defect, 1
// outside, 2 inside.
struct WallSize {
    double width = 0.2, height = 0.16, thickness = 0.018, bend = 0.16;
    double defect_x = 0.025, defect_y = 0.02;  // semi-axes at the inner and outer surface
    double rim = 0.005;
};
Mesh make_hernia_wall(const WallSize& size, uint32_t triangles);

// Subdivision of a surgical mesh: columns x rows of hexagonal cells in brick order, one pore per whole cell
// (half cells at row ends have none), `along` segments per cell side and `across` segments across a strand.
struct MeshCells {
    uint32_t columns = 1, rows = 1, along = 1, across = 1;
    uint32_t pores() const { return columns * rows - rows / 2; }
    uint32_t triangles() const;
};
// The finest subdivision for this number of triangles with cells at most 6.6 mm wide; none if too few.
MeshCells divide_mesh(uint32_t triangles);

// Surgical mesh of polypropylene: an open flat sheet of 0.15 x 0.1 m in z = 0, facing +z, centred, with one
// outer boundary and a boundary loop per pore. Texture tile 10 mm. No material.
Mesh make_surgical_mesh(const MeshCells& cells);

// The same sheet without modelled pores, which its texture shows: a lightweight mesh whose pores are finer than its triangles.
Mesh make_fine_mesh(uint32_t triangles);

}  // namespace trocar
