#include "engine/box_tree.hpp"

#include <array>

#include "engine/check.hpp"
namespace trocar {
namespace {

constexpr int kBins = 32;

float middle(const FloatBox& box, int k) { return 0.5f * (box.min[k] + box.max[k]); }

struct Rows {
    uint32_t begin, end;
    float area;
};

Rows rows_of(std::span<const FloatBox> boxes, const BoxTree& tree, uint32_t begin, uint32_t end) {
    FloatBox sum;
    clear(sum);
    for (uint32_t i = begin; i < end; ++i) grow(sum, boxes[tree.row[i]]);
    return {begin, end, half_area(sum)};
}

// Cuts rows [begin, end) into up to eight parts, always the one with the largest box, and makes a node of them.
uint32_t build_node(std::span<const FloatBox> boxes, uint32_t begin, uint32_t end, uint32_t parent, uint32_t slot,
                    BoxTree& tree) {
    std::array<Rows, 8> part{Rows{begin, end, 0}};
    uint32_t count = 1;
    while (count < 8) {
        uint32_t largest = 8;
        for (uint32_t i = 0; i < count; ++i) {
            if (part[i].end - part[i].begin < 2) continue;
            if (largest == 8 || part[i].area > part[largest].area) largest = i;
        }
        if (largest == 8) break;
        const auto [first, last, area] = part[largest];
        const std::span<uint32_t> rows = std::span(tree.row).subspan(first, last - first);
        BoxCut cut = choose_cut(boxes, rows, 1);
        const uint32_t least = std::max(1u, (last - first) / 8);
        cut.left = std::clamp(cut.left, least, last - first - least);
        apply_cut(boxes, cut, rows);
        part[largest] = rows_of(boxes, tree, first, first + cut.left);
        part[count++] = rows_of(boxes, tree, first + cut.left, last);
    }
    const uint32_t at = static_cast<uint32_t>(tree.node.size());
    BoxNode node{};
    node.count = count;
    node.parent = parent;
    node.slot = slot;
    for (int k = 0; k < 3; ++k) {
        std::fill_n(node.low[k], 8, INFINITY);
        std::fill_n(node.high[k], 8, -INFINITY);
    }
    tree.node.push_back(node);
    for (uint32_t i = 0; i < count; ++i) {
        const bool leaf = part[i].end - part[i].begin == 1;
        const uint32_t child =
            leaf ? kBoxLeaf | tree.row[part[i].begin] : build_node(boxes, part[i].begin, part[i].end, at, i, tree);
        tree.node[at].child[i] = child;
    }
    return at;
}

float least(const float* v) {
    __m128 m = _mm_min_ps(_mm_load_ps(v), _mm_load_ps(v + 4));
    m = _mm_min_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_min_ss(m, _mm_movehdup_ps(m)));
}
float greatest(const float* v) {
    __m128 m = _mm_max_ps(_mm_load_ps(v), _mm_load_ps(v + 4));
    m = _mm_max_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_max_ss(m, _mm_movehdup_ps(m)));
}

}  // namespace

BoxCut choose_cut(std::span<const FloatBox> boxes, std::span<const uint32_t> rows, uint32_t grain) {
    const uint32_t count = static_cast<uint32_t>(rows.size());
    std::array<float, 3> low{INFINITY, INFINITY, INFINITY}, high{-INFINITY, -INFINITY, -INFINITY};
    for (const uint32_t row : rows)
        for (int k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], middle(boxes[row], k));
            high[k] = std::max(high[k], middle(boxes[row], k));
        }
    const auto groups = [&](uint32_t n) { return static_cast<float>((n + grain - 1) / grain); };
    float best = INFINITY;
    BoxCut cut{0, count / 2};
    for (int k = 0; k < 3; ++k) {
        if (!(high[k] > low[k])) continue;
        const float per_length = 0.9999f * kBins / (high[k] - low[k]);
        FloatBox bin[kBins];
        uint32_t in_bin[kBins] = {};
        for (FloatBox& b : bin) clear(b);
        for (const uint32_t row : rows) {
            const int b = std::clamp(static_cast<int>((middle(boxes[row], k) - low[k]) * per_length), 0, kBins - 1);
            grow(bin[b], boxes[row]);
            ++in_bin[b];
        }
        float area_right[kBins];
        FloatBox sum;
        clear(sum);
        for (int b = kBins - 1; b > 0; --b) {
            grow(sum, bin[b]);
            area_right[b] = half_area(sum);
        }
        clear(sum);
        uint32_t on_left = 0;
        for (int b = 0; b + 1 < kBins; ++b) {
            grow(sum, bin[b]);
            on_left += in_bin[b];
            if (on_left == 0 || on_left == count) continue;
            const float cost = half_area(sum) * groups(on_left) + area_right[b + 1] * groups(count - on_left);
            if (cost < best) best = cost, cut = {k, on_left};
        }
    }
    return cut;
}

void apply_cut(std::span<const FloatBox> boxes, BoxCut cut, std::span<uint32_t> rows) {
    const auto less = [&](uint32_t s, uint32_t t) {
        const float a = middle(boxes[s], cut.axis), b = middle(boxes[t], cut.axis);
        return a != b ? a < b : s < t;
    };
    std::nth_element(rows.begin(), rows.begin() + cut.left, rows.end(), less);
}

void build_box_tree(std::span<const FloatBox> boxes, BoxTree& tree) {
    const uint32_t count = static_cast<uint32_t>(boxes.size());
    tree.node.clear();
    tree.built_area = 0;
    if (count == 0) return;
    tree.node.reserve(count / 4 + 1);
    tree.row.resize(count);
    for (uint32_t i = 0; i < count; ++i) tree.row[i] = i;
    build_node(boxes, 0, count, 0, 0, tree);
    std::vector<uint32_t> depth(tree.node.size(), 1);  // the walk of a query stacks up to 7 a level, and writes 8
    for (uint32_t i = 1; i < tree.node.size(); ++i) {
        depth[i] = depth[tree.node[i].parent] + 1;
        TROCAR_ASSERT(7 * depth[i] + 8 <= kBoxStack);
    }
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
        for (int k = 0; k < 3; ++k) sum.min[k] = least(node.low[k]), sum.max[k] = greatest(node.high[k]);
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
