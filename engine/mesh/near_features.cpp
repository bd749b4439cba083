#include "engine/mesh/near_features.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

constexpr uint32_t kWidth = 8;          // features of a leaf
constexpr uint32_t kLeafGrain = 64;     // leaves
constexpr float kFarAway = 1e30f;       // m, coordinates of lanes without a feature
constexpr float kFlatArea = 1e-8f;      // (2 area)^2 / longest edge^4 below which a triangle is only its edges
constexpr float kNearParallel = 1e-6f;  // sine^2 of edges, below which their closest points are lost in rounding
// Distances from floats are wrong by less than this share of the longest edge: of a triangle that is not flat, its plane by 1e-4 of it; of
// edges that are not parallel, what 1e-7 / kNearParallel of an edge changes at that angle; of parallel ones, what the angle does.
constexpr float kErrorOfDistance = 2e-3f;

Vec8f to_unit(Vec8f a) { return least(greatest(a, Vec8f{}), lanes_of(1)); }
EightPoints spread(const EightPoints& a, uint32_t lane) { return {lanes_of(a.x[lane]), lanes_of(a.y[lane]), lanes_of(a.z[lane])}; }
EightPoints spread(const Float4& p) { return {lanes_of(p.x), lanes_of(p.y), lanes_of(p.z)}; }
EightPoints lower(const EightPoints& a, const EightPoints& b) { return {least(a.x, b.x), least(a.y, b.y), least(a.z, b.z)}; }
EightPoints upper(const EightPoints& a, const EightPoints& b) { return {greatest(a.x, b.x), greatest(a.y, b.y), greatest(a.z, b.z)}; }

Mask8 same(const std::array<uint32_t, kWidth>& vertex, uint32_t other) {
    const __m256i lanes = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(vertex.data()));
    return (Mask8)_mm256_cmpeq_epi32(lanes, _mm256_set1_epi32(static_cast<int>(other)));
}

bool is_finite(const Float4& p) { return std::isfinite(p.x + p.y + p.z); }

// Coordinates of a corner of eight features. at(lane): vertex, kNone for none.
template <typename At>
EightPoints gather_corner(const Float4* position, std::array<uint32_t, kWidth>& vertex, const At& at) {
    std::array<std::array<float, kWidth>, 3> lanes;
    for (uint32_t lane = 0; lane < kWidth; ++lane) {
        vertex[lane] = at(lane);
        const bool none = vertex[lane] == kNone;
        lanes[0][lane] = none ? kFarAway : position[vertex[lane]].x;
        lanes[1][lane] = none ? kFarAway : position[vertex[lane]].y;
        lanes[2][lane] = none ? kFarAway : position[vertex[lane]].z;
    }
    return {load_lanes(lanes[0]), load_lanes(lanes[1]), load_lanes(lanes[2])};
}

// Box of the lanes that have a feature.
FeatureBox box_of(const EightPoints& low, const EightPoints& high) {
    const auto top = [](Vec8f a) { return -least_lane(-(a < lanes_of(kFarAway) ? a : lanes_of(-kFarAway))); };
    return {{least_lane(low.x), least_lane(low.y), least_lane(low.z), 0}, {top(high.x), top(high.y), top(high.z), 0}};
}

void build_levels(std::vector<std::vector<FeatureBox>>& level, size_t leaves) {
    level.resize(leaves == 0 ? 0 : std::bit_width(leaves - 1) + 1u);
    if (leaves > 0) level[0].resize(leaves);
}
void join_levels(std::vector<std::vector<FeatureBox>>& level) {
    const auto join = [](const FeatureBox& a, const FeatureBox& b) {
        FeatureBox box;
        _mm_storeu_ps(box.low.data(), _mm_min_ps(_mm_loadu_ps(a.low.data()), _mm_loadu_ps(b.low.data())));
        _mm_storeu_ps(box.high.data(), _mm_max_ps(_mm_loadu_ps(a.high.data()), _mm_loadu_ps(b.high.data())));
        return box;
    };
    for (size_t l = 1; l < level.size(); ++l) {
        const std::vector<FeatureBox>& below = level[l - 1];
        level[l].resize((below.size() + 1) / 2);
        for (size_t i = 0; i < level[l].size(); ++i)
            level[l][i] = 2 * i + 1 < below.size() ? join(below[2 * i], below[2 * i + 1]) : below[2 * i];
    }
}

