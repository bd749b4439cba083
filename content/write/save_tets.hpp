#pragma once
#include <filesystem>
#include <string>

#include "content/volume/isosurface_stuffing.hpp"
namespace trocar {

// VTK XML unstructured grid (.vtu for ParaView): double points, appended raw, little endian.
std::string encode_vtu(const TetMesh& mesh);
// Gmsh MSH 2.2 ASCII (.msh): the fewest digits that give the same double when read, one physical group 1.
std::string encode_msh(const TetMesh& mesh);

// Writes the format of the extension, .vtu or .msh, completely or not. Throws InputError "file: reason".
void save_tets(const TetMesh& mesh, const std::filesystem::path& path);

}  // namespace trocar
