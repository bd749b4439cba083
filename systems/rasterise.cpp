#include "systems/rasterise.hpp"

#include <algorithm>

#include "engine/check.hpp"
#include "engine/geometry/contact_kernels.hpp"
#include "engine/parallel.hpp"
namespace trocar {
namespace {

constexpr uint64_t kEmptyCell = UINT64_MAX;
constexpr uint32_t kMostCells = 64;  // of one triangle; more goes to the oversize list
constexpr double kGridCells = (1 << 21) - 2;

Box overlap_of(const Box& a, const Box& b) { return {a.min.cwiseMax(b.min), a.max.cwiseMin(b.max)}; }
Box enlarged(const Box& box, double by) { return {box.min - Vec3d::Constant(by), box.max + Vec3d::Constant(by)}; }
Box joined(const Box& a, const Box& b) { return {a.min.cwiseMin(b.min), a.max.cwiseMax(b.max)}; }

// Overlap boxes of all pairs, a hair larger than rounding, and which of them each body has.
Box collect_regions(const BodyBoxes& boxes, const CandidatePairs& pairs, RasteriseScratch& scratch) {
    const uint32_t count = uint32_t(pairs.a.size()), bodies = uint32_t(boxes.box.size());
    Box all;
    scratch.region.resize(count);
    scratch.region_first.assign(bodies + 2, 0);
    for (uint32_t i = 0; i < count; ++i) {
        const Box region = overlap_of(boxes.box[pairs.a[i]], boxes.box[pairs.b[i]]);
        scratch.region[i] = enlarged(region, 1e-14 * region.min.cwiseAbs().cwiseMax(region.max.cwiseAbs()).maxCoeff());
        all = joined(all, scratch.region[i]);
        ++scratch.region_first[pairs.a[i] + 2];
        ++scratch.region_first[pairs.b[i] + 2];
    }
    for (uint32_t i = 0; i < bodies; ++i) scratch.region_first[i + 2] += scratch.region_first[i + 1];
    scratch.region_pair.resize(2 * size_t(count));
    for (uint32_t i = 0; i < count; ++i) {
        scratch.region_pair[scratch.region_first[pairs.a[i] + 1]++] = i;
        scratch.region_pair[scratch.region_first[pairs.b[i] + 1]++] = i;
    }
    scratch.packed_region.resize(2 * size_t(count));
    for (uint32_t i = 0; i < 2 * count; ++i) {
        scratch.packed_region[i] = pack_box(scratch.region[scratch.region_pair[i]], all.min);
    }
    scratch.body.clear();
    for (uint32_t body = 0; body < bodies; ++body) {
        if (scratch.region_first[body + 1] > scratch.region_first[body]) scratch.body.push_back(body);
    }
    return all;
}

// Sides of the box that each vertex lies beyond; a triangle whose corners share a side does not meet the box. Vertices
// that are not finite may lie beyond none.
void find_outcodes(const BodyPoints& points, __m256d low, __m256d high, std::vector<uint8_t>& outcode) {
    const uint32_t count = uint32_t(outcode.size());
    for (uint32_t v = 0; v < count; ++v) {
        const __m256d p = points(v);
        const int below = _mm256_movemask_pd(_mm256_cmp_pd(p, low, _CMP_LT_OQ));
        const int above = _mm256_movemask_pd(_mm256_cmp_pd(p, high, _CMP_GT_OQ));
        outcode[v] = uint8_t(below | above << 4);
    }
}

// The same for float offsets, two at a time; the box is in their frame and moved outward to floats.
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

// Sum of the three edge lengths.
float perimeter(__m256d a, __m256d b, __m256d c) {
    const __m128 ab = _mm256_cvtpd_ps(_mm256_sub_pd(b, a)), bc = _mm256_cvtpd_ps(_mm256_sub_pd(c, b)),
                 ca = _mm256_cvtpd_ps(_mm256_sub_pd(a, c));
    const __m128 squares = _mm_hadd_ps(_mm_hadd_ps(_mm_mul_ps(ab, ab), _mm_mul_ps(bc, bc)),
                                       _mm_hadd_ps(_mm_mul_ps(ca, ca), _mm_setzero_ps()));
    alignas(16) float length[4];
    _mm_store_ps(length, _mm_sqrt_ps(squares));
    return length[0] + length[1] + length[2];
}

// Triangles of one body whose enlarged box meets one of its regions.
void screen_body(const Surfaces& s, const BodyBoxes& boxes, const Vec3d& origin, uint32_t body,
                 const RasteriseScratch& scratch, BodyScreen& screen) {
    const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
    const double reach = reach_of(s.bodies, boxes, body);
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
        find_outcodes(points, _mm256_setr_pd(a.x(), a.y(), a.z(), -inf), _mm256_setr_pd(b.x(), b.y(), b.z(), inf),
                      screen.outcode);
    }

