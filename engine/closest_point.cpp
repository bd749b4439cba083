#include "engine/closest_point.hpp"

#include <embree3/rtcore.h>
#include <immintrin.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <numbers>
#include <vector>

#include "engine/box_tree.hpp"
#include "engine/check.hpp"
#include "engine/closest_point_kernels.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/winding_number.hpp"
#include "engine/meshlet_cutter.hpp"
#include "engine/race_detector.hpp"
#include "engine/winding_tree.hpp"

// How an answer is found, and why it is the right one.
//
// Local frame: x -> (x - centre) * scale, scale a power of two that brings the half extent of the mesh to [1, 2), so
// that neither small nor large units leave the range of float. Float only selects; every number handed out is computed
// in double from the vertices themselves.
//
// Error bound of the float distance f of a triangle, d its true distance, u = 2^-24, L its longest edge, A its area,
// a = 2A / L^2, R the largest |vertex| of its meshlet, q the query point, all in the local frame:
//   vertices rounded to float move by at most u R, the query point by u |q|; distance is 1-Lipschitz in both;
//   differences to the query and edges are each rounded once: their points move by at most u (d + L) and u L;
//   segment: the clamped parameter is off by (3 u |r| + 4 u L) / L, |r| <= d + L; along the segment that costs at most
//     10 u L (for d > L only its square over 2 d counts); the point, its square and the root are good to 3 u d:
//     in all 5 u d + 12 u L;
//   face: the normal is tilted by at most k = 4 u L^2 / 2A = 4 u / a, which costs k L at the foot point (inside the
//     triangle, so within L of the corner taken) plus d k^2 / 2; h = n . r costs 4 u (d + L), its division and root 3 u
//     d;
//   taking a point for inside the three edge planes that is up to e = (k + 8 u) d + 8 u L outside costs at most e / d
//   of
//     that, that is 9 u L + 0.01 u d at an edge; in a corner (its angle is at least a) the distance to the corner is at
//     most 2 e / a, which costs 16 u L / a + d (2 (k + 8 u) / a)^2 and no more.
// Sum: |f - d| <= u R + u |q| + u (16 + 24 / a) L + (10 u + (2 (k + 8 u) / a)^2) d, the last row kept per meshlet as
// error_base + error_slope d, times 1.01 for what is of second order and for the rounding of the bound itself.
// Triangles with a < 1e-2 are kept out of it and evaluated in double.
//
// Let `upper` be the least f + bound seen so far: the nearest triangle is no farther. The tree (our own, or Embree's) is
// asked for all meshlets within `upper` of the query (boxes rounded outward), every triangle with f - bound <= upper is kept, and the kept
// ones are evaluated in double; the least (squared distance, triangle) wins. The winner is always among the kept,
// whatever the starting radius, the order of the visits or the tree, so none of them can change the answer.
namespace trocar {
namespace {

constexpr float kUnit = 0x1p-24f;
constexpr uint32_t kSlots = 64;  // an icosphere's centre ties 80 faces and overflows; a vertex of valence 20 does not
constexpr uint32_t kBatch = 32;
constexpr double kMostGrowth = 1.3;  // of the tree's summed area by refits before it is built afresh
constexpr double kFarthest = 1e15;  // local units: beyond, squares leave the range of float

std::atomic<bool>& embree_chosen() {
    static std::atomic<bool> chosen{false};
    return chosen;
}

std::atomic<bool>& avx2_forced() {
    static std::atomic<bool> forced{false};
    return forced;
}

const MeshletKernels& chosen_kernels() {
    static const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
                                   __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
    return has_avx512 && !avx2_forced().load(std::memory_order_relaxed) ? kMeshletKernelsAvx512 : kMeshletKernelsAvx2;
}

// One device for the process: it holds worker state, and a second one would be paid for in threads and memory.
std::shared_ptr<RTCDeviceTy> shared_device() {
    static const std::shared_ptr<RTCDeviceTy> device(rtcNewDevice(nullptr), [](RTCDevice d) {
        if (d) rtcReleaseDevice(d);
    });
    TROCAR_ASSERT(device);
    return device;
}

struct alignas(64) CacheLine {
    unsigned char bytes[64];
};
constexpr uint32_t kNarrowLines = 4, kWideLines = sizeof(Meshlet) / sizeof(CacheLine);

// Corners of one lane of a meshlet: what the double evaluation reads.
struct Lane {
    Triangle vertex;
    uint32_t triangle;
};

// What one query carries through the traversal.
struct Search {
    const MeshletKernels* kernels;
    Vec3d point;               // m
    alignas(16) float q[4];    // local frame; the fourth is 0
    float query_error;         // 2^-24 |q| and a little
    float upper;               // the nearest triangle is not farther, local frame
    uint32_t first;            // meshlet visited before the traversal
    uint32_t nearest;          // meshlet that set upper last
    uint32_t count;
    bool overflow;
    uint32_t lane[kSlots];
    float lower[kSlots];
};

// Best answer so far of a search in double.
struct Winner {
    TrianglePoint closest;
    uint32_t lane = kNone;
    uint32_t triangle = kNone;
};

// The last query answered: distance is 1-Lipschitz, so it bounds the next one.
struct Previous {
    Vec3d point;
    float upper;  // local frame
    uint32_t meshlet = kNone;
};

struct ExactSearch {
    Search* search;
    Winner winner;
};

void prefer(Winner& winner, const TrianglePoint& closest, uint32_t lane, uint32_t triangle) {
    if (closest.squared_distance < winner.closest.squared_distance ||
        (closest.squared_distance == winner.closest.squared_distance && triangle < winner.triangle))
        winner = {closest, lane, triangle};
}

// next float above x (finite, >= 0) and a little more
float round_up(double x) { return static_cast<float>(x) * (1.0f + 4.0f * kUnit) + 1e-30f; }

// The traversals round the differences to their boxes and the squares; 8 units cover them
float search_radius(const Search& search) {
    return (search.upper + search.query_error) * (1.0f + 16.0f * kUnit) + 1e-30f;
}

float squared_reach(const Search& search) { return search_radius(search) * search_radius(search); }

// Embree's leaves hold several meshlets and call for all of them
bool near_box(const Search& search, const FloatBox& box) {
    const __m128 q = _mm_load_ps(search.q);
    const __m128 outside = _mm_max_ps(
        _mm_max_ps(_mm_sub_ps(_mm_load_ps(box.min), q), _mm_sub_ps(q, _mm_load_ps(box.max))), _mm_setzero_ps());
    return _mm_cvtss_f32(_mm_dp_ps(outside, outside, 0x71)) <= squared_reach(search);
}

uint32_t lanes_below(const float* squared, float limit) {
    const __m256 l = _mm256_set1_ps(limit);
    const int low = _mm256_movemask_ps(_mm256_cmp_ps(_mm256_load_ps(squared), l, _CMP_LT_OQ));
    const int high = _mm256_movemask_ps(_mm256_cmp_ps(_mm256_load_ps(squared + 8), l, _CMP_LT_OQ));
    return static_cast<uint32_t>(low) | static_cast<uint32_t>(high) << 8;
}

// largest squared float distance a triangle can have and still be as near as upper
float kept_limit(const Search& search, const Meshlet& meshlet) {
    const float reach = (search.upper + meshlet.error_base + search.query_error) * (1.0f + 1.1f * meshlet.error_slope);
    return reach * reach * (1.0f + 16.0f * kUnit) + 1e-36f;
}

}  // namespace

struct ClosestPointTree::Impl {
    MeshView mesh;
    Admission admission = Admission::kRefused;
    bool deformable = false;
    std::vector<Float4> offset;  // present positions of a deformable mesh
    Vec3d centre = Vec3d::Zero();
    double scale = 1;
    std::vector<CacheLine> pool;         // meshlets
    std::vector<uint32_t> first_line;    // of a meshlet
    std::vector<uint32_t> vertex;        // of the meshlets, 16 or 32 each
    std::vector<uint32_t> first_vertex;  // of a meshlet
    std::vector<Lane> lanes;             // 16 a meshlet
    std::vector<uint32_t> lane_of_triangle;
    std::vector<FloatBox> boxes;  // one a meshlet, local frame, outward
    FloatBox box;                 // of all
    BoxTree tree;                 // over boxes
    uint64_t rebuilds = 0;        // by refits
    bool cross_checked = false;
    WindingTree clusters;  // empty unless signs need it
    bool with_embree = embree_chosen().load(std::memory_order_relaxed);
    std::shared_ptr<RTCDeviceTy> device;
    RTCScene scene = nullptr;  // only with_embree
    RTCGeometry geometry = nullptr;

