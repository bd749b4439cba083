#include "systems/detect/broad/broad_phase_pairs.hpp"

#include <immintrin.h>

#include <algorithm>
#include <limits>
#include <numeric>

#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {
namespace {

bool is_empty(const Box& box) { return !(box.min.array() <= box.max.array()).all(); }

// Float at or below (sign = -1) or above (sign = 1) a coordinate relative to `base`; equal in, equal out.
float outward(double x, double base, float sign) {
    const float v = float(std::clamp(x - base, -1e30, 1e30));
    return v + sign * (std::abs(v) * 0x1p-22f + 1e-30f);
}

// Axis along which the box centres spread most. Keeps the previous axis unless another is clearly better.
uint32_t choose_axis(const BodyBoxes& boxes, uint32_t before) {
    Vec3d sum = Vec3d::Zero(), squares = Vec3d::Zero();
    double count = 0;
    for (const Box& box : boxes.box) {
        if (is_empty(box)) continue;
        const Vec3d middle = 0.5 * (box.min + box.max);
        sum += middle;
        squares += middle.cwiseProduct(middle);
        ++count;
    }
    const Vec3d spread = squares - sum.cwiseProduct(sum) / std::max(count, 1.0);
    uint32_t best = before % 3;
    for (uint32_t k = 0; k < 3; ++k) {
        if (spread[k] > 1.2 * spread[best]) best = k;
    }
    return best;
}

// Sorts bodies by the lower ends of their boxes. Insertion sort, as the order of the previous pass is nearly
// sorted; a full sort if the scene has jumped.
void sort_entries(std::vector<SweepEntry>& entry) {
    const auto less = [](const SweepEntry& a, const SweepEntry& b) { return a.low < b.low || (a.low == b.low && a.body < b.body); };
    size_t moves = 0;
    for (size_t i = 1; i < entry.size(); ++i) {
        const SweepEntry p = entry[i];
        size_t j = i;
        for (; j > 0 && less(p, entry[j - 1]); --j) entry[j] = entry[j - 1];
        entry[j] = p;
        moves += i - j;
        if (moves > 16 * entry.size()) return std::sort(entry.begin(), entry.end(), less);
    }
}

// Fills the bounds in sweep order. Returns the number of bodies swept.
uint32_t order_boxes(const BodyBoxes& boxes, BroadPhaseScratch& scratch) {
    scratch.axis = choose_axis(boxes, scratch.axis);
    const uint32_t bodies = uint32_t(boxes.box.size());
    if (scratch.order.size() != bodies) {
        scratch.order.resize(bodies);
        std::iota(scratch.order.begin(), scratch.order.end(), 0u);
    }
    Vec3d base = Vec3d::Zero();
    if (bodies > 0 && !is_empty(boxes.box[scratch.order[bodies / 2]])) base = boxes.box[scratch.order[bodies / 2]].min;
    scratch.entry.clear();
    uint32_t empty = 0;  // empty boxes go to the front of the order, for the next pass
    for (const uint32_t body : scratch.order) {
        const Box& box = boxes.box[body];
        if (!is_empty(box)) scratch.entry.push_back({outward(box.min[scratch.axis], base[scratch.axis], -1), body});
    }
    sort_entries(scratch.entry);
    for (uint32_t body = 0; body < bodies && scratch.entry.size() < bodies; ++body) {
        if (is_empty(boxes.box[body])) scratch.order[empty++] = body;
    }
    const uint32_t count = uint32_t(scratch.entry.size());
    for (uint32_t i = 0; i < count; ++i) scratch.order[empty + i] = scratch.entry[i].body;
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t axis = (scratch.axis + k) % 3;
        scratch.swept.low[k].assign(count + 8, std::numeric_limits<float>::infinity());
        scratch.swept.high[k].assign(count + 8, -std::numeric_limits<float>::infinity());
        for (uint32_t i = 0; i < count; ++i) {
            const Box& box = boxes.box[scratch.entry[i].body];
            scratch.swept.low[k][i] = outward(box.min[axis], base[axis], -1);
            scratch.swept.high[k][i] = outward(box.max[axis], base[axis], 1);
        }
    }
    return count;
}