    screen.triangle.clear();
    screen.box.clear();
    screen.tight.clear();
    screen.edge_sum = 0;
    const uint8_t* outcode = screen.outcode.data();
    const __m256d grow = _mm256_setr_pd(reach, reach, reach, 0);
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const Triangle& corner = mesh.triangle[t];
        if ((outcode[corner[0]] & outcode[corner[1]] & outcode[corner[2]]) != 0) continue;
        const __m256d p = points(corner[0]), q = points(corner[1]), r = points(corner[2]);
        if (!is_finite(p) || !is_finite(q) || !is_finite(r)) continue;
        const __m256d low = _mm256_min_pd(_mm256_min_pd(p, q), r), high = _mm256_max_pd(_mm256_max_pd(p, q), r);
        const PackedBox box = pack_box(_mm256_sub_pd(low, grow), _mm256_add_pd(high, grow));
        const __m256 face = facing(load_box(box));
        bool met = false;
        for (uint32_t i = first; i < end && !met; ++i) met = meets(face, load_box(scratch.packed_region[i]));
        if (!met) continue;
        screen.triangle.push_back(t);
        screen.box.push_back(box);
        screen.tight.push_back(pack_box(low, high));
        screen.edge_sum += perimeter(p, q, r);
    }
}

// Puts the bodies' findings one after the other. Returns the mean edge of all, m.
double gather_screens(uint32_t bodies, const RasteriseScratch& scratch, ScreenedTriangles& screened) {
    screened.body.assign(bodies, {});
    screened.triangle.clear();
    screened.box.clear();
    screened.tight.clear();
    double edge_sum = 0;
    for (uint32_t i = 0; i < scratch.body.size(); ++i) {
        const BodyScreen& screen = scratch.screen[i];
        screened.body[scratch.body[i]] = {uint32_t(screened.triangle.size()), uint32_t(screen.triangle.size())};
        screened.triangle.insert(screened.triangle.end(), screen.triangle.begin(), screen.triangle.end());
        screened.box.insert(screened.box.end(), screen.box.begin(), screen.box.end());
        screened.tight.insert(screened.tight.end(), screen.tight.begin(), screen.tight.end());
        edge_sum += screen.edge_sum;
    }
    return screened.triangle.empty() ? 0 : edge_sum / (3.0 * double(screened.triangle.size()));
}

// Cells grow when the region would need more than 21 bits an axis, or when speed makes most boxes larger than a cell.
double choose_cell_size(const ContactParams& params, double mean_edge, const BodyBoxes& boxes, const Surfaces& s,
                        const Vec3d& extent, const ScreenedTriangles& screened, const RasteriseScratch& scratch) {
    double reach = 0;
    for (const uint32_t body : scratch.body) reach += screened.body[body].count * reach_of(s.bodies, boxes, body);
    if (!screened.triangle.empty()) reach /= double(screened.triangle.size());
    const double size = std::max({params.cell_edges * mean_edge, 2 * reach, extent.maxCoeff() / kGridCells});
    return size > 0 && std::isfinite(size) ? size : 1.0;
}

void clear_table(RasteriseScratch& scratch) {
    for (const uint32_t slot : scratch.used_slot) scratch.table[slot] = {kEmptyCell, 0, 0};
    scratch.used_slot.clear();
}

void grow_table(RasteriseScratch& scratch) {
    const size_t size = std::max<size_t>(1024, 2 * scratch.table.size());
    scratch.table.assign(size, {kEmptyCell, 0, 0});
    scratch.used_slot.clear();
}

// Slot of a cell, taken if new. The body is counted.
uint32_t count_cell(uint64_t key, uint32_t body, uint32_t shift, RasteriseScratch& scratch) {
    const uint32_t mask = uint32_t(scratch.table.size()) - 1;
    uint32_t slot = uint32_t((key * 0x9E3779B97F4A7C15ull) >> shift);
    for (;; slot = (slot + 1) & mask) {
        CountedCell& cell = scratch.table[slot];
        if (cell.key == key) {
            if (cell.object != body && cell.shared == 0) {
                scratch.shared.push_back({key, scratch.shared.size()});
                cell.shared = uint32_t(scratch.shared.size());
            }
            return slot;
        }
        if (cell.key == kEmptyCell) {
            cell = {key, body, 0};
            scratch.used_slot.push_back(slot);
            return slot;
        }
    }
}

