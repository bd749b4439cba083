#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Writes a surface by the extension of the name: .obj (with .mtl and PNG textures beside it), .stl (binary), .ply
// (binary, double positions), .wrl (VRML97, PNG textures beside it) or .vtp (ParaView's XML PolyData, text; no looks).
// Text carries the shortest digits that read back to the same double; STL rounds to float. Triangles, their order, texture coordinates and
// materials are kept where the format has a place for them. All files are written whole or not at all. Throws InputError "file: reason".
void save_mesh(const Mesh& mesh, const std::filesystem::path& path);

// Numbers at the vertices of a surface: `components` of them a vertex.
struct PointField {
    std::string name;
    uint32_t components = 1;
    std::vector<float> values;
};
// A .vtp file with fields, as save_mesh writes it without. `note` is written as a comment at its head; without "--".
void save_vtp(const Mesh& mesh, std::span<const PointField> fields, const std::filesystem::path& path, const std::string& note = "");

}  // namespace trocar
