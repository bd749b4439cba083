#pragma once
#include <string_view>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Whether the bytes are XML with a VTKFile element.
bool looks_like_vtp(std::string_view bytes);

// Reads VTK's XML PolyData with arrays in ascii, as save_mesh writes it: the polygons and strips of all pieces, texture
// coordinates of points (named by TCoords) or of corners ("texture_coordinates"), the material of each face ("material").
// Text is read to double. Throws InputError "file: reason".
LoadedMesh read_vtp(std::string_view bytes, const std::filesystem::path& path);

}  // namespace trocar
