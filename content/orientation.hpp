#pragma once
#include "components/mesh.hpp"
#include "engine/edge_table.hpp"
namespace trocar {

// What happened to the winding of the faces.
struct OrientationReport {
    uint32_t faces_turned = 0;   // to agree with their neighbours
    uint32_t unorientable = 0;   // patches that cannot agree (a Moebius band); left as they were
    uint32_t pieces_turned = 0;  // closed pieces that were inside out
    uint32_t cavities = 0;       // closed pieces that stay inside out: hollows of the piece around them
};

// Makes faces agree across every edge that exactly two of them share; a patch turns its minority (on a tie, the
// faces that disagree with its lowest). Texture coordinates follow.
OrientationReport agree_orientation(Mesh& mesh, const EdgeTable& table);

// Which closed pieces of a mesh point the wrong way, and how the rest nests.
struct PieceTurns {
    std::vector<uint8_t> inside_out;  // per face: 1 = it belongs to a piece that points the wrong way
    uint32_t pieces = 0;              // of those
    uint32_t cavities = 0;            // pieces that rightly point inward
    uint32_t doubly_inside = 0;       // outward pieces that lie in what is inside already: winding number 2 and more
};

// Decides which closed pieces point the wrong way. A piece here is what hangs together across two-face edges and is
// closed by itself; patches that only together close around non-manifold edges are one. A piece inside no other must
// have a positive volume. A piece inside another keeps its direction relative to the one around it (a hollow stays a
// hollow when both were inside out), unless that would make the winding number inside it negative. Open and flat
// pieces are left alone.
PieceTurns find_inside_out_pieces(const Mesh& mesh, const EdgeTable& table);

// Swaps two corners of a face, and their texture coordinates.
void turn_face(Mesh& mesh, uint32_t face);

}  // namespace trocar
