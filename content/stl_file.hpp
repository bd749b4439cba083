#pragma once
#include <string_view>

#include "content/load_mesh.hpp"
namespace trocar {

// Whether the bytes have exactly the size their facet count (bytes 80 to 83) asks for, whatever word they begin with.
bool is_binary_stl(std::string_view bytes);

// Reads STL as three vertices a facet, not welded; normals and colours are dropped. Binary coordinates are floats, text
// is read to double. A facet count the file is too short for is refused before anything is allocated. Throws
// InputError.
LoadedMesh read_binary_stl(std::string_view bytes, const std::filesystem::path& path);
LoadedMesh read_ascii_stl(std::string_view text, const std::filesystem::path& path);

}  // namespace trocar
