#pragma once
#include <string_view>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Reads Wavefront OBJ text: v, vt, f (ear-clipped polygons; negative numbers count from the end), usemtl and
// mtllib (Kd, Ks, Ns, d, map_Kd). Normals are checked and dropped, groups ignored. Not welded. Throws
// InputError "file:line: reason".
LoadedMesh read_obj(std::string_view text, const std::filesystem::path& path, const FileRoots& roots = {});

}  // namespace trocar
