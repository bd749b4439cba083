#include "systems/detect/broad/candidate_cells.hpp"

#include <algorithm>
#include <limits>

#include "engine/base/subspan.hpp"
#include "engine/contact/displacement_bound.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/project_vertices.hpp"
#include "engine/mesh/sum_velocities.hpp"
namespace trocar {
namespace {

constexpr uint8_t kAllCorners = 7;
constexpr uint32_t kMostRuns = 3 * kMostChunks;  // of cells, of pairs with triangles too large for them, of trees
constexpr size_t kCrowded = 1 << 20;             // triangle pairs of a cell beyond which they are sorted before they are compared

uint32_t find_pair(const BroadPhasePairs& pairs, const std::vector<uint32_t>& first, uint32_t a, uint32_t b) {
    const auto begin = pairs.b.begin() + first[a], end = pairs.b.begin() + first[a + 1];
    const auto at = std::lower_bound(begin, end, b);
    return at != end && *at == b ? uint32_t(at - pairs.b.begin()) : kNone;
}

__m256 empty_hull() { return _mm256_set1_ps(std::numeric_limits<float>::infinity()); }

__m256 hull_of(const std::vector<PackedBox>& box, std::span<const uint32_t> indices) {
    __m256 hull = empty_hull();
    for (const uint32_t index : indices) hull = _mm256_min_ps(hull, load_box(box[index]));
    return hull;
}

struct CellTest {
    const ScreenedTriangles& screened;
    CellChunk& found;
    std::vector<uint32_t>& near_side;  // see NearSides
    uint64_t key;                      // of the cell
    float inv_size;
    uint32_t run, pair;

