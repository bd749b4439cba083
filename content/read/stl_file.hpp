#pragma once
#include <string_view>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Whether the size is exactly what the facet count (bytes 80 to 83) requires, whatever the first word.
bool is_binary_stl(std::string_view bytes);

// Reads STL as three vertices per facet, not welded; drops normals and colours. Binary coordinates are
// floats, text is read to double. Rejects facet counts larger than the file before allocating. Throws
// InputError.
LoadedMesh read_binary_stl(std::string_view bytes, const std::filesystem::path& path);
LoadedMesh read_ascii_stl(std::string_view text, const std::filesystem::path& path);

}  // namespace trocar
