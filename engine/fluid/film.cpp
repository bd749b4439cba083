#include "engine/fluid/film.hpp"

#include <immintrin.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
namespace trocar {
namespace {

// Part of a cell that may leave it over one edge in a step.
constexpr float kMostOut = 0.5f;
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
Eight magnitude(Eight x) { return _mm256_andnot_ps(fill(-0.0f), x); }
Eight add(Eight a, Eight b) { return _mm256_add_ps(a, b); }
Eight sub(Eight a, Eight b) { return _mm256_sub_ps(a, b); }
Eight mul(Eight a, Eight b) { return _mm256_mul_ps(a, b); }
Eight div(Eight a, Eight b) { return _mm256_div_ps(a, b); }
Eight choose(Eight mask, Eight yes, Eight no) { return _mm256_blendv_ps(no, yes, mask); }

// Eight cells' records to one vector per member, and back.
[[gnu::always_inline]] inline Four load_cells(const FilmScratch::Cell* cell, const uint32_t* index) {
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
[[gnu::always_inline]] inline Two load_donors(const FilmScratch::Donor* donor, const uint32_t* index) {
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

// Takes over the amounts of a film and what its shape says of pools; all cells are to be looked at.
void load_film(const FilmShape& shape, const Film& film, FilmScratch& s) {
    for (size_t v = 0; v < s.amount.size(); ++v) s.amount[v] = {film.volume[v], film.blood[v]};
    std::fill(s.need.begin(), s.need.end(), uint8_t{0});
    s.cells.clear(), s.awake.clear(), s.waves = 0;
    for (uint32_t v = 0; v < s.amount.size(); v += kFilmBlock) {
        s.cells.push_back(v);
        _mm256_storeu_ps(&s.standing[v], div(fill(1), _mm256_max_ps(load_eight(&shape.upright[v]), fill(kLeastUpright))));
        const Eight fullness = div(fill(2), add(load_eight(&shape.relief[v]), fill(1e-9f)));
        const Eight overhangs = _mm256_cmp_ps(load_eight(&shape.upright[v]), _mm256_setzero_ps(), _CMP_LE_OQ);
        _mm256_storeu_ps(&s.fullness[v], _mm256_andnot_ps(overhangs, fullness));  // there liquid never stands
    }
}

// The longest step of a block that begins at a tick, in ticks: blocks that step alike step together.
uint32_t longest_step(uint32_t tick) { return tick == 0 ? kMostSubsteps : tick & -tick; }

// A block of edges that sleeps takes part from this tick on if it has come to have a wet cell. `waves`: the need of all cells.
void wake_block(const Film& film, uint32_t tick, uint32_t block, uint8_t waves, FilmScratch& s) {
    const auto needs = [&](const uint32_t* cell) {
        return _mm256_i32gather_epi32(reinterpret_cast<const int*>(s.need.data()),
                                      _mm256_loadu_si256(reinterpret_cast<const __m256i*>(cell)), 1);
    };
    const __m256i both = _mm256_or_si256(needs(&film.from[block * kFilmBlock]), needs(&film.to[block * kFilmBlock]));
    const __m128i four = _mm_or_si128(_mm256_castsi256_si128(both), _mm256_extracti128_si256(both, 1));
    const uint64_t two = static_cast<uint64_t>(_mm_extract_epi64(four, 0)) | static_cast<uint64_t>(_mm_extract_epi64(four, 1));
    const auto own = static_cast<uint8_t>(two | two >> 32);
    if (own == 0) return;
    const uint8_t need = own & FilmScratch::kPool ? waves : own;
    s.awake.push_back(block * kFilmBlock);
    s.due[block] = static_cast<uint8_t>(tick);
    s.ticks[block] = s.most[block] = static_cast<uint8_t>(2 * kMostSubsteps >> std::bit_width(need));
}

// Finds the blocks of edges that step at a tick.
void find_due(const Film& film, uint32_t tick, FilmScratch& s) {
    const uint64_t four = s.waves | s.waves >> 32, two = four | four >> 16;
    const auto waves = static_cast<uint8_t>(two | two >> 8);
    for (uint32_t block = 0; s.spreads && block < s.due.size(); ++block)
        if (s.due[block] == FilmScratch::kAsleep) wake_block(film, tick, block, waves, s);
    s.spreads = false;
    s.block.clear();
    for (const uint32_t first : s.awake)
        if (s.due[first / kFilmBlock] == tick) s.block.push_back(first);
}

// Finds the blocks of cells that liquid flows between over these edges.
void find_cells(const Film& film, FilmScratch& s) {
    s.cells.clear();
    std::fill(s.beside.begin(), s.beside.end(), uint8_t{0});
    for (const uint32_t first : s.block)
        for (size_t e = first; e < first + kFilmBlock; ++e) s.beside[film.from[e] / kFilmBlock] = s.beside[film.to[e] / kFilmBlock] = 1;
    for (uint32_t k = 0; k < s.beside.size(); ++k)
        if (s.beside[k]) s.cells.push_back(k * kFilmBlock);
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

// A byte of 1 or 0 per number.
uint64_t bytes_of(Eight mask) { return _pdep_u64(static_cast<uint64_t>(_mm256_movemask_ps(mask)), 0x0101010101010101u); }

// Per cell a bit, and one more for every time that a pass has to be halved until a step resolves its waves; 0 if dry.
uint64_t need_of(Eight wet, Eight steps) {
    uint64_t need = bytes_of(wet);
    for (uint32_t most = 1; most < kMostSubsteps; most *= 2)
        need |= bytes_of(_mm256_and_ps(wet, _mm256_cmp_ps(steps, fill(static_cast<float>(most)), _CMP_GT_OQ))) * (2 * most);
    return need;
}

// What drives and drags the liquid of eight cells. The longest stable step for waves between them obeys
// a dt^2 < 4 + 2 (f / h^2) dt with a = 2 g h d(surface)/dh sum(conductance) / area; waves that the shortest step does not resolve are
// dragged more.
void look_at_eight(const Mixture& mixture, float gravity, float seconds, const FilmShape& shape, const Film& film, size_t v,
                   FilmScratch& s) {
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
    const Eight root = _mm256_sqrt_ps(add(mul(drag, drag), mul(mul(fill(4), a), mul(h2, h2))));
    const Eight rate = div(mul(a, h2), add(add(drag, root), fill(1e-30f)));
    const Eight wet = _mm256_cmp_ps(h, fill(kThinnestFilm), _CMP_GT_OQ);
    uint64_t need = need_of(wet, mul(rate, fill(seconds / kWaveCourant)));
    s.waves |= need;
    need |= bytes_of(_mm256_and_ps(wet, pool)) * FilmScratch::kPool;
    uint64_t before = 0;
    std::memcpy(&before, &s.need[v], sizeof before);
    std::memcpy(&s.need[v], &need, sizeof need);
    s.spreads |= (bytes_of(wet) & ~before) != 0;
    const float shortest = seconds / static_cast<float>(kMostSubsteps);
    const Eight unresolved = sub(mul(a, fill(shortest * shortest / (kWaveCourant * kWaveCourant))), fill(4));
    drag = _mm256_max_ps(drag, mul(mul(h2, unresolved), fill(0.5f / shortest)));
    const Eight lead = add(above, mul(fill(kAhead), sub(above, load_eight(&film.rise[v]))));
    store_cells({{load_eight(&shape.height[v]), lead, _mm256_and_ps(h, wet), drag}}, &s.cell[v]);
    store_pairs(blood, inverse, &s.donor[v].share);
    _mm256_storeu_ps(&film.rise[v], above);
    _mm256_storeu_ps(&s.out[v], zero);
}

// Flows over eight edges after a step, and those that move liquid in it: that at its end, but where friction and the slope rule that in
// its middle, as cells empty meanwhile: by Adams and Bashforth from the flow before it. The weights are those of equal steps: where a
// block doubled its steps while a cell drained, those of unequal steps came as often further from the exact answer as nearer. An edge
// over which nothing has flowed begins with Euler's step. From thick to thin the weight of the liquid is driven by the mean of what both
// sides carry (the integral of h^3 between them), all other flow by what it comes from.
Two flow_eight(float gravity, float dt, const Four& a, const Four& b, Eight before) {
    const Eight zero = _mm256_setzero_ps();
    const Eight step = sub(a.at[0], b.at[0]), push = sub(a.at[1], b.at[1]), fall = add(step, push);
    const Eight forward = _mm256_cmp_ps(fall, zero, _CMP_GE_OQ), h = choose(forward, a.at[2], b.at[2]);
    const Eight all = add(add(magnitude(push), magnitude(step)), fill(1e-12f)), less = _mm256_min_ps(a.at[2], b.at[2]);
    const Eight half_share = div(mul(fill(0.5f), magnitude(push)), all);
    const Eight h1 = sub(h, mul(half_share, sub(h, less)));
    const Eight h2 = sub(mul(h, h), mul(half_share, sub(mul(h, h), mul(less, less))));
    const Eight drag = choose(forward, a.at[3], b.at[3]);
    const Eight driven = add(before, mul(mul(fill(gravity * dt), h1), fall));
    const Eight inert = div(h2, add(h2, mul(drag, fill(dt)))), flow = mul(driven, inert);
    const Eight flowed = _mm256_cmp_ps(before, zero, _CMP_NEQ_OQ);
    const Eight viscous = _mm256_and_ps(mul(sub(fill(1), inert), sub(fill(0.5f), half_share)), flowed);
    const Eight donor = choose(_mm256_cmp_ps(flow, zero, _CMP_GE_OQ), a.at[2], b.at[2]);
    const Eight wet = _mm256_cmp_ps(donor, zero, _CMP_GT_OQ);
    const Eight middle = add(flow, mul(viscous, sub(flow, before)));
    const Eight alike = _mm256_cmp_ps(mul(middle, flow), zero, _CMP_GT_OQ);
    return {{_mm256_and_ps(flow, wet), _mm256_and_ps(_mm256_and_ps(middle, alike), wet)}};
}

// Flows of the blocks that are due, each after the longest step in which no more than a part of a cell leaves it over an edge; what
// they move, and out of which cells.
void flow_edges(float gravity, float seconds, const Film& film, uint32_t tick, FilmScratch& s) {
    const FilmScratch::Cell* const cell = s.cell.data();
    float* const out = s.out.data();
    for (const uint32_t first : s.block) {
        const uint32_t *from = &film.from[first], *to = &film.to[first], block = first / kFilmBlock;
        const Four at_from = load_cells(cell, from), at_to = load_cells(cell, to);
        const Eight a = load_eight(reinterpret_cast<const float*>(from)), b = load_eight(reinterpret_cast<const float*>(to));
        const Eight before = load_eight(&film.flow[first]), conductance = load_eight(&film.conductance[first]);
        uint32_t ticks = std::min<uint32_t>(s.ticks[block], longest_step(tick));
        alignas(32) uint32_t giver[8];
        for (;; ticks /= 2) {
            ++s.steps;
            const float dt = seconds * static_cast<float>(ticks) / static_cast<float>(kMostSubsteps);
            const auto [flow, middle] = flow_eight(gravity, dt, at_from, at_to, before).at;
            _mm256_store_ps(reinterpret_cast<float*>(giver), choose(_mm256_cmp_ps(flow, _mm256_setzero_ps(), _CMP_GE_OQ), a, b));
            const Two donor = load_donors(s.donor.data(), giver);
            const Eight moved = mul(mul(conductance, fill(dt)), middle), part = mul(magnitude(moved), donor.at[1]);
            if (ticks > 1 && _mm256_movemask_ps(_mm256_cmp_ps(part, fill(kMostOut), _CMP_GT_OQ))) continue;
            const bool calm = _mm256_movemask_ps(_mm256_cmp_ps(part, fill(0.4f * kMostOut), _CMP_GT_OQ)) == 0;
            s.due[block] = static_cast<uint8_t>(tick + ticks);
            s.ticks[block] = static_cast<uint8_t>(calm ? std::min<uint32_t>(2 * ticks, s.most[block]) : ticks);
            alignas(32) float leaves[8];
            _mm256_store_ps(leaves, magnitude(moved));
            for (size_t k = 0; k < 8; ++k) out[giver[k]] += leaves[k];
            std::memcpy(&s.giver[first], giver, sizeof giver);
            _mm256_storeu_ps(&film.flow[first], flow);
            store_pairs(moved, mul(moved, donor.at[0]), &s.moved[first].volume);
            break;
        }
    }
}

__m128d to_doubles(const FilmScratch::Moved& moved) {
    return _mm_cvtps_pd(_mm_castsi128_ps(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(&moved))));
}
void add_amount(__m128d change, FilmScratch::Amount& amount) {
    _mm_store_pd(&amount.volume, _mm_add_pd(_mm_load_pd(&amount.volume), change));
}

void move_liquid(const Film& film, FilmScratch& s) {
    const __m128d minus = _mm_set1_pd(-0.0);
    const FilmScratch::Moved* const all = s.moved.data();
    FilmScratch::Amount* const amount = s.amount.data();
    const uint32_t *const from = film.from.data(), *const to = film.to.data();
    for (const uint32_t first : s.block) {
        for (size_t e = first; e < first + kFilmBlock; ++e) {
            const __m128d moved = to_doubles(all[e]);
            add_amount(_mm_xor_pd(moved, minus), amount[from[e]]);
            add_amount(moved, amount[to[e]]);
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
void spare_cells(const Film& film, FilmScratch& s) {
    for (const uint32_t first : s.block) {
        const auto* giver = reinterpret_cast<const __m256i*>(&s.giver[first]);
        const Eight kept = _mm256_i32gather_ps(s.kept.data(), _mm256_loadu_si256(giver), 4);
        _mm256_storeu_ps(&film.flow[first], mul(load_eight(&film.flow[first]), kept));
        float* moved = &s.moved[first].volume;
        const Eight low = _mm256_unpacklo_ps(kept, kept), high = _mm256_unpackhi_ps(kept, kept);
        _mm256_storeu_ps(moved, mul(load_eight(moved), _mm256_permute2f128_ps(low, high, 0x20)));
        _mm256_storeu_ps(moved + 8, mul(load_eight(moved + 8), _mm256_permute2f128_ps(low, high, 0x31)));
    }
}

void resize(const Film& film, FilmScratch& s) {
    const size_t cells = film.volume.size(), edges = film.from.size();
    for (auto* each : {&s.standing, &s.fullness, &s.out, &s.kept}) each->resize(cells);
    s.moved.resize(edges), s.giver.resize(edges);
    s.cell.resize(cells), s.donor.resize(cells), s.amount.resize(cells), s.need.resize(cells + 3), s.beside.resize(cells / kFilmBlock);
    s.ticks.resize(edges / kFilmBlock), s.most.resize(edges / kFilmBlock), s.due.assign(edges / kFilmBlock, FilmScratch::kAsleep);
    s.awake.reserve(edges / kFilmBlock), s.block.reserve(edges / kFilmBlock), s.cells.reserve(cells / kFilmBlock);
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
    s.steps = 0;
    const Mixture mixture(params);
    const float g = static_cast<float>(gravity), all = static_cast<float>(seconds);
    load_film(shape, film, s);
    for (uint32_t tick = 0; tick < kMostSubsteps; ++tick) {
        if (tick > 0) find_due(film, tick, s), find_cells(film, s);
        for (const uint32_t v : s.cells) look_at_eight(mixture, g, all, shape, film, v, s);
        if (tick == 0) find_due(film, tick, s);
        flow_edges(g, all, film, tick, s);
        if (find_kept(s)) spare_cells(film, s);
        move_liquid(film, s);
        std::erase_if(s.awake, [&](uint32_t first) { return s.due[first / kFilmBlock] == kMostSubsteps; });
    }
    if (s.steps == 0) return;
    for (size_t v = 0; v < s.amount.size(); ++v) film.volume[v] = s.amount[v].volume, film.blood[v] = s.amount[v].blood;
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