    // What the traversal's callback gets to see.
    struct Traversal {
        const Impl* tree;
        Search* search;
        ExactSearch* exact;
    };

    ~Impl() { release_scene(); }

    void build(const MeshView& view);
    void choose_frame();
    void make_meshlets();
    void update_meshlets();
    void fill_from_doubles(Meshlet& meshlet, const uint32_t* vertices) const;
    void measure(uint32_t m, const MeshletKernels& kernels);
    void make_scene();
    void release_scene();
    void update_scene(bool rebuild);

    Meshlet& meshlet(uint32_t m) { return *reinterpret_cast<Meshlet*>(&pool[first_line[m]]); }
    uint32_t triangles_of(uint32_t m) const {
        return static_cast<uint32_t>(std::popcount(static_cast<uint32_t>(meshlet(m).float_lanes | meshlet(m).exact_lanes)));
    }
    const Meshlet& meshlet(uint32_t m) const { return *reinterpret_cast<const Meshlet*>(&pool[first_line[m]]); }
    Vec3d position(uint32_t v) const {
        if (!deformable) return mesh.position[v];
        return {offset[v].x, offset[v].y, offset[v].z};
    }
    TrianglePoint evaluate(const Vec3d& p, uint32_t lane) const {
        const auto& v = lanes[lane].vertex;
        return closest_point_on_triangle(p, position(v[0]), position(v[1]), position(v[2]));
    }
    Vec3d normal_of(const Triangle& t) const { return triangle_normal(position(t[0]), position(t[1]), position(t[2])); }
    void update_clusters();
    bool winds_around(const Vec3d& p) const;
    double winding(const Vec3d& p) const {
        return deformable ? trocar::winding_number(std::span<const Float4>(offset), mesh.triangle, p)
                          : trocar::winding_number(mesh.position, mesh.triangle, p);
    }

