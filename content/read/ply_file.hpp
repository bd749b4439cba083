#pragma once
#include <string_view>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Whether the bytes begin with the line "ply".
bool looks_like_ply(std::string_view bytes);

// Reads PLY 1.0, ascii or binary of either byte order: element vertex (x, y, z of any scalar type; s t, u v
// or texture_u texture_v), element face (list vertex_indices or vertex_index; list texcoord, two numbers per
// corner), element tristrips (-1 begins a new strip). Text is read to double. Skips other elements and
// properties, colours with a warning; "comment TextureFile" names the texture. Rejects elements larger than
// the file before allocating. Throws InputError "file:line: reason", binary: "file: element, row and reason".
LoadedMesh read_ply(std::string_view bytes, const std::filesystem::path& path, const FileRoots& roots);

// The same, and the vertex property `property`; InputError if it is missing or a value is not finite.
LoadedMesh read_painted_ply(std::string_view bytes, const std::filesystem::path& path, const std::string& property,
                            std::vector<double>& field);

}  // namespace trocar
