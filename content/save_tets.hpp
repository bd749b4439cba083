#pragma once
#include <filesystem>
#include <string>

#include "content/isosurface_stuffing.hpp"
namespace trocar {

// VTK XML unstructured grid (.vtu for ParaView): double points, appended raw, little endian.
std::string encode_vtu(const TetMesh& mesh);
// Gmsh MSH 2.2 ASCII (.msh): shortest digits that read back to the same double, one physical group 1.
std::string encode_msh(const TetMesh& mesh);

// Writes by the extension of the name, .vtu or .msh, whole or not at all. Throws InputError "file: reason".
void save_tets(const TetMesh& mesh, const std::filesystem::path& path);

}  // namespace trocar
