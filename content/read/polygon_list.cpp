#include "content/read/polygon_list.hpp"

#include <cmath>

#include "content/text/polygon.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

void check_corners(const PolygonList& list, size_t polygon, uint32_t first, size_t points, const std::filesystem::path& path) {
    for (uint32_t k = first; k < list.end[polygon]; ++k) {
        if (list.corner[k] < points) continue;
        throw InputError(path.string() + ": polygon " + std::to_string(polygon) + " (from 0) has corner " + std::to_string(list.corner[k]) +
                         " when there are " + std::to_string(points) + " points");
    }
}

void add_triangle(const PolygonList& list, uint32_t first, const Triangle& t, Mesh& mesh) {
    std::array<Vec2, 3> uv;
    Triangle point;
    for (size_t k = 0; k < 3; ++k) {
        point[k] = list.corner[first + t[k]];
        if (!list.corner_uv.empty()) {
            uv[k] = list.corner_uv[first + t[k]];
        } else if (!list.point_uv.empty()) {
            uv[k] = list.point_uv[point[k]];
        }
    }
    mesh.triangle.push_back(point);
    if (!list.corner_uv.empty() || !list.point_uv.empty()) mesh.uv.push_back(uv);
}

}  // namespace

Vec2 texture_coordinate(double u, double v) {
    const Vec2 uv{static_cast<float>(u), static_cast<float>(v)};
    return std::isfinite(uv.u) && std::isfinite(uv.v) ? uv : Vec2{};
}

void add_strip(std::span<const uint32_t> corner, PolygonList& polygons) {
    for (size_t k = 2; k < corner.size(); ++k) {
        const size_t odd = k % 2;
        const uint32_t a = corner[k - 2 + odd], b = corner[k - 1 - odd], c = corner[k];
        if (a == b || b == c || c == a) continue;
        polygons.corner.insert(polygons.corner.end(), {a, b, c});
        polygons.end.push_back(static_cast<uint32_t>(polygons.corner.size()));
    }
}

void cut_polygons(const PolygonList& list, LoadedMesh& loaded, const std::filesystem::path& path) {
    Mesh& mesh = loaded.mesh;
    PolygonScratch scratch;
    std::vector<Vec3d> corner;
    std::vector<Triangle> cut;
    uint64_t fanned = 0, few = 0;
    if (list.corner.size() > 2 * list.end.size()) mesh.triangle.reserve(list.corner.size() - 2 * list.end.size());
    uint32_t first = 0;
    for (size_t p = 0; p < list.end.size(); first = list.end[p++]) {
        check_corners(list, p, first, mesh.position.size(), path);
        const uint32_t n = list.end[p] - first;
        if (n < 3) {
            ++few;
        } else if (n == 3) {
            add_triangle(list, first, {0, 1, 2}, mesh);
        } else {
            corner.clear();
            for (uint32_t k = first; k < list.end[p]; ++k) corner.push_back(mesh.position[list.corner[k]]);
            cut.clear();
            if (!triangulate_polygon(corner, scratch, cut)) ++fanned;
            for (const Triangle& t : cut) add_triangle(list, first, t, mesh);
        }
    }
    const auto note = [&](uint64_t count, const char* what) {
        if (count > 0) loaded.warnings.push_back(path.string() + ": " + std::to_string(count) + what);
    };
    note(few, " polygons dropped: fewer than three corners");
    note(fanned, " polygons cut as a fan: crossing themselves or without area");
}

}  // namespace trocar
