#include "systems/detect/broad/rasterise.hpp"

#include <algorithm>

#include "engine/base/check.hpp"
#include "engine/contact/direct_pairs.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

constexpr uint32_t kMostCells = 64;  // per triangle; larger triangles go to the oversize list
constexpr double kGridCells = (1 << 21) - 2;

Box overlap_of(const Box& a, const Box& b) { return {a.min.cwiseMax(b.min), a.max.cwiseMin(b.max)}; }
Box enlarged(const Box& box, double by) { return {box.min - Vec3d::Constant(by), box.max + Vec3d::Constant(by)}; }
Box joined(const Box& a, const Box& b) { return {a.min.cwiseMin(b.min), a.max.cwiseMax(b.max)}; }

// Overlap boxes of all pairs that touch by triangles, enlarged slightly beyond rounding, and the list of each body's.
Box collect_regions(const ContactInputs& in, RasteriseScratch& scratch) {
    const BodyBoxes& boxes = in.boxes;
    const BroadPhasePairs& pairs = in.pairs;
    const uint32_t count = uint32_t(pairs.a.size()), bodies = uint32_t(boxes.box.size());
    Box all;
    scratch.region.resize(count);
    scratch.region_first.assign(bodies + 2, 0);
    scratch.by_triangles.resize(count);
    for (uint32_t i = 0; i < count; ++i) {
        scratch.by_triangles[i] = !touch_as_hulls(in, i);
        if (!scratch.by_triangles[i]) continue;
        const Box region = overlap_of(boxes.box[pairs.a[i]], boxes.box[pairs.b[i]]);
        scratch.region[i] = enlarged(region, 1e-14 * region.min.cwiseAbs().cwiseMax(region.max.cwiseAbs()).maxCoeff());
        all = joined(all, scratch.region[i]);
        ++scratch.region_first[pairs.a[i] + 2];
        ++scratch.region_first[pairs.b[i] + 2];
    }
    for (uint32_t i = 0; i < bodies; ++i) scratch.region_first[i + 2] += scratch.region_first[i + 1];
    scratch.region_pair.resize(2 * size_t(count));
    for (uint32_t i = 0; i < count; ++i) {
        if (!scratch.by_triangles[i]) continue;
        scratch.region_pair[scratch.region_first[pairs.a[i] + 1]++] = i;
        scratch.region_pair[scratch.region_first[pairs.b[i] + 1]++] = i;
    }
    const uint32_t regions = scratch.region_first[bodies];
    scratch.packed_region.resize(regions);
    for (uint32_t i = 0; i < regions; ++i) {
        scratch.packed_region[i] = pack_box(scratch.region[scratch.region_pair[i]], all.min);
    }
    scratch.body.clear();
    for (uint32_t body = 0; body < bodies; ++body) {
        if (scratch.region_first[body + 1] > scratch.region_first[body]) scratch.body.push_back(body);
    }
    return all;
}

// Outcodes: the sides of the box beyond which each vertex lies; a triangle whose corners share a side misses
// the box. Non-finite vertices may have none.
void find_outcodes(const BodyPoints& points, __m256d low, __m256d high, std::vector<uint8_t>& outcode) {
    const uint32_t count = uint32_t(outcode.size());
    for (uint32_t v = 0; v < count; ++v) {
        const __m256d p = points(v);
        const int below = _mm256_movemask_pd(_mm256_cmp_pd(p, low, _CMP_LT_OQ));
        const int above = _mm256_movemask_pd(_mm256_cmp_pd(p, high, _CMP_GT_OQ));
        outcode[v] = uint8_t(below | above << 4);
    }
}

