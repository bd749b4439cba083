#include "engine/meshlet_cutter.hpp"

#include <algorithm>

#include "engine/box_tree.hpp"
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

// Halves a group until it fits into 32 vertices (soups of unconnected triangles need it).
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
        BoxCut cut = choose_cut(boxes, rows, 16);
        cut.left = std::clamp((cut.left + 8) / 16 * 16, 16u, (size - 1) / 16 * 16);
        apply_cut(boxes, cut, rows);
        open.push_back({begin + cut.left, end});
        open.push_back({begin, begin + cut.left});
    }
    return out;
}

}  // namespace trocar
