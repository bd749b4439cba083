#pragma once
#include <string_view>

#include "content/load_mesh.hpp"
namespace trocar {

// Whether the bytes begin with "# vtk DataFile".
bool looks_like_vtk(std::string_view bytes);

// Reads legacy VTK PolyData (versions 1.0 to 5.1), ASCII (to double) or BINARY (big-endian): POINTS, POLYGONS and
// TRIANGLE_STRIPS. Lines, vertices and fields are passed over, data of points and cells with a warning. Other data sets
// and counts the file is too short for are refused. Throws InputError "file:line: reason".
LoadedMesh read_vtk(std::string_view bytes, const std::filesystem::path& path);

}  // namespace trocar