// The same for float offsets, two at a time; the box is in their frame and rounded outward to floats.
void find_outcodes(std::span<const Float4> offset, const Box& box, std::vector<uint8_t>& outcode) {
    const float inf = std::numeric_limits<float>::infinity();
    alignas(16) float low[4] = {0, 0, 0, -inf}, high[4] = {0, 0, 0, inf};
    for (int k = 0; k < 3; ++k) {
        low[k] = std::nextafter(float(box.min[k]), -inf);
        high[k] = std::nextafter(float(box.max[k]), inf);
    }
    const __m128 low4 = _mm_load_ps(low), high4 = _mm_load_ps(high);
    const __m256 low8 = _mm256_set_m128(low4, low4), high8 = _mm256_set_m128(high4, high4);
    const uint32_t count = uint32_t(outcode.size());
    uint32_t v = 0;
    for (; v + 2 <= count; v += 2) {
        const __m256 p = _mm256_loadu_ps(&offset[v].x);
        const uint32_t below = uint32_t(_mm256_movemask_ps(_mm256_cmp_ps(p, low8, _CMP_LT_OQ)));
        const uint32_t above = uint32_t(_mm256_movemask_ps(_mm256_cmp_ps(p, high8, _CMP_GT_OQ)));
        outcode[v] = uint8_t((below & 15) | above << 4);
        outcode[v + 1] = uint8_t(below >> 4 | (above & 0xf0));
    }
    for (; v < count; ++v) {
        const __m128 p = _mm_loadu_ps(&offset[v].x);
        outcode[v] = uint8_t(_mm_movemask_ps(_mm_cmplt_ps(p, low4)) | _mm_movemask_ps(_mm_cmpgt_ps(p, high4)) << 4);
    }
}

float perimeter(__m256d a, __m256d b, __m256d c) {
    const __m128 ab = _mm256_cvtpd_ps(_mm256_sub_pd(b, a)), bc = _mm256_cvtpd_ps(_mm256_sub_pd(c, b)),
                 ca = _mm256_cvtpd_ps(_mm256_sub_pd(a, c));
    const __m128 squares =
        _mm_hadd_ps(_mm_hadd_ps(_mm_mul_ps(ab, ab), _mm_mul_ps(bc, bc)), _mm_hadd_ps(_mm_mul_ps(ca, ca), _mm_setzero_ps()));
    alignas(16) float length[4];
    _mm_store_ps(length, _mm_sqrt_ps(squares));
    return length[0] + length[1] + length[2];
}

// Adds the triangles of one body (an index into scratch.body) whose enlarged box meets one of its regions.
void screen_body(const ContactInputs& in, const Vec3d& origin, uint32_t index, RasteriseScratch& scratch, ScreenChunk& screen) {
    const Surfaces& s = in.surfaces;
    const uint32_t body = scratch.body[index];
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const double reach = reach_of(s.bodies, in.boxes, body);
    const uint32_t first = scratch.region_first[body], end = scratch.region_first[body + 1];
    Box all;
    for (uint32_t i = first; i < end; ++i) all = joined(all, scratch.region[scratch.region_pair[i]]);
    const Box wide = enlarged(all, reach);
    const BodyPoints points(s, body, origin);
    screen.outcode.resize(mesh.position.size());
    if (is_deformable(s.bodies, body)) {
        const Vec3d& own = s.poses.origin[body];
        const Box box = {wide.min - own, wide.max - own};
        find_outcodes(std::span(s.particles.offset).subspan(s.bodies.particles[body].first), box, screen.outcode);
    } else {
        const double inf = std::numeric_limits<double>::infinity();
        const Vec3d a = wide.min - origin, b = wide.max - origin;
        find_outcodes(points, _mm256_setr_pd(a.x(), a.y(), a.z(), -inf), _mm256_setr_pd(b.x(), b.y(), b.z(), inf), screen.outcode);
    }

    const uint32_t triangles = uint32_t(mesh.triangle.size());
    if (screen.triangle.size() < screen.used + triangles) screen.triangle.resize(screen.used + triangles);
    uint32_t* const candidate = screen.triangle.data() + screen.used;
    find_block_codes(screen.outcode, screen.block_code);
    const uint32_t count =
        find_sideless_triangles(mesh.triangle, scratch.runs[s.bodies.mesh[body]], screen.outcode, screen.block_code, candidate);

    if (screen.box.size() < screen.used + count) {
        screen.box.resize(screen.used + count);
        screen.tight.resize(screen.used + count);
    }
    double edge_sum = 0;
    uint32_t kept = 0;
    const __m256d grow = _mm256_setr_pd(reach, reach, reach, 0);
    for (uint32_t k = 0; k < count; ++k) {
        const Triangle& corner = mesh.triangle[candidate[k]];
        const __m256d p = points(corner[0]), q = points(corner[1]), r = points(corner[2]);
        if (!is_finite(p) || !is_finite(q) || !is_finite(r)) continue;
        const __m256d low = _mm256_min_pd(_mm256_min_pd(p, q), r), high = _mm256_max_pd(_mm256_max_pd(p, q), r);
        const PackedBox box = pack_box(_mm256_sub_pd(low, grow), _mm256_add_pd(high, grow));
        const __m256 face = facing(load_box(box));
        bool met = false;
        for (uint32_t i = first; i < end && !met; ++i) met = meets(face, load_box(scratch.packed_region[i]));
        if (!met) continue;
        candidate[kept] = candidate[k];
        screen.box[screen.used + kept] = box;
        screen.tight[screen.used + kept++] = pack_box(low, high);
        edge_sum += perimeter(p, q, r);
    }
    screen.used += kept;
    scratch.kept[index] = kept;
    scratch.edge_sum[index] = edge_sum;
}

