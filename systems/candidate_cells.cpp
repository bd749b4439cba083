#include "systems/candidate_cells.hpp"

#include <algorithm>
#include <limits>

#include "engine/geometry/contact_kernels.hpp"
namespace trocar {
namespace {

constexpr size_t kCrowded = 16384;  // triangle pairs of a cell from which sorting beats testing all

using Found = std::vector<std::array<uint32_t, 3>>;

uint32_t find_pair(const CandidatePairs& pairs, const std::vector<uint32_t>& first, uint32_t a, uint32_t b) {
    const auto begin = pairs.b.begin() + first[a], end = pairs.b.begin() + first[a + 1];
    const auto at = std::lower_bound(begin, end, b);
    return at != end && *at == b ? uint32_t(at - pairs.b.begin()) : kNone;
}

// What every test of a cell needs.
struct CellTest {
    const ScreenedTriangles& screened;
    uint64_t key;
    float inv_size;
    uint32_t pair;
    Found& found;

    void operator()(uint32_t a, __m256 box_a, __m256 facing_a, uint32_t b) const {
        const __m256 box_b = load_box(screened.box[b]);
        if (!meets(facing_a, box_b)) return;
        if (cell_of_meeting(box_a, box_b, inv_size) == key) found.push_back({a, b, pair});
    }
};

// Rows whose box meets a hull, in order. Returns the hull of what is kept.
__m256 keep_meeting(const std::vector<PackedBox>& box, std::span<const uint32_t> rows, __m256 hull,
                    std::vector<uint32_t>& kept) {
    const __m256 face = facing(hull);
    __m256 kept_hull = _mm256_set1_ps(std::numeric_limits<float>::infinity());
    kept.clear();
    for (const uint32_t row : rows) {
        const __m256 own = load_box(box[row]);
        if (!meets(face, own)) continue;
        kept.push_back(row);
        kept_hull = _mm256_min_ps(kept_hull, own);
    }
    return kept_hull;
}

// Most boxes of a cell are away from the other body's: both lists are first cut to the hull of the other.
void test_all(const CellTest& test, std::span<const uint32_t> rows_a, std::span<const uint32_t> rows_b,
              CandidateCellsScratch& scratch) {
    const std::vector<PackedBox>& box = test.screened.box;
    __m256 hull = _mm256_set1_ps(std::numeric_limits<float>::infinity());
    for (const uint32_t b : rows_b) hull = _mm256_min_ps(hull, load_box(box[b]));
    hull = keep_meeting(box, rows_a, hull, scratch.sweep_a);
    if (scratch.sweep_a.empty()) return;
    keep_meeting(box, rows_b, hull, scratch.sweep_b);
    for (const uint32_t a : scratch.sweep_a) {
        const __m256 box_a = load_box(box[a]), face = facing(box_a);
        for (const uint32_t b : scratch.sweep_b) test(a, box_a, face, b);
    }
}

// The same pairs by a sweep along x.
void test_crowded(const CellTest& test, std::span<const uint32_t> rows_a, std::span<const uint32_t> rows_b,
                  CandidateCellsScratch& scratch) {
    const std::vector<PackedBox>& box = test.screened.box;
    const auto sorted = [&](std::span<const uint32_t> rows, std::vector<uint32_t>& out) {
        out.assign(rows.begin(), rows.end());
        std::sort(out.begin(), out.end(), [&](uint32_t x, uint32_t y) {
            return box[x].min[0] < box[y].min[0] || (box[x].min[0] == box[y].min[0] && x < y);
        });
    };
    sorted(rows_a, scratch.sweep_a);
    sorted(rows_b, scratch.sweep_b);
    size_t i = 0, j = 0;
    while (i < scratch.sweep_a.size() && j < scratch.sweep_b.size()) {
        const uint32_t a = scratch.sweep_a[i], b = scratch.sweep_b[j];
        if (box[a].min[0] <= box[b].min[0]) {
            const __m256 box_a = load_box(box[a]), face = facing(box_a);
            for (size_t k = j; k < scratch.sweep_b.size(); ++k) {
                if (box[scratch.sweep_b[k]].min[0] > -box[a].neg_max[0]) break;
                test(a, box_a, face, scratch.sweep_b[k]);
            }
            ++i;
        } else {
            for (size_t k = i; k < scratch.sweep_a.size(); ++k) {
                const uint32_t row = scratch.sweep_a[k];
                if (box[row].min[0] > -box[b].neg_max[0]) break;
                const __m256 box_a = load_box(box[row]);
                test(row, box_a, facing(box_a), b);
            }
            ++j;
        }
    }
}

void search_cells(const CandidatePairs& pairs, const ScreenedTriangles& screened, const Occupancy& occupancy,
                  CandidateCellsScratch& scratch) {
    const float inv_size = 1.0f / float(occupancy.cell_size);
    const auto rows_of = [&](uint32_t object) {
        const uint32_t first = occupancy.primitive_first[object];
        return std::span(occupancy.primitive_row).subspan(first, occupancy.primitive_first[object + 1] - first);
    };
    for (uint32_t cell = 0; cell < occupancy.cell_key.size(); ++cell) {
        const uint32_t end = occupancy.object_first[cell + 1];
        for (uint32_t i = occupancy.object_first[cell]; i < end; ++i) {
            for (uint32_t j = i + 1; j < end; ++j) {
                const uint32_t pair = find_pair(pairs, scratch.pair_first, occupancy.object[i], occupancy.object[j]);
                if (pair == kNone) continue;
                const CellTest test{screened, occupancy.cell_key[cell], inv_size, pair, scratch.found};
                const auto a = rows_of(i), b = rows_of(j);
                a.size() * b.size() <= kCrowded ? test_all(test, a, b, scratch) : test_crowded(test, a, b, scratch);
            }
        }
    }
}

// Triangles too large for the cells: each against everything of the other body.
void search_oversize(const CandidatePairs& pairs, const ScreenedTriangles& screened, const Occupancy& occupancy,
                     Found& found) {
    const std::vector<uint32_t>& large = occupancy.oversize;
    if (large.empty()) return;
    const auto large_of = [&](uint32_t body) {
        const auto begin = std::lower_bound(large.begin(), large.end(), screened.body[body].first);
        return std::span(begin, std::lower_bound(begin, large.end(), screened.body[body].end()));
    };
    for (uint32_t pair = 0; pair < pairs.a.size(); ++pair) {
        const Range rows_a = screened.body[pairs.a[pair]], rows_b = screened.body[pairs.b[pair]];
        const auto large_a = large_of(pairs.a[pair]), large_b = large_of(pairs.b[pair]);
        for (const uint32_t a : large_a) {
            const __m256 face = facing(load_box(screened.box[a]));
            for (uint32_t b = rows_b.first; b < rows_b.end(); ++b) {
                if (meets(face, load_box(screened.box[b]))) found.push_back({a, b, pair});
            }
        }
        for (const uint32_t b : large_b) {
            const __m256 face = facing(load_box(screened.box[b]));
            auto skip = large_a.begin();
            for (uint32_t a = rows_a.first; a < rows_a.end(); ++a) {
                if (skip != large_a.end() && *skip == a) {
                    ++skip;
                } else if (meets(face, load_box(screened.box[a]))) {
                    found.push_back({a, b, pair});
                }
            }
        }
    }
}

// Ascending (row of a, row of b). Rows of b ascend with the pair, so each row of a has its pairs in order too.
void sort_by_row(uint32_t rows, CandidateCellsScratch& scratch) {
    scratch.first.assign(rows + 1, 0);
    for (const auto& f : scratch.found) ++scratch.first[f[0] + 1];
    for (uint32_t i = 0; i < rows; ++i) scratch.first[i + 1] += scratch.first[i];
    scratch.by_row.resize(scratch.found.size());
    for (const auto& f : scratch.found) scratch.by_row[scratch.first[f[0]]++] = f;
    uint32_t begin = 0;
    for (uint32_t row = 0; row < rows; ++row) {
        const uint32_t end = scratch.first[row];
        std::sort(scratch.by_row.begin() + begin, scratch.by_row.begin() + end,
                  [](const auto& x, const auto& y) { return x[1] < y[1]; });
        begin = end;
    }
}

}  // namespace

void find_candidate_triangles(const CandidatePairs& pairs, const ScreenedTriangles& screened,
                              const Occupancy& occupancy, CandidateCellsScratch& scratch,
                              CandidateTriangles& candidates) {
    const uint32_t bodies = uint32_t(screened.body.size()), count = uint32_t(pairs.a.size());
    scratch.pair_first.assign(bodies + 1, 0);
    for (const uint32_t a : pairs.a) ++scratch.pair_first[a + 1];
    for (uint32_t i = 0; i < bodies; ++i) scratch.pair_first[i + 1] += scratch.pair_first[i];
    scratch.found.clear();
    search_cells(pairs, screened, occupancy, scratch);
    search_oversize(pairs, screened, occupancy, scratch.found);
    sort_by_row(uint32_t(screened.triangle.size()), scratch);

    candidates.pair.assign(count, {});
    for (const auto& f : scratch.by_row) ++candidates.pair[f[2]].count;
    uint32_t first = 0;
    scratch.first.resize(count);
    for (uint32_t i = 0; i < count; ++i) {
        candidates.pair[i].first = scratch.first[i] = first;
        first += candidates.pair[i].count;
    }
    candidates.triangle.resize(first);
    for (const auto& [a, b, pair] : scratch.by_row) {
        candidates.triangle[scratch.first[pair]++] = {screened.triangle[a], screened.triangle[b]};
    }
}

}  // namespace trocar