void build_triangle_leaf(const MeshView& mesh, const Float4* position, uint32_t leaf, FeatureTrees& trees) {
    EightTriangles& eight = trees.triangles[leaf];
    const auto exists = [&](uint32_t t) {
        if (t >= mesh.triangle.size()) return false;
        const auto [a, b, c] = mesh.triangle[t];
        return a != b && b != c && c != a && is_finite(position[a]) && is_finite(position[b]) && is_finite(position[c]);
    };
    std::array<bool, kWidth> here;
    for (uint32_t lane = 0; lane < kWidth; ++lane) here[lane] = exists(kWidth * leaf + lane);
    for (size_t c = 0; c < 3; ++c)
        eight.corner[c] = gather_corner(position, eight.vertex[c],
                                        [&](uint32_t lane) { return here[lane] ? mesh.triangle[kWidth * leaf + lane][c] : kNone; });
    eight.low = lower(lower(eight.corner[0], eight.corner[1]), eight.corner[2]);
    eight.high = upper(upper(eight.corner[0], eight.corner[1]), eight.corner[2]);
    trees.triangle_level[0][leaf] = box_of(eight.low, eight.high);
}

// Returns the square of the longest edge.
float build_edge_leaf(const MeshView& mesh, const Float4* position, uint32_t leaf, FeatureTrees& trees) {
    EightEdges& eight = trees.edges[leaf];
    const auto end = [&](uint32_t lane, size_t k) {
        const uint32_t e = kWidth * leaf + lane;
        if (e >= mesh.edge.size() || (mesh.edge_triangle[e][0] >= mesh.triangle.size() && mesh.edge_triangle[e][1] >= mesh.triangle.size()))
            return kNone;
        const auto [v, w] = mesh.edge[e];
        return is_finite(position[v]) && is_finite(position[w]) ? mesh.edge[e][k] : kNone;
    };
    for (size_t k = 0; k < 2; ++k) eight.end[k] = gather_corner(position, eight.vertex[k], [&](uint32_t lane) { return end(lane, k); });
    trees.edge_level[0][leaf] = box_of(lower(eight.end[0], eight.end[1]), upper(eight.end[0], eight.end[1]));
    return -least_lane(-norm2(eight.end[1] - eight.end[0]));
}

FeatureBox box_of_vertices(const Float4* position, uint32_t first, uint32_t count) {
    FeatureBox box{{kFarAway, kFarAway, kFarAway, 0}, {-kFarAway, -kFarAway, -kFarAway, 0}};
    for (uint32_t v = first; v < first + count; ++v) {
        const Float4& p = position[v];
        if (!is_finite(p)) continue;
        const std::array<float, 3> at{p.x, p.y, p.z};
        for (size_t k = 0; k < 3; ++k) box.low[k] = std::min(box.low[k], at[k]), box.high[k] = std::max(box.high[k], at[k]);
    }
    return box;
}

FeatureBox enlarge(FeatureBox box, float by) {
    for (size_t k = 0; k < 3; ++k) box.low[k] -= by, box.high[k] += by;
    return box;
}

bool meet(const FeatureBox& a, const FeatureBox& b) {
    const __m128 under = _mm_cmple_ps(_mm_loadu_ps(a.low.data()), _mm_loadu_ps(b.high.data()));
    const __m128 over = _mm_cmple_ps(_mm_loadu_ps(b.low.data()), _mm_loadu_ps(a.high.data()));
    return _mm_movemask_ps(_mm_and_ps(under, over)) == 15;
}

