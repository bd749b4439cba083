#include "engine/fluid/film.hpp"

#include <immintrin.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
namespace trocar {
namespace {

// Part of a cell that may leave it over one edge in a substep: a cell has about three edges downhill.
constexpr float kMostOut = 0.35f;
// Of the longest step at which waves between cells are stable.
constexpr float kWaveCourant = 0.5f;
// By how much of its last change the surface is thought ahead where it drives the flow: damps waves of a cell's length and no
// steady flow. Twice the 0.1 of Skamarock & Klemp, Monthly Weather Review 120, 1992, because the bottom is rough.
constexpr float kAhead = 0.2f;
constexpr float kLeastUpright = 0.05f;

// Finds the blocks of edges and of cells that liquid may flow over and between. False if nothing flows.
bool find_active(const FilmShape& shape, const Film& film, FilmScratch& s) {
    const size_t cells = film.volume.size(), edges = film.from.size();
    uint8_t any = 0;
    for (size_t v = 0; v < cells; ++v) {
        s.wet[v] = static_cast<float>(film.volume[v]) * shape.inverse_area[v] > kThinnestFilm;
        any |= s.wet[v];
    }
    s.block.clear(), s.cells.clear();
    if (!any) return false;
    std::fill(s.beside.begin(), s.beside.end(), uint8_t{0});
    for (uint32_t first = 0; first < edges; first += kFilmBlock) {
        uint8_t flows = 0;
        for (size_t e = first; e < first + kFilmBlock; ++e) flows |= s.wet[film.from[e]] | s.wet[film.to[e]];
        if (!flows) continue;
        s.block.push_back(first);
        for (size_t e = first; e < first + kFilmBlock; ++e) s.beside[film.from[e] / kFilmBlock] = s.beside[film.to[e] / kFilmBlock] = 1;
    }
    for (uint32_t k = 0; k < s.beside.size(); ++k)
        if (s.beside[k]) s.cells.push_back(k * kFilmBlock);
    return true;
}

// visit(cell) for all cells of those blocks.
template <typename Visit>
void each_cell(const FilmScratch& s, const Visit& visit) {
    for (const uint32_t first : s.cells)
        for (size_t v = first; v < first + kFilmBlock; ++v) visit(v);
}

using Eight = __m256;
struct Rows {
    Eight row[8];
    Eight& operator[](size_t k) { return row[k]; }
    const Eight& operator[](size_t k) const { return row[k]; }
};
Eight fill(float x) { return _mm256_set1_ps(x); }
Eight load_eight(const float* p) { return _mm256_loadu_ps(p); }
Eight to_floats8(const double* p) { return _mm256_set_m128(_mm256_cvtpd_ps(_mm256_loadu_pd(p + 4)), _mm256_cvtpd_ps(_mm256_loadu_pd(p))); }
Eight magnitude(Eight x) { return _mm256_andnot_ps(fill(-0.0f), x); }
float largest_of(Eight x) {
    alignas(32) float lane[8];
    _mm256_store_ps(lane, x);
    return *std::max_element(lane, lane + 8);
}

// Eight rows of eight numbers to eight columns, in place.
void transpose(Rows& r) {
    Rows t;
    for (size_t k = 0; k < 8; k += 2) t[k] = _mm256_unpacklo_ps(r[k], r[k + 1]), t[k + 1] = _mm256_unpackhi_ps(r[k], r[k + 1]);
    for (size_t k = 0; k < 8; k += 4) {
        r[k] = _mm256_shuffle_ps(t[k], t[k + 2], 0x44), r[k + 1] = _mm256_shuffle_ps(t[k], t[k + 2], 0xee);
        r[k + 2] = _mm256_shuffle_ps(t[k + 1], t[k + 3], 0x44), r[k + 3] = _mm256_shuffle_ps(t[k + 1], t[k + 3], 0xee);
    }
    for (size_t k = 0; k < 4; ++k)
        t[k] = _mm256_permute2f128_ps(r[k], r[k + 4], 0x20), t[k + 4] = _mm256_permute2f128_ps(r[k], r[k + 4], 0x31);
    r = t;
}

// Cubic step from 0 at half the relief to 1 at the relief.
Eight levelness8(Eight thickness, Eight relief) {
    const Eight ratio = _mm256_div_ps(_mm256_add_ps(thickness, thickness), _mm256_add_ps(relief, fill(1e-9f)));
    const Eight t = _mm256_min_ps(_mm256_max_ps(_mm256_sub_ps(ratio, fill(1)), _mm256_setzero_ps()), fill(1));
    return _mm256_mul_ps(_mm256_mul_ps(t, t), _mm256_sub_ps(fill(3), _mm256_add_ps(t, t)));
}

// nu of the mixture, m^2/s.
struct Mixture {
    Eight fluidity, more_fluidity, density, more_density;  // of water, and of blood less that
    explicit Mixture(const FluidParams& p)
        : fluidity(fill(static_cast<float>(1 / p.water_viscosity))),
          more_fluidity(fill(static_cast<float>(1 / p.blood_viscosity - 1 / p.water_viscosity))),
          density(fill(static_cast<float>(p.water_density))),
          more_density(fill(static_cast<float>(p.blood_density - p.water_density))) {}
    Eight viscosity(Eight blood) const {
        const Eight f = _mm256_add_ps(fluidity, _mm256_mul_ps(blood, more_fluidity));
        return _mm256_div_ps(fill(1), _mm256_mul_ps(f, _mm256_add_ps(density, _mm256_mul_ps(blood, more_density))));
    }
};

// What drives and drags the liquid of eight cells; returns 1 / the longest stable step for waves between them,
// a dt^2 < 4 + 2 (f / h^2) dt with a = 2 g h d(surface)/dh sum(conductance) / area. 1/s
Eight look_at_eight(const Mixture& mixture, float gravity, const FilmShape& shape, const Film& film, size_t v, FilmScratch& s) {
    const auto mul = [](Eight a, Eight b) { return _mm256_mul_ps(a, b); };
    const auto add = [](Eight a, Eight b) { return _mm256_add_ps(a, b); };
    const auto sub = [](Eight a, Eight b) { return _mm256_sub_ps(a, b); };
    const auto div = [](Eight a, Eight b) { return _mm256_div_ps(a, b); };
    const Eight zero = _mm256_setzero_ps(), one = fill(1), g = fill(gravity);
    const Eight volume = to_floats8(&s.volume[v]), up = load_eight(&shape.upright[v]), inverse_area = load_eight(&shape.inverse_area[v]);
    const Eight inverse = div(one, add(volume, fill(1e-30f))), blood = _mm256_min_ps(mul(to_floats8(&s.blood[v]), inverse), one);
    const Eight h = mul(volume, inverse_area), nu = mixture.viscosity(blood);
    const Eight down = div(one, _mm256_max_ps(up, fill(kLeastUpright)));
    const Eight level = _mm256_and_ps(levelness8(h, load_eight(&shape.relief[v])), _mm256_cmp_ps(up, zero, _CMP_GT_OQ));
    const Eight above = mul(h, add(up, mul(level, sub(down, up))));
    // waves on a deep pool lose most in the layer that they drag along the ground, sqrt(nu omega / 2) per depth (Landau & Lifshitz,
    // Fluid Mechanics, section 25), with the frequency of waves as long as the pool is deep
    const Eight omega = _mm256_sqrt_ps(div(g, add(h, fill(1e-9f))));
    const Eight deep = _mm256_max_ps(sub(mul(h, _mm256_sqrt_ps(mul(fill(0.5f), mul(nu, omega)))), mul(fill(9), nu)), zero);
    const Eight drag = add(mul(fill(3), nu), mul(level, deep));
    // at most d(surface)/dh: while the surface turns level it rises faster
    const Eight turning = _mm256_and_ps(_mm256_cmp_ps(level, zero, _CMP_GT_OQ), _mm256_cmp_ps(level, one, _CMP_LT_OQ));
    const Eight flat = _mm256_blendv_ps(down, up, _mm256_cmp_ps(level, zero, _CMP_LE_OQ));
    const Eight steep = _mm256_blendv_ps(flat, add(down, mul(fill(3), sub(down, up))), turning);
    const Eight a = mul(mul(mul(fill(2), g), mul(h, steep)), mul(load_eight(&film.crowding[v]), inverse_area)), h2 = mul(h, h);
    Rows row{{load_eight(&shape.height[v]), add(above, mul(fill(kAhead), sub(above, load_eight(&film.rise[v])))),
              _mm256_and_ps(h, _mm256_cmp_ps(h, fill(kThinnestFilm), _CMP_GT_OQ)), drag, blood, inverse, zero, zero}};
    transpose(row);
    for (size_t k = 0; k < 8; ++k) _mm256_store_ps(&s.cell[v + k].height, row[k]);
    _mm256_storeu_ps(&s.rise[v], above);
    _mm256_storeu_ps(&s.stiffness[v], a);
    const Eight root = _mm256_sqrt_ps(add(mul(drag, drag), mul(mul(fill(4), a), mul(h2, h2))));
    return div(mul(a, h2), add(add(drag, root), fill(1e-30f)));
}

// 1/s, over the longest stable step of all.
float look_at_cells(const FluidParams& params, float gravity, const FilmShape& shape, const Film& film, FilmScratch& s) {
    const Mixture mixture(params);
    Eight most = _mm256_setzero_ps();
    for (const uint32_t v : s.cells) most = _mm256_max_ps(most, look_at_eight(mixture, gravity, shape, film, v, s));
    return largest_of(most);
}

// Drags those cells more whose waves the step does not resolve.
void damp_unresolved(float dt, FilmScratch& s) {
    each_cell(s, [&](size_t v) {
        const float needed = s.stiffness[v] * dt * dt / (kWaveCourant * kWaveCourant) - 4, h = s.cell[v].thickness;
        s.cell[v].drag = std::max(s.cell[v].drag, h * h * needed / (2 * dt));
    });
}

// Flows over eight edges after a step. From thick to thin the weight of the liquid is driven by the mean of what both sides carry
// (the integral of h^3 between them), all other flow by what it comes from.
Eight flow_eight(float gravity, float dt, const Rows& a, const Rows& b, Eight before) {
    const auto mul = [](Eight x, Eight y) { return _mm256_mul_ps(x, y); };
    const auto add = [](Eight x, Eight y) { return _mm256_add_ps(x, y); };
    const auto sub = [](Eight x, Eight y) { return _mm256_sub_ps(x, y); };
    const Eight zero = _mm256_setzero_ps();
    const Eight step = sub(a[0], b[0]), push = sub(a[1], b[1]), fall = add(step, push), forward = _mm256_cmp_ps(fall, zero, _CMP_GE_OQ);
    const Eight h = _mm256_blendv_ps(b[2], a[2], forward), less = _mm256_min_ps(a[2], b[2]);
    const Eight all = add(add(magnitude(push), magnitude(step)), fill(1e-12f));
    const Eight half_share = _mm256_div_ps(mul(fill(0.5f), magnitude(push)), all);
    const Eight h1 = sub(h, mul(half_share, sub(h, less)));
    const Eight h2 = sub(mul(h, h), mul(half_share, sub(mul(h, h), mul(less, less))));
    const Eight drag = _mm256_blendv_ps(b[3], a[3], forward);
    const Eight driven = add(before, mul(mul(fill(gravity * dt), h1), fall));
    const Eight flow = mul(driven, _mm256_div_ps(h2, add(h2, mul(drag, fill(dt)))));
    const Eight donor = _mm256_blendv_ps(b[2], a[2], _mm256_cmp_ps(flow, zero, _CMP_GE_OQ));
    return _mm256_and_ps(flow, _mm256_cmp_ps(donor, zero, _CMP_GT_OQ));
}

// Flows after a step, what they move, and the largest part of a cell that leaves it over one edge.
float flow_edges(float gravity, float dt, const Film& film, FilmScratch& s) {
    Eight most = _mm256_setzero_ps();
    for (const uint32_t first : s.block) {
        Rows a, b;
        for (size_t k = 0; k < 8; ++k) {
            a[k] = _mm256_load_ps(&s.cell[film.from[first + k]].height);
            b[k] = _mm256_load_ps(&s.cell[film.to[first + k]].height);
        }
        transpose(a), transpose(b);
        const Eight flow = flow_eight(gravity, dt, a, b, load_eight(&film.flow[first]));
        const Eight outward = _mm256_cmp_ps(flow, _mm256_setzero_ps(), _CMP_GE_OQ);
        const Eight moved = _mm256_mul_ps(_mm256_mul_ps(load_eight(&film.conductance[first]), fill(dt)), flow);
        most = _mm256_max_ps(most, _mm256_mul_ps(magnitude(moved), _mm256_blendv_ps(b[5], a[5], outward)));
        _mm256_storeu_ps(&s.flow[first], flow);
        _mm256_storeu_ps(&s.moved[first], moved);
        _mm256_storeu_ps(&s.dye[first], _mm256_mul_ps(moved, _mm256_blendv_ps(b[4], a[4], outward)));
    }
    return largest_of(most);
}

void move_liquid(const Film& film, FilmScratch& s) {
    double *volume = s.volume.data(), *blood = s.blood.data();
    for (const uint32_t first : s.block) {
        for (size_t e = first; e < first + kFilmBlock; ++e) {
            const uint32_t a = film.from[e], b = film.to[e];
            const double m = static_cast<double>(s.moved[e]), dye = static_cast<double>(s.dye[e]);
            volume[a] -= m, volume[b] += m;
            blood[a] -= dye, blood[b] += dye;
        }
    }
}

// Scales flows down where a cell would give more than it has, less what rounding may take.
void spare_cells(const Film& film, FilmScratch& s) {
    each_cell(s, [&](size_t v) { s.out[v] = 0; });
    const auto each_edge = [&](const auto& visit) {
        for (const uint32_t first : s.block)
            for (size_t e = first; e < first + kFilmBlock; ++e) visit(e, s.moved[e] >= 0 ? film.from[e] : film.to[e]);
    };
    each_edge([&](size_t e, uint32_t from) { s.out[from] += std::abs(s.moved[e]); });
    each_cell(s, [&](size_t v) {
        const float has = 0.999f * static_cast<float>(film.volume[v]);
        s.out[v] = s.out[v] > has ? has / s.out[v] : 1.0f;
    });
    each_edge([&](size_t e, uint32_t from) { s.flow[e] *= s.out[from], s.moved[e] *= s.out[from], s.dye[e] *= s.out[from]; });
}

bool any_overdrawn(const FilmScratch& s) {
    uint64_t signs = 0;
    each_cell(s, [&](size_t v) { signs |= std::bit_cast<uint64_t>(s.volume[v]) | std::bit_cast<uint64_t>(s.blood[v]); });
    return signs >> 63 != 0;
}

void load_amounts(const Film& film, FilmScratch& s) {
    each_cell(s, [&](size_t v) { s.volume[v] = film.volume[v], s.blood[v] = film.blood[v]; });
}

void take_over(const Film& film, const FilmScratch& s) {
    each_cell(s, [&](size_t v) { film.volume[v] = s.volume[v], film.blood[v] = s.blood[v], film.rise[v] = s.rise[v]; });
    for (const uint32_t first : s.block) std::copy_n(s.flow.begin() + first, kFilmBlock, film.flow.begin() + first);
}

void resize(const Film& film, FilmScratch& s) {
    const size_t cells = film.volume.size(), edges = film.from.size();
    for (auto* each : {&s.rise, &s.stiffness, &s.out}) each->resize(cells);
    for (auto* each : {&s.volume, &s.blood}) each->resize(cells);
    for (auto* each : {&s.flow, &s.moved, &s.dye}) each->resize(edges);
    s.cell.resize(cells), s.wet.resize(cells), s.beside.resize(cells / kFilmBlock);
    s.block.reserve(edges / kFilmBlock), s.cells.reserve(cells / kFilmBlock);
}

}  // namespace

float levelness(float thickness, float relief) {
    const float t = std::clamp(2 * thickness / (relief + 1e-9f) - 1, 0.0f, 1.0f);
    return t * t * (3 - 2 * t);
}

float liquid_rise(float thickness, float upright, float relief) {
    if (!(upright > 0)) return 0;
    return thickness * (upright + levelness(thickness, relief) * (1 / std::max(upright, kLeastUpright) - upright));
}

void flow_film(const FluidParams& params, double gravity, double seconds, const FilmShape& shape, const Film& film, FilmScratch& s) {
    resize(film, s);
    s.substeps = 0;
    const double shortest = seconds / kMostSubsteps;
    const float g = static_cast<float>(gravity);
    double left = seconds, dt = *film.step > 0 ? std::min(*film.step, seconds) : shortest;
    for (uint32_t turn = 0; left > 1e-9 * seconds; ++turn) {
        // liquid passes a third of a cell in a substep
        if (turn % 3 == 0 && !find_active(shape, film, s)) break;
        load_amounts(film, s);
        const float rate = look_at_cells(params, g, shape, film, s);
        const double stable = rate > 0 ? static_cast<double>(kWaveCourant / rate) : seconds;
        double step = std::min(std::max(std::min(dt, stable), shortest), left);
        if (step > stable) damp_unresolved(static_cast<float>(step), s);
        float most = flow_edges(g, static_cast<float>(step), film, s);
        ++s.substeps;
        if (most > 2 * kMostOut && step > shortest) {
            dt = std::max(shortest, 0.5 * step);
            continue;
        }
        move_liquid(film, s);
        if (any_overdrawn(s)) {
            spare_cells(film, s);
            load_amounts(film, s);
            move_liquid(film, s);
        }
        take_over(film, s);
        left -= step;
        dt = step * static_cast<double>(std::clamp(kMostOut / std::max(most, 1e-6f), 0.5f, 2.0f));
    }
    *film.step = std::clamp(dt, shortest, seconds);
}

void order_edges(std::span<const std::array<uint32_t, 2>> edge, uint32_t vertices, std::span<uint32_t> order) {
    // the first edge of every lower vertex, then the second of each, ...
    std::vector<uint32_t> taken(vertices, 0), turn(edge.size());
    uint32_t turns = 0;
    for (size_t e = 0; e < edge.size(); ++e) turn[e] = taken[edge[e][0]]++, turns = std::max(turns, turn[e] + 1);
    size_t at = 0;
    for (uint32_t t = 0; t < turns; ++t)
        for (uint32_t e = 0; e < edge.size(); ++e)
            if (turn[e] == t) order[at++] = e;
}

void compute_conductances(std::span<const Vec3d> position, std::span<const std::array<uint32_t, 3>> triangle,
                          std::span<const std::array<uint32_t, 3>> triangle_edge, std::span<const std::array<uint32_t, 2>> edge,
                          std::span<float> conductance) {
    std::vector<double> sum(conductance.size(), 0.0), area(position.size(), 0.0);
    double all = 0;
    for (size_t t = 0; t < triangle.size(); ++t) {
        for (size_t k = 0; k < 3; ++k) {
            const Vec3d apex = position[triangle[t][(k + 2) % 3]];
            const Vec3d a = position[triangle[t][k]] - apex, b = position[triangle[t][(k + 1) % 3]] - apex;
            const double twice = a.cross(b).norm();
            if (twice > 0) sum[triangle_edge[t][k]] += 0.5 * a.dot(b) / twice;
            area[triangle[t][k]] += twice / 6, all += twice / 6;
        }
    }
    // in a mesh of regular triangles an edge conducts 1/sqrt(3), and a cell has the mean area
    const double most = position.empty() || !(all > 0) ? 0 : 4 / std::sqrt(3.0) * static_cast<double>(position.size()) / all;
    for (size_t e = 0; e < sum.size(); ++e)
        conductance[e] = static_cast<float>(std::clamp(sum[e], 0.0, most * std::min(area[edge[e][0]], area[edge[e][1]])));
}

}  // namespace trocar