    void visit(Search& search, uint32_t m) const;
    void visit_exactly(ExactSearch& exact, uint32_t m) const;
    void keep_lane(Search& search, uint32_t lane, float lower) const;
    void start(Search& search, const MeshletKernels& kernels, const Vec3d& p, const Vec3d& q, double radius) const;
    float bound_by_box(const Vec3d& q) const;
    void select(Search& search) const;
    void select_with_embree(Search& search) const;
    Winner search_exactly(Search& search) const;
    void search_exactly_with_embree(ExactSearch& exact) const;
    Winner scan(const Vec3d& p) const;
    void prefetch_lane(uint32_t lane) const;
    void prefetch_meshlet(uint32_t m) const;
    SurfacePoint answer(const Vec3d& p, double radius, const Winner& winner) const;
    template <typename Visit>  // Visit: void(corner a, b, c, normal), a the winning vertex
    void for_each_in_fan(const Winner& winner, const Visit& visit) const {
        const uint32_t v = lanes[winner.lane].vertex[static_cast<int>(winner.closest.feature)];
        for (uint32_t i = mesh.incident_first[v]; i < mesh.incident_first[v + 1]; ++i) {
            const Triangle& t = mesh.triangle[mesh.incident[i]];
            const int k = t[0] == v ? 0 : t[1] == v ? 1 : 2;
            const Vec3d a = position(v), b = position(t[(k + 1) % 3]), c = position(t[(k + 2) % 3]);
            visit(a, b, c, triangle_normal(a, b, c));
        }
    }
    double side_of_fan(const Winner& winner, double rounding) const;
    bool pseudonormal(const Winner& winner, Vec3d& normal, double& weight) const;
    double side_of(const Vec3d& p, const Winner& winner, double d, Vec3d& direction) const;
    bool outside_box(const Vec3d& p) const;
    bool disagrees(const Vec3d& p, const SurfacePoint& found) const;
    void query_batch(std::span<const Vec3d> points, std::span<const double> radius, std::span<const uint32_t> hint,
                     std::span<SurfacePoint> out, Previous& previous, QueryCounters& counters) const;
};

bool bound_error(Meshlet* meshlet, const MeshletMeasure* measure) {
    const uint32_t used = meshlet->float_lanes | meshlet->exact_lanes;
    float reach2 = 0;
    for (int k = 0; k < 3; ++k) {
        const float reach = std::max(std::abs(measure->min[k]), std::abs(measure->max[k]));
        reach2 += reach * reach;
    }
    const float tilt = 2 * (4 * kUnit * measure->slenderness + 8 * kUnit) * measure->slenderness;
    meshlet->error_base = 1.01f * kUnit * (std::sqrt(reach2) + measure->size_term);
    meshlet->error_slope = 1.01f * (10 * kUnit + tilt * tilt);
    const bool finite = reach2 < 1e30f && meshlet->error_base < 1e15f;
    if (!finite) meshlet->error_base = meshlet->error_slope = 0;
    meshlet->exact_lanes = static_cast<uint16_t>(used & (finite ? measure->slender_lanes : 0xffff));
    meshlet->float_lanes = static_cast<uint16_t>(used & ~meshlet->exact_lanes);
    return finite;
}

namespace {

// Embree asks for boxes on threads of its own choice.
void commit(RTCScene scene, const std::vector<FloatBox>& boxes) {
    hand_over(&boxes);
    rtcCommitScene(scene);
    take_over(&boxes);
}

void meshlet_bounds(const RTCBoundsFunctionArguments* args) {
    take_over(args->geometryUserPtr);
    const FloatBox& b = static_cast<const std::vector<FloatBox>*>(args->geometryUserPtr)->operator[](args->primID);
    RTCBounds& out = *args->bounds_o;
    out.lower_x = b.min[0], out.lower_y = b.min[1], out.lower_z = b.min[2];
    out.upper_x = b.max[0], out.upper_y = b.max[1], out.upper_z = b.max[2];
    hand_over(args->geometryUserPtr);
}

}  // namespace

void ClosestPointTree::Impl::build(const MeshView& view) {
    mesh = view;
    admission = view.info ? view.info->admission : Admission::kSheet;
    TROCAR_ASSERT(mesh.neighbour.size() == mesh.triangle.size());
    TROCAR_ASSERT(mesh.incident_first.size() == mesh.position.size() + 1);
    TROCAR_ASSERT(!deformable || offset.size() == mesh.position.size());
    choose_frame();
    make_meshlets();
    update_meshlets();
    build_box_tree(boxes, tree);
    update_clusters();
    make_scene();
}

void ClosestPointTree::Impl::choose_frame() {
    Vec3d low = Vec3d::Constant(INFINITY), high = -low;
    for (uint32_t v = 0; v < mesh.position.size(); ++v) {
        low = low.cwiseMin(position(v));
        high = high.cwiseMax(position(v));
    }
    const double extent = 0.5 * (high - low).maxCoeff();
    if (mesh.position.empty() || !std::isfinite(extent)) return;
    centre = low + 0.5 * (high - low);
    if (deformable) centre = centre.cast<float>().cast<double>();  // so that offset - centre is rounded once
    if (extent > 0) scale = std::ldexp(1.0, -std::clamp(std::ilogb(extent), -100, 100));
}

void ClosestPointTree::Impl::make_meshlets() {
    Vec3d low = Vec3d::Constant(INFINITY), high = -low;
    for (const Vec3d& x : mesh.position) low = low.cwiseMin(x), high = high.cwiseMax(x);
    const MeshletGroups cutter = cut_meshlets(mesh, low + 0.5 * (high - low), scale);
    const uint32_t count = static_cast<uint32_t>(cutter.groups.size());
    lanes.resize(16ul * count);
    lane_of_triangle.resize(mesh.triangle.size());
    first_line.resize(count);
    first_vertex.resize(count);
    std::vector<std::array<std::array<uint8_t, 16>, 3>> corner(count);
    uint32_t lines = 0;
    for (uint32_t m = 0; m < count; ++m) {
        const auto [begin, end] = cutter.groups[m];
        first_line[m] = lines;
        first_vertex[m] = static_cast<uint32_t>(vertex.size());
        for (uint32_t j = 0; j < 16; ++j) {
            const uint32_t t = cutter.order[std::min(begin + j, end - 1)];
            lanes[16 * m + j] = {mesh.triangle[t], t};
            if (begin + j < end) lane_of_triangle[t] = 16 * m + j;
            for (int k = 0; k < 3; ++k) {
                const auto first = vertex.begin() + first_vertex[m];
                const auto found = std::find(first, vertex.end(), mesh.triangle[t][k]);
                corner[m][k][j] = static_cast<uint8_t>(found - first);
                if (found == vertex.end()) vertex.push_back(mesh.triangle[t][k]);
            }
        }
        const bool wide = vertex.size() - first_vertex[m] > 16;
        vertex.resize(first_vertex[m] + (wide ? 32 : 16), vertex.back());
        lines += wide ? kWideLines : kNarrowLines;
    }
    pool.resize(lines + kWideLines - kNarrowLines);  // a narrow meshlet at the end may be looked at as a whole
    boxes.resize(count);
    for (uint32_t m = 0; m < count; ++m) {
        Meshlet& t = meshlet(m);
        std::copy_n(&corner[m][0][0], 48, &t.corner[0][0]);
        t.wide = (m + 1 < count ? first_vertex[m + 1] : vertex.size()) - first_vertex[m] > 16;
        t.float_lanes = static_cast<uint16_t>((1u << (cutter.groups[m][1] - cutter.groups[m][0])) - 1);
        t.exact_lanes = 0;
        t.pad = 0;
    }
}

void ClosestPointTree::Impl::fill_from_doubles(Meshlet& meshlet, const uint32_t* vertices) const {
    for (int i = 0; i < (meshlet.wide ? 32 : 16); ++i) {
        const Vec3d x = (mesh.position[vertices[i]] - centre) * scale;
        (i < 16 ? meshlet.x : meshlet.more_x)[i & 15] = static_cast<float>(x.x());
        (i < 16 ? meshlet.y : meshlet.more_y)[i & 15] = static_cast<float>(x.y());
        (i < 16 ? meshlet.z : meshlet.more_z)[i & 15] = static_cast<float>(x.z());
    }
}

// Error bound (see the top of this file) and outward box of one meshlet.
void ClosestPointTree::Impl::measure(uint32_t m, const MeshletKernels& kernels) {
    Meshlet& t = meshlet(m);
    MeshletMeasure got;
    kernels.measure(&t, &got);
    FloatBox& b = boxes[m];
    if (bound_error(&t, &got)) {
        for (int k = 0; k < 3; ++k) {
            b.min[k] = got.min[k] - (std::abs(got.min[k]) * 2 * kUnit + 1e-30f);
            b.max[k] = got.max[k] + (std::abs(got.max[k]) * 2 * kUnit + 1e-30f);
        }
        return;
    }
    clear(b);  // a vertex is not finite: box the others
    for (uint32_t j = 0; j < 16; ++j) {
        for (const uint32_t v : lanes[16 * m + j].vertex) {
            const Vec3d x = (position(v) - centre) * scale;
            if (!(x.squaredNorm() < 1e30)) continue;
            for (int k = 0; k < 3; ++k) {
                b.min[k] = std::min(b.min[k], std::nextafter(static_cast<float>(x[k]), -INFINITY));
                b.max[k] = std::max(b.max[k], std::nextafter(static_cast<float>(x[k]), INFINITY));
            }
        }
    }
    if (!(b.min[0] <= b.max[0])) b = {};
}

void ClosestPointTree::Impl::update_meshlets() {
    const MeshletKernels& kernels = chosen_kernels();
    const Vec3 c = centre.cast<float>();
    const float float_centre[4] = {c.x(), c.y(), c.z(), 0};
    clear(box);
    for (uint32_t m = 0; m < boxes.size(); ++m) {
        const uint32_t* vertices = vertex.data() + first_vertex[m];
        if (deformable)
            kernels.fill(&meshlet(m), &offset[0].x, vertices, float_centre, static_cast<float>(scale));
        else
            fill_from_doubles(meshlet(m), vertices);
        measure(m, kernels);
        grow(box, boxes[m]);
    }
}

void ClosestPointTree::Impl::make_scene() {
    if (boxes.empty() || !with_embree) return;
    device = shared_device();
    scene = rtcNewScene(device.get());
    geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_USER);
    if (deformable) {
        // Embree 3.13 refits only with all three of these; with fewer it silently rebuilds
        rtcSetSceneFlags(scene, RTC_SCENE_FLAG_DYNAMIC);
        rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_LOW);
        rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_REFIT);
    }
    rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(boxes.size()));
    rtcSetGeometryUserData(geometry, &boxes);
    rtcSetGeometryBoundsFunction(geometry, meshlet_bounds, nullptr);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    commit(scene, boxes);
    TROCAR_ASSERT(rtcGetDeviceError(device.get()) == RTC_ERROR_NONE);
}

