#include "engine/fluid/film.hpp"

#include <immintrin.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
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

using Eight = __m256;
struct Four {
    Eight at[4];
};
struct Two {
    Eight at[2];
};
Eight fill(float x) { return _mm256_set1_ps(x); }
Eight load_eight(const float* p) { return _mm256_loadu_ps(p); }
Eight to_floats8(const double* p) { return _mm256_set_m128(_mm256_cvtpd_ps(_mm256_loadu_pd(p + 4)), _mm256_cvtpd_ps(_mm256_loadu_pd(p))); }
Eight magnitude(Eight x) { return _mm256_andnot_ps(fill(-0.0f), x); }
Eight add(Eight a, Eight b) { return _mm256_add_ps(a, b); }
Eight sub(Eight a, Eight b) { return _mm256_sub_ps(a, b); }
Eight mul(Eight a, Eight b) { return _mm256_mul_ps(a, b); }
Eight div(Eight a, Eight b) { return _mm256_div_ps(a, b); }
Eight choose(Eight mask, Eight yes, Eight no) { return _mm256_blendv_ps(no, yes, mask); }
float largest_of(Eight x) {
    alignas(32) float lane[8];
    _mm256_store_ps(lane, x);
    return *std::max_element(lane, lane + 8);
}

// Eight cells' records to one vector per member, and back.
Four load_cells(const FilmScratch::Cell* cell, const uint32_t* index) {
    const auto two = [&](size_t k) {
        return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_load_ps(&cell[index[k]].height)), _mm_load_ps(&cell[index[k + 4]].height),
                                    1);
    };
    const Eight a = two(0), b = two(1), c = two(2), d = two(3);
    const Eight ab = _mm256_unpacklo_ps(a, b), cd = _mm256_unpacklo_ps(c, d), ab2 = _mm256_unpackhi_ps(a, b),
                cd2 = _mm256_unpackhi_ps(c, d);
    return {{_mm256_shuffle_ps(ab, cd, 0x44), _mm256_shuffle_ps(ab, cd, 0xee), _mm256_shuffle_ps(ab2, cd2, 0x44),
             _mm256_shuffle_ps(ab2, cd2, 0xee)}};
}
void store_cells(const Four& v, FilmScratch::Cell* cell) {
    const Eight ab = _mm256_unpacklo_ps(v.at[0], v.at[1]), cd = _mm256_unpacklo_ps(v.at[2], v.at[3]);
    const Eight ab2 = _mm256_unpackhi_ps(v.at[0], v.at[1]), cd2 = _mm256_unpackhi_ps(v.at[2], v.at[3]);
    const Eight row[4] = {_mm256_shuffle_ps(ab, cd, 0x44), _mm256_shuffle_ps(ab, cd, 0xee), _mm256_shuffle_ps(ab2, cd2, 0x44),
                          _mm256_shuffle_ps(ab2, cd2, 0xee)};
    for (size_t k = 0; k < 4; ++k) {
        _mm_store_ps(&cell[k].height, _mm256_castps256_ps128(row[k]));
        _mm_store_ps(&cell[k + 4].height, _mm256_extractf128_ps(row[k], 1));
    }
}

// Pairs of numbers in memory to two vectors, and back.
Two load_donors(const FilmScratch::Donor* donor, const uint32_t* index) {
    const auto pair = [&](size_t k) { return reinterpret_cast<const __m128i*>(&donor[index[k]]); };
    const auto two = [&](size_t k) { return _mm_castsi128_ps(_mm_unpacklo_epi64(_mm_loadl_epi64(pair(k)), _mm_loadl_epi64(pair(k + 1)))); };
    const Eight a = _mm256_set_m128(two(4), two(0)), b = _mm256_set_m128(two(6), two(2));
    return {{_mm256_shuffle_ps(a, b, 0x88), _mm256_shuffle_ps(a, b, 0xdd)}};
}
void store_pairs(Eight first, Eight second, float* to) {
    const Eight low = _mm256_unpacklo_ps(first, second), high = _mm256_unpackhi_ps(first, second);
    _mm256_storeu_ps(to, _mm256_permute2f128_ps(low, high, 0x20));
    _mm256_storeu_ps(to + 8, _mm256_permute2f128_ps(low, high, 0x31));
}
// Volumes and blood of eight cells.
Two load_amounts(const FilmScratch::Amount* amount) {
    const auto two = [&](size_t k) { return _mm256_cvtpd_ps(_mm256_loadu_pd(&amount[k].volume)); };
    const Eight a = _mm256_set_m128(two(4), two(0)), b = _mm256_set_m128(two(6), two(2));
    return {{_mm256_shuffle_ps(a, b, 0x88), _mm256_shuffle_ps(a, b, 0xdd)}};
}