uint64_t count_triangles(const Surfaces& s, std::span<const uint32_t> bodies) {
    uint64_t triangles = 0;
    for (const uint32_t body : bodies) triangles += s.meshes.info[s.bodies.mesh[body]].triangles.count;
    return triangles;
}

template <typename Triangles>
void reserve_indices(size_t count, Triangles& used) {
    used.triangle.reserve(count);
    used.box.reserve(count);
    used.tight.reserve(count);
}

// Screens all bodies, several small ones per chunk so that their results are contiguous.
void screen_bodies(const ContactInputs& in, const Vec3d& origin, RasteriseScratch& scratch) {
    const Surfaces& s = in.surfaces;
    const uint32_t bodies = uint32_t(scratch.body.size()), grain = bodies < 128 ? 1 : 32;
    if (scratch.screen.size() < chunk_count(bodies, grain)) scratch.screen.resize(chunk_count(bodies, grain));
    for (ScreenChunk& chunk : scratch.screen) chunk.used = 0;
    scratch.runs.resize(s.meshes.info.size());
    for (const uint32_t body : scratch.body) {
        const uint32_t mesh = s.bodies.mesh[body];
        keep_runs(mesh_view(s.meshes, mesh).triangle, scratch.runs[mesh]);
    }
    scratch.kept.resize(bodies);
    scratch.edge_sum.resize(bodies);
    parallel_for(bodies, grain, [&](uint32_t begin, uint32_t end) {
        ScreenChunk& chunk = scratch.screen[begin / grain];
        // reserve the maximum for this chunk: unused memory takes no pages, and moving the used part takes
        // fresh ones
        const uint64_t most = count_triangles(s, std::span(scratch.body).subspan(begin, end - begin));
        if (chunk.box.capacity() < most) reserve_indices(most + most / 2, chunk);
        for (uint32_t index = begin; index < end; ++index) screen_body(in, origin, index, scratch, chunk);
    });
}