void ClosestPointTree::Impl::release_scene() {
    if (geometry) rtcReleaseGeometry(geometry);
    if (scene) rtcReleaseScene(scene);
    geometry = nullptr;
    scene = nullptr;
}

void ClosestPointTree::Impl::update_scene(bool rebuild) {
    if (!scene) return;
    if (rebuild) rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_LOW);
    rtcUpdateGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0);
    rtcCommitGeometry(geometry);
    commit(scene, boxes);
    if (rebuild) rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_REFIT);
}

void ClosestPointTree::Impl::keep_lane(Search& search, uint32_t lane, float lower) const {
    if (search.count == kSlots) {
        uint32_t kept = 0;
        for (uint32_t i = 0; i < kSlots; ++i) {
            if (!(search.lower[i] <= search.upper)) continue;
            search.lower[kept] = search.lower[i];
            search.lane[kept++] = search.lane[i];
        }
        search.count = kept;
        if (kept == kSlots) {
            search.overflow = true;
            return;
        }
    }
    search.lane[search.count] = lane;
    search.lower[search.count++] = lower;
}

// Lowers search.upper by what meshlet m holds and keeps its triangles that may win.
void ClosestPointTree::Impl::visit(Search& search, uint32_t m) const {
    const Meshlet& t = meshlet(m);
    alignas(64) float squared[16];
    uint32_t mask;
    const float base = t.error_base + search.query_error;
    float least = search.kernels->distance(&t, search.q, kept_limit(search, t), squared, &mask);
    mask &= t.float_lanes;
    if (mask != 0) {
        if (t.exact_lanes != 0) {
            least = INFINITY;
            for (uint32_t j = mask; j != 0; j &= j - 1) least = std::min(least, squared[std::countr_zero(j)]);
        }
        const float f = std::sqrt(least);
        const float upper = f + (base + t.error_slope * f);
        if (upper < search.upper) search.upper = upper, search.nearest = m;
        for (uint32_t j = mask & lanes_below(squared, kept_limit(search, t)); j != 0; j &= j - 1) {
            const uint32_t i = static_cast<uint32_t>(std::countr_zero(j));
            const float g = std::sqrt(squared[i]);
            keep_lane(search, 16 * m + i, g - (base + t.error_slope * g));
        }
    }
    for (uint32_t j = t.exact_lanes; j != 0; j &= j - 1) {
        const uint32_t lane = 16 * m + static_cast<uint32_t>(std::countr_zero(j));
        const double d = std::sqrt(evaluate(search.point, lane).squared_distance) * scale;
        const float upper = round_up(d), lower = static_cast<float>(d) * (1 - 4 * kUnit);
        if (upper < search.upper) search.upper = upper, search.nearest = m;
        if (lower <= search.upper) keep_lane(search, lane, lower);
    }
}

