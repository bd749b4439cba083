#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Writes a surface in the format of the extension: .obj (with .mtl and PNG textures beside it), .stl
// (binary), .ply (binary, double positions), .wrl (VRML97, PNG textures beside it) or .vtp (ParaView's XML
// PolyData, text; no materials). Text has the fewest digits that give the same double when read; STL rounds
// to float. Keeps triangles, their order, texture coordinates and materials where the format allows. Writes
// all files completely or none. Throws InputError "file: reason".
void save_mesh(const Mesh& mesh, const std::filesystem::path& path);

// Values at the vertices of a surface, `components` per vertex.
struct PointField {
    std::string name;
    uint32_t components = 1;
    std::vector<float> values;
};
// Like save_mesh for .vtp, with fields. `note` becomes a comment at the top; it must not contain "--".
void save_vtp(const Mesh& mesh, std::span<const PointField> fields, const std::filesystem::path& path, const std::string& note = "");

}  // namespace trocar
