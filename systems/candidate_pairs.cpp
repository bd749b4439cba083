#include "systems/candidate_pairs.hpp"

#include <algorithm>
#include <numeric>

#include "engine/geometry/contact_kernels.hpp"
#include "engine/surfaces.hpp"
namespace trocar {
namespace {

// Orders bodies by (lower x, row). Nearly sorted from the pass before, so insertion; a scene that jumped is sorted
// anew.
void sort_order(const BodyBoxes& boxes, std::vector<uint32_t>& order) {
    const size_t count = boxes.box.size();
    const auto less = [&](uint32_t a, uint32_t b) {
        const double x = boxes.box[a].min.x(), y = boxes.box[b].min.x();
        return x < y || (x == y && a < b);
    };
    if (order.size() != count) {
        order.resize(count);
        std::iota(order.begin(), order.end(), 0u);
        std::sort(order.begin(), order.end(), less);
        return;
    }
    size_t moves = 0;
    for (size_t i = 1; i < count; ++i) {
        const uint32_t body = order[i];
        size_t j = i;
        for (; j > 0 && less(body, order[j - 1]); --j) order[j] = order[j - 1];
        order[j] = body;
        moves += i - j;
        if (moves > 16 * count) return std::sort(order.begin(), order.end(), less);
    }
}

}  // namespace

void find_candidate_pairs(const Bodies& bodies, const BodyBoxes& boxes,
                          std::span<const std::array<uint32_t, 2>> excluded, CandidatePairsScratch& scratch,
                          CandidatePairs& pairs) {
    sort_order(boxes, scratch.order);
    const uint32_t count = uint32_t(scratch.order.size());
    scratch.sorted.resize(count);
    for (uint32_t i = 0; i < count; ++i) scratch.sorted[i] = boxes.box[scratch.order[i]];

    // sweep; a body without a finite vertex has an empty box and meets nothing
    scratch.found.clear();
    for (uint32_t i = 0; i < count; ++i) {
        const Box& box = scratch.sorted[i];
        const bool pushed = joins_islands(bodies.motion[scratch.order[i]]);
        for (uint32_t j = i + 1; j < count && scratch.sorted[j].min.x() <= box.max.x(); ++j) {
            if (!boxes_meet(box, scratch.sorted[j])) continue;
            if (!pushed && !joins_islands(bodies.motion[scratch.order[j]])) continue;
            const auto [a, b] = std::minmax(scratch.order[i], scratch.order[j]);
            if (std::binary_search(excluded.begin(), excluded.end(), std::array{a, b})) continue;
            scratch.found.push_back({a, b});
        }
    }

    // counting sort by a, then the few partners of each
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

}  // namespace trocar