    uint32_t side(bool of_b) const { return (2 * pair + of_b) * kMostRuns + run; }  // for 11 million pairs
    bool is_near(uint32_t index, bool of_b) const { return near_side[index] == side(of_b); }
    void add_near(uint32_t own, uint32_t across, bool of_b) const {
        if (is_near(own, of_b)) return;
        near_side[own] = side(of_b);
        found.near.push_back({own, across, 2 * pair + of_b});
    }
    void add_both(uint32_t a, uint32_t b) const {
        add_near(a, b, false);
        add_near(b, a, true);
    }
    void add_crossing(uint32_t a, __m256 tight_a, uint32_t b, __m256 tight_b) const {
        if (cell_of_meeting(tight_a, tight_b, inv_size) == key) found.crossing.push_back({a, b, pair});
    }
};

// Entries whose box overlaps a hull, in order. Returns the hull of the kept boxes.
__m256 keep_meeting(const std::vector<PackedBox>& box, std::span<const uint32_t> indices, __m256 hull, std::vector<uint32_t>& kept) {
    const __m256 face = facing(hull);
    __m256 kept_hull = empty_hull();
    kept.clear();
    for (const uint32_t index : indices) {
        const __m256 own = load_box(box[index]);
        if (!meets(face, own)) continue;
        kept.push_back(index);
        kept_hull = _mm256_min_ps(kept_hull, own);
    }
    return kept_hull;
}

// Keeps only boxes that overlap the other list's hull: most are far from the other body.
void cut_to_hulls(const std::vector<PackedBox>& box, std::span<const uint32_t> triangles_a, std::span<const uint32_t> triangles_b,
                  std::vector<uint32_t>& kept_a, std::vector<uint32_t>& kept_b) {
    const __m256 hull = keep_meeting(box, triangles_a, hull_of(box, triangles_b), kept_a);
    kept_b.clear();
    if (!kept_a.empty()) keep_meeting(box, triangles_b, hull, kept_b);
}

// One overlapping box is enough to be near: each entry stops at its first.
void find_near(const CellTest& test, std::span<const uint32_t> own, std::span<const uint32_t> across, bool of_b) {
    const std::vector<PackedBox>& box = test.screened.box;
    for (const uint32_t index : own) {
        if (test.is_near(index, of_b)) continue;
        const __m256 face = facing(load_box(box[index]));
        for (const uint32_t other : across) {
            if (!meets(face, load_box(box[other]))) continue;
            of_b ? test.add_both(other, index) : test.add_both(index, other);
            break;
        }
    }
}

void test_all(const CellTest& test, std::span<const uint32_t> triangles_a, std::span<const uint32_t> triangles_b) {
    CellChunk& c = test.found;
    cut_to_hulls(test.screened.box, triangles_a, triangles_b, c.near_a, c.near_b);
    if (c.near_b.empty()) return;
    find_near(test, c.near_a, c.near_b, false);
    find_near(test, c.near_b, c.near_a, true);
    const std::vector<PackedBox>& tight = test.screened.tight;
    cut_to_hulls(tight, c.near_a, c.near_b, c.sweep_a, c.sweep_b);
    for (const uint32_t a : c.sweep_a) {
        const __m256 tight_a = load_box(tight[a]), face = facing(tight_a);
        for (const uint32_t b : c.sweep_b) {
            const __m256 tight_b = load_box(tight[b]);
            if (meets(face, tight_b)) test.add_crossing(a, tight_a, b, tight_b);
        }
    }
}

// Axis along which the lower corners of the boxes spread most.
uint32_t widest_axis(const std::vector<PackedBox>& box, std::span<const uint32_t> triangles_a, std::span<const uint32_t> triangles_b) {
    std::array<float, 3> low, high;
    low.fill(std::numeric_limits<float>::infinity());
    high.fill(-std::numeric_limits<float>::infinity());
    for (const auto indices : {triangles_a, triangles_b}) {
        for (const uint32_t index : indices) {
            for (uint32_t k = 0; k < 3; ++k) {
                low[k] = std::min(low[k], box[index].min[k]);
                high[k] = std::max(high[k], box[index].min[k]);
            }
        }
    }
    uint32_t axis = 0;
    for (uint32_t k = 1; k < 3; ++k) {
        if (high[k] - low[k] > high[axis] - low[axis]) axis = k;
    }
    return axis;
}

// The same test by a sweep along one axis.
void test_crowded(const CellTest& test, std::span<const uint32_t> triangles_a, std::span<const uint32_t> triangles_b) {
    CellChunk& c = test.found;
    const std::vector<PackedBox>&box = test.screened.box, &tight = test.screened.tight;
    const uint32_t axis = widest_axis(box, triangles_a, triangles_b);
    const auto from = [&](uint32_t index) { return box[index].min[axis]; };
    const auto to = [&](uint32_t index) { return -box[index].neg_max[axis]; };
    const auto sorted = [&](std::span<const uint32_t> indices, std::vector<uint32_t>& out) {
        out.assign(indices.begin(), indices.end());
        std::sort(out.begin(), out.end(), [&](uint32_t x, uint32_t y) { return from(x) < from(y) || (from(x) == from(y) && x < y); });
    };
    const auto compare = [&](uint32_t a, uint32_t b) {
        if (!meets(facing(load_box(box[a])), load_box(box[b]))) return;
        test.add_both(a, b);
        const __m256 tight_a = load_box(tight[a]), tight_b = load_box(tight[b]);
        if (meets(facing(tight_a), tight_b)) test.add_crossing(a, tight_a, b, tight_b);
    };
    sorted(triangles_a, c.sweep_a);
    sorted(triangles_b, c.sweep_b);
    size_t i = 0, j = 0;
    while (i < c.sweep_a.size() && j < c.sweep_b.size()) {
        const uint32_t a = c.sweep_a[i], b = c.sweep_b[j];
        if (from(a) <= from(b)) {
            for (size_t k = j; k < c.sweep_b.size() && from(c.sweep_b[k]) <= to(a); ++k) {
                compare(a, c.sweep_b[k]);
            }
            ++i;
        } else {
            for (size_t k = i; k < c.sweep_a.size() && from(c.sweep_a[k]) <= to(b); ++k) {
                compare(c.sweep_a[k], b);
            }
            ++j;
        }
    }
}

// Clears the last search's results and sizes every thread's scratch without touching its memory.
void start_search(uint32_t indices, CandidateCellsScratch& scratch) {
    for (CellChunk& c : scratch.cells) c.crossing.clear(), c.near.clear();
    if (indices == 0) return;
    ++scratch.search;
    scratch.near_sides.resize(thread_count());
    for (NearSides& sides : scratch.near_sides) sides.last.reserve(indices);
    scratch.cells.resize(kMostRuns);
}

// The calling thread's NearSides, sized for this search.
std::vector<uint32_t>& near_sides(const ScreenedTriangles& screened, CandidateCellsScratch& scratch) {
    NearSides& own = scratch.near_sides[thread_index()];
    if (own.search != scratch.search) own.last.assign(screened.triangle.size(), kNone);
    own.search = scratch.search;
    return own.last;
}

void search_cell(const BroadPhasePairs& pairs, const ScreenedTriangles& screened, const Occupancy& occupancy, uint32_t cell, uint32_t run,
                 std::vector<uint32_t>& near_side, CandidateCellsScratch& scratch) {
    const auto triangles_of = [&](uint32_t object) {
        return subspan(occupancy.primitive_row, range_at(occupancy.primitive_first, object));
    };
    const float inv_size = 1.0f / float(occupancy.cell_size);
    const uint32_t end = occupancy.object_first[cell + 1];
    for (uint32_t i = occupancy.object_first[cell]; i < end; ++i) {
        for (uint32_t j = i + 1; j < end; ++j) {
            const uint32_t pair = find_pair(pairs, scratch.pair_first, occupancy.object[i], occupancy.object[j]);
            if (pair == kNone || scratch.search_of[pair] != PairSearch::kCells) continue;
            const CellTest test{screened, scratch.cells[run], near_side, occupancy.cell_key[cell], inv_size, run, pair};
            const auto a = triangles_of(i), b = triangles_of(j);
            a.size() * b.size() <= kCrowded ? test_all(test, a, b) : test_crowded(test, a, b);
        }
    }
}

void search_cells(const BroadPhasePairs& pairs, const ScreenedTriangles& screened, const Occupancy& occupancy,
                  CandidateCellsScratch& scratch) {
    const uint32_t cells = uint32_t(occupancy.cell_key.size()), grain = std::max(8u, chunk_count(cells, kMostChunks));
    parallel_for(cells, grain, [&](uint32_t begin, uint32_t end) {
        std::vector<uint32_t>& near_side = near_sides(screened, scratch);
        for (uint32_t cell = begin; cell < end; ++cell) search_cell(pairs, screened, occupancy, cell, begin / grain, near_side, scratch);
    });
}

using Finds = std::vector<std::array<uint32_t, 3>>;

// Sorts the results of all runs by first entry, then group (third entry), then second entry.
void sort_by_index(uint32_t indices, Finds CellChunk::*found, CandidateCellsScratch& scratch) {
    scratch.first.assign(indices + 1, 0);
    size_t count = 0;
    for (const CellChunk& c : scratch.cells) {
        count += (c.*found).size();
        for (const auto& f : c.*found) ++scratch.first[f[0] + 1];
    }
    for (uint32_t i = 0; i < indices; ++i) scratch.first[i + 1] += scratch.first[i];
    scratch.by_index.resize(count);
    for (const CellChunk& c : scratch.cells)
        for (const auto& f : c.*found) scratch.by_index[scratch.first[f[0]]++] = f;
    uint32_t begin = 0;
    for (uint32_t index = 0; index < indices; ++index) {
        const uint32_t end = scratch.first[index];
        if (end - begin < 2) {
            begin = end;
            continue;
        }
        std::sort(scratch.by_index.begin() + begin, scratch.by_index.begin() + end,
                  [](const auto& x, const auto& y) { return x[2] < y[2] || (x[2] == y[2] && x[1] < y[1]); });
        begin = end;
    }
}

// Keeps only the first result where several cells found a triangle near the same body. After sort_by_index.
void drop_repeats(Finds& finds) {
    const auto same = [](const auto& x, const auto& y) { return x[0] == y[0] && x[2] == y[2]; };
    finds.erase(std::unique(finds.begin(), finds.end(), same), finds.end());
}

// Distributes sorted results to the groups in their third entries, as local triangles, ascending in each.
// Groups of directly compared pairs keep their given count; their results are copied later.
void deal_out(const ScreenedTriangles& screened, const CandidateCellsScratch& scratch, std::vector<Range>& range,
              std::vector<std::array<uint32_t, 2>>& out) {
    for (const auto& f : scratch.by_index) ++range[f[2]].count;
    uint32_t first = 0;
    for (Range& r : range) {
        r.first = first;
        first += r.count;
    }
    out.resize(first);
    for (const auto& f : scratch.by_index) range[f[2]].count = 0;
    for (const auto& [own, across, group] : scratch.by_index) {
        Range& r = range[group];
        out[r.first + r.count++] = {screened.triangle[own], screened.triangle[across]};
    }
}

void cut_to_hull_of(const std::vector<PackedBox>& box, Range indices, __m256 hull, std::vector<uint32_t>& kept) {
    const __m256 face = facing(hull);
    uint32_t count = 0;
    kept.resize(indices.count);
    for (uint32_t index = indices.first; index < indices.end(); ++index) {
        kept[count] = index;
        count += meets(face, load_box(box[index]));
    }
    kept.resize(count);
}

void put_side(const PackedBox& box, size_t slot, BoxSides& sides) {
    for (int k = 0; k < 3; ++k) sides[k][slot] = box.min[k], sides[3 + k][slot] = box.neg_max[k];
}

void lay_out_sides(const std::vector<PackedBox>& box, const std::vector<uint32_t>& indices, BoxSides& sides) {
    const size_t room = (indices.size() + 7) / 8 * 8;
    for (auto& side : sides) side.resize(room);
    for (size_t i = 0; i < indices.size(); ++i) put_side(box[indices[i]], i, sides);
    for (auto& side : sides) std::fill(side.begin() + indices.size(), side.end(), std::numeric_limits<float>::infinity());  // pads
}

// Hulls of eight boxes each.
void lay_out_hulls(const std::vector<PackedBox>& box, const std::vector<uint32_t>& indices, BoxSides& hulls) {
    const size_t eights = (indices.size() + 7) / 8, room = (eights + 7) / 8 * 8;
    for (auto& side : hulls) side.assign(room, std::numeric_limits<float>::infinity());
    for (size_t e = 0; e < eights; ++e) {
        PackedBox packed;
        _mm256_store_ps(packed.min.data(), hull_of(box, std::span(indices).subspan(8 * e, std::min(size_t{8}, indices.size() - 8 * e))));
        put_side(packed, e, hulls);
    }
}

// Tests eight boxes against one; the result is a bit mask.
struct BoxLimits {
    __m256 limit[6];
    explicit BoxLimits(const PackedBox& box) {
        for (int k = 0; k < 3; ++k) limit[k] = _mm256_set1_ps(-box.neg_max[k]), limit[3 + k] = _mm256_set1_ps(-box.min[k]);
    }
    uint32_t meeting(const BoxSides& sides, size_t first) const {
        __m256 met = _mm256_cmp_ps(_mm256_loadu_ps(&sides[0][first]), limit[0], _CMP_LE_OQ);
        for (int k = 1; k < 6; ++k) met = _mm256_and_ps(met, _mm256_cmp_ps(_mm256_loadu_ps(&sides[k][first]), limit[k], _CMP_LE_OQ));
        return uint32_t(_mm256_movemask_ps(met));
    }
};

// Calls `Eight` for every eight boxes of which some overlap one, ascending, with their bits. Tests only
// eights whose hull overlaps: consecutive triangles of a mesh are usually neighbours.
template <typename Eight>  // Eight: void(size_t eight, uint32_t met)
void for_each_meeting_eight(const BoxLimits& limits, const BoxSides& sides, const BoxSides& hulls, const Eight& look_at) {
    for (size_t i = 0; i < hulls[0].size(); i += 8) {
        for (uint32_t eights = limits.meeting(hulls, i); eights != 0; eights &= eights - 1) {
            const size_t eight = i + uint32_t(__builtin_ctz(eights));
            const uint32_t met = limits.meeting(sides, 8 * eight);
            if (met != 0) look_at(eight, met);
        }
    }
}

// The longer list is filtered first.
void cut_to_hulls(const ScreenedTriangles& screened, Range a, Range b, DirectChunk& c) {
    __m256 hull = empty_hull();
    const bool a_first = a.count > b.count;
    const Range small = a_first ? b : a;
    for (uint32_t index = small.first; index < small.end(); ++index) hull = _mm256_min_ps(hull, load_box(screened.box[index]));
    cut_to_hull_of(screened.box, a_first ? a : b, hull, c.indices[!a_first]);
    cut_to_hull_of(screened.box, small, hull_of(screened.box, c.indices[!a_first]), c.indices[a_first]);
}

// Mean velocities of the deformable bodies in pairs; non-finite values count as zero.
void find_drifts(const Surfaces& s, const BroadPhasePairs& pairs, CandidateCellsScratch& scratch) {
    const uint32_t bodies = uint32_t(s.bodies.mesh.size());
    scratch.drift.resize(bodies);
    scratch.paired.assign(bodies, 0);
    for (const auto* side : {&pairs.a, &pairs.b})
        for (const uint32_t body : *side) scratch.paired[body] = is_deformable(s.bodies, body);
    parallel_for(bodies, 32, [&](uint32_t begin, uint32_t end) {
        for (uint32_t body = begin; body < end; ++body) {
            if (!scratch.paired[body]) continue;
            const Range indices = s.bodies.particles[body];
            scratch.drift[body] = sum_velocities(s.particles, indices.first, indices.count).sum / std::max(1u, indices.count);
        }
    });
}

bool is_static(const Bodies& bodies, uint32_t body) { return bodies.motion[body] == Motion::kStatic; }

// Farthest position (m from `base`) of each vertex of a body along a direction in a period, relative to a
// body that moves with `drift`; returns the farthest of all. Non-finite vertices do not count.
double reach_along(const Surfaces& s, uint32_t body, double period, const Vec3d& base, const Vec3d& direction, const Vec3d& drift,
                   std::vector<double>& along) {
    project_vertices(s, body, base, direction, along);
    const uint32_t count = uint32_t(along.size());
    if (!is_static(s.bodies, body)) {
        const Particles& v = s.particles;
        const double still = drift.dot(direction);
        const uint32_t first = s.bodies.particles[body].first;
        const float *x = v.velocity_x.data() + first, *y = v.velocity_y.data() + first, *z = v.velocity_z.data() + first;
        uint32_t i = 0;
        for (; i + 4 <= count; i += 4) {
            const auto part = [i](const float* at, double factor) { return factor * (Vec4d)_mm256_cvtps_pd(_mm_loadu_ps(at + i)); };
            const Vec4d speed = part(x, direction.x()) + part(y, direction.y()) + part(z, direction.z()) - still;
            const Vec4d size = (Vec4d)_mm256_andnot_pd(_mm256_set1_pd(-0.0), (__m256d)speed);
            _mm256_storeu_pd(&along[i], (__m256d)((Vec4d)_mm256_loadu_pd(&along[i]) + size * period));
        }
        for (; i < count; ++i) along[i] += std::abs(direction.x() * x[i] + direction.y() * y[i] + direction.z() * z[i] - still) * period;
    }
    double farthest = -std::numeric_limits<double>::infinity();
    for (const double a : along)
        if (a > farthest) farthest = a;
    return farthest;
}

// Boxes of slanted triangles and margins of a body's fastest vertex locate contact only coarsely.
void cut_to_slabs(const ContactInputs& in, std::span<const ExternalDisplacement> external, const ScreenedTriangles& screened,
                  std::span<const Vec3d> drift, const std::array<uint32_t, 2>& body, DirectChunk& c) {
    const Surfaces& s = in.surfaces;
    for (int k = 0; k < 2; ++k) c.corners[k].assign(c.indices[k].size(), kAllCorners);
    constexpr uint32_t kManyVertices = 4096;  // of a static body; above this few of its triangles would be among the candidates
    for (const uint32_t b : body) {
        if (is_deformable(s.bodies, b)) continue;
        if (!is_static(s.bodies, b) || s.meshes.info[s.bodies.mesh[b]].vertices.count > kManyVertices) return;
    }
    const Box& first = in.boxes.box[body[0]];
    const Vec3d base = 0.5 * (first.min + first.max), apart = direction_between(s, in.boxes, body[0], body[1]);
    const double distance = apart.norm();
    if (!(distance > 0)) return;
    const bool both_move = !is_static(s.bodies, body[0]) && !is_static(s.bodies, body[1]);
    const Vec3d direction = apart / distance, mean = both_move ? Vec3d(0.5 * (drift[body[0]] + drift[body[1]])) : Vec3d::Zero();
    double slack = in.fall + 1e-12 * (distance + base.norm());
    slack += external_displacement_along(external, body[0], direction) + external_displacement_along(external, body[1], -direction);
    for (const uint32_t b : body) slack += reach_at_rest(s, b);
    double farthest[2];
    for (int k = 0; k < 2; ++k) farthest[k] = reach_along(s, body[k], in.period, base, k ? Vec3d(-direction) : direction, mean, c.along[k]);
    for (int k = 0; k < 2; ++k) {
        const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body[k]]);
        const double needed = -farthest[1 - k] - slack;
        const auto gets_there = [&](uint32_t v) { return !(c.along[k][v] < needed); };
        uint32_t kept = 0;
        for (const uint32_t index : c.indices[k]) {
            const Triangle& t = mesh.triangle[screened.triangle[index]];
            const int corners = gets_there(t[0]) | gets_there(t[1]) << 1 | gets_there(t[2]) << 2;
            if (corners == 0) continue;
            c.indices[k][kept] = index;
            c.corners[k][kept++] = uint8_t(corners);
        }
        c.indices[k].resize(kept);
        c.corners[k].resize(kept);
    }
}

