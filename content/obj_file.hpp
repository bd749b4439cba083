#pragma once
#include <string_view>

#include "content/load_mesh.hpp"
namespace trocar {

// Reads Wavefront OBJ text: v, vt, f (polygons ear-clipped, negative numbers counted from the end), usemtl and mtllib
// (Kd, Ks, Ns, d, map_Kd); normals are checked and dropped, groups ignored. Not welded. Throws InputError "file:line:
// reason".
LoadedMesh read_obj(std::string_view text, const std::filesystem::path& path);

}  // namespace trocar
