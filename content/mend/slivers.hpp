#pragma once
#include "components/mesh.hpp"
namespace trocar {

struct SliverReport {
    uint32_t collapsed = 0;  // needles: the short edge collapsed to a vertex, two faces fewer
    uint32_t flipped = 0;    // caps: the long edge was flipped
    uint32_t left = 0;
};

// Removes faces lower than `height` times their longest edge from a manifold surface, without opening it or
// creating an edge with three faces. A face with a short edge has it collapsed (if the link condition of Dey
// et al., "Topology preserving edge contraction" (1999) holds); a flat corner opposite a long edge has that
// edge flipped. No point moves farther than `height` times an edge of the face.
SliverReport remove_slivers(Mesh& mesh, double height);

}  // namespace trocar