// Every triangle of a against every one of b. Results ascend by a, then b.
void compare_directly(const ScreenedTriangles& screened, DirectChunk& c, DirectFinds& found) {
    lay_out_sides(screened.box, c.indices[1], c.sides);
    lay_out_sides(screened.tight, c.indices[1], c.tight_sides);
    lay_out_hulls(screened.box, c.indices[1], c.hulls);
    c.across.resize(c.indices[1].size());
    c.met.assign(c.sides[0].size() / 8, 0);
    const uint32_t first_crossing = uint32_t(c.crossing.size()), first_near = uint32_t(c.near.size());
    const auto triangle_at = [&](size_t j) { return screened.triangle[c.indices[1][j]]; };
    for (size_t r = 0; r < c.indices[0].size(); ++r) {
        const uint32_t index = c.indices[0][r], triangle = screened.triangle[index];
        const BoxLimits limits(screened.box[index]), tight(screened.tight[index]);
        uint32_t across = kNone;
        for_each_meeting_eight(limits, c.sides, c.hulls, [&](size_t i, uint32_t met) {
            if (across == kNone) across = triangle_at(8 * i + uint32_t(__builtin_ctz(met)));
            for (uint32_t fresh = met & ~c.met[i]; fresh != 0; fresh &= fresh - 1)
                c.across[8 * i + uint32_t(__builtin_ctz(fresh))] = triangle;
            c.met[i] |= uint8_t(met);
            for (uint32_t bits = met & tight.meeting(c.tight_sides, 8 * i); bits != 0; bits &= bits - 1)
                c.crossing.push_back({triangle, triangle_at(8 * i + uint32_t(__builtin_ctz(bits)))});
        });
        if (across == kNone) continue;
        c.near.push_back({triangle, across});
        c.near_corners.push_back(c.corners[0][r]);
    }
    found.crossing = {first_crossing, uint32_t(c.crossing.size()) - first_crossing};
    found.near[0] = {first_near, uint32_t(c.near.size()) - first_near};
    for (size_t j = 0; j < c.indices[1].size(); ++j) {
        if (!(c.met[j / 8] >> (j % 8) & 1)) continue;
        c.near.push_back({triangle_at(j), c.across[j]});
        c.near_corners.push_back(c.corners[1][j]);
    }
    found.near[1] = {found.near[0].end(), uint32_t(c.near.size()) - found.near[0].end()};
}

