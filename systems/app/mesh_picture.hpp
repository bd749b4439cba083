#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/mesh.hpp"
#include "components/picture.hpp"
namespace trocar {

// One part of a picture of meshes.
struct MeshTile {
    uint32_t mesh = 0;     // row of the meshes drawn
    double azimuth = 0;    // radians, as Camera
    double elevation = 0;  // radians
    std::string label;     // upper left; may be empty
};

struct MeshPictureParams {
    uint32_t width = 1024;
    uint32_t height = 768;
    Vec3d up = Vec3d::UnitZ();
    bool wireframe = false;
    bool sizes = false;  // writes the box of each mesh into its tiles, in units of the mesh
};

// Front (seen from -y when z is up), side (from +x), top and an oblique view of one mesh.
std::vector<MeshTile> four_views(uint32_t mesh);

// Draws meshes of any unit and place, textured and lit, without a scene: each tile shows one mesh alone, fitted to it.
// Tiles fill the picture row by row in a grid. Open surfaces are lit from both sides. Throws InputError naming a mesh
// that cannot be drawn (see judge_mesh: refused). The same bytes every time.
Image draw_meshes(const MeshPictureParams& params, std::span<const Mesh> meshes, std::span<const MeshTile> tiles);

}  // namespace trocar
