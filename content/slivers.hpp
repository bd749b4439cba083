#pragma once
#include "components/mesh.hpp"
namespace trocar {

struct SliverReport {
    uint32_t collapsed = 0;  // needles: their short edge became a vertex, two faces fewer
    uint32_t flipped = 0;    // caps: their long edge was turned
    uint32_t left = 0;
};

// Removes faces lower than `height` of their longest edge from a manifold surface without opening it or making an edge
// of three faces: a face with a short edge loses it (where the link condition of Dey et al., "Topology preserving edge
// contraction" (1999) holds), a flat corner over a long edge is turned into the neighbour's. Nothing moves farther than
// `height` of an edge of the face.
SliverReport remove_slivers(Mesh& mesh, double height);

}  // namespace trocar
