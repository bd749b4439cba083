#include "engine/geometry/edge_table.hpp"

#include <algorithm>

#include "engine/base/check.hpp"
#include "engine/base/disjoint_sets.hpp"
namespace trocar {

EdgeTable make_edge_table(std::span<const Triangle> triangles, uint32_t vertices) {
    TROCAR_ASSERT(triangles.size() < kNone / 3);
    std::vector<uint32_t> first(vertices + 1, 0);
    std::vector<uint64_t> packed(3 * triangles.size());  // higher vertex << 32 | half-edge
    const auto each = [&](auto&& visit) {
        for (uint32_t t = 0; t < triangles.size(); ++t) {
            for (uint32_t k = 0; k < 3; ++k) {
                const uint32_t a = triangles[t][k], b = triangles[t][k == 2 ? 0 : k + 1];
                visit(std::min(a, b), uint64_t{std::max(a, b)} << 32 | (3 * t + k));
            }
        }
    };
    // counting sort on the lower end, then a small sort per vertex
    each([&](uint32_t lower, uint64_t) { ++first[lower + 1]; });
    std::partial_sum(first.begin(), first.end(), first.begin());
    std::vector<uint32_t> fill(first.begin(), first.end() - 1);
    each([&](uint32_t lower, uint64_t key) { packed[fill[lower]++] = key; });

    EdgeTable table;
    table.edge.reserve(packed.size() / 2 + 1);
    table.first.reserve(packed.size() / 2 + 2);
    table.half_edge.resize(packed.size());
    for (uint32_t lower = 0; lower < vertices; ++lower) {
        std::sort(packed.begin() + first[lower], packed.begin() + first[lower + 1]);
        for (uint32_t i = first[lower]; i < first[lower + 1]; ++i) {
            const uint32_t higher = static_cast<uint32_t>(packed[i] >> 32);
            if (i == first[lower] || higher != packed[i - 1] >> 32) {
                TROCAR_ASSERT(lower != higher);
                table.edge.push_back({lower, higher});
                table.first.push_back(i);
            }
            table.half_edge[i] = static_cast<uint32_t>(packed[i]);
        }
    }
    table.first.push_back(static_cast<uint32_t>(packed.size()));
    return table;
}

uint32_t number_pieces(const EdgeTable& table, uint32_t triangles, std::vector<uint32_t>& piece_of_triangle) {
    piece_of_triangle = make_sets(triangles);
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        const auto users = table.users(e);
        for (const uint32_t h : users) join_sets(piece_of_triangle, users[0] / 3, h / 3);
    }
    for (uint32_t t = 0; t < triangles; ++t) piece_of_triangle[t] = find_set(piece_of_triangle, t);
    uint32_t pieces = 0;
    for (uint32_t t = 0; t < triangles; ++t) {
        // the lowest triangle of a piece comes first, so its element already contains the piece's number
        piece_of_triangle[t] = piece_of_triangle[t] == t ? pieces++ : piece_of_triangle[piece_of_triangle[t]];
    }
    return pieces;
}

}  // namespace trocar
