#pragma once
#include <span>

#include "content/load_mesh.hpp"
namespace trocar {

// Polygons as a file lists them, flat: polygon k has the corners from end[k - 1] (0 for the first) to end[k].
struct PolygonList {
    std::vector<uint32_t> corner;  // point numbers
    std::vector<uint32_t> end;
    std::vector<Vec2> corner_uv;  // as corner, or empty
    std::vector<Vec2> point_uv;   // one per point, or empty; used when corner_uv is empty
};

// A texture coordinate from a file; zero where it is not finite.
Vec2 texture_coordinate(double u, double v);

// Appends a strip as triangles that all turn the way its first does; those with two equal corners only move the strip
// on and are left out.
void add_strip(std::span<const uint32_t> corner, PolygonList& polygons);

// Cuts the polygons into the triangles of a mesh that has its points already: ears are clipped, polygons with fewer
// than three corners dropped and counted in a warning. Throws InputError that names the first polygon with a corner
// beyond the points.
void cut_polygons(const PolygonList& polygons, LoadedMesh& loaded, const std::filesystem::path& path);

}  // namespace trocar
