#include <immintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "engine/distance/closest_point_impl.hpp"
namespace trocar {
namespace {

constexpr double kFarthest = 1e15;  // local units: above, squares exceed the range of float

void prefer(Winner& winner, const TrianglePoint& closest, uint32_t lane, uint32_t triangle) {
    if (closest.squared_distance < winner.closest.squared_distance ||
        (closest.squared_distance == winner.closest.squared_distance && triangle < winner.triangle))
        winner = {closest, lane, triangle};
}

// at least the next float above x (finite, >= 0)
float round_up(double x) { return static_cast<float>(x) * (1.0f + 4.0f * kUnit) + 1e-30f; }

// Covers the traversals' rounding of box differences and squares by 8 units.
float search_radius(const Search& search) { return (search.upper + search.query_error) * (1.0f + 16.0f * kUnit) + 1e-30f; }

float squared_reach(const Search& search) { return search_radius(search) * search_radius(search); }

// Embree's leaves hold several meshlets and report all of them
bool near_box(const Search& search, const FloatBox& box) {
    const __m128 q = _mm_load_ps(search.q);
    const __m128 outside =
        _mm_max_ps(_mm_max_ps(_mm_sub_ps(_mm_load_ps(box.min), q), _mm_sub_ps(q, _mm_load_ps(box.max))), _mm_setzero_ps());
    return _mm_cvtss_f32(_mm_dp_ps(outside, outside, 0x71)) <= squared_reach(search);
}

uint32_t lanes_below(const float* squared, float limit) {
    const __m256 l = _mm256_set1_ps(limit);
    const int low = _mm256_movemask_ps(_mm256_cmp_ps(_mm256_load_ps(squared), l, _CMP_LT_OQ));
    const int high = _mm256_movemask_ps(_mm256_cmp_ps(_mm256_load_ps(squared + 8), l, _CMP_LT_OQ));
    return static_cast<uint32_t>(low) | static_cast<uint32_t>(high) << 8;
}

// largest squared float distance at which a triangle can still be as near as upper
float kept_limit(const Search& search, const Meshlet& meshlet) {
    const float reach = (search.upper + meshlet.error_base + search.query_error) * (1.0f + 1.1f * meshlet.error_slope);
    return reach * reach * (1.0f + 16.0f * kUnit) + 1e-36f;
}

}  // namespace

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

// Lowers search.upper by meshlet m and keeps its triangles that may win.
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

// As visit, but evaluates in double at once: for queries that tie more triangles than there are slots.
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

void ClosestPointTree::Impl::start(Search& search, const MeshletKernels& kernels, const Vec3d& p, const Vec3d& q, double radius) const {
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

// The surface touches every side of its box, so it is no farther than the far corner of the best side
// (Roussopoulos, Kelley & Vincent, Nearest neighbor queries, SIGMOD 1995).
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

// Visits all meshlets that may hold a triangle within search.upper, then drops triangles that are farther.
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
    for (uint32_t t = 0; t < lane_of_triangle.size(); ++t) prefer(winner, evaluate(p, lane_of_triangle[t]), lane_of_triangle[t], t);
    return winner;
}

void ClosestPointTree::Impl::prefetch_meshlet(uint32_t m) const {
    if (m == kNone) return;
    for (uint32_t i = 0; i < kNarrowLines; ++i) _mm_prefetch(reinterpret_cast<const char*>(&pool[first_line[m] + i]), _MM_HINT_T0);
}

// All meshlets of a small mesh at once: in a scene of a thousand bodies none is in the cache.
void ClosestPointTree::Impl::prefetch_small() const {
    constexpr size_t kFewLines = 256;  // 16 kB, half a first-level cache
    if (pool.size() > kFewLines) return;
    for (const CacheLine& line : pool) _mm_prefetch(reinterpret_cast<const char*>(&line), _MM_HINT_T0);
}

void ClosestPointTree::Impl::prefetch_lane(uint32_t lane) const {
    const Lane& entry = lanes[lane];
    for (const uint32_t v : entry.vertex)
        _mm_prefetch(deformable ? reinterpret_cast<const char*>(&offset[v]) : reinterpret_cast<const char*>(&mesh.position[v]),
                     _MM_HINT_T0);
    _mm_prefetch(reinterpret_cast<const char*>(&mesh.neighbour[entry.triangle]), _MM_HINT_T0);
}

void ClosestPointTree::Impl::query_batch(std::span<const Vec3d> points, std::span<const double> radius, std::span<const uint32_t> hint,
                                         std::span<SurfacePoint> out, Previous& previous, QueryCounters& counters) const {
    const MeshletKernels& kernels = chosen_kernels();
    uint32_t first[kBatch + 1] = {};
    uint32_t lane[kBatch * kSlots];
    uint32_t answered = 0;  // bits; a point neither answered nor with lanes is beyond its radius
    const auto decide = [&](uint32_t i, const Winner& winner) {
        out[i] = answer(points[i], radius[i], winner);
        answered |= 1u << i;
    };
    static_assert(kBatch <= 32);
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
            decide(i, scan(points[i]));
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
        // Embree tests children against the initial radius, so it should be as small as possible
        if (search.upper > 1) search.upper = std::min(search.upper, bound_by_box(q));
        select(search);
        if (search.nearest != kNone) previous = {points[i], search.upper, search.nearest};
        if (search.overflow) {
            ++counters.tie_overflows;
            decide(i, search_exactly(search));
            continue;
        }
        if (search.count == 0 && radius[i] == INFINITY) decide(i, scan(points[i]));
        for (uint32_t j = 0; j < search.count; ++j) {
            _mm_prefetch(reinterpret_cast<const char*>(&lanes[search.lane[j]]), _MM_HINT_T0);
            lane[first[i + 1]++] = search.lane[j];
        }
    }
    for (uint32_t j = 0; j < first[points.size()]; ++j) prefetch_lane(lane[j]);
    for (uint32_t i = 0; i < points.size(); ++i) {
        if (!(answered >> i & 1)) {
            Winner winner;
            for (uint32_t j = first[i]; j < first[i + 1]; ++j)
                prefer(winner, evaluate(points[i], lane[j]), lane[j], lanes[lane[j]].triangle);
            out[i] = answer(points[i], radius[i], winner);
        }
        if (cross_checked && admission == Admission::kSolid && disagrees(points[i], out[i])) ++counters.disagreements;
    }
}

}  // namespace trocar
