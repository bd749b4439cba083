#include "systems/detect/broad/broad_phase_pairs.hpp"

#include <immintrin.h>

#include <algorithm>
#include <iterator>
#include <limits>
#include <numeric>

#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {
namespace {

// By trial on 10,000 boxes that move by 0 to 20 % of their size a pass.
constexpr double kLoose = 0.05;        // of a box's mean edge: how much larger its loose box is on every side
constexpr uint32_t kLeastShare = 8;    // a sweep of all bodies costs about as much as pairing this share anew
constexpr size_t kMostTests = 32;      // likewise: of strays with each other, per body
constexpr uint32_t kFewestPasses = 3;  // that loose boxes must last to pay
constexpr uint32_t kExactPasses = 16;  // until they are tried again
constexpr double kLengthy = 4;         // of the mean length along the axis

bool is_empty(const Box& box) { return !(box.min.array() <= box.max.array()).all(); }

// Float at or below (sign = -1) or above (sign = 1) a coordinate relative to `base`; equal in, equal out.
float outward(double x, double base, float sign) {
    const float v = float(std::clamp(x - base, -1e30, 1e30));
    return v + sign * (std::abs(v) * 0x1p-22f + 1e-30f);
}

// Axis along which the box centres spread most. Keeps the previous axis unless another is clearly better.
uint32_t choose_axis(std::span<const Box> boxes, uint32_t before) {
    Vec3d sum = Vec3d::Zero(), squares = Vec3d::Zero();
    double count = 0;
    for (const Box& box : boxes) {
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

// Puts the loose boxes in sweep order.
void order_boxes(BroadPhaseScratch& scratch) {
    const std::span<const Box> boxes = scratch.loose;
    scratch.axis = choose_axis(boxes, scratch.axis);
    const uint32_t bodies = uint32_t(boxes.size());
    if (scratch.order.size() != bodies) {
        scratch.order.resize(bodies);
        std::iota(scratch.order.begin(), scratch.order.end(), 0u);
    }
    scratch.base = bodies > 0 && !is_empty(boxes[scratch.order[bodies / 2]]) ? boxes[scratch.order[bodies / 2]].min : Vec3d(Vec3d::Zero());
    scratch.entry.clear();
    for (const uint32_t body : scratch.order)
        if (!is_empty(boxes[body])) scratch.entry.push_back({outward(boxes[body].min[scratch.axis], scratch.base[scratch.axis], -1), body});
    sort_entries(scratch.entry);
    uint32_t empty = 0;  // empty boxes go to the front of the order, for the next pass
    for (uint32_t body = 0; body < bodies && scratch.entry.size() < bodies; ++body)
        if (is_empty(boxes[body])) scratch.order[empty++] = body;
    const uint32_t count = uint32_t(scratch.entry.size());
    for (uint32_t i = 0; i < count; ++i) scratch.order[empty + i] = scratch.entry[i].body;
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t axis = (scratch.axis + k) % 3;
        scratch.swept.low[k].assign(count + 8, std::numeric_limits<float>::infinity());
        scratch.swept.high[k].assign(count + 8, -std::numeric_limits<float>::infinity());
        for (uint32_t i = 0; i < count; ++i) {
            const Box& box = boxes[scratch.entry[i].body];
            scratch.swept.low[k][i] = outward(box.min[axis], scratch.base[axis], -1);
            scratch.swept.high[k][i] = outward(box.max[axis], scratch.base[axis], 1);
        }
    }
}

// One box in the order of SweptBoxes.
struct SweptBox {
    std::array<float, 3> low, high;
};

// Calls found(j) for every box from entry i on that overlaps `box`, until one begins beyond it; eight tests at a time.
template <typename Found>
void sweep_from(const SweptBoxes& swept, const SweptBox& box, size_t i, const Found& found) {
    const auto all = [](float x) { return _mm256_set1_ps(x); };
    const __m256 low_0 = all(box.low[0]), high_0 = all(box.high[0]), low_1 = all(box.low[1]), high_1 = all(box.high[1]),
                 low_2 = all(box.low[2]), high_2 = all(box.high[2]);
    for (size_t j = i;; j += 8) {
        const auto at = [j](const std::vector<float>& values) { return _mm256_loadu_ps(values.data() + j); };
        const auto in = [](__m256 low, __m256 high, __m256 others_low, __m256 others_high) {
            return _mm256_and_ps(_mm256_cmp_ps(others_low, high, _CMP_LE_OQ), _mm256_cmp_ps(others_high, low, _CMP_GE_OQ));
        };
        const __m256 along = _mm256_cmp_ps(at(swept.low[0]), high_0, _CMP_LE_OQ);
        const __m256 in_0 = _mm256_and_ps(along, _mm256_cmp_ps(at(swept.high[0]), low_0, _CMP_GE_OQ));
        const __m256 in_1 = in(low_1, high_1, at(swept.low[1]), at(swept.high[1])),
                     in_2 = in(low_2, high_2, at(swept.low[2]), at(swept.high[2]));
        uint32_t met = uint32_t(_mm256_movemask_ps(_mm256_and_ps(in_0, _mm256_and_ps(in_1, in_2))));
        for (; met != 0; met &= met - 1) found(j + uint32_t(__builtin_ctz(met)));
        if (_mm256_movemask_ps(along) != 0xff) return;
    }
}

// Adds the pair to `found` if its loose boxes overlap and it may touch.
void add_near(const Bodies& bodies, uint32_t body, uint32_t other, BroadPhaseScratch& scratch) {
    const auto [a, b] = std::minmax(body, other);
    if (!boxes_meet(scratch.loose[a], scratch.loose[b])) return;
    if (!joins_islands(bodies.motion[a]) && !joins_islands(bodies.motion[b])) return;
    if (std::binary_search(scratch.excluded.begin(), scratch.excluded.end(), std::array{a, b})) return;
    scratch.found.push_back({a, b});
}

// The found pairs in ascending order: counting sort by a, then a sort of the few partners of each.
void sort_found(uint32_t bodies, BroadPhaseScratch& scratch) {
    std::vector<uint32_t>& first = scratch.first;
    first.assign(bodies + 1, 0);
    for (const auto& [a, b] : scratch.found) ++first[a + 1];
    for (uint32_t i = 0; i < bodies; ++i) first[i + 1] += first[i];
    scratch.near.reserve(scratch.merged.capacity());
    scratch.near.resize(scratch.found.size());
    for (const auto& pair : scratch.found) scratch.near[first[pair[0]]++] = pair;
    for (uint32_t a = 0, begin = 0; a < bodies; begin = first[a++])
        std::sort(scratch.near.begin() + begin, scratch.near.begin() + first[a]);
}

Box loose_box(const Box& box, double looseness) {
    const double margin = looseness / 3 * (box.max - box.min).sum();
    return !is_empty(box) && std::isfinite(margin) ? Box{box.min - Vec3d::Constant(margin), box.max + Vec3d::Constant(margin)} : box;
}

// New loose boxes of all bodies, and their near pairs.
void sweep_all(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
               BroadPhaseScratch& scratch) {
    if (scratch.exact_passes > 0)
        --scratch.exact_passes;
    else if (scratch.passes < kFewestPasses && !scratch.loose.empty())
        scratch.exact_passes = kExactPasses;
    const double looseness = scratch.exact_passes > 0 ? 0 : kLoose;
    const uint32_t count = uint32_t(boxes.box.size());
    scratch.passes = 0;
    scratch.excluded.assign(excluded.begin(), excluded.end());
    scratch.strays.assign(count, 0), scratch.leaves.assign(count, 0);
    scratch.stray.clear(), scratch.leaving.clear();
    scratch.stray.reserve(count), scratch.leaving.reserve(count);  // any number may stray in a pass
    scratch.loose.resize(count);
    for (uint32_t body = 0; body < count; ++body) scratch.loose[body] = loose_box(boxes.box[body], looseness);

    order_boxes(scratch);
    const SweptBoxes& swept = scratch.swept;
    const size_t entries = scratch.entry.size();
    double length = 0;
    for (size_t i = 0; i < entries; ++i) length += double(swept.high[0][i]) - swept.low[0][i];
    scratch.window = kLengthy * length / std::max<double>(1, double(entries));
    scratch.lengthy.clear();
    scratch.found.clear();
    for (uint32_t i = 0; i < entries; ++i) {
        if (!(double(swept.high[0][i]) - swept.low[0][i] <= scratch.window)) scratch.lengthy.push_back(i);
        const SweptBox box{{swept.low[0][i], swept.low[1][i], swept.low[2][i]}, {swept.high[0][i], swept.high[1][i], swept.high[2][i]}};
        sweep_from(swept, box, i + 1, [&](size_t j) { add_near(bodies, scratch.entry[i].body, scratch.entry[j].body, scratch); });
    }
    sort_found(count, scratch);
}

// Finds the near pairs of a body that has left its loose box among the bodies that have not, and the strays before it in their list.
void pair_anew(const Bodies& bodies, uint32_t body, BroadPhaseScratch& scratch) {
    SweptBox box;
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t axis = (scratch.axis + k) % 3;
        box.low[k] = outward(scratch.loose[body].min[axis], scratch.base[axis], -1);
        box.high[k] = outward(scratch.loose[body].max[axis], scratch.base[axis], 1);
    }
    const auto add = [&](size_t j) {
        if (!scratch.strays[scratch.entry[j].body]) add_near(bodies, body, scratch.entry[j].body, scratch);
    };
    const float start = outward(box.low[0], scratch.window, -1);
    const auto from = std::ranges::lower_bound(scratch.entry, start, {}, &SweepEntry::low);
    sweep_from(scratch.swept, box, size_t(from - scratch.entry.begin()), add);
    for (const uint32_t j : scratch.lengthy)
        if (scratch.entry[j].low < start) add(j);
    for (const uint32_t other : scratch.stray)
        if (other != body && !(scratch.leaves[other] && other < body)) add_near(bodies, body, other, scratch);
}

// Gives bodies that left their loose boxes new ones, and pairs them anew. False if a sweep of all costs less.
bool follow_strays(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                   BroadPhaseScratch& scratch) {
    const uint32_t count = uint32_t(boxes.box.size());
    if (scratch.loose.size() != count || scratch.exact_passes > 0 || !std::ranges::equal(excluded, scratch.excluded)) return false;
    ++scratch.passes;
    scratch.leaving.clear();
    for (uint32_t body = 0; body < count; ++body) {
        const Box &box = boxes.box[body], &loose = scratch.loose[body];
        const bool inside = (box.min.array() >= loose.min.array()).all() && (box.max.array() <= loose.max.array()).all();
        if (!inside && !is_empty(box)) scratch.leaving.push_back(body);
    }
    if (scratch.leaving.empty()) return true;
    for (const uint32_t body : scratch.leaving)
        if (!scratch.strays[body]) scratch.strays[body] = 1, scratch.stray.push_back(body);
    if (scratch.stray.size() > count / kLeastShare || scratch.leaving.size() * scratch.stray.size() > kMostTests * size_t{count})
        return false;

    for (const uint32_t body : scratch.leaving) scratch.leaves[body] = 1, scratch.loose[body] = loose_box(boxes.box[body], kLoose);
    std::erase_if(scratch.near, [&](const auto& pair) { return scratch.leaves[pair[0]] || scratch.leaves[pair[1]]; });
    scratch.found.clear();
    for (const uint32_t body : scratch.leaving) pair_anew(bodies, body, scratch);
    for (const uint32_t body : scratch.leaving) scratch.leaves[body] = 0;
    std::ranges::sort(scratch.found);
    scratch.merged.clear();
    // they change places: each gets the room of the larger, so that a scene that repeats itself allocates nothing
    scratch.merged.reserve(std::max(scratch.near.capacity(), scratch.near.size() + scratch.found.size()));
    std::ranges::merge(scratch.near, scratch.found, std::back_inserter(scratch.merged));
    scratch.near.swap(scratch.merged);
    return true;
}

}  // namespace

void find_broad_phase_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            BroadPhaseScratch& scratch, BroadPhasePairs& pairs) {
    if (!follow_strays(bodies, boxes, excluded, scratch)) sweep_all(bodies, boxes, excluded, scratch);
    pairs.a.clear(), pairs.b.clear();
    for (const auto& [a, b] : scratch.near)
        if (boxes_meet(boxes.box[a], boxes.box[b])) pairs.a.push_back(a), pairs.b.push_back(b);
}

void update_candidate_pairs(const Bodies& bodies, const BodyBoxes& boxes, std::span<const std::array<uint32_t, 2>> excluded,
                            BroadPhaseScratch& scratch, BroadPhasePairs& pairs) {
    if (same_boxes(boxes.box, scratch.box) && std::ranges::equal(excluded, scratch.excluded)) return;
    find_broad_phase_pairs(bodies, boxes, excluded, scratch, pairs);
    scratch.box = boxes.box;
}

}  // namespace trocar
