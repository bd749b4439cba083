#pragma once
#include <span>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Polygons of a file in flat form: polygon k has the corners from end[k - 1] (0 for the first) to end[k].
struct PolygonList {
    std::vector<uint32_t> corner;  // point indices
    std::vector<uint32_t> end;
    std::vector<Vec2> corner_uv;  // one per corner, or empty
    std::vector<Vec2> point_uv;   // one per point, or empty; used if corner_uv is empty
};

// A texture coordinate from a file; zero if it is not finite.
Vec2 texture_coordinate(double u, double v);

// Appends a strip as triangles with the orientation of its first one; triangles with two equal corners only
// advance the strip and are left out.
void add_strip(std::span<const uint32_t> corner, PolygonList& polygons);

// Triangulates the polygons into a mesh that already has its points: clips ears; drops polygons with fewer
// than three corners with a warning. Throws InputError naming the first polygon with an invalid point index.
void cut_polygons(const PolygonList& polygons, LoadedMesh& loaded, const std::filesystem::path& path);

}  // namespace trocar