// As visit, but decides in double at once: for queries that tie more triangles than there are slots.
void ClosestPointTree::Impl::visit_exactly(ExactSearch& exact, uint32_t m) const {
    Search& search = *exact.search;
    const Meshlet& t = meshlet(m);
    alignas(64) float squared[16];
    uint32_t mask;
    search.kernels->distance(&t, search.q, kept_limit(search, t), squared, &mask);
    for (uint32_t j = (mask & t.float_lanes) | t.exact_lanes; j != 0; j &= j - 1) {
        const uint32_t lane = 16 * m + static_cast<uint32_t>(std::countr_zero(j));
        prefer(exact.winner, evaluate(search.point, lane), lane, lanes[lane].triangle);
    }
    const double d = std::sqrt(exact.winner.closest.squared_distance) * scale;
    if (d < search.upper) search.upper = std::min(search.upper, round_up(d));
}

void ClosestPointTree::Impl::start(Search& search, const MeshletKernels& kernels, const Vec3d& p, const Vec3d& q,
                                   double radius) const {
    search.kernels = &kernels;
    search.point = p;
    for (int k = 0; k < 3; ++k) search.q[k] = static_cast<float>(q[k]);
    search.q[3] = 0;
    search.query_error = 1.01f * kUnit * static_cast<float>(q.norm()) + 1e-30f;
    search.upper = round_up(radius * scale);
    search.first = search.nearest = kNone;
    search.count = 0;
    search.overflow = false;
}

// The surface touches every side of its box: it is no farther than the far corner of the best side (Roussopoulos,
// Kelley & Vincent, Nearest neighbor queries, SIGMOD 1995).
float ClosestPointTree::Impl::bound_by_box(const Vec3d& q) const {
    double far2[3], near2[3], sum = 0, best = INFINITY;
    for (int k = 0; k < 3; ++k) {
        const double low = std::abs(q[k] - box.min[k]), high = std::abs(q[k] - box.max[k]);
        far2[k] = std::max(low, high) * std::max(low, high);
        near2[k] = std::min(low, high) * std::min(low, high);
        sum += far2[k];
    }
    for (int k = 0; k < 3; ++k) best = std::min(best, sum - far2[k] + near2[k]);
    return round_up(std::sqrt(std::max(best, 0.0)) + 1e-5);
}

// Visits all meshlets that may hold a triangle within search.upper, and drops what turned out to be farther.
void ClosestPointTree::Impl::select(Search& search) const {
    if (scene) {
        select_with_embree(search);
    } else {
        visit_near_boxes(tree, search.q, squared_reach(search), [&](uint32_t m) {
            if (m != search.first) visit(search, m);
            return search.overflow ? -1.0f : squared_reach(search);
        });
    }
    uint32_t kept = 0;
    for (uint32_t i = 0; i < search.count; ++i)
        if (search.lower[i] <= search.upper) search.lane[kept++] = search.lane[i];
    search.count = kept;
}