// Cubic step from 0 at half the relief to 1 at the relief; `fullness` = 2 / relief.
Eight levelness8(Eight thickness, Eight fullness) {
    const Eight t = _mm256_min_ps(_mm256_max_ps(sub(mul(thickness, fullness), fill(1)), _mm256_setzero_ps()), fill(1));
    return mul(mul(t, t), sub(fill(3), add(t, t)));
}

// Wet or not, of eight cells.
void mark_wet(Eight thickness, uint8_t* wet) {
    const auto bits = static_cast<uint64_t>(_mm256_movemask_ps(_mm256_cmp_ps(thickness, fill(kThinnestFilm), _CMP_GT_OQ)));
    const uint64_t bytes = _pdep_u64(bits, 0x0101010101010101u);
    std::memcpy(wet, &bytes, sizeof bytes);
}

// Takes over the amounts of a film that is wet anywhere; false if it is not.
bool load_film(const FilmShape& shape, const Film& film, FilmScratch& s) {
    for (size_t v = 0; v < s.wet.size(); v += kFilmBlock)
        mark_wet(mul(to_floats8(&film.volume[v]), load_eight(&shape.inverse_area[v])), &s.wet[v]);
    if (std::find(s.wet.begin(), s.wet.end(), 1) == s.wet.end()) return false;
    for (size_t v = 0; v < s.wet.size(); ++v) s.amount[v] = {film.volume[v], film.blood[v]};
    for (size_t v = 0; v < s.wet.size(); v += kFilmBlock) {
        _mm256_storeu_ps(&s.standing[v], div(fill(1), _mm256_max_ps(load_eight(&shape.upright[v]), fill(kLeastUpright))));
        const Eight fullness = div(fill(2), add(load_eight(&shape.relief[v]), fill(1e-9f)));
        const Eight overhangs = _mm256_cmp_ps(load_eight(&shape.upright[v]), _mm256_setzero_ps(), _CMP_LE_OQ);
        _mm256_storeu_ps(&s.fullness[v], _mm256_andnot_ps(overhangs, fullness));  // there liquid never stands
    }
    return true;
}

// Which of the cells that liquid flows between are wet by now.
void update_wet(const FilmShape& shape, FilmScratch& s) {
    for (const uint32_t first : s.cells)
        mark_wet(mul(load_amounts(&s.amount[first]).at[0], load_eight(&shape.inverse_area[first])), &s.wet[first]);
}

// Finds the blocks of edges and of cells that liquid may flow over and between.
void find_active(const Film& film, FilmScratch& s) {
    std::fill(s.beside.begin(), s.beside.end(), uint8_t{0});
    s.block.clear(), s.cells.clear();
    for (uint32_t first = 0; first < film.from.size(); first += kFilmBlock) {
        uint8_t flows = 0;
        for (size_t e = first; e < first + kFilmBlock; ++e) flows |= s.wet[film.from[e]] | s.wet[film.to[e]];
        if (!flows) continue;
        s.block.push_back(first);
        for (size_t e = first; e < first + kFilmBlock; ++e) s.beside[film.from[e] / kFilmBlock] = s.beside[film.to[e] / kFilmBlock] = 1;
    }
    for (uint32_t k = 0; k < s.beside.size(); ++k)
        if (s.beside[k]) s.cells.push_back(k * kFilmBlock);
}

// visit(cell) for all cells of those blocks.
template <typename Visit>
void each_cell(const FilmScratch& s, const Visit& visit) {
    for (const uint32_t first : s.cells)
        for (size_t v = first; v < first + kFilmBlock; ++v) visit(v);
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
        return div(fill(1), mul(add(fluidity, mul(blood, more_fluidity)), add(density, mul(blood, more_density))));
    }
};

// Of the drag of a deep pool that by which it exceeds a film's: its waves lose most in the layer that they drag along the ground,
// sqrt(nu omega / 2) per depth (Landau & Lifshitz, Fluid Mechanics, section 25), with the frequency of waves as long as it is deep.
Eight deep_drag(Eight gravity, Eight thickness, Eight viscosity) {
    const Eight omega = _mm256_sqrt_ps(div(gravity, add(thickness, fill(1e-9f))));
    const Eight layer = mul(thickness, _mm256_sqrt_ps(mul(fill(0.5f), mul(viscosity, omega))));
    return _mm256_max_ps(sub(layer, mul(fill(9), viscosity)), _mm256_setzero_ps());
}

