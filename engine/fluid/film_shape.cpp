#include "engine/fluid/film_shape.hpp"

#include <immintrin.h>

#include <cmath>
namespace trocar {
namespace {

// Vertices in the body's frame, with room for those that are padding.
void find_places(const Surfaces& s, uint32_t body, uint32_t vertices, uint32_t cells, std::vector<Float4>& place) {
    place.resize(cells);
    if (is_deformable(s.bodies, body)) {
        const auto* offset = s.particles.offset.data() + s.bodies.particles[body].first;
        std::copy_n(offset, vertices, place.begin());
        return;
    }
    const Vec3d* position = s.meshes.position.data() + s.meshes.info[s.bodies.mesh[body]].vertices.first;
    for (uint32_t v = 0; v < vertices; ++v)
        place[v] = {static_cast<float>(position[v].x()), static_cast<float>(position[v].y()), static_cast<float>(position[v].z()), 0};
}

__m128 rotate_lanes(__m128 v) { return _mm_shuffle_ps(v, v, _MM_SHUFFLE(3, 0, 2, 1)); }
__m128 cross(__m128 a, __m128 b) { return rotate_lanes(_mm_sub_ps(_mm_mul_ps(a, rotate_lanes(b)), _mm_mul_ps(rotate_lanes(a), b))); }

// Per vertex: the sum of its triangles' normals, each twice as long as the triangle is large; in w the sum of their lengths.
void sum_normals(std::span<const Triangle> triangles, const std::vector<Float4>& place, std::vector<Float4>& sum) {
    sum.assign(place.size(), Float4{});
    const auto at = [&](uint32_t v) { return _mm_load_ps(&place[v].x); };
    for (const Triangle& t : triangles) {
        const __m128 a = at(t[0]), n = cross(_mm_sub_ps(at(t[1]), a), _mm_sub_ps(at(t[2]), a));
        const float length = std::sqrt(_mm_cvtss_f32(_mm_dp_ps(n, n, 0x71)));
        const __m128 with_length = _mm_blend_ps(n, _mm_set1_ps(length), 8);
        for (const uint32_t v : t) _mm_store_ps(&sum[v].x, _mm_add_ps(_mm_load_ps(&sum[v].x), with_length));
    }
}

}  // namespace

void find_film_shape(const Surfaces& s, uint32_t body, uint32_t cells, const Vec3d& down, FilmShapeScratch& scratch, FilmShape& shape) {
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const auto vertices = static_cast<uint32_t>(mesh.position.size());
    find_places(s, body, vertices, cells, scratch.place);
    sum_normals(mesh.triangle, scratch.place, scratch.sum);
    const Vec3d in_frame = is_deformable(s.bodies, body) ? down : rotate_back(s.poses.orientation[body], down);
    const Vec3 up = -in_frame.cast<float>();
    const bool sheet = !has_inside(s, body);
    for (auto* each : {&shape.height, &shape.inverse_area, &shape.upright, &shape.relief}) each->resize(cells);
    for (uint32_t v = 0; v < vertices; ++v) {
        const Float4 &p = scratch.place[v], &n = scratch.sum[v];
        const float length = std::sqrt(n.x * n.x + n.y * n.y + n.z * n.z), area = n.w / 6;
        const float along = n.x * up.x() + n.y * up.y() + n.z * up.z();
        const float cosine = length > 0 ? (sheet ? std::abs(along) : along) / length : 0.0f;
        shape.height[v] = p.x * up.x() + p.y * up.y() + p.z * up.z();
        shape.inverse_area[v] = area > 0 ? 1 / area : 0.0f;
        shape.upright[v] = std::min(std::max(cosine, 0.0f), 1.0f);
        shape.relief[v] = std::sqrt(area * std::max(1 - cosine * cosine, 0.0f));
    }
    for (uint32_t v = vertices; v < cells; ++v) shape.height[v] = shape.inverse_area[v] = shape.upright[v] = shape.relief[v] = 0;
}

double capillary_length(const FluidParams& params, double gravity) {
    if (!(gravity > 0)) return std::numeric_limits<double>::infinity();
    return std::sqrt(params.surface_tension / (params.blood_density * gravity));
}

double hanging_drop(const FluidParams& params, double gravity) {
    const double capillary = capillary_length(params, gravity);
    return 4 * capillary * capillary * capillary;
}

}  // namespace trocar