uint32_t pair_grain(const BroadPhasePairs& pairs) { return coarse_grain(uint32_t(pairs.a.size())); }

// Finds and counts the results of all directly compared pairs.
void search_direct(const ContactInputs& in, const DirectPairs& direct, const ScreenedTriangles& screened, CandidateCellsScratch& scratch,
                   CandidateTriangles& candidates) {
    const BroadPhasePairs& pairs = in.pairs;
    const uint32_t count = uint32_t(pairs.a.size()), grain = pair_grain(pairs);
    candidates.pair.assign(count, {});
    candidates.side.assign(2 * size_t{count}, {});
    scratch.direct.resize(count);
    scratch.search_of.resize(count);
    for (uint32_t pair = 0; pair < count; ++pair) scratch.search_of[pair] = pair_search(in, screened, pair, direct.most);
    if (direct.most == 0) return;
    if (count > 0) find_drifts(in.surfaces, pairs, scratch);
    if (scratch.chunk.size() < chunk_count(count, grain)) scratch.chunk.resize(chunk_count(count, grain));
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        DirectChunk& chunk = scratch.chunk[begin / grain];
        chunk.crossing.clear();
        chunk.near.clear();
        chunk.near_corners.clear();
        for (uint32_t pair = begin; pair < end; ++pair) {
            if (scratch.search_of[pair] != PairSearch::kDirect) continue;
            DirectFinds& found = scratch.direct[pair];
            cut_to_hulls(screened, screened.body[pairs.a[pair]], screened.body[pairs.b[pair]], chunk);
            cut_to_slabs(in, direct.external, screened, scratch.drift, {pairs.a[pair], pairs.b[pair]}, chunk);
            compare_directly(screened, chunk, found);
            candidates.pair[pair].count = found.crossing.count;
            for (int side = 0; side < 2; ++side) candidates.side[2 * pair + side].count = found.near[side].count;
        }
    });
}