// Concatenates the chunks' results. Returns the mean edge of all, m.
double gather_screens(const ContactInputs& in, const RasteriseScratch& scratch, ScreenedTriangles& screened) {
    size_t used = 0;
    for (const ScreenChunk& chunk : scratch.screen) used += chunk.used;
    if (screened.box.capacity() < used) {
        const size_t most = count_triangles(in.surfaces, scratch.body);
        reserve_indices(std::min(4 * used, most + most / 2), screened);
    }
    screened.triangle.resize(used);
    screened.box.resize(used);
    screened.tight.resize(used);
    const uint32_t chunks = uint32_t(scratch.screen.size());
    parallel_for(chunks, std::max(1u, chunks / 16), [&](uint32_t begin, uint32_t end) {
        size_t to = 0;
        for (uint32_t i = 0; i < begin; ++i) to += scratch.screen[i].used;
        for (uint32_t i = begin; i < end; ++i) {
            const ScreenChunk& chunk = scratch.screen[i];
            std::copy_n(chunk.triangle.begin(), chunk.used, screened.triangle.begin() + ptrdiff_t(to));
            std::copy_n(chunk.box.begin(), chunk.used, screened.box.begin() + ptrdiff_t(to));
            std::copy_n(chunk.tight.begin(), chunk.used, screened.tight.begin() + ptrdiff_t(to));
            to += chunk.used;
        }
    });
    screened.body.assign(in.boxes.box.size(), {});
    uint32_t first = 0;
    double edge_sum = 0;
    for (uint32_t index = 0; index < scratch.body.size(); ++index) {
        screened.body[scratch.body[index]] = {first, scratch.kept[index]};
        first += scratch.kept[index];
        edge_sum += scratch.edge_sum[index];
    }
    return screened.triangle.empty() ? 0 : edge_sum / (3.0 * double(screened.triangle.size()));
}

// Cells grow if the region needs more than 21 bits per axis, or speed makes most boxes larger than them.
double choose_cell_size(const ContactInputs& in, double mean_edge, const Vec3d& extent, const ScreenedTriangles& screened,
                        const RasteriseScratch& scratch) {
    double reach = 0;
    for (const uint32_t body : scratch.body) reach += screened.body[body].count * reach_of(in.surfaces.bodies, in.boxes, body);
    if (!screened.triangle.empty()) reach /= double(screened.triangle.size());
    const double size = std::max({in.params.cell_edges * mean_edge, 2 * reach, extent.maxCoeff() / kGridCells});
    return size > 0 && std::isfinite(size) ? size : 1.0;
}

uint64_t cell_count(const CellRange& cells) {
    return uint64_t(cells.last[0] - cells.first[0] + 1) * (cells.last[1] - cells.first[1] + 1) * (cells.last[2] - cells.first[2] + 1);
}

// Hull of the regions of one body: outside it no cell can be shared.
__m256 clip_of(uint32_t body, const Vec3d& origin, const RasteriseScratch& scratch) {
    Box all;
    for (uint32_t i = scratch.region_first[body]; i < scratch.region_first[body + 1]; ++i) {
        all = joined(all, scratch.region[scratch.region_pair[i]]);
    }
    return load_box(pack_box(all, origin));
}

// Calls visit(index, body, cells) for the triangles of all bodies in cells, in order, and end(cells) after
// those of a body, which lie in these cells. Triangles of too many cells are listed and visited with none.
template <typename Visit, typename End>
void for_each_triangle(const ScreenedTriangles& screened, float inv_size, const RasteriseScratch& scratch, Occupancy& occupancy,
                       const Visit& visit, const End& end) {
    occupancy.oversize.clear();
    for (const uint32_t body : scratch.body) {
        const __m256 clip = clip_of(body, screened.origin, scratch);
        for (uint32_t index = screened.body[body].first; index < screened.body[body].end(); ++index) {
            CellRange cells = cells_of(_mm256_max_ps(load_box(screened.box[index]), clip), inv_size);
            if (cell_count(cells) > kMostCells) {
                occupancy.oversize.push_back(index);
                cells = {{1, 0, 0, 0}, {0, 0, 0, 0}};
            }
            visit(index, body, cells);
        }
        end(cells_of(clip, inv_size));
    }
}

