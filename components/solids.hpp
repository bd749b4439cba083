#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// A prototype filled with tetrahedra. Its nodes are the vertices of its surface (range of Meshes) followed by
// the inner nodes, so a system that works on surfaces sees the first particles of a solid. Without tetrahedra
// the prototype is a shell. With an embedded surface no vertex is a node: the surface is interpolated from
// the tetrahedra; its particles (inverse mass 0, padded to 16) precede those of the nodes and carry no state.
// Every function that moves the nodes must recompute them.
struct SolidInfo {
    Range inner;          // range of position; with an embedded surface all nodes
    Range tetrahedra;     // range of corner, rest, per_rest; padded to a multiple of 16
    uint32_t count = 0;   // number of tetrahedra without padding
    Range slices;         // range of slot_column, one per 16 nodes
    Range nodes;          // range of node_volume
    Range skin;           // range of embedding_node and embedding_weight, one per vertex of the surface; empty = vertices are nodes
    uint32_t varied = 0;  // 1: stiffness differs between tetrahedra, see factor
    TROCAR_FIELDS(inner, tetrahedra, count, slices, nodes, skin, varied);
};

// Constant after load, but for solids that instruments cut (CutSolid). Nodes and tetrahedra are local to the prototype. The tetrahedra
// around a node are listed in SELL-16 slices like springs: a column holds one (tetrahedron, corner) for each of 16 nodes, so that a node
// gathers its own forces.
struct Solids {
    std::vector<SolidInfo> info;                  // one per prototype, up to the last solid
    std::vector<Vec3d> position;                  // m, body frame: rest positions of inner nodes
    std::array<std::vector<uint32_t>, 4> corner;  // nodes of a tetrahedron, positive volume; padding 0 0 0 0
    std::vector<float> rest;                      // m^3, six times the volume at rest; padding 0
    std::vector<float> per_rest;                  // 1 / rest; padding 0
    std::vector<float> factor;                    // as rest, up to the last solid with varied stiffness: stiffness /
                                                  // stiffness of the body's tissue
    std::vector<float> metric;                    // 1/m^2, as 6 times rest, up to the last solid of a hyperelastic law; per 16 tetrahedra 6
                                                  // rows: aa, bb, cc, ab, ac, bc of the inverse of the products of the edges a, b, c
                                                  // from the first corner at rest
    std::vector<uint32_t> slot_column;            // first column of a slice; slices.count + 1 elements per prototype, at
                                                  // slices.first + prototype index
    std::vector<uint32_t> slot;                   // 16 per column: corner * padded tetrahedra + tetrahedron; padding 4 * padded tetrahedra
    std::vector<std::array<uint32_t, 4>> embedding_node;  // corners of the tetrahedron that a surface vertex is embedded in
    std::vector<std::array<double, 4>> embedding_weight;  // barycentric coordinates of the vertex there: below 0 or above 1 outside
    std::vector<double> node_volume;                      // m^3, volume lumped to a node: see engine/tissue/lumped_volume.hpp
    TROCAR_FIELDS(info, position, "m", corner, rest, "m^3", per_rest, "1/m^3", factor, metric, "1/m^2", slot_column, slot, node_volume,
                  "m^3", embedding_node, embedding_weight);
};

}  // namespace trocar