// What drives and drags the liquid of eight cells; returns 1 / the longest stable step for waves between them,
// a dt^2 < 4 + 2 (f / h^2) dt with a = 2 g h d(surface)/dh sum(conductance) / area. 1/s
Eight look_at_eight(const Mixture& mixture, float gravity, const FilmShape& shape, const Film& film, size_t v, FilmScratch& s) {
    const Eight zero = _mm256_setzero_ps(), one = fill(1), g = fill(gravity);
    const Two amount = load_amounts(&s.amount[v]);
    const Eight up = load_eight(&shape.upright[v]), down = load_eight(&s.standing[v]), inverse_area = load_eight(&shape.inverse_area[v]);
    const Eight inverse = div(one, add(amount.at[0], fill(1e-30f))), blood = _mm256_min_ps(mul(amount.at[1], inverse), one);
    const Eight h = mul(amount.at[0], inverse_area), nu = mixture.viscosity(blood);
    const Eight level = levelness8(h, load_eight(&s.fullness[v])), pool = _mm256_cmp_ps(level, zero, _CMP_GT_OQ);
    Eight above = mul(h, up), drag = mul(fill(3), nu), steep = up;
    if (_mm256_movemask_ps(pool)) {
        above = mul(h, add(up, mul(level, sub(down, up))));
        drag = add(drag, mul(level, deep_drag(g, h, nu)));
        // at most d(surface)/dh: while the surface turns level it rises faster
        const Eight turning = add(down, mul(fill(3), sub(down, up)));
        steep = choose(pool, choose(_mm256_cmp_ps(level, one, _CMP_LT_OQ), turning, down), up);
    }
    const Eight h2 = mul(h, h), a = mul(mul(mul(fill(2), g), mul(h, steep)), mul(load_eight(&film.crowding[v]), inverse_area));
    const Eight lead = add(above, mul(fill(kAhead), sub(above, load_eight(&film.rise[v]))));
    store_cells({{load_eight(&shape.height[v]), lead, _mm256_and_ps(h, _mm256_cmp_ps(h, fill(kThinnestFilm), _CMP_GT_OQ)), drag}},
                &s.cell[v]);
    store_pairs(blood, inverse, &s.donor[v].share);
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
Eight flow_eight(float gravity, float dt, const Four& a, const Four& b, Eight before) {
    const Eight zero = _mm256_setzero_ps();
    const Eight step = sub(a.at[0], b.at[0]), push = sub(a.at[1], b.at[1]), fall = add(step, push);
    const Eight forward = _mm256_cmp_ps(fall, zero, _CMP_GE_OQ), h = choose(forward, a.at[2], b.at[2]);
    const Eight all = add(add(magnitude(push), magnitude(step)), fill(1e-12f)), less = _mm256_min_ps(a.at[2], b.at[2]);
    const Eight half_share = div(mul(fill(0.5f), magnitude(push)), all);
    const Eight h1 = sub(h, mul(half_share, sub(h, less)));
    const Eight h2 = sub(mul(h, h), mul(half_share, sub(mul(h, h), mul(less, less))));
    const Eight drag = choose(forward, a.at[3], b.at[3]);
    const Eight driven = add(before, mul(mul(fill(gravity * dt), h1), fall));
    const Eight flow = mul(driven, div(h2, add(h2, mul(drag, fill(dt)))));
    const Eight donor = choose(_mm256_cmp_ps(flow, zero, _CMP_GE_OQ), a.at[2], b.at[2]);
    return _mm256_and_ps(flow, _mm256_cmp_ps(donor, zero, _CMP_GT_OQ));
}

// Flows after a step, what they move and out of which cells, and the largest part of a cell that leaves it over one edge.
float flow_edges(float gravity, float dt, const Film& film, FilmScratch& s) {
    for (const uint32_t v : s.cells) _mm256_storeu_ps(&s.out[v], _mm256_setzero_ps());
    Eight most = _mm256_setzero_ps();
    for (const uint32_t first : s.block) {
        const uint32_t *from = &film.from[first], *to = &film.to[first];
        const Eight flow =
            flow_eight(gravity, dt, load_cells(s.cell.data(), from), load_cells(s.cell.data(), to), load_eight(&film.flow[first]));
        const Eight a = load_eight(reinterpret_cast<const float*>(from)), b = load_eight(reinterpret_cast<const float*>(to));
        uint32_t* giver = &s.giver[first];
        _mm256_storeu_ps(reinterpret_cast<float*>(giver), choose(_mm256_cmp_ps(flow, _mm256_setzero_ps(), _CMP_GE_OQ), a, b));
        const Two donor = load_donors(s.donor.data(), giver);
        const Eight moved = mul(mul(load_eight(&film.conductance[first]), fill(dt)), flow);
        alignas(32) float leaves[8];
        _mm256_store_ps(leaves, magnitude(moved));
        for (size_t k = 0; k < 8; ++k) s.out[giver[k]] += leaves[k];
        most = _mm256_max_ps(most, mul(magnitude(moved), donor.at[1]));
        _mm256_storeu_ps(&s.flow[first], flow);
        store_pairs(moved, mul(moved, donor.at[0]), &s.moved[first].volume);
    }
    return largest_of(most);
}

__m128d to_doubles(const FilmScratch::Moved& moved) {
    return _mm_cvtps_pd(_mm_castsi128_ps(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(&moved))));
}
void add_amount(__m128d change, FilmScratch::Amount& amount) {
    _mm_store_pd(&amount.volume, _mm_add_pd(_mm_load_pd(&amount.volume), change));
}

