#include "engine/mesh/crossing_faces.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <limits>

#include "engine/geometry/predicates.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/face_meeting.hpp"
namespace trocar {
namespace {

constexpr uint32_t kLanes = 8;
constexpr uint32_t kGrain = 64;  // leaves
constexpr float kInfinity = std::numeric_limits<float>::infinity();
// A signed volume n.(x - a) from floats is wrong by 13 roundings of |e1||e2||x - a| at most: two of the edges and four of the
// normal, each for three coordinates, one of x - a and three of the product.
constexpr float kErrorOfProduct = 8 * std::numeric_limits<float>::epsilon();  // sixteen roundings
constexpr float kUnderflow = 1e-30f;                                          // m^3, far above what flushed denormals lose

Vec8f magnitude(Vec8f a) { return greatest(a, -a); }
Vec8f taxicab(const EightPoints& a) { return magnitude(a.x) + magnitude(a.y) + magnitude(a.z); }
EightPoints lane_of(const EightPoints& a, uint32_t lane) { return {lanes_of(a.x[lane]), lanes_of(a.y[lane]), lanes_of(a.z[lane])}; }
EightPoints low_end(const EightPoints& a, const EightPoints& b) { return {least(a.x, b.x), least(a.y, b.y), least(a.z, b.z)}; }
EightPoints high_end(const EightPoints& a, const EightPoints& b) { return {greatest(a.x, b.x), greatest(a.y, b.y), greatest(a.z, b.z)}; }

Mask8 equals(const std::array<uint32_t, kLanes>& vertex, uint32_t other) {
    const __m256i lanes = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(vertex.data()));
    return (Mask8)_mm256_cmpeq_epi32(lanes, _mm256_set1_epi32(static_cast<int>(other)));
}

// At most eight faces of a surface; the last one once more in lanes left over, where no box meets it.
EightFaces gather(std::span<const Triangle> triangle, const Float4* position) {
    EightFaces faces;
    std::array<std::array<float, kLanes>, 9> at{};
    for (uint32_t lane = 0; lane < kLanes; ++lane) {
        for (size_t c = 0; c < 3; ++c) {
            const uint32_t v = faces.vertex[c][lane] = triangle[std::min<size_t>(lane, triangle.size() - 1)][c];
            at[3 * c][lane] = position[v].x, at[3 * c + 1][lane] = position[v].y, at[3 * c + 2][lane] = position[v].z;
        }
    }
    for (size_t c = 0; c < 3; ++c) faces.corner[c] = {load_lanes(at[3 * c]), load_lanes(at[3 * c + 1]), load_lanes(at[3 * c + 2])};
    const auto& [a, b, c] = faces.corner;
    faces.normal = cross(b - a, c - a);
    faces.error = kErrorOfProduct * taxicab(b - a) * taxicab(c - a);
    faces.low = low_end(low_end(a, b), c), faces.high = high_end(high_end(a, b), c);
    for (auto lane = static_cast<uint32_t>(triangle.size()); lane < kLanes; ++lane) faces.low.x[lane] = kInfinity;
    return faces;
}

FaceBox leaf_box(const EightFaces& faces) {
    return {{least_lane(faces.low.x), least_lane(faces.low.y), least_lane(faces.low.z), 0},
            {-least_lane(-faces.high.x), -least_lane(-faces.high.y), -least_lane(-faces.high.z), 0}};
}

FaceBox join(const FaceBox& a, const FaceBox& b) {
    FaceBox box;
    _mm_storeu_ps(box.low.data(), _mm_min_ps(_mm_loadu_ps(a.low.data()), _mm_loadu_ps(b.low.data())));
    _mm_storeu_ps(box.high.data(), _mm_max_ps(_mm_loadu_ps(a.high.data()), _mm_loadu_ps(b.high.data())));
    return box;
}

bool boxes_meet(const FaceBox& a, const FaceBox& b) {
    const __m128 under = _mm_cmple_ps(_mm_loadu_ps(a.low.data()), _mm_loadu_ps(b.high.data()));
    const __m128 over = _mm_cmple_ps(_mm_loadu_ps(b.low.data()), _mm_loadu_ps(a.high.data()));
    return _mm_movemask_ps(_mm_and_ps(under, over)) == 15;
}

void build_tree(std::span<const Triangle> triangle, const Float4* position, CrossingFacesScratch& tree) {
    const uint32_t leaves = static_cast<uint32_t>((triangle.size() + kLanes - 1) / kLanes);
    tree.leaf.resize(leaves);
    tree.level.resize(std::bit_width(leaves - 1) + 1u);
    tree.level[0].resize(leaves);
    parallel_for(leaves, 4 * kGrain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t i = begin; i < end; ++i) {
            tree.leaf[i] = gather(triangle.subspan(kLanes * i, std::min<size_t>(kLanes, triangle.size() - kLanes * i)), position);
            tree.level[0][i] = leaf_box(tree.leaf[i]);
        }
    });
    for (size_t level = 1; level < tree.level.size(); ++level) {
        const std::vector<FaceBox>& below = tree.level[level - 1];
        tree.level[level].resize((below.size() + 1) / 2);
        for (size_t i = 0; i < tree.level[level].size(); ++i)
            tree.level[level][i] = 2 * i + 1 < below.size() ? join(below[2 * i], below[2 * i + 1]) : below[2 * i];
    }
}