// Lanes whose boxes meet one.
uint32_t meet(const EightPoints& low, const EightPoints& high, const EightPoints& other_low, const EightPoints& other_high) {
    return mask_bits((low.x <= other_high.x) & (other_low.x <= high.x) & (low.y <= other_high.y) & (other_low.y <= high.y) &
                     (low.z <= other_high.z) & (other_low.z <= high.z));
}

// Calls visit(leaf) for the leaves from `first` on whose boxes meet one, ascending.
template <typename Visit>
void visit_leaves(const std::vector<std::vector<FeatureBox>>& level, const FeatureBox& box, uint32_t first, const Visit& visit) {
    struct Node {
        uint32_t level, index;
    };
    std::array<Node, 72> stack;  // two for each level at most
    size_t top = 0;
    if (!level.empty()) stack[top++] = {static_cast<uint32_t>(level.size() - 1), 0};
    while (top > 0) {
        const Node node = stack[--top];
        if (uint64_t{node.index + 1} << node.level <= first || !meet(box, level[node.level][node.index])) continue;
        if (node.level == 0) {
            visit(node.index);
            continue;
        }
        if (const uint32_t right = 2 * node.index + 1; right < level[node.level - 1].size()) stack[top++] = {node.level - 1, right};
        stack[top++] = {node.level - 1, 2 * node.index};
    }
}

// Squared distance of a point from an edge.
Vec8f to_edge(const EightPoints& p, const EightPoints& a, const EightPoints& b) {
    const EightPoints along = b - a, to = p - a;
    const Vec8f length2 = norm2(along), share = to_unit(dot(to, along) / greatest(length2, lanes_of(1e-30f)));
    return norm2(to - share * along);
}

// Squared distance of a point from triangles.
Vec8f to_triangles(const EightPoints& p, const EightTriangles& t) {
    const auto& [a, b, c] = t.corner;
    const EightPoints ab = b - a, bc = c - b, ca = a - c, pa = p - a, normal = cross(ab, c - a);
    const Vec8f area2 = norm2(normal), longest2 = greatest(greatest(norm2(ab), norm2(bc)), norm2(ca));
    const Mask8 inside = (dot(cross(ab, pa), normal) >= Vec8f{}) & (dot(cross(bc, p - b), normal) >= Vec8f{}) &
                         (dot(cross(ca, p - c), normal) >= Vec8f{}) & (area2 > lanes_of(kFlatArea) * longest2 * longest2);
    const Vec8f height = dot(normal, pa), to_plane = height * height / greatest(area2, lanes_of(1e-30f));
    return inside ? to_plane : least(least(to_edge(p, a, b), to_edge(p, b, c)), to_edge(p, c, a));
}

// Squared distance of an edge from others.
Vec8f between_edges(const EightPoints& p, const EightPoints& q, const EightEdges& other) {
    const EightPoints along = q - p, across = other.end[1] - other.end[0], apart = p - other.end[0];
    const Vec8f a = greatest(norm2(along), lanes_of(1e-30f)), e = greatest(norm2(across), lanes_of(1e-30f)), f = dot(across, apart),
                c = dot(along, apart), b = dot(along, across), sine2 = a * e - b * b;
    const auto from = [&](Vec8f s) {
        const Vec8f t = to_unit((b * s + f) / e), best = to_unit((b * t - c) / a);
        return norm2(apart + best * along - t * across);
    };
    const Vec8f crossing = to_unit((b * f - c * e) / greatest(sine2, lanes_of(1e-30f)));
    const Mask8 parallel = sine2 < lanes_of(kNearParallel) * a * e;
    return least(from(parallel ? Vec8f{} : crossing), from(parallel ? lanes_of(1) : crossing));
}