void ClosestPointTree::Impl::select_with_embree(Search& search) const {
    alignas(16) RTCPointQuery query{search.q[0], search.q[1], search.q[2], 0, search_radius(search)};
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    Traversal traversal{this, &search, nullptr};
    rtcPointQuery(
        scene, &query, &context,
        [](RTCPointQueryFunctionArguments* args) {
            const Traversal& t = *static_cast<const Traversal*>(args->userPtr);
            if (args->primID == t.search->first || t.search->overflow) return false;
            if (!near_box(*t.search, t.tree->boxes[args->primID])) return false;
            const float before = t.search->upper;
            t.tree->visit(*t.search, args->primID);
            if (!(t.search->upper < before) && !t.search->overflow) return false;
            args->query->radius = t.search->overflow ? 0.0f : search_radius(*t.search);
            return true;
        },
        &traversal);
}

Winner ClosestPointTree::Impl::search_exactly(Search& search) const {
    ExactSearch exact{&search, {}};
    if (scene) {
        search_exactly_with_embree(exact);
    } else {
        visit_near_boxes(tree, search.q, squared_reach(search), [&](uint32_t m) {
            visit_exactly(exact, m);
            return squared_reach(search);
        });
    }
    return exact.winner;
}

void ClosestPointTree::Impl::search_exactly_with_embree(ExactSearch& exact) const {
    Search& search = *exact.search;
    alignas(16) RTCPointQuery query{search.q[0], search.q[1], search.q[2], 0, search_radius(search)};
    RTCPointQueryContext context;
    rtcInitPointQueryContext(&context);
    Traversal traversal{this, &search, &exact};
    rtcPointQuery(
        scene, &query, &context,
        [](RTCPointQueryFunctionArguments* args) {
            const Traversal& t = *static_cast<const Traversal*>(args->userPtr);
            if (!near_box(*t.search, t.tree->boxes[args->primID])) return false;
            const float before = t.search->upper;
            t.tree->visit_exactly(*t.exact, args->primID);
            if (!(t.search->upper < before)) return false;
            args->query->radius = search_radius(*t.search);
            return true;
        },
        &traversal);
}

// Every triangle in double: for points beyond the range of float, and meshes with vertices that are not finite.
Winner ClosestPointTree::Impl::scan(const Vec3d& p) const {
    Winner winner;
    for (uint32_t t = 0; t < lane_of_triangle.size(); ++t)
        prefer(winner, evaluate(p, lane_of_triangle[t]), lane_of_triangle[t], t);
    return winner;
}

void ClosestPointTree::Impl::update_clusters() {
    if (admission != Admission::kWinding && !cross_checked) return;
    clusters.box.resize(boxes.size());
    for (uint32_t m = 0; m < boxes.size(); ++m) {
        std::array<std::array<Vec3d, 3>, 16> corner;
        const uint32_t count = triangles_of(m);
        for (uint32_t j = 0; j < count; ++j)
            for (int k = 0; k < 3; ++k) corner[j][k] = position(lanes[16 * m + j].vertex[k]);
        clusters.box[m] = winding_cluster(std::span(corner).first(count));
    }
    join_winding_tree(tree, clusters);
}

bool ClosestPointTree::Impl::winds_around(const Vec3d& p) const {
    constexpr double kRounding = 1e-6;  // of either sum, far more than measured
    const auto near = [&](uint32_t m) {
        double half_angles = 0;
        for (uint32_t j = 0; j < triangles_of(m); ++j) {
            const Triangle& v = lanes[16 * m + j].vertex;
            half_angles += half_solid_angle(position(v[0]), position(v[1]), position(v[2]), p);
        }
        return half_angles / (2 * std::numbers::pi);
    };
    if (!clusters.node.empty()) {
        for (const double tolerance : {1e-2, 1e-4}) {
            const FarField sum = sum_winding(tree, clusters, p, tolerance, near);
            if (std::abs(sum.value - 0.5) > sum.error + kRounding) return sum.value > 0.5;
        }
    }
    return winding(p) > 0.5;
}

// A closed surface has nothing inside it beyond its own box.
bool ClosestPointTree::Impl::outside_box(const Vec3d& p) const {
    const Vec3d q = (p - centre) * scale;
    bool outside = false;
    for (int k = 0; k < 3; ++k) outside |= q[k] < box.min[k] || q[k] > box.max[k];
    return outside;
}

// Pseudonormal of the winning feature and the sum of its weights. False where it is not defined: a face of no area
// takes part, or the contributions cancel.
bool ClosestPointTree::Impl::pseudonormal(const Winner& winner, Vec3d& normal, double& weight) const {
    const Feature feature = winner.closest.feature;
    bool defined = true;
    const auto add = [&](const Vec3d& n, double w) {
        const double length = n.norm();
        defined &= length > 0;
        if (!(length > 0)) return;
        normal += (w / length) * n;
        weight += w;
    };
    normal.setZero();
    weight = 0;
    if (feature >= Feature::kEdge0) {
        add(normal_of(lanes[winner.lane].vertex), 1);
        if (feature == Feature::kFace) return defined;
        const int k = static_cast<int>(feature) - static_cast<int>(Feature::kEdge0);
        const uint32_t other = mesh.neighbour[winner.triangle][k];
        if (other != kNone) add(normal_of(mesh.triangle[other]), 1);
    } else {
        for_each_in_fan(winner, [&](const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& n) {
            add(n, std::atan2(n.norm(), (b - a).dot(c - a)));
        });
    }
    return defined && normal.squaredNorm() > 1e-28 * weight * weight;
}