// Whether a plane parts two faces: all corners of one that the other does not share are clearly on one side of the other's
// plane, so that they meet in what they share at most.
struct Sides {
    Mask8 above = ~Mask8{}, below = ~Mask8{}, shared = ~Mask8{};
    void add(Vec8f product, Vec8f error, Mask8 is_shared) {
        above &= is_shared | (product > error);
        below &= is_shared | (product < -error);
        shared &= is_shared;
    }
    Mask8 parted() const { return (above | below) & ~shared; }
};

// Lanes of b that the plane of a's face or their own may not part from it.
uint32_t unparted(const EightFaces& a, uint32_t lane, const EightFaces& b) {
    const std::array<uint32_t, 3> vertex{a.vertex[0][lane], a.vertex[1][lane], a.vertex[2][lane]};
    Sides of_a, of_b;
    std::array<std::array<Mask8, 3>, 3> same;  // corner of b, corner of a
    for (size_t c = 0; c < 3; ++c)
        for (size_t k = 0; k < 3; ++k) same[c][k] = equals(b.vertex[c], vertex[k]);
    const EightPoints normal = lane_of(a.normal, lane), origin = lane_of(a.corner[0], lane);
    const Vec8f error = lanes_of(a.error[lane]), tiny = lanes_of(kUnderflow);
    for (size_t c = 0; c < 3; ++c) {
        const EightPoints to = b.corner[c] - origin, from = lane_of(a.corner[c], lane) - b.corner[0];
        of_a.add(dot(normal, to), error * taxicab(to) + tiny, same[c][0] | same[c][1] | same[c][2]);
        of_b.add(dot(b.normal, from), b.error * taxicab(from) + tiny, same[0][c] | same[1][c] | same[2][c]);
    }
    return mask_bits(~(of_a.parted() | of_b.parted()));
}

// Lanes of b whose boxes meet a box.
uint32_t boxes_meet(const EightPoints& low, const EightPoints& high, const EightFaces& b) {
    return mask_bits((low.x <= b.high.x) & (b.low.x <= high.x) & (low.y <= b.high.y) & (b.low.y <= high.y) & (low.z <= b.high.z) &
                     (b.low.z <= high.z));
}
uint32_t boxes_meet(const FaceBox& box, const EightFaces& b) {
    const auto spread = [](const std::array<float, 4>& p) { return EightPoints{lanes_of(p[0]), lanes_of(p[1]), lanes_of(p[2])}; };
    return boxes_meet(spread(box.low), spread(box.high), b);
}

Corners corners_at(const Triangle& t, const Float4* position) {
    const auto at = [&](uint32_t v) { return Vec3d(position[v].x, position[v].y, position[v].z); };
    return {at(t[0]), at(t[1]), at(t[2])};
}

bool cross_exactly(const Triangle& t, const Triangle& u, const Float4* position) {
    const Corners a = corners_at(t, position), b = corners_at(u, position);
    return meet_faces(t, a, u, b) == Meeting::kCrossing && !are_collinear(a[0], a[1], a[2]) && !are_collinear(b[0], b[1], b[2]);
}

