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

using Eight = __m256;
Eight product_difference(Eight a, Eight b, Eight c, Eight d) { return _mm256_sub_ps(_mm256_mul_ps(a, b), _mm256_mul_ps(c, d)); }

// Places of eight vertices, a vector per axis.
struct Places {
    Eight x, y, z;
};
template <typename Index>
Places load_places(const Float4* place, const Index& index) {
    const auto two = [&](size_t k) {
        return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(&place[index(k)].x)), _mm_load_ps(&place[index(k + 4)].x), 1);
    };
    const Eight a = two(0), b = two(1), c = two(2), d = two(3);
    const Eight ab = _mm256_unpacklo_ps(a, b), cd = _mm256_unpacklo_ps(c, d);
    const Eight high = _mm256_shuffle_ps(_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d), 0x44);
    return {_mm256_shuffle_ps(ab, cd, 0x44), _mm256_shuffle_ps(ab, cd, 0xee), high};
}
void store_rows(Eight x, Eight y, Eight z, Eight w, Float4* to) {
    const Eight xy = _mm256_unpacklo_ps(x, y), zw = _mm256_unpacklo_ps(z, w), xy2 = _mm256_unpackhi_ps(x, y),
                zw2 = _mm256_unpackhi_ps(z, w);
    const Eight row[4] = {_mm256_shuffle_ps(xy, zw, 0x44), _mm256_shuffle_ps(xy, zw, 0xee), _mm256_shuffle_ps(xy2, zw2, 0x44),
                          _mm256_shuffle_ps(xy2, zw2, 0xee)};
    for (size_t k = 0; k < 4; ++k) {
        _mm_store_ps(&to[k].x, _mm256_castps256_ps128(row[k]));
        _mm_store_ps(&to[k + 4].x, _mm256_extractf128_ps(row[k], 1));
    }
}

// Per triangle: its normal, twice as long as the triangle is large, and in w that length.
void find_normals(std::span<const Triangle> triangles, const std::vector<Float4>& place, std::vector<Float4>& normal) {
    normal.resize((triangles.size() + 7) / 8 * 8);
    for (size_t first = 0; first < triangles.size(); first += 8) {
        const auto corners = [&](size_t corner) {
            return load_places(place.data(), [&](size_t k) { return triangles[std::min(first + k, triangles.size() - 1)][corner]; });
        };
        const Places a = corners(0), b = corners(1), c = corners(2);
        const Places ab{_mm256_sub_ps(b.x, a.x), _mm256_sub_ps(b.y, a.y), _mm256_sub_ps(b.z, a.z)};
        const Places ac{_mm256_sub_ps(c.x, a.x), _mm256_sub_ps(c.y, a.y), _mm256_sub_ps(c.z, a.z)};
        const Eight x = product_difference(ab.y, ac.z, ab.z, ac.y), y = product_difference(ab.z, ac.x, ab.x, ac.z);
        const Eight z = product_difference(ab.x, ac.y, ab.y, ac.x);
        const Eight squared = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(x, x), _mm256_mul_ps(y, y)), _mm256_mul_ps(z, z));
        store_rows(x, y, z, _mm256_sqrt_ps(squared), &normal[first]);
    }
}

// Per vertex: the sum over its triangles.
void sum_normals(const MeshView& mesh, const std::vector<Float4>& normal, std::vector<Float4>& sum) {
    sum.resize((mesh.position.size() + 7) / 8 * 8);
    for (size_t v = 0; v < mesh.position.size(); ++v) {
        __m128 all = _mm_setzero_ps();
        for (uint32_t i = mesh.incident_first[v]; i < mesh.incident_first[v + 1]; ++i)
            all = _mm_add_ps(all, _mm_load_ps(&normal[mesh.incident[i]].x));
        _mm_store_ps(&sum[v].x, all);
    }
}

}  // namespace

void find_film_shape(const Surfaces& s, uint32_t body, uint32_t cells, const Vec3d& down, FilmShapeScratch& scratch, FilmShape& shape) {
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const auto vertices = static_cast<uint32_t>(mesh.position.size());
    find_places(s, body, vertices, cells, scratch.place);
    find_normals(mesh.triangle, scratch.place, scratch.normal);
    sum_normals(mesh, scratch.normal, scratch.sum);
    const Vec3d in_frame = is_deformable(s.bodies, body) ? down : rotate_back(s.poses.orientation[body], down);
    const Vec3 up = -in_frame.cast<float>();
    const Eight side = has_inside(s, body) ? _mm256_setzero_ps() : _mm256_set1_ps(-0.0f);  // of a sheet, that which is up
    for (auto* each : {&shape.height, &shape.inverse_area, &shape.upright, &shape.relief}) each->resize(cells);
    const auto fill = [](float x) { return _mm256_set1_ps(x); };
    const auto along_up = [&](const Places& p) {
        return _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(p.x, fill(up.x())), _mm256_mul_ps(p.y, fill(up.y()))),
                             _mm256_mul_ps(p.z, fill(up.z())));
    };
    const Eight zero = _mm256_setzero_ps(), one = fill(1);
    for (uint32_t v = 0; v < vertices; v += 8) {
        const auto next = [&](size_t k) { return v + k; };
        const Places n = load_places(scratch.sum.data(), next), p = load_places(scratch.place.data(), next);
        alignas(32) float twice[8];
        for (size_t k = 0; k < 8; ++k) twice[k] = scratch.sum[v + k].w;
        const Eight area = _mm256_div_ps(_mm256_load_ps(twice), fill(6)), along = _mm256_andnot_ps(side, along_up(n));
        const Eight squared = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(n.x, n.x), _mm256_mul_ps(n.y, n.y)), _mm256_mul_ps(n.z, n.z));
        const Eight is = _mm256_cmp_ps(squared, zero, _CMP_GT_OQ);
        const Eight cosine = _mm256_min_ps(_mm256_max_ps(_mm256_and_ps(_mm256_div_ps(along, _mm256_sqrt_ps(squared)), is), zero), one);
        const Eight steepness = _mm256_max_ps(_mm256_sub_ps(one, _mm256_mul_ps(cosine, cosine)), zero);
        _mm256_storeu_ps(&shape.height[v], along_up(p));
        _mm256_storeu_ps(&shape.inverse_area[v], _mm256_and_ps(_mm256_div_ps(one, area), _mm256_cmp_ps(area, zero, _CMP_GT_OQ)));
        _mm256_storeu_ps(&shape.upright[v], cosine);
        _mm256_storeu_ps(&shape.relief[v], _mm256_sqrt_ps(_mm256_mul_ps(area, steepness)));
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