// Distributes the first `kept` references to the layers. cell_first has their number for each cell, shifted
// by one.
void fill_layers(const ScreenedTriangles& screened, size_t kept, RasteriseScratch& scratch, Occupancy& occupancy) {
    const uint32_t cells = uint32_t(occupancy.cell_key.size());
    for (uint32_t i = 0; i < cells; ++i) scratch.cell_first[i + 1] += scratch.cell_first[i];
    occupancy.primitive.resize(kept);
    occupancy.primitive_row.resize(kept);
    scratch.cell_body.resize(kept);
    scratch.next.assign(scratch.cell_first.begin(), scratch.cell_first.end());
    for (size_t i = 0; i < kept; ++i) {
        const CellReference& reference = scratch.reference[i];
        const uint32_t to_slot = scratch.next[reference.cell]++;
        occupancy.primitive_row[to_slot] = reference.index;
        occupancy.primitive[to_slot] = screened.triangle[reference.index];
        scratch.cell_body[to_slot] = reference.body;
    }
    occupancy.object_first.clear();
    occupancy.object.clear();
    occupancy.primitive_first.clear();
    for (uint32_t cell = 0; cell < cells; ++cell) {
        occupancy.object_first.push_back(uint32_t(occupancy.object.size()));
        for (uint32_t i = scratch.cell_first[cell]; i < scratch.cell_first[cell + 1]; ++i) {
            if (i > scratch.cell_first[cell] && scratch.cell_body[i] == scratch.cell_body[i - 1]) continue;
            occupancy.object.push_back(scratch.cell_body[i]);
            occupancy.primitive_first.push_back(i);
        }
    }
    occupancy.object_first.push_back(uint32_t(occupancy.object.size()));
    occupancy.primitive_first.push_back(uint32_t(kept));
}

// Both passes with one bit per cell. False if the grid has too many cells for that.
bool fill_from_bits(const ScreenedTriangles& screened, float inv_size, RasteriseScratch& scratch, Occupancy& occupancy) {
    std::array<uint32_t, 4> last{};
    for (const uint32_t body : scratch.body) {
        const CellRange cells = cells_of(clip_of(body, screened.origin, scratch), inv_size);
        for (uint32_t k = 0; k < 3; ++k) last[k] = std::max(last[k], cells.last[k]);
    }
    // clearing the bits must not cost more than sorting
    const uint64_t worth = 1024 + 8 * uint64_t{screened.triangle.size()};
    if (!clear_cells(last, std::min<uint64_t>(scratch.most_words, worth), scratch.bits)) return false;
    scratch.cells.clear();
    for_each_triangle(
        screened, inv_size, scratch, occupancy,
        [&](uint32_t, uint32_t, const CellRange& cells) {
            scratch.cells.push_back(cells);
            for_each_word(scratch.bits, cells, [&](uint32_t word, uint64_t mask) { scratch.bits.own[word] |= mask; });
        },
        [&](const CellRange& all) { end_object(all, scratch.bits); });
    rank_shared_cells(scratch.bits, occupancy.cell_key);
    scratch.cell_first.assign(occupancy.cell_key.size() + 1, 0);
    size_t kept = 0, at = 0;
    for (const uint32_t body : scratch.body) {
        for (uint32_t index = screened.body[body].first; index < screened.body[body].end(); ++index) {
            if (scratch.reference.size() < kept + kMostCells) scratch.reference.resize(2 * scratch.reference.size() + kMostCells);
            for_each_shared_cell(scratch.bits, scratch.cells[at++], [&](uint32_t cell) {
                ++scratch.cell_first[cell + 1];
                scratch.reference[kept++] = {cell, index, body};
            });
        }
    }
    fill_layers(screened, kept, scratch, occupancy);
    return true;
}

// Stable radix sort by key, two digits per axis; a digit that all keys share is skipped after counting.
void sort_references(std::vector<KeyedReference>& keyed, std::vector<KeyedReference>& spare) {
    spare.resize(keyed.size());
    for (const uint32_t shift : {0u, 11u, 21u, 32u, 42u, 53u}) {
        std::array<uint32_t, 2049> first{};
        const auto digit = [&](const KeyedReference& r) { return uint32_t(r.key >> shift) & (shift % 21 ? 1023 : 2047); };
        for (const KeyedReference& r : keyed) ++first[digit(r) + 1];
        if (keyed.empty() || first[digit(keyed[0]) + 1] == keyed.size()) continue;
        for (uint32_t i = 0; i < 2048; ++i) first[i + 1] += first[i];
        for (const KeyedReference& r : keyed) spare[first[digit(r)]++] = r;
        keyed.swap(spare);
    }
}

