#pragma once
#include "components/mesh.hpp"
namespace trocar {

struct SplitReport {
    uint32_t edges = 0;     // with three faces or more, taken apart
    uint32_t vertices = 0;  // copies made
};

// Takes a surface apart where it touches itself in an edge or a vertex, after Gueziec et al., "Cutting and stitching"
// (2001): faces around an edge with more than two stay together in pairs that have solid between them, the rest become
// rims; faces around a vertex that do not hang together get vertices of their own. Every part of such a vertex moves by
// `apart` (0..1) of the way to the middle of its neighbours, so that the parts no longer touch. After that no edge has
// more than two faces and no vertex more than one fan.
SplitReport split_fans(Mesh& mesh, double apart);

}  // namespace trocar
