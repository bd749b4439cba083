#pragma once
#include "components/mesh.hpp"
namespace trocar {

struct SplitReport {
    uint32_t edges = 0;     // non-manifold edges (three faces or more) separated
    uint32_t halved = 0;    // edges halved first
    uint32_t vertices = 0;  // copies made of vertices
};

// Separates a surface where it touches itself in an edge or a vertex, after Gueziec et al., "Cutting and
// stitching" (2001). Faces around an edge with more than two stay together in pairs with solid between them;
// the others become boundaries. An edge whose pairs are
// joined around both ends cannot be parted there and is halved: its new middle is. Disconnected fans around a vertex each get a vertex of
// their own. Each copy of such a vertex moves by the fraction `apart` (0..1) towards the mean of its neighbours, so that the parts no
// longer touch. Afterwards no edge has more than two faces and no vertex more than one fan.
SplitReport split_fans(Mesh& mesh, double apart);

}  // namespace trocar