// Both passes by sorting: a cell of one body is omitted.
void fill_from_sorted(const ScreenedTriangles& screened, float inv_size, RasteriseScratch& scratch, Occupancy& occupancy) {
    std::vector<KeyedReference>& keyed = scratch.keyed;
    keyed.clear();
    for_each_triangle(
        screened, inv_size, scratch, occupancy,
        [&](uint32_t index, uint32_t body, const CellRange& cells) {
            for (uint32_t i = cells.first[0]; i <= cells.last[0]; ++i) {
                for (uint32_t j = cells.first[1]; j <= cells.last[1]; ++j) {
                    for (uint32_t k = cells.first[2]; k <= cells.last[2]; ++k) keyed.push_back({pack_cell(i, j, k), index, body});
                }
            }
        },
        [](const CellRange&) {});
    sort_references(keyed, scratch.keyed_spare);
    occupancy.cell_key.clear();
    scratch.cell_first.assign(1, 0);
    if (scratch.reference.size() < keyed.size()) scratch.reference.resize(keyed.size());
    size_t kept = 0;
    for (size_t begin = 0, end = 0; begin < keyed.size(); begin = end) {
        while (end < keyed.size() && keyed[end].key == keyed[begin].key) ++end;
        if (keyed[begin].body == keyed[end - 1].body) continue;
        const uint32_t cell = uint32_t(occupancy.cell_key.size());
        occupancy.cell_key.push_back(keyed[begin].key);
        scratch.cell_first.push_back(uint32_t(end - begin));
        for (size_t i = begin; i < end; ++i) scratch.reference[kept++] = {cell, keyed[i].index, keyed[i].body};
    }
    fill_layers(screened, kept, scratch, occupancy);
}

// Removes from scratch.body the bodies all of whose pairs are compared directly.
void set_direct_pairs_apart(const ContactInputs& in, const ScreenedTriangles& screened, uint64_t most_direct, RasteriseScratch& scratch) {
    const BroadPhasePairs& pairs = in.pairs;
    if (most_direct == 0) return;
    scratch.in_cells.assign(screened.body.size(), 0);
    for (uint32_t i = 0; i < pairs.a.size(); ++i) {
        if (pair_search(in, screened, i, most_direct) == PairSearch::kCells)
            scratch.in_cells[pairs.a[i]] = scratch.in_cells[pairs.b[i]] = 1;
    }
    std::erase_if(scratch.body, [&](uint32_t body) { return !scratch.in_cells[body]; });
}

}  // namespace

void rasterise(const ContactInputs& in, uint64_t most_direct, RasteriseScratch& scratch, Report& report, ScreenedTriangles& screened,
               Occupancy& occupancy) {
    TROCAR_ASSERT(in.params.cell_edges > 0 && std::isfinite(in.params.cell_edges));
    const Box all = collect_regions(in, scratch);
    const bool any = !scratch.packed_region.empty();
    screened.origin = any ? all.min : Vec3d(Vec3d::Zero());
    screen_bodies(in, screened.origin, scratch);
    const double mean_edge = gather_screens(in, scratch, screened);
    const Vec3d extent = any ? Vec3d(all.max - all.min) : Vec3d(Vec3d::Zero());
    occupancy.origin = screened.origin;
    occupancy.cell_size = choose_cell_size(in, mean_edge, extent, screened, scratch);
    const float inv_size = 1.0f / float(occupancy.cell_size);
    set_direct_pairs_apart(in, screened, most_direct, scratch);
    if (!fill_from_bits(screened, inv_size, scratch, occupancy)) fill_from_sorted(screened, inv_size, scratch, occupancy);
    report.oversize_triangles += occupancy.oversize.size();
}

}  // namespace trocar