struct LeafSearch {
    std::span<const Triangle> triangle;
    const Float4* position;
    const CrossingFacesScratch& tree;
    uint32_t leaf;
    std::vector<std::array<uint32_t, 2>>* pairs = nullptr;  // takes each pair
    uint32_t tests = 0, crossings = 0;

    void meet(uint32_t other) {
        const EightFaces &a = tree.leaf[leaf], &b = tree.leaf[other];
        uint32_t lanes = boxes_meet(tree.level[0][other], a);
        const uint32_t others = boxes_meet(tree.level[0][leaf], b);
        for (; lanes != 0; lanes &= lanes - 1) {
            const auto lane = static_cast<uint32_t>(std::countr_zero(lanes));
            uint32_t near = others & (leaf == other ? ~1u << lane : ~0u);
            if (near == 0) return;
            near &= boxes_meet(lane_of(a.low, lane), lane_of(a.high, lane), b);
            if (near == 0) continue;
            near &= unparted(a, lane, b);
            for (; near != 0 && tests < kMostExactTests; near &= near - 1, ++tests) {
                const uint32_t face = kLanes * other + static_cast<uint32_t>(std::countr_zero(near));
                if (!cross_exactly(triangle[kLanes * leaf + lane], triangle[face], position)) continue;
                ++crossings;
                if (pairs) pairs->push_back({kLanes * leaf + lane, face});
            }
        }
    }

    // Meets this leaf with itself and those after it.
    void run() {
        struct Node {
            uint32_t level, index;
        };
        std::array<Node, 40> stack;  // two for each level at most
        size_t top = 0;
        const FaceBox& box = tree.level[0][leaf];
        stack[top++] = {static_cast<uint32_t>(tree.level.size() - 1), 0};
        while (top > 0 && tests < kMostExactTests) {
            const Node node = stack[--top];
            const uint32_t end = (node.index + 1) << node.level;  // of its leaves
            if (end <= leaf || !boxes_meet(box, tree.level[node.level][node.index])) continue;
            if (node.level == 0) {
                meet(node.index);
                continue;
            }
            if (const uint32_t right = 2 * node.index + 1; right < tree.level[node.level - 1].size())
                stack[top++] = {node.level - 1, right};
            stack[top++] = {node.level - 1, 2 * node.index};
        }
    }
};

}  // namespace

uint64_t count_crossing_faces(std::span<const Triangle> triangle, const Float4* position, CrossingFacesScratch& scratch) {
    if (triangle.empty()) return 0;
    build_tree(triangle, position, scratch);
    std::atomic<uint64_t> crossings = 0;
    parallel_for(static_cast<uint32_t>(scratch.leaf.size()), kGrain, [&](uint32_t begin, uint32_t end) {
        uint64_t found = 0;
        for (uint32_t i = begin; i < end; ++i) {
            LeafSearch search{triangle, position, scratch, i};
            search.run();
            found += search.crossings;
        }
        crossings.fetch_add(found, std::memory_order_relaxed);
    });
    return crossings;
}

void find_crossing_pairs(std::span<const Triangle> triangle, const Float4* position, CrossingFacesScratch& scratch,
                         std::vector<std::array<uint32_t, 2>>& pairs) {
    pairs.clear();
    if (triangle.empty()) return;
    build_tree(triangle, position, scratch);
    for (uint32_t leaf = 0; leaf < scratch.leaf.size(); ++leaf) LeafSearch{triangle, position, scratch, leaf, &pairs}.run();
}

void find_crossing_faces(std::span<const Triangle> triangle, const Float4* position, CrossingFacesScratch& scratch,
                         std::vector<uint32_t>& faces) {
    find_crossing_pairs(triangle, position, scratch, scratch.pairs);
    faces.clear();
    for (const auto& [a, b] : scratch.pairs) faces.push_back(a), faces.push_back(b);
    std::sort(faces.begin(), faces.end());
    faces.erase(std::unique(faces.begin(), faces.end()), faces.end());
}

}  // namespace trocar