// Every one of `large` against the other body's triangles except `done`; both ascend.
void compare_large(const CellTest& test, std::span<const uint32_t> large, Range others, std::span<const uint32_t> done, bool large_of_b) {
    const std::vector<PackedBox>&box = test.screened.box, &tight = test.screened.tight;
    CellChunk& c = test.found;
    cut_to_hull_of(box, others, hull_of(box, large), c.near_b);
    std::erase_if(c.near_b, [&](uint32_t index) { return std::binary_search(done.begin(), done.end(), index); });
    keep_meeting(box, large, hull_of(box, c.near_b), c.near_a);
    lay_out_sides(box, c.near_b, c.sides);
    lay_out_hulls(box, c.near_b, c.hulls);
    for (const uint32_t index : c.near_a) {
        const __m256 face = facing(load_box(tight[index]));
        for_each_meeting_eight(BoxLimits(box[index]), c.sides, c.hulls, [&](size_t eight, uint32_t met) {
            for (; met != 0; met &= met - 1) {
                const uint32_t other = c.near_b[8 * eight + uint32_t(__builtin_ctz(met))];
                const uint32_t a = large_of_b ? other : index, b = large_of_b ? index : other;
                test.add_both(a, b);
                if (meets(face, load_box(tight[other]))) c.crossing.push_back({a, b, test.pair});
            }
        });
    }
}

