#pragma once
#include <string_view>

#include "content/load_mesh.hpp"
namespace trocar {

// Whether the first word is OFF, with or without the prefixes ST, C and N.
bool looks_like_off(std::string_view bytes);

// Reads Geomview's OFF, text (to double; each vertex and each face begins a line, as every writer has it) or BINARY
// (big-endian floats). Texture coordinates of STOFF are kept, normals and colours dropped. Files of another dimension
// (4OFF, nOFF) and counts the file is too short for are refused. Throws InputError "file:line: reason".
LoadedMesh read_off(std::string_view bytes, const std::filesystem::path& path);

}  // namespace trocar
