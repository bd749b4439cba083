#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Every undirected edge of some triangles with its half-edges. Half-edge 3 * t + k goes from corner k of
// triangle t to the next corner.
struct EdgeTable {
    std::vector<std::array<uint32_t, 2>> edge;  // lower vertex first, ascending
    std::vector<uint32_t> first;                // edge -> range of half_edge, edge.size() + 1
    std::vector<uint32_t> half_edge;            // ascending within an edge

    std::span<const uint32_t> users(uint32_t e) const { return std::span(half_edge).subspan(first[e], first[e + 1] - first[e]); }
};

// Builds the table in linear time for meshes of bounded degree. No triangle may have a repeated vertex.
EdgeTable make_edge_table(std::span<const Triangle> triangles, uint32_t vertices);

inline uint32_t half_edge_start(std::span<const Triangle> triangles, uint32_t half_edge) { return triangles[half_edge / 3][half_edge % 3]; }

// Numbers the edge-connected pieces of a table's triangles, 0 for the piece of the lowest triangle and so on;
// returns their number.
uint32_t number_pieces(const EdgeTable& table, uint32_t triangles, std::vector<uint32_t>& piece_of_triangle);

}  // namespace trocar
