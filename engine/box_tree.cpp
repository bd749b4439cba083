#include "engine/box_tree.hpp"

#include <array>

#include "engine/check.hpp"
namespace trocar {
namespace {

constexpr int kBins = 32;

float middle(const FloatBox& box, int k) { return 0.5f * (box.min[k] + box.max[k]); }

// Node of the binary tree that the wide one is made of.
struct Branch {
    uint32_t begin = 0, end = 0;  // of the rows
    uint32_t low = 0, high = 0;   // branches below; 0 where it holds a single row
    float area = 0;
    // With j places in the wide node above: least summed cost of the wide nodes below, and how many of the places `low`
    // then gets; 0 = one place is better left empty.
    std::array<float, 9> cost{};
    std::array<uint8_t, 9> on_low{};
};

// Halves rows [begin, end) until they are single; every branch comes before those below it. Returns its box.
FloatBox halve_boxes(std::span<const FloatBox> boxes, std::span<uint32_t> rows, uint32_t begin, uint32_t end, std::vector<Branch>& branch) {
    const uint32_t at = static_cast<uint32_t>(branch.size());
    branch.push_back({begin, end});
    const uint32_t count = end - begin;
    if (count == 1) return boxes[rows[begin]];
    const std::span<uint32_t> mine = rows.subspan(begin, count);
    BoxCut cut = choose_cut(boxes, mine, 1);
    const uint32_t least = std::max(1u, count / 8);
    cut.left = std::clamp(cut.left, least, count - least);
    apply_cut(boxes, cut, mine);
    branch[at].low = at + 1;
    FloatBox box = halve_boxes(boxes, rows, begin, begin + cut.left, branch);
    branch[at].high = static_cast<uint32_t>(branch.size());
    grow(box, halve_boxes(boxes, rows, begin + cut.left, end, branch));
    branch[at].area = half_area(box);
    return box;
}

// Which branches become wide nodes, so that these cost least in sum (Ylitie, Karras & Laine, Efficient incoherent ray
// traversal on GPUs through compressed wide BVHs, HPG 2017, section 4.1): from the bottom up, the best that j places
// above can do is the best way to share them out among the two sides. A node costs its area and that of a box besides:
// who comes near enough to ask for the boxes looks into nodes without area too.
void share_places(std::vector<Branch>& branch, float area_of_box) {
    for (uint32_t at = static_cast<uint32_t>(branch.size()); at-- > 0;) {
        Branch& b = branch[at];
        if (b.low == 0) continue;  // a single row costs nothing
        const auto &low = branch[b.low].cost, &high = branch[b.high].cost;
        for (uint32_t j = 2; j <= 8; ++j) {
            for (uint32_t k = 1; k < j; ++k) {
                const float cost = low[k] + high[j - k];
                if (k == 1 || cost < b.cost[j]) b.cost[j] = cost, b.on_low[j] = static_cast<uint8_t>(k);
            }
        }
        b.cost[1] = b.area + area_of_box + b.cost[8];
        for (uint32_t j = 2; j < 8; ++j)
            if (!(b.cost[j] < b.cost[j - 1])) b.cost[j] = b.cost[j - 1], b.on_low[j] = 0;
    }
}

// Makes a wide node of branch `from` and of what lies below it; a node comes before those below it.
uint32_t make_node(const std::vector<Branch>& branch, uint32_t from, uint32_t parent, uint32_t slot, BoxTree& tree) {
    const uint32_t at = static_cast<uint32_t>(tree.node.size());
    BoxNode node{};
    node.parent = parent;
    node.slot = slot;
    for (int k = 0; k < 3; ++k) {
        std::fill_n(node.low[k], 8, INFINITY);
        std::fill_n(node.high[k], 8, -INFINITY);
    }
    std::array<std::array<uint32_t, 2>, 8> open{{{from, 8}}};  // branches and their places
    std::array<uint32_t, 8> child;
    uint32_t count = 0;
    for (uint32_t waiting = 1; waiting > 0;) {
        auto [b, places] = open[--waiting];
        while (places > 1 && branch[b].low != 0 && branch[b].on_low[places] == 0) --places;
        if (places == 1 || branch[b].low == 0) {
            child[count++] = b;
            continue;
        }
        const uint32_t k = branch[b].on_low[places];
        open[waiting++] = {branch[b].high, places - k};
        open[waiting++] = {branch[b].low, k};
    }
    node.count = count;
    tree.node.push_back(node);
    for (uint32_t i = 0; i < count; ++i) {
        const Branch& b = branch[child[i]];
        const uint32_t below = b.low == 0 ? kBoxLeaf | tree.row[b.begin] : make_node(branch, child[i], at, i, tree);
        tree.node[at].child[i] = below;
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
    std::vector<Branch> branch;
    branch.reserve(2 * count - 1);
    halve_boxes(boxes, tree.row, 0, count, branch);
    double area = 0;
    for (const FloatBox& box : boxes) area += half_area(box);
    share_places(branch, static_cast<float>(area / count));
    make_node(branch, 0, 0, 0, tree);
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