void move_liquid(const Film& film, FilmScratch& s) {
    const __m128d minus = _mm_set1_pd(-0.0);
    for (const uint32_t first : s.block) {
        for (size_t e = first; e < first + kFilmBlock; ++e) {
            const __m128d moved = to_doubles(s.moved[e]);
            add_amount(_mm_xor_pd(moved, minus), s.amount[film.from[e]]);
            add_amount(moved, s.amount[film.to[e]]);
        }
    }
}

// The part of what would leave each cell that it has, less what rounding may take. False if all have enough.
bool find_kept(FilmScratch& s) {
    int less = 0;
    const Eight one = fill(1);
    for (const uint32_t first : s.cells) {
        const Eight has = mul(fill(0.999f), load_amounts(&s.amount[first]).at[0]), out = load_eight(&s.out[first]);
        const Eight lacks = _mm256_cmp_ps(out, has, _CMP_GT_OQ);
        _mm256_storeu_ps(&s.kept[first], choose(lacks, div(has, out), one));
        less |= _mm256_movemask_ps(lacks);
    }
    return less != 0;
}

// Scales flows down where a cell would give more than it has.
void spare_cells(FilmScratch& s) {
    for (const uint32_t first : s.block) {
        const auto* giver = reinterpret_cast<const __m256i*>(&s.giver[first]);
        const Eight kept = _mm256_i32gather_ps(s.kept.data(), _mm256_loadu_si256(giver), 4);
        _mm256_storeu_ps(&s.flow[first], mul(load_eight(&s.flow[first]), kept));
        float* moved = &s.moved[first].volume;
        const Eight low = _mm256_unpacklo_ps(kept, kept), high = _mm256_unpackhi_ps(kept, kept);
        _mm256_storeu_ps(moved, mul(load_eight(moved), _mm256_permute2f128_ps(low, high, 0x20)));
        _mm256_storeu_ps(moved + 8, mul(load_eight(moved + 8), _mm256_permute2f128_ps(low, high, 0x31)));
    }
}

void resize(const Film& film, FilmScratch& s) {
    const size_t cells = film.volume.size(), edges = film.from.size();
    for (auto* each : {&s.rise, &s.stiffness, &s.standing, &s.fullness, &s.out, &s.kept}) each->resize(cells);
    s.flow.resize(edges), s.moved.resize(edges), s.giver.resize(edges);
    s.cell.resize(cells), s.donor.resize(cells), s.amount.resize(cells), s.wet.resize(cells), s.beside.resize(cells / kFilmBlock);
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
    if (!load_film(shape, film, s)) return;
    const double shortest = seconds / kMostSubsteps;
    const float g = static_cast<float>(gravity);
    double left = seconds, dt = *film.step > 0 ? std::min(*film.step, seconds) : shortest;
    for (uint32_t turn = 0; left > 1e-9 * seconds; ++turn) {
        // liquid passes a third of a cell in a substep
        if (turn > 0 && turn % 3 == 0) update_wet(shape, s);
        if (turn % 3 == 0) find_active(film, s);
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
        if (find_kept(s)) spare_cells(s);
        move_liquid(film, s);
        each_cell(s, [&](size_t v) { film.rise[v] = s.rise[v]; });
        for (const uint32_t first : s.block) std::copy_n(s.flow.begin() + first, kFilmBlock, film.flow.begin() + first);
        left -= step;
        dt = step * static_cast<double>(std::clamp(kMostOut / std::max(most, 1e-6f), 0.5f, 2.0f));
    }
    for (size_t v = 0; v < s.amount.size(); ++v) film.volume[v] = s.amount[v].volume, film.blood[v] = s.amount[v].blood;
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
