#include <immintrin.h>

#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/base/cpu.hpp"
#include "engine/distance/closest_point_impl.hpp"
#include "engine/distance/meshlet_cutter.hpp"
#include "engine/jobs/race_detector.hpp"

// How a query is answered, and proof that the answer is exact.
//
// Local frame: x -> (x - centre) * scale, scale a power of two that brings the half extent of the mesh to
// [1, 2), so that neither small nor large units leave the range of float. Float only selects candidates;
// every returned number is computed in double from the vertices themselves.
//
// Error bound of the float distance f of a triangle, d its true distance, u = 2^-24, L its longest edge, A
// its area, a = 2A / L^2, R the largest |vertex| of its meshlet, q the query point, all in the local frame:
//   rounding to float moves vertices by at most u R, the query point by u |q|; distance is 1-Lipschitz in
//     both;
//   differences to the query and edges are each rounded once: their points move by at most u (d + L) and u L;
//   segment: the clamped parameter has an error of (3 u |r| + 4 u L) / L, |r| <= d + L, which adds at most
//     10 u L along the segment (for d > L only its square over 2 d counts); the point, its square and the
//     root are accurate to 3 u d: in all 5 u d + 12 u L;
//   face: the normal is tilted by at most k = 4 u L^2 / 2A = 4 u / a, which adds k L at the closest point
//     (inside the triangle, so within L of the corner used) plus d k^2 / 2; h = n . r adds 4 u (d + L), its
//     division and root 3 u d;
//   a point up to e = (k + 8 u) d + 8 u L outside the three edge planes may count as inside, which adds at
//     most e / d of that, 9 u L + 0.01 u d at an edge; in a corner (its angle is at least a) the distance to
//     the corner is at most 2 e / a, which adds at most 16 u L / a + d (2 (k + 8 u) / a)^2.
// Sum: |f - d| <= u R + u |q| + u (16 + 24 / a) L + (10 u + (2 (k + 8 u) / a)^2) d, stored per meshlet as
// error_base + error_slope d, times 1.01 for second-order terms and for the rounding of the bound itself.
// Triangles with a < 1e-2 are excluded and evaluated in double.
//
// Let `upper` be the least f + bound so far: the nearest triangle is no farther. The tree (our own or
// Embree's) is searched for all meshlets within `upper` of the query (boxes rounded outward), every triangle
// with f - bound <= upper is kept, and the kept ones are evaluated in double; the least (squared distance,
// triangle) wins. The winner is always among the kept, so the starting radius, the order of visits and the
// tree cannot change the answer.
namespace trocar {
namespace {

constexpr double kMostGrowth = 1.3;  // growth of the tree's summed area by refits that triggers a rebuild

}  // namespace

const MeshletKernels& meshlet_search::chosen_kernels() { return kernels_of_isa(kMeshletKernelsAvx2, kMeshletKernelsAvx512); }

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

// Embree requests the boxes on its own threads.
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

void ClosestPointTree::Impl::build(const MeshView& view, const Impl* like) {
    mesh = view;
    admission = view.info ? view.info->admission : Admission::kSheet;
    TROCAR_ASSERT(mesh.neighbour.size() == mesh.triangle.size());
    TROCAR_ASSERT(mesh.incident_first.size() == mesh.position.size() + 1);
    TROCAR_ASSERT(!deformable || offset.size() == mesh.position.size());
    choose_frame();
    closed = like ? like->closed : is_closed();
    if (like) {
        TROCAR_ASSERT(like->mesh.triangle.data() == mesh.triangle.data() && like->mesh.triangle.size() == mesh.triangle.size());
        pool = like->pool;
        take_cut(like->cut);
    } else {
        make_meshlets();
    }
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
    const auto made = std::make_shared<MeshletCut>();
    auto& [lines_of, vertices, vertices_of, corners, lane_of] = *made;
    corners.resize(16ul * count);
    lane_of.resize(mesh.triangle.size());
    lines_of.resize(count);
    vertices_of.resize(count);
    std::vector<std::array<std::array<uint8_t, 16>, 3>> corner(count);
    uint32_t lines = 0;
    for (uint32_t m = 0; m < count; ++m) {
        const auto [begin, end] = cutter.groups[m];
        lines_of[m] = lines;
        vertices_of[m] = static_cast<uint32_t>(vertices.size());
        for (uint32_t j = 0; j < 16; ++j) {
            const uint32_t t = cutter.order[std::min(begin + j, end - 1)];
            corners[16 * m + j] = {mesh.triangle[t], t};
            if (begin + j < end) lane_of[t] = 16 * m + j;
            for (int k = 0; k < 3; ++k) {
                const auto first = vertices.begin() + vertices_of[m];
                const auto found = std::find(first, vertices.end(), mesh.triangle[t][k]);
                corner[m][k][j] = static_cast<uint8_t>(found - first);
                if (found == vertices.end()) vertices.push_back(mesh.triangle[t][k]);
            }
        }
        const bool wide = vertices.size() - vertices_of[m] > 16;
        vertices.resize(vertices_of[m] + (wide ? 32 : 16), vertices.back());
        lines += wide ? kWideLines : kNarrowLines;
    }
    pool.resize(lines + kWideLines - kNarrowLines);  // a narrow meshlet at the end may be read at full width
    take_cut(made);
    for (uint32_t m = 0; m < count; ++m) {
        Meshlet& t = meshlet(m);
        std::copy_n(&corner[m][0][0], 48, &t.corner[0][0]);
        t.wide = (m + 1 < count ? first_vertex[m + 1] : vertex.size()) - first_vertex[m] > 16;
        t.float_lanes = static_cast<uint16_t>((1u << (cutter.groups[m][1] - cutter.groups[m][0])) - 1);
        t.exact_lanes = 0;
        t.pad = 0;
    }
}

void ClosestPointTree::Impl::take_cut(std::shared_ptr<const MeshletCut> made) {
    cut = std::move(made);
    first_line = cut->first_line, vertex = cut->vertex, first_vertex = cut->first_vertex;
    lane_of_triangle = cut->lane_of_triangle, lanes = cut->lanes;
    boxes.resize(first_line.size());
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
    if (boxes.empty() || walk != TreeSearch::kEmbree) return;
    const RTCDevice device = embree_device();
    scene = rtcNewScene(device);
    geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
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
    TROCAR_ASSERT(rtcGetDeviceError(device) == RTC_ERROR_NONE);
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

QueryCounters& QueryCounters::operator+=(const QueryCounters& other) {
    queries += other.queries;
    tie_overflows += other.tie_overflows;
    disagreements += other.disagreements;
    settled += other.settled;
    return *this;
}

void add_to_report(const QueryCounters& counters, Report& report) {
    report.queries += counters.queries;
    report.tie_overflows += counters.tie_overflows;
    report.disagreements += counters.disagreements;
    report.sign_disagreements += counters.settled;
}

bool ClosestPointTree::looks_at(const MeshView& mesh) const {
    const MeshView& own = impl_->mesh;
    return own.position.data() == mesh.position.data() && own.triangle.data() == mesh.triangle.data() && own.info == mesh.info;
}

ClosestPointTree::ClosestPointTree(const MeshView& mesh, const ClosestPointTree* like, TreeSearch search) : impl_(new Impl) {
    impl_->walk = search;
    impl_->build(mesh, like ? like->impl_.get() : nullptr);
}

ClosestPointTree::ClosestPointTree(const MeshView& mesh, std::span<const Float4> offset, const ClosestPointTree* like, TreeSearch search)
    : impl_(new Impl) {
    TROCAR_ASSERT(offset.size() >= mesh.position.size());
    impl_->walk = search;
    impl_->deformable = true;
    impl_->offset.assign(offset.begin(), offset.begin() + static_cast<std::ptrdiff_t>(mesh.position.size()));
    impl_->build(mesh, like ? like->impl_.get() : nullptr);
}

ClosestPointTree::~ClosestPointTree() = default;

void ClosestPointTree::refit(std::span<const Float4> offset) {
    Impl& t = *impl_;
    TROCAR_ASSERT(t.deformable && offset.size() >= t.offset.size());
    std::copy_n(offset.begin(), t.offset.size(), t.offset.begin());
    t.update_meshlets();
    const bool grown = refit_box_tree(t.boxes, t.tree) > kMostGrowth * t.tree.built_area;
    if (grown) build_box_tree(t.boxes, t.tree);
    t.update_clusters();
    t.update_scene(grown);
}

void ClosestPointTree::rebuild() {
    build_box_tree(impl_->boxes, impl_->tree);
    impl_->update_clusters();
    impl_->release_scene();
    impl_->make_scene();
}

uint64_t ClosestPointTree::builds() const { return impl_->tree.builds; }
const BoxTree& ClosestPointTree::hierarchy() const { return impl_->tree; }
uint32_t ClosestPointTree::groups() const { return static_cast<uint32_t>(impl_->boxes.size()); }
std::span<const uint32_t> ClosestPointTree::lane_of_triangle() const { return impl_->lane_of_triangle; }
TreeSearch ClosestPointTree::search() const { return impl_->walk; }

bool ClosestPointTree::cut_like(const ClosestPointTree& other) const { return impl_->cut == other.impl_->cut; }

void ClosestPointTree::query(std::span<const Vec3d> points, std::span<const double> radius, std::span<const uint32_t> hint,
                             std::span<SurfacePoint> out, QueryCounters& counters) const {
    counters.queries += points.size();
    TROCAR_ASSERT(radius.size() == points.size() && out.size() == points.size());
    TROCAR_ASSERT(hint.empty() || hint.size() == points.size());
    if (impl_->boxes.empty()) {
        std::fill(out.begin(), out.end(), SurfacePoint{});
        return;
    }
    if (points.size() > 1) impl_->prefetch_small();
    Previous previous;
    for (size_t i = 0; i < points.size(); i += kBatch) {
        const size_t n = std::min<size_t>(kBatch, points.size() - i);
        impl_->query_batch(points.subspan(i, n), radius.subspan(i, n), hint.empty() ? hint : hint.subspan(i, n), out.subspan(i, n),
                           previous, counters);
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
bool ClosestPointTree::decide_side(const Vec3d& point, SurfacePoint& answer) const {
    if (winds_around(point) == (answer.distance < 0)) return false;
    answer.distance = -answer.distance;
    answer.normal = -answer.normal;
    return true;
}

void ClosestPointTree::cross_check(bool on) { impl_->cross_checked = on; }

Vec3d ClosestPointTree::vertex(uint32_t v) const { return impl_->position(v); }

const char* closest_point_library() { return RTC_VERSION_STRING; }
void start_embree() { embree_device(); }

}  // namespace trocar