struct FeatureSearch {
    const MeshView& mesh;
    const Float4* position;
    const FeatureTrees &trees, &other;
    bool itself;
    float reach, cull2;  // m; m^2, squared distance below which a pair is kept

    void put(uint64_t first, uint32_t leaf, uint32_t lanes, std::vector<uint64_t>& out) const {
        for (; lanes != 0; lanes &= lanes - 1)
            out.push_back(first << 32 | (kWidth * leaf + static_cast<uint32_t>(std::countr_zero(lanes))));
    }

    void vertices(uint32_t eight, std::vector<uint64_t>& out) const {
        const uint32_t begin = kWidth * eight, end = std::min(begin + kWidth, static_cast<uint32_t>(mesh.position.size()));
        visit_leaves(other.triangle_level, enlarge(trees.vertex_box[eight], reach), 0, [&](uint32_t leaf) {
            const EightTriangles& t = other.triangles[leaf];
            for (uint32_t v = begin; v < end; ++v) {
                const EightPoints p = spread(position[v]), far{lanes_of(reach), lanes_of(reach), lanes_of(reach)};
                uint32_t lanes = meet(p - far, p + far, t.low, t.high);
                if (lanes == 0) continue;
                if (itself) lanes &= ~mask_bits(same(t.vertex[0], v) | same(t.vertex[1], v) | same(t.vertex[2], v));
                if (lanes == 0) continue;
                put(v, leaf, lanes & mask_bits(to_triangles(p, t) < lanes_of(cull2)), out);
            }
        });
    }

    void edges(uint32_t eight, std::vector<uint64_t>& out) const {
        const EightEdges& mine = trees.edges[eight];
        const EightPoints far{lanes_of(reach), lanes_of(reach), lanes_of(reach)};
        const EightPoints low = lower(mine.end[0], mine.end[1]) - far, high = upper(mine.end[0], mine.end[1]) + far;
        visit_leaves(other.edge_level, enlarge(trees.edge_level[0][eight], reach), itself ? eight : 0, [&](uint32_t leaf) {
            const EightEdges& theirs = other.edges[leaf];
            const EightPoints their_low = lower(theirs.end[0], theirs.end[1]), their_high = upper(theirs.end[0], theirs.end[1]);
            for (uint32_t lane = 0; lane < kWidth; ++lane) {
                const uint32_t v = mine.vertex[0][lane], w = mine.vertex[1][lane];
                if (v == kNone) continue;
                uint32_t lanes = meet(spread(low, lane), spread(high, lane), their_low, their_high);
                if (itself && leaf == eight) lanes &= ~1u << lane;
                if (lanes == 0) continue;
                if (itself)
                    lanes &= ~mask_bits(same(theirs.vertex[0], v) | same(theirs.vertex[1], v) | same(theirs.vertex[0], w) |
                                        same(theirs.vertex[1], w));
                if (lanes == 0) continue;
                const Vec8f distance2 = between_edges(spread(mine.end[0], lane), spread(mine.end[1], lane), theirs);
                put(kWidth * eight + lane, leaf, lanes & mask_bits(distance2 < lanes_of(cull2)), out);
            }
        });
    }
};

FeatureSearch search_within(const MeshView& mesh, const Float4* position, const FeatureTrees& trees, const FeatureTrees& other, bool itself,
                            float reach) {
    const float farthest = reach + kErrorOfDistance * std::max(trees.longest, other.longest);
    return {mesh, position, trees, other, itself, farthest, farthest * farthest};
}

// Appends what was found for the features of a leaf: those of each lane are ascending already, one lane follows the other.
void append_by_lane(const std::vector<uint64_t>& found, std::vector<uint64_t>& out) {
    const auto lane_of = [](uint64_t pair) { return static_cast<size_t>(pair >> 32) % kWidth; };
    std::array<size_t, kWidth + 1> next{};
    for (const uint64_t pair : found) ++next[lane_of(pair) + 1];
    next[0] = out.size();
    for (size_t lane = 0; lane < kWidth; ++lane) next[lane + 1] += next[lane];
    out.resize(out.size() + found.size());
    for (const uint64_t pair : found) out[next[lane_of(pair)]++] = pair;
}