// Side of p where every face around the winning vertex agrees on it, else 0: spares most vertices the angles.
double ClosestPointTree::Impl::side_of_fan(const Winner& winner, double rounding) const {
    bool outside = true, inside = true;
    for_each_in_fan(winner, [&](const Vec3d&, const Vec3d&, const Vec3d&, const Vec3d& n) {
        const double height = -winner.closest.offset.dot(n), limit = rounding * n.norm();
        outside &= height > limit;
        inside &= height < -limit;
    });
    return outside ? 1 : inside ? -1 : 0;
}

SurfacePoint ClosestPointTree::Impl::answer(const Vec3d& p, double radius, const Winner& winner) const {
    SurfacePoint out;
    if (winner.triangle == kNone) return out;
    const TrianglePoint& closest = winner.closest;
    const double d = std::sqrt(closest.squared_distance);
    if (!(d <= radius)) return out;
    out.point = p + closest.offset;
    out.triangle = winner.triangle;
    out.feature = closest.feature;
    const bool is_signed = admission == Admission::kSolid || admission == Admission::kWinding;

    Vec3d direction = Vec3d::Zero();
    const double side = side_of(p, winner, d, direction);
    out.distance = is_signed ? side * d : d;
    out.normal = is_signed ? Vec3d(side * direction) : direction;
    return out;
}

// Side of the surface p is on: +1 outside, -1 inside. `direction` becomes the unit direction from the surface to p;
// where p lies on the surface, side * pseudonormal. Sheets have no inside: their side matters on the surface only.
double ClosestPointTree::Impl::side_of(const Vec3d& p, const Winner& winner, double d, Vec3d& direction) const {
    const TrianglePoint& closest = winner.closest;
    const auto by_winding = [&] { return winds_around(p) ? -1.0 : 1.0; };
    const bool boxed_out = outside_box(p);
    if (closest.feature == Feature::kFace) {
        const double side = closest.height < 0 ? -1.0 : 1.0;
        // the offset is a multiple of the normal to the last bit, however short
        direction = d > 0 ? Vec3d(-closest.offset / d) : normal_of(lanes[winner.lane].vertex).normalized();
        if (boxed_out) return 1;
        return admission == Admission::kWinding && d > 0 ? by_winding() : side;
    }
    // below the rounding of the offset its direction means nothing
    double reach2 = 0;
    for (const uint32_t v : lanes[winner.lane].vertex) reach2 = std::max(reach2, (position(v) - p).squaredNorm());
    const double rounding = 0x1p-49 * std::sqrt(reach2);
    const bool on_surface = d <= rounding;
    if (!on_surface) {
        direction = -closest.offset / d;
        if (boxed_out || admission == Admission::kSheet || admission == Admission::kRefused) return 1;
        if (admission == Admission::kWinding) return by_winding();
        if (closest.feature < Feature::kEdge0)
            if (const double side = side_of_fan(winner, rounding); side != 0) return side;
    }
    Vec3d sum;
    double weight;
    const bool defined = pseudonormal(winner, sum, weight);
    const double dot = -closest.offset.dot(sum);
    const double side = dot < 0 ? -1.0 : 1.0;
    if (on_surface) {
        direction = side * (sum.squaredNorm() > 0 ? sum.normalized() : Vec3d::UnitX().eval());
        return side;
    }
    return defined && std::abs(dot) > rounding * weight ? side : by_winding();
}

// Nearer than a distance's rounding both signs may be right.
bool ClosestPointTree::Impl::disagrees(const Vec3d& p, const SurfacePoint& found) const {
    const double rounding = 0x1p-49 * (p - centre).norm() + 0x1p-48 / scale;
    if (found.triangle == kNone || !(std::abs(found.distance) > rounding)) return false;
    return winds_around(p) != (found.distance < 0);
}

void ClosestPointTree::Impl::prefetch_meshlet(uint32_t m) const {
    if (m == kNone) return;
    for (uint32_t i = 0; i < kNarrowLines; ++i)
        _mm_prefetch(reinterpret_cast<const char*>(&pool[first_line[m] + i]), _MM_HINT_T0);
}

void ClosestPointTree::Impl::prefetch_lane(uint32_t lane) const {
    const Lane& row = lanes[lane];
    for (const uint32_t v : row.vertex)
        _mm_prefetch(
            deformable ? reinterpret_cast<const char*>(&offset[v]) : reinterpret_cast<const char*>(&mesh.position[v]),
            _MM_HINT_T0);
    _mm_prefetch(reinterpret_cast<const char*>(&mesh.neighbour[row.triangle]), _MM_HINT_T0);
}