// Triangles too large for the cells: each against all triangles of the other body.
void search_oversize(const BroadPhasePairs& pairs, const ScreenedTriangles& screened, const Occupancy& occupancy,
                     CandidateCellsScratch& scratch) {
    const std::vector<uint32_t>& large = occupancy.oversize;
    if (large.empty()) return;
    const auto large_of = [&](Range indices) {
        const auto begin = std::lower_bound(large.begin(), large.end(), indices.first);
        return std::span(begin, std::lower_bound(begin, large.end(), indices.end()));
    };
    const uint32_t grain = pair_grain(pairs);
    parallel_for(uint32_t(pairs.a.size()), grain, [&](uint32_t begin, uint32_t end) {
        std::vector<uint32_t>& near_side = near_sides(screened, scratch);
        const uint32_t run = kMostChunks + begin / grain;
        for (uint32_t pair = begin; pair < end; ++pair) {
            if (scratch.search_of[pair] != PairSearch::kCells) continue;
            const Range triangles_a = screened.body[pairs.a[pair]], triangles_b = screened.body[pairs.b[pair]];
            const auto large_a = large_of(triangles_a), large_b = large_of(triangles_b);
            const CellTest test{screened, scratch.cells[run], near_side, 0, 0, run, pair};
            if (!large_a.empty()) compare_large(test, large_a, triangles_b, {}, false);
            if (!large_b.empty()) compare_large(test, large_b, triangles_a, large_a, true);
        }
    });
}

