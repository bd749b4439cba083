#include "engine/distance/box_tree.hpp"

#include <array>
#include <atomic>
#include <new>

#include "engine/base/check.hpp"
#include "engine/distance/embree_device.hpp"
#include "engine/jobs/race_detector.hpp"
namespace trocar {
namespace {

// An inner node of Embree's builder, which refers to a node by its address and to a leaf by 2 * box index + 1.
struct Branch {
    uint32_t count;
    std::array<void*, 8> child;
};
bool is_leaf(const void* branch) { return (reinterpret_cast<uintptr_t>(branch) & 1) != 0; }
uint32_t row_of_leaf(const void* branch) { return static_cast<uint32_t>(reinterpret_cast<uintptr_t>(branch) >> 1); }

// The builder creates nodes on several threads.
struct Branches {
    std::vector<Branch> branch;
    std::atomic<uint32_t> used{0};
};

void* create_node(RTCThreadLocalAllocator, unsigned count, void* user) {
    Branches& made = *static_cast<Branches*>(user);
    take_over(&made);
    Branch& branch = made.branch[made.used.fetch_add(1, std::memory_order_relaxed)];
    branch.count = count;
    return &branch;
}
void set_children(void* node, void** children, unsigned count, void* user) {
    std::copy_n(children, count, static_cast<Branch*>(node)->child.begin());
    hand_over(user);
}
void set_bounds(void*, const RTCBounds**, unsigned, void*) {}  // refit_box_tree writes them
void* create_leaf(RTCThreadLocalAllocator, const RTCBuildPrimitive* primitive, size_t, void*) {
    return reinterpret_cast<void*>(2 * static_cast<uintptr_t>(primitive->primID) + 1);
}

// Embree's tree over the boxes; returns its root.
const void* build_branches(std::span<const FloatBox> boxes, Branches& made) {
    std::vector<RTCBuildPrimitive> primitives(boxes.size());
    for (uint32_t i = 0; i < boxes.size(); ++i) {
        const FloatBox& b = boxes[i];
        primitives[i] = {b.min[0], b.min[1], b.min[2], 0, b.max[0], b.max[1], b.max[2], i};
    }
    made.branch.resize(boxes.size());
    hand_over(&made);
    RTCBuildArguments build = rtcDefaultBuildArguments();
    build.maxBranchingFactor = 8;
    build.maxDepth = kBoxDepth;
    build.maxLeafSize = 1;
    build.bvh = rtcNewBVH(embree_device());
    build.primitives = primitives.data();
    build.primitiveCount = build.primitiveArrayCapacity = primitives.size();
    build.createNode = create_node, build.setNodeChildren = set_children, build.setNodeBounds = set_bounds;
    build.createLeaf = create_leaf;
    build.userPtr = &made;
    const void* root = rtcBuildBVH(&build);
    rtcReleaseBVH(build.bvh);
    take_over(&made);
    const RTCError error = rtcGetDeviceError(embree_device());
    if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
    TROCAR_ASSERT(root != nullptr && error == RTC_ERROR_NONE);
    return root;
}

// Converts a branch and its descendants, in preorder: independent of the order in which threads created them.
uint32_t add_branch(std::span<const void* const> child, uint32_t parent, uint32_t slot, BoxTree& tree) {
    const uint32_t at = static_cast<uint32_t>(tree.node.size());
    BoxNode& node = tree.node.emplace_back();
    node.parent = parent, node.slot = slot, node.count = static_cast<uint32_t>(child.size());
    for (int k = 0; k < 3; ++k) {
        std::fill_n(node.low[k], 8, INFINITY);
        std::fill_n(node.high[k], 8, -INFINITY);
    }
    for (uint32_t i = 0; i < child.size(); ++i) {
        const Branch* below = is_leaf(child[i]) ? nullptr : static_cast<const Branch*>(child[i]);
        const uint32_t index =
            below ? add_branch(std::span(below->child).first(below->count), at, i, tree) : kBoxLeaf | row_of_leaf(child[i]);
        tree.node[at].child[i] = index;
    }
    return at;
}

float least_of_eight(const float* v) {
    __m128 m = _mm_min_ps(_mm_load_ps(v), _mm_load_ps(v + 4));
    m = _mm_min_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_min_ss(m, _mm_movehdup_ps(m)));
}
float greatest_of_eight(const float* v) {
    __m128 m = _mm_max_ps(_mm_load_ps(v), _mm_load_ps(v + 4));
    m = _mm_max_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_max_ss(m, _mm_movehdup_ps(m)));
}

}  // namespace

void build_box_tree(std::span<const FloatBox> boxes, BoxTree& tree) {
    tree.node.clear();
    tree.built_area = 0;
    if (boxes.empty()) return;
    Branches made;
    const void* root = build_branches(boxes, made);
    tree.node.reserve(std::max(1u, made.used.load()));
    if (is_leaf(root))
        add_branch({&root, 1}, 0, 0, tree);
    else
        add_branch(std::span(static_cast<const Branch*>(root)->child).first(static_cast<const Branch*>(root)->count), 0, 0, tree);
    ++tree.builds;
    tree.built_area = refit_box_tree(boxes, tree);
}

double refit_box_tree(std::span<const FloatBox> boxes, BoxTree& tree) {
    double area = 0;
    for (uint32_t at = static_cast<uint32_t>(tree.node.size()); at-- > 0;) {
        BoxNode& node = tree.node[at];
        for (uint32_t i = 0; i < node.count; ++i) {
            if (node.child[i] < kBoxLeaf) continue;  // has written its own box
            const FloatBox& box = boxes[node.child[i] & ~kBoxLeaf];
            for (int k = 0; k < 3; ++k) node.low[k][i] = box.min[k], node.high[k][i] = box.max[k];
            area += half_area(box);
        }
        FloatBox sum;
        for (int k = 0; k < 3; ++k) sum.min[k] = least_of_eight(node.low[k]), sum.max[k] = greatest_of_eight(node.high[k]);
        area += half_area(sum);
        if (at == 0) break;
        BoxNode& parent = tree.node[node.parent];
        for (int k = 0; k < 3; ++k) {
            parent.low[k][node.slot] = sum.min[k];
            parent.high[k][node.slot] = sum.max[k];
        }
    }
    return area;
}

}  // namespace trocar