// Runs find(leaf, out) for all leaves in chunks. The second features that it finds for each of the first ascend.
template <typename Find>
void search_leaves(uint32_t leaves, NearFeatures& near, std::vector<uint64_t>& all, const Find& find) {
    std::vector<std::vector<uint64_t>>& part = near.part;
    const uint32_t chunks = (leaves + kLeafGrain - 1) / kLeafGrain;
    if (part.size() < chunks) part.resize(chunks), near.leaf.resize(chunks);
    parallel_for(leaves, kLeafGrain, [&](uint32_t begin, uint32_t end) {
        std::vector<uint64_t>&out = part[begin / kLeafGrain], &of_leaf = near.leaf[begin / kLeafGrain];
        out.clear();
        for (uint32_t leaf = begin; leaf < end; ++leaf) {
            of_leaf.clear();
            find(leaf, of_leaf);
            append_by_lane(of_leaf, out);
        }
    });
    all.clear();
    for (uint32_t chunk = 0; chunk < chunks; ++chunk) all.insert(all.end(), part[chunk].begin(), part[chunk].end());
}

constexpr float kAbove = 0.5f;          // share of a vertex' distance by which it is off the plane of a triangle that it faces
constexpr float kLeastSine2 = 0.0024f;  // of edges that face each other: a little below 0.05^2

// Points of up to eight pairs. at(pair): the vertex.
template <typename At>
EightPoints gather_points(const Float4* position, std::span<const uint64_t> pairs, const std::array<float, 3>& shift, const At& at) {
    std::array<std::array<float, kWidth>, 3> lanes;
    for (uint32_t lane = 0; lane < kWidth; ++lane) {
        const Float4& p = position[at(pairs[std::min<size_t>(lane, pairs.size() - 1)])];
        lanes[0][lane] = p.x, lanes[1][lane] = p.y, lanes[2][lane] = p.z;
    }
    return {load_lanes(lanes[0]) + lanes_of(shift[0]), load_lanes(lanes[1]) + lanes_of(shift[1]),
            load_lanes(lanes[2]) + lanes_of(shift[2])};
}
uint32_t first_of(uint64_t pair) { return static_cast<uint32_t>(pair >> 32); }
uint32_t second_of(uint64_t pair) { return static_cast<uint32_t>(pair); }
uint32_t lanes_in_use(size_t pairs) { return (1u << pairs) - 1; }

}  // namespace

uint32_t facing_vertices(const FacingSurfaces& s, std::span<const uint64_t> pairs, float reach) {
    const float wrong = kErrorOfDistance * s.longest, most = reach + wrong;
    const EightPoints p = gather_points(s.position, pairs, {}, first_of);
    EightTriangles t;
    for (size_t k = 0; k < 3; ++k)
        t.corner[k] = gather_points(s.other_position, pairs, s.shift, [&](uint64_t pair) { return s.triangle[second_of(pair)][k]; });
    const auto& [a, b, c] = t.corner;
    const EightPoints normal = cross(b - a, c - a);
    const Vec8f longest2 = greatest(greatest(norm2(b - a), norm2(c - b)), norm2(a - c)), area2 = norm2(normal);
    const Vec8f distance2 = to_triangles(p, t), off = dot(normal, p - a) / square_roots(greatest(area2, lanes_of(1e-30f)));
    const Vec8f height = greatest(off, -off) + lanes_of(2 * wrong), flat = lanes_of(kFlatArea) * longest2 * longest2;
    const Mask8 faces = (height * height >= lanes_of(kAbove * kAbove) * distance2) | !(area2 > flat);
    return mask_bits(faces & (distance2 < lanes_of(most * most))) & lanes_in_use(pairs.size());
}