// Attaches the triangles of the pairs to be searched by trees to those trees.
void hang_bodies(const ContactInputs& in, const ScreenedTriangles& screened, CandidateCellsScratch& scratch) {
    const BroadPhasePairs& pairs = in.pairs;
    scratch.tree_body.clear();
    for (uint32_t pair = 0; pair < pairs.a.size(); ++pair) {
        if (scratch.search_of[pair] != PairSearch::kTrees) continue;
        scratch.tree_body.push_back(pairs.a[pair]);
        scratch.tree_body.push_back(pairs.b[pair]);
    }
    std::sort(scratch.tree_body.begin(), scratch.tree_body.end());
    scratch.tree_body.erase(std::unique(scratch.tree_body.begin(), scratch.tree_body.end()), scratch.tree_body.end());
    if (!scratch.tree_body.empty() && scratch.tree.size() < screened.body.size()) scratch.tree.resize(screened.body.size());
    parallel_for(uint32_t(scratch.tree_body.size()), 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            const uint32_t body = scratch.tree_body[i];
            hang_triangles(*in.trees[in.surfaces.bodies.tree[body]], screened, body, scratch.tree[body]);
        }
    });
}

// Start points of the walks of all pairs of trees: enough that every thread gets some.
void seed_trees(const BroadPhasePairs& pairs, CandidateCellsScratch& scratch) {
    scratch.seed.clear();
    for (uint32_t pair = 0; pair < pairs.a.size(); ++pair) {
        if (scratch.search_of[pair] != PairSearch::kTrees) continue;
        open_node_pairs(scratch.tree[pairs.a[pair]], scratch.tree[pairs.b[pair]], 4 * kMostChunks, scratch.open, scratch.opened);
        for (const NodePair& from : scratch.open) scratch.seed.push_back({pair, from});
    }
}

