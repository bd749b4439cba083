#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// A prototype filled with tetrahedra. Its nodes are the vertices of its surface (rows of Meshes), then the inner ones:
// whatever works on a surface sees the first particles of a solid. Without tetrahedra it is a shell. With a skin no vertex
// is a node: the surface rides on the tetrahedra, its particles (inverse mass 0, padded to 16) come before those of the
// nodes and hold no state: whoever moves the nodes writes them anew.
struct SolidInfo {
    Range inner;          // rows of position; with a skin of all nodes
    Range tetrahedra;     // rows of corner, rest, per_rest; padded to a multiple of 16
    uint32_t count = 0;   // tetrahedra without padding
    Range slices;         // rows of slot_column, one per 16 nodes
    Range nodes;          // rows of node_volume
    Range skin;           // rows of skin_node and skin_weight, one per vertex of the surface; empty = vertices are nodes
    uint32_t varied = 0;  // 1: tetrahedra differ in stiffness, see factor
    TROCAR_FIELDS(inner, tetrahedra, count, slices, nodes, skin, varied);
};

// Constant after load. Nodes and tetrahedra are local to the prototype. Which tetrahedra meet in a node lies in SELL-16
// slices like springs: a column names one (tetrahedron, corner) of each of 16 nodes, so that a node gathers its own.
struct Solids {
    std::vector<SolidInfo> info;                  // one per prototype, up to the last solid
    std::vector<Vec3d> position;                  // m, body frame: rest positions of inner nodes
    std::array<std::vector<uint32_t>, 4> corner;  // nodes of a tetrahedron, positive volume; padding 0 0 0 0
    std::vector<float> rest;                      // m^3, six times the volume at rest; padding 0
    std::vector<float> per_rest;                  // 1 / rest; padding 0
    std::vector<float> factor;                    // as rest, up to the last varied solid: stiffness / that of the body's tissue
    std::vector<uint32_t> slot_column;  // first column of a slice; slices.count + 1 rows per prototype, at slices.first + prototype row
    std::vector<uint32_t> slot;         // 16 per column: corner * padded tetrahedra + tetrahedron; padding 4 * padded tetrahedra
    std::vector<std::array<uint32_t, 4>> skin_node;  // corners of the tetrahedron that a vertex rides on
    std::vector<std::array<double, 4>> skin_weight;  // its barycentric coordinates there: below 0 or above 1 outside
    std::vector<double> node_volume;                                   // m^3, what a node stands for: see engine/lumped_volume.hpp
    TROCAR_FIELDS(info, position, "m", corner, rest, "m^3", per_rest, "1/m^3", factor, slot_column, slot, node_volume, "m^3", skin_node, skin_weight);
};

}  // namespace trocar
