#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/mesh.hpp"
#include "components/picture.hpp"
namespace trocar {

// One part of a picture of meshes.
struct MeshTile {
    uint32_t mesh = 0;     // index into the drawn meshes
    double azimuth = 0;    // radians, as in Camera
    double elevation = 0;  // radians
    std::string label;     // drawn at the upper left; may be empty
};

struct MeshPictureParams {
    uint32_t width = 1024;
    uint32_t height = 768;
    Vec3d up = Vec3d::UnitZ();
    bool wireframe = false;
    bool sizes = false;  // writes the size of each mesh into its tiles, in units of the mesh
};

// Front (seen from -y when z is up), side (from +x), top and an oblique view of one mesh.
std::vector<MeshTile> four_views(uint32_t mesh);

// Draws meshes of any unit and position without a scene, textured and lit. Each tile shows one mesh, fitted
// to the tile; tiles fill a grid row by row. Open surfaces are lit on both sides. Output is deterministic to
// the byte. Throws InputError naming a mesh that cannot be drawn (see judge_mesh: refused).
Image draw_meshes(const MeshPictureParams& params, std::span<const Mesh> meshes, std::span<const MeshTile> tiles);

}  // namespace trocar
