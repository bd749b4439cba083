#pragma once
#include <string_view>

#include "content/load_mesh.hpp"
namespace trocar {

// Whether the bytes begin with the line "ply".
bool looks_like_ply(std::string_view bytes);

// Reads PLY 1.0, ascii or binary of either byte order: element vertex (x, y, z of any scalar type; s t, u v or
// texture_u texture_v), element face (list vertex_indices or vertex_index; list texcoord of two numbers a corner),
// element tristrips (-1 begins a new strip). Text is read to double; other elements and properties are passed over,
// colours with a warning; "comment TextureFile" names the picture. An element the file is too short for is refused
// before anything is allocated. Throws InputError "file:line: reason", for binary data "file: element, row and reason".
LoadedMesh read_ply(std::string_view bytes, const std::filesystem::path& path);

// Likewise, and the numbers `property` of its vertices; InputError when there are none or one is not finite.
LoadedMesh read_painted_ply(std::string_view bytes, const std::filesystem::path& path, const std::string& property,
                            std::vector<double>& field);

}  // namespace trocar