uint32_t facing_edges(const FacingSurfaces& s, std::span<const uint64_t> pairs, float reach) {
    const float wrong = kErrorOfDistance * s.longest;
    const auto mine = [&](size_t k) {
        return gather_points(s.position, pairs, {}, [&](uint64_t pair) { return s.edge[first_of(pair)][k]; });
    };
    const auto theirs = [&](size_t k) {
        return gather_points(s.other_position, pairs, s.shift, [&](uint64_t pair) { return s.other_edge[second_of(pair)][k]; });
    };
    const EightPoints p = mine(0), u = mine(1) - p, q = theirs(0), v = theirs(1) - q, across = cross(u, v), apart = q - p;
    const Vec8f u2 = norm2(u), v2 = norm2(v), sine2 = norm2(across), sine = square_roots(sine2), height = dot(across, apart);
    // along either edge, times its length and the squared sine: within it but for what is wrong
    const auto within = [&](const EightPoints& other, Vec8f length2) {
        const Vec8f length = square_roots(length2), at = dot(cross(apart, other), across) * length, edge = lanes_of(wrong) * sine2;
        return (at >= -edge) & (at <= length * sine2 + edge);
    };
    const Mask8 faces = (sine2 > lanes_of(kLeastSine2) * u2 * v2) & within(v, u2) & within(u, v2) &
                        (greatest(height, -height) < lanes_of(reach + wrong) * sine);
    return mask_bits(faces) & lanes_in_use(pairs.size());
}

void build_feature_trees(const MeshView& mesh, const Float4* position, FeatureTrees& trees) {
    const auto leaves_of = [](size_t count) { return static_cast<uint32_t>((count + kWidth - 1) / kWidth); };
    const uint32_t triangles = leaves_of(mesh.triangle.size()), edges = leaves_of(mesh.edge.size()),
                   vertices = leaves_of(mesh.position.size());
    trees.triangles.resize(triangles), trees.edges.resize(edges), trees.vertex_box.resize(vertices);
    build_levels(trees.triangle_level, triangles);
    build_levels(trees.edge_level, edges);
    parallel_for(triangles, 4 * kLeafGrain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t leaf = begin; leaf < end; ++leaf) build_triangle_leaf(mesh, position, leaf, trees);
    });
    for (uint32_t eight = 0; eight < vertices; ++eight)
        trees.vertex_box[eight] =
            box_of_vertices(position, kWidth * eight, std::min(kWidth, static_cast<uint32_t>(mesh.position.size()) - kWidth * eight));
    float longest2 = 0;
    for (uint32_t leaf = 0; leaf < edges; ++leaf) longest2 = std::max(longest2, build_edge_leaf(mesh, position, leaf, trees));
    trees.longest = std::sqrt(longest2);
    join_levels(trees.triangle_level);
    join_levels(trees.edge_level);
}

void find_near_vertices(const MeshView& mesh, const Float4* position, const FeatureTrees& trees, const FeatureTrees& other, bool itself,
                        float reach, NearFeatures& near) {
    const FeatureSearch search = search_within(mesh, position, trees, other, itself, reach);
    near.edge_edge.clear();
    search_leaves(static_cast<uint32_t>(trees.vertex_box.size()), near, near.vertex_triangle,
                  [&](uint32_t eight, std::vector<uint64_t>& out) { search.vertices(eight, out); });
}

void find_near_features(const MeshView& mesh, const Float4* position, const FeatureTrees& trees, const FeatureTrees& other, bool itself,
                        float reach, NearFeatures& near) {
    find_near_vertices(mesh, position, trees, other, itself, reach, near);
    const FeatureSearch search = search_within(mesh, position, trees, other, itself, reach);
    search_leaves(static_cast<uint32_t>(trees.edges.size()), near, near.edge_edge,
                  [&](uint32_t eight, std::vector<uint64_t>& out) { search.edges(eight, out); });
}

}  // namespace trocar