// Pass 1 over one body: counts it in every cell of its triangles. False when the table must grow first.
bool count_body(const ScreenedTriangles& screened, uint32_t body, __m256 clip, float inv_size,
                RasteriseScratch& scratch, Occupancy& occupancy) {
    const uint32_t shift = 64 - uint32_t(__builtin_ctzll(scratch.table.size()));
    const Range rows = screened.body[body];
    for (uint32_t row = rows.first; row < rows.end(); ++row) {
        if (scratch.used_slot.size() + kMostCells > scratch.table.size() / 2) return false;
        const CellRange cells = cells_of(_mm256_max_ps(load_box(screened.box[row]), clip), inv_size);
        const uint64_t x = cells.last[0] - cells.first[0] + 1, y = cells.last[1] - cells.first[1] + 1,
                       z = cells.last[2] - cells.first[2] + 1;
        if (x * y * z > kMostCells) {
            occupancy.oversize.push_back(row);
            continue;
        }
        if (scratch.reference.size() < scratch.references + kMostCells) {
            scratch.reference.resize(2 * scratch.reference.size() + kMostCells);
        }
        CellReference* next = scratch.reference.data() + scratch.references;
        scratch.references += uint32_t(x * y * z);
        for (uint32_t i = cells.first[0]; i <= cells.last[0]; ++i) {
            for (uint32_t j = cells.first[1]; j <= cells.last[1]; ++j) {
                for (uint32_t k = cells.first[2]; k <= cells.last[2]; ++k) {
                    *next++ = {count_cell(pack_cell(i, j, k), body, shift, scratch), row, body};
                }
            }
        }
    }
    return true;
}

void count_objects(const ScreenedTriangles& screened, float inv_size, RasteriseScratch& scratch, Occupancy& occupancy) {
    if (scratch.table.empty()) grow_table(scratch);
    for (bool done = false; !done;) {
        scratch.references = 0;
        scratch.shared.clear();
        occupancy.oversize.clear();
        done = true;
        for (const uint32_t body : scratch.body) {
            Box all;
            for (uint32_t i = scratch.region_first[body]; i < scratch.region_first[body + 1]; ++i) {
                all = joined(all, scratch.region[scratch.region_pair[i]]);
            }
            done = count_body(screened, body, load_box(pack_box(all, screened.origin)), inv_size, scratch, occupancy);
            if (!done) break;
        }
        if (!done) grow_table(scratch);
    }
}

// Pass 2: the shared cells in key order, their references in the order (cell, body, triangle).
void fill_layers(const ScreenedTriangles& screened, RasteriseScratch& scratch, Occupancy& occupancy) {
    const uint32_t cells = uint32_t(scratch.shared.size());
    std::sort(scratch.shared.begin(), scratch.shared.end());
    scratch.rank.resize(cells);
    occupancy.cell_key.resize(cells);
    for (uint32_t i = 0; i < cells; ++i) {
        occupancy.cell_key[i] = scratch.shared[i][0];
        scratch.rank[scratch.shared[i][1]] = i;
    }
    scratch.cell_first.assign(cells + 1, 0);
    size_t kept = 0;
    for (uint32_t i = 0; i < scratch.references; ++i) {
        const CellReference reference = scratch.reference[i];
        const uint32_t shared = scratch.table[reference.slot].shared;
        if (shared == 0) continue;
        const uint32_t cell = scratch.rank[shared - 1];
        ++scratch.cell_first[cell + 1];
        scratch.reference[kept++] = {cell, reference.row, reference.body};
    }
    for (uint32_t i = 0; i < cells; ++i) scratch.cell_first[i + 1] += scratch.cell_first[i];
    occupancy.primitive.resize(kept);
    occupancy.primitive_row.resize(kept);
    scratch.cell_body.resize(kept);
    scratch.next.assign(scratch.cell_first.begin(), scratch.cell_first.end());
    for (size_t i = 0; i < kept; ++i) {
        const CellReference& reference = scratch.reference[i];
        const uint32_t place = scratch.next[reference.slot]++;
        occupancy.primitive_row[place] = reference.row;
        occupancy.primitive[place] = screened.triangle[reference.row];
        scratch.cell_body[place] = reference.body;
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

}  // namespace

void rasterise(const ContactParams& params, const Surfaces& surfaces, const BodyBoxes& boxes,
               const CandidatePairs& pairs, RasteriseScratch& scratch, Report& report, ScreenedTriangles& screened,
               Occupancy& occupancy) {
    TROCAR_ASSERT(params.cell_edges > 0 && std::isfinite(params.cell_edges));
    const Box all = collect_regions(boxes, pairs, scratch);
    screened.origin = pairs.a.empty() ? Vec3d(Vec3d::Zero()) : all.min;
    if (scratch.screen.size() < scratch.body.size()) scratch.screen.resize(scratch.body.size());
    parallel_for(uint32_t(scratch.body.size()), 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            screen_body(surfaces, boxes, screened.origin, scratch.body[i], scratch, scratch.screen[i]);
        }
    });
    const double mean_edge = gather_screens(uint32_t(boxes.box.size()), scratch, screened);
    const Vec3d extent = pairs.a.empty() ? Vec3d(Vec3d::Zero()) : Vec3d(all.max - all.min);
    occupancy.origin = screened.origin;
    occupancy.cell_size = choose_cell_size(params, mean_edge, boxes, surfaces, extent, screened, scratch);
    count_objects(screened, 1.0f / float(occupancy.cell_size), scratch, occupancy);
    report.oversize_triangles += occupancy.oversize.size();
    fill_layers(screened, scratch, occupancy);
    clear_table(scratch);
}

}  // namespace trocar