void ClosestPointTree::Impl::query_batch(std::span<const Vec3d> points, std::span<const double> radius,
                                         std::span<const uint32_t> hint, std::span<SurfacePoint> out,
                                         Previous& previous, QueryCounters& counters) const {
    const MeshletKernels& kernels = chosen_kernels();
    uint32_t first[kBatch + 1] = {};
    uint32_t lane[kBatch * kSlots];
    Winner decided[kBatch];
    const auto meshlet_of_hint = [&](uint32_t i) {
        return !hint.empty() && hint[i] < lane_of_triangle.size() ? lane_of_triangle[hint[i]] / 16 : kNone;
    };
    for (const uint32_t h : hint)
        if (h < lane_of_triangle.size()) _mm_prefetch(reinterpret_cast<const char*>(&lane_of_triangle[h]), _MM_HINT_T0);
    for (uint32_t i = 0; i < points.size(); ++i) {
        first[i + 1] = first[i];
        if (i + 1 < points.size()) prefetch_meshlet(meshlet_of_hint(i + 1));
        const Vec3d q = (points[i] - centre) * scale;
        const double far = q.cwiseAbs().maxCoeff();
        if (!(far < INFINITY) || !(radius[i] >= 0)) continue;
        if (far > kFarthest) {
            decided[i] = scan(points[i]);
            continue;
        }
        Search search;
        start(search, kernels, points[i], q, radius[i]);
        uint32_t near = meshlet_of_hint(i);
        if (near == kNone && previous.meshlet != kNone) {
            const float step = static_cast<float>((points[i] - previous.point).norm() * scale);
            search.upper = std::min(search.upper, (previous.upper + step) * (1 + 4 * kUnit));
            if (step < previous.upper) near = previous.meshlet;
        }
        if (near != kNone) visit(search, near);
        search.first = near;
        // Embree tests children against the radius it started with: never start with a needlessly large one
        if (search.upper > 1) search.upper = std::min(search.upper, bound_by_box(q));
        select(search);
        if (search.nearest != kNone) previous = {points[i], search.upper, search.nearest};
        if (search.overflow) {
            ++counters.tie_overflows;
            decided[i] = search_exactly(search);
            continue;
        }
        if (search.count == 0 && radius[i] == INFINITY) decided[i] = scan(points[i]);
        for (uint32_t j = 0; j < search.count; ++j) {
            _mm_prefetch(reinterpret_cast<const char*>(&lanes[search.lane[j]]), _MM_HINT_T0);
            lane[first[i + 1]++] = search.lane[j];
        }
    }
    for (uint32_t j = 0; j < first[points.size()]; ++j) prefetch_lane(lane[j]);
    for (uint32_t i = 0; i < points.size(); ++i) {
        for (uint32_t j = first[i]; j < first[i + 1]; ++j)
            prefer(decided[i], evaluate(points[i], lane[j]), lane[j], lanes[lane[j]].triangle);
        out[i] = answer(points[i], radius[i], decided[i]);
        if (cross_checked && admission == Admission::kSolid && disagrees(points[i], out[i])) ++counters.disagreements;
    }
}

ClosestPointTree::ClosestPointTree(const MeshView& mesh) : impl_(new Impl) { impl_->build(mesh); }

ClosestPointTree::ClosestPointTree(const MeshView& mesh, std::span<const Float4> offset) : impl_(new Impl) {
    TROCAR_ASSERT(offset.size() >= mesh.position.size());
    impl_->deformable = true;
    impl_->offset.assign(offset.begin(), offset.begin() + static_cast<std::ptrdiff_t>(mesh.position.size()));
    impl_->build(mesh);
}

ClosestPointTree::~ClosestPointTree() = default;

void ClosestPointTree::refit(std::span<const Float4> offset) {
    Impl& t = *impl_;
    TROCAR_ASSERT(t.deformable && offset.size() >= t.offset.size());
    std::copy_n(offset.begin(), t.offset.size(), t.offset.begin());
    t.update_meshlets();
    const bool grown = refit_box_tree(t.boxes, t.tree) > kMostGrowth * t.tree.built_area;
    if (grown) {
        build_box_tree(t.boxes, t.tree);
        ++t.rebuilds;
    }
    t.update_clusters();
    t.update_scene(grown);
}

void ClosestPointTree::rebuild() {
    build_box_tree(impl_->boxes, impl_->tree);
    impl_->update_clusters();
    impl_->release_scene();
    impl_->make_scene();
}

uint64_t ClosestPointTree::rebuilds() const { return impl_->rebuilds; }

void ClosestPointTree::query(std::span<const Vec3d> points, std::span<const double> radius,
                             std::span<const uint32_t> hint, std::span<SurfacePoint> out,
                             QueryCounters& counters) const {
    TROCAR_ASSERT(radius.size() == points.size() && out.size() == points.size());
    TROCAR_ASSERT(hint.empty() || hint.size() == points.size());
    if (impl_->boxes.empty()) {
        std::fill(out.begin(), out.end(), SurfacePoint{});
        return;
    }
    Previous previous;
    for (size_t i = 0; i < points.size(); i += kBatch) {
        const size_t n = std::min<size_t>(kBatch, points.size() - i);
        impl_->query_batch(points.subspan(i, n), radius.subspan(i, n), hint.empty() ? hint : hint.subspan(i, n),
                           out.subspan(i, n), previous, counters);
    }
}

SurfacePoint ClosestPointTree::query(const Vec3d& point, double radius) const {
    SurfacePoint out;
    QueryCounters counters;
    query({&point, 1}, {&radius, 1}, {}, {&out, 1}, counters);
    return out;
}

double ClosestPointTree::winding_number(const Vec3d& point) const { return impl_->winding(point); }

bool ClosestPointTree::winds_around(const Vec3d& point) const { return impl_->winds_around(point); }

void ClosestPointTree::cross_check(bool on) {
    impl_->cross_checked = on;
    impl_->update_clusters();
}

Vec3d ClosestPointTree::vertex(uint32_t v) const { return impl_->position(v); }

const char* instruction_set() { return chosen_kernels().name; }
void search_with_embree(bool on) { embree_chosen().store(on, std::memory_order_relaxed); }
void force_avx2(bool on) { avx2_forced().store(on, std::memory_order_relaxed); }

const char* closest_point_library() { return RTC_VERSION_STRING; }

}  // namespace trocar
