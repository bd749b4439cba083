#pragma once
#include <string_view>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Whether the first word is OFF, with or without the prefixes ST, C and N.
bool looks_like_off(std::string_view bytes);

// Reads Geomview's OFF, text (to double; each vertex and each face starts a line, as all writers do) or
// BINARY (big-endian floats). Keeps texture coordinates of STOFF, drops normals and colours. Rejects other
// dimensions (4OFF, nOFF) and counts larger than the file can hold. Throws InputError "file:line: reason".
LoadedMesh read_off(std::string_view bytes, const std::filesystem::path& path);

}  // namespace trocar