// Calls found(j) for every box after i that overlaps it, eight tests at a time.
template <typename Found>
void sweep_from(const SweptBoxes& swept, uint32_t i, const Found& found) {
    const auto all = [](float x) { return _mm256_set1_ps(x); };
    const __m256 high_0 = all(swept.high[0][i]), low_1 = all(swept.low[1][i]), high_1 = all(swept.high[1][i]), low_2 = all(swept.low[2][i]),
                 high_2 = all(swept.high[2][i]);
    for (uint32_t j = i + 1;; j += 8) {
        const auto at = [j](const std::vector<float>& values) { return _mm256_loadu_ps(values.data() + j); };
        const __m256 along = _mm256_cmp_ps(at(swept.low[0]), high_0, _CMP_LE_OQ);
        const __m256 in_1 =
            _mm256_and_ps(_mm256_cmp_ps(at(swept.low[1]), high_1, _CMP_LE_OQ), _mm256_cmp_ps(at(swept.high[1]), low_1, _CMP_GE_OQ));
        const __m256 in_2 =
            _mm256_and_ps(_mm256_cmp_ps(at(swept.low[2]), high_2, _CMP_LE_OQ), _mm256_cmp_ps(at(swept.high[2]), low_2, _CMP_GE_OQ));
        uint32_t met = uint32_t(_mm256_movemask_ps(_mm256_and_ps(along, _mm256_and_ps(in_1, in_2))));
        for (; met != 0; met &= met - 1) found(j + uint32_t(__builtin_ctz(met)));
        if (_mm256_movemask_ps(along) != 0xff) return;
    }
}

}  // namespace

void find_broad_phase_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            BroadPhaseScratch& scratch, BroadPhasePairs& pairs) {
    const uint32_t count = uint32_t(boxes.box.size()), swept = order_boxes(boxes, scratch);
    scratch.found.clear();
    for (uint32_t i = 0; i < swept; ++i) {
        const uint32_t body = scratch.entry[i].body;
        sweep_from(scratch.swept, i, [&](uint32_t j) {
            const auto [a, b] = std::minmax(body, scratch.entry[j].body);
            if (!boxes_meet(boxes.box[a], boxes.box[b])) return;
            if (!joins_islands(bodies.motion[a]) && !joins_islands(bodies.motion[b])) return;
            if (std::binary_search(excluded.begin(), excluded.end(), std::array{a, b})) return;
            scratch.found.push_back({a, b});
        });
    }

    // counting sort by a, then sort the few partners of each
    scratch.first.assign(count + 1, 0);
    for (const auto& [a, b] : scratch.found) ++scratch.first[a + 1];
    for (uint32_t i = 0; i < count; ++i) scratch.first[i + 1] += scratch.first[i];
    pairs.a.resize(scratch.found.size());
    pairs.b.resize(scratch.found.size());
    for (const auto& [a, b] : scratch.found) pairs.b[scratch.first[a]++] = b;
    uint32_t begin = 0;
    for (uint32_t a = 0; a < count; ++a) {
        const uint32_t end = scratch.first[a];
        std::sort(pairs.b.begin() + begin, pairs.b.begin() + end);
        std::fill(pairs.a.begin() + begin, pairs.a.begin() + end, a);
        begin = end;
    }
}

void update_candidate_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            BroadPhaseScratch& scratch, BroadPhasePairs& pairs) {
    if (same_boxes(boxes.box, scratch.swept_box) && std::ranges::equal(excluded, scratch.swept_excluded)) return;
    find_broad_phase_pairs(bodies, boxes, excluded, scratch, pairs);
    scratch.swept_box = boxes.box;
    scratch.swept_excluded.assign(excluded.begin(), excluded.end());
}

}  // namespace trocar
