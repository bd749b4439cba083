#pragma once
#include <string_view>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Whether the bytes begin with "# vtk DataFile".
bool looks_like_vtk(std::string_view bytes);

// Reads legacy VTK PolyData (versions 1.0 to 5.1), ASCII (to double) or BINARY (big-endian): POINTS, POLYGONS
// and TRIANGLE_STRIPS. Skips lines, vertices and fields, and point and cell data with a warning. Rejects
// other data sets and counts larger than the file can hold. Throws InputError "file:line: reason".
LoadedMesh read_vtk(std::string_view bytes, const std::filesystem::path& path);

}  // namespace trocar
