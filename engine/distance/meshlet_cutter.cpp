#include "engine/distance/meshlet_cutter.hpp"

#include <algorithm>

#include "engine/distance/box_tree.hpp"
namespace trocar {
namespace {

std::vector<FloatBox> boxes_of_triangles(const MeshView& mesh, const Vec3d& centre, double scale) {
    std::vector<FloatBox> boxes(mesh.triangle.size());
    for (uint32_t t = 0; t < boxes.size(); ++t) {
        clear(boxes[t]);
        for (const uint32_t v : mesh.triangle[t]) {
            const Vec3 x = ((mesh.position[v] - centre) * scale).cast<float>();
            for (int k = 0; k < 3; ++k) {
                boxes[t].min[k] = std::min(boxes[t].min[k], x[k]);
                boxes[t].max[k] = std::max(boxes[t].max[k], x[k]);
            }
        }
    }
    return boxes;
}

// Halves a group until it fits into 32 vertices (needed for unconnected triangles).
void cut_by_vertices(const MeshView& mesh, uint32_t begin, uint32_t end, MeshletGroups& out) {
    std::array<uint32_t, 48> seen;
    uint32_t count = 0;
    for (uint32_t i = begin; i < end; ++i)
        for (const uint32_t v : mesh.triangle[out.order[i]])
            if (std::find(seen.begin(), seen.begin() + count, v) == seen.begin() + count) seen[count++] = v;
    if (count <= 32) {
        out.groups.push_back({begin, end});
        return;
    }
    const uint32_t middle = begin + (end - begin) / 2;
    cut_by_vertices(mesh, begin, middle, out);
    cut_by_vertices(mesh, middle, end, out);
}

constexpr int kBins = 32;

float middle(const FloatBox& box, int k) { return 0.5f * (box.min[k] + box.max[k]); }

// Where to cut a set of boxes in two: binned surface-area heuristic on their middles (Wald, On fast construction of
// SAH-based bounding volume hierarchies, RT 2007). A side costs its area times the groups of 16 that it fills.
struct BoxCut {
    int axis = 0;
    uint32_t left = 0;  // boxes on the low side
};
BoxCut choose_cut(std::span<const FloatBox> boxes, std::span<const uint32_t> rows) {
    const uint32_t count = static_cast<uint32_t>(rows.size());
    std::array<float, 3> low{INFINITY, INFINITY, INFINITY}, high{-INFINITY, -INFINITY, -INFINITY};
    for (const uint32_t row : rows)
        for (int k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], middle(boxes[row], k));
            high[k] = std::max(high[k], middle(boxes[row], k));
        }
    const auto groups = [&](uint32_t n) { return static_cast<float>((n + 15) / 16); };
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

// Reorders box indices so that the first cut.left are on the low side; equal middles are ordered by index.
void apply_cut(std::span<const FloatBox> boxes, BoxCut cut, std::span<uint32_t> rows) {
    const auto less = [&](uint32_t s, uint32_t t) {
        const float a = middle(boxes[s], cut.axis), b = middle(boxes[t], cut.axis);
        return a != b ? a < b : s < t;
    };
    std::nth_element(rows.begin(), rows.begin() + cut.left, rows.end(), less);
}

}  // namespace

MeshletGroups cut_meshlets(const MeshView& mesh, const Vec3d& centre, double scale) {
    const std::vector<FloatBox> boxes = boxes_of_triangles(mesh, centre, scale);
    const uint32_t count = static_cast<uint32_t>(boxes.size());
    MeshletGroups out;
    out.order.resize(count);
    for (uint32_t t = 0; t < count; ++t) out.order[t] = t;
    std::vector<std::array<uint32_t, 2>> open;
    if (count > 0) open.push_back({0, count});
    while (!open.empty()) {
        const auto [begin, end] = open.back();
        open.pop_back();
        const uint32_t size = end - begin;
        if (size <= 16) {
            cut_by_vertices(mesh, begin, end, out);
            continue;
        }
        const std::span<uint32_t> rows = std::span(out.order).subspan(begin, size);
        BoxCut cut = choose_cut(boxes, rows);
        cut.left = std::clamp((cut.left + 8) / 16 * 16, 16u, (size - 1) / 16 * 16);
        apply_cut(boxes, cut, rows);
        open.push_back({begin + cut.left, end});
        open.push_back({begin, begin + cut.left});
    }
    return out;
}

}  // namespace trocar