void search_trees(const BroadPhasePairs& pairs, const ScreenedTriangles& screened, CandidateCellsScratch& scratch) {
    const uint32_t count = uint32_t(scratch.seed.size()), grain = coarse_grain(count);
    parallel_for(count, grain, [&](uint32_t begin, uint32_t end) {
        std::vector<uint32_t>& near_side = near_sides(screened, scratch);
        const uint32_t run = 2 * kMostChunks + begin / grain;
        CellChunk& c = scratch.cells[run];
        for (uint32_t i = begin; i < end; ++i) {
            const auto [pair, from] = scratch.seed[i];
            const CellTest test{screened, c, near_side, 0, 0, run, pair};
            c.meeting.clear();
            find_meeting_triangles(scratch.tree[pairs.a[pair]], scratch.tree[pairs.b[pair]], from, c.meeting);
            for (const MeetingTriangles& m : c.meeting) {
                test.add_both(m.a, m.b);
                if (m.may_cross) c.crossing.push_back({m.a, m.b, pair});
            }
        }
    });
}

void put_direct(const BroadPhasePairs& pairs, const CandidateCellsScratch& scratch, CandidateTriangles& candidates) {
    const uint32_t grain = pair_grain(pairs);
    parallel_for(uint32_t(pairs.a.size()), grain, [&](uint32_t begin, uint32_t end) {
        const auto copy = [](const auto& from, Range indices, auto& to, Range slot) {
            std::copy_n(from.begin() + indices.first, indices.count, to.begin() + slot.first);
        };
        for (uint32_t pair = begin; pair < end; ++pair) {
            if (scratch.search_of[pair] != PairSearch::kDirect) continue;
            const DirectChunk& chunk = scratch.chunk[begin / grain];
            const DirectFinds& found = scratch.direct[pair];
            copy(chunk.crossing, found.crossing, candidates.triangle, candidates.pair[pair]);
            for (int side = 0; side < 2; ++side) {
                copy(chunk.near, found.near[side], candidates.near, candidates.side[2 * pair + side]);
                copy(chunk.near_corners, found.near[side], candidates.near_corners, candidates.side[2 * pair + side]);
            }
        }
    });
}

}  // namespace

void find_candidate_triangles(const ContactInputs& in, const DirectPairs& direct, const ScreenedTriangles& screened,
                              const Occupancy& occupancy, CandidateCellsScratch& scratch, CandidateTriangles& candidates) {
    const BroadPhasePairs& pairs = in.pairs;
    const uint32_t bodies = uint32_t(screened.body.size());
    scratch.pair_first.assign(bodies + 1, 0);
    for (const uint32_t a : pairs.a) ++scratch.pair_first[a + 1];
    for (uint32_t i = 0; i < bodies; ++i) scratch.pair_first[i + 1] += scratch.pair_first[i];
    search_direct(in, direct, screened, scratch, candidates);
    hang_bodies(in, screened, scratch);
    seed_trees(pairs, scratch);
    const bool any = !occupancy.cell_key.empty() || !occupancy.oversize.empty() || !scratch.seed.empty();
    const uint32_t indices = any ? uint32_t(screened.triangle.size()) : 0;
    start_search(indices, scratch);
    search_cells(pairs, screened, occupancy, scratch);
    search_oversize(pairs, screened, occupancy, scratch);
    search_trees(pairs, screened, scratch);
    sort_by_index(indices, &CellChunk::crossing, scratch);
    deal_out(screened, scratch, candidates.pair, candidates.triangle);
    sort_by_index(indices, &CellChunk::near, scratch);
    drop_repeats(scratch.by_index);
    deal_out(screened, scratch, candidates.side, candidates.near);
    candidates.near_corners.assign(candidates.near.size(), kAllCorners);
    put_direct(pairs, scratch, candidates);
    candidates.beside.clear();
}

}  // namespace trocar
