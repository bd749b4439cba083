#pragma once
#include "components/mesh.hpp"
#include "engine/geometry/edge_table.hpp"
namespace trocar {

// Changes of the faces' winding.
struct OrientationReport {
    uint32_t faces_turned = 0;   // reversed to agree with their neighbours
    uint32_t unorientable = 0;   // patches that cannot be oriented (Moebius band); unchanged
    uint32_t pieces_turned = 0;  // closed pieces that were inside out
    uint32_t cavities = 0;       // cavities: closed pieces rightly oriented inward; unchanged
};

// Orients faces consistently across every edge shared by exactly two; each patch reverses its minority (on a
// tie, the faces that disagree with its lowest). Texture coordinates follow.
OrientationReport agree_orientation(Mesh& mesh, const EdgeTable& table);

// Which closed pieces of a mesh are inside out, and how the others nest.
struct PieceTurns {
    std::vector<uint8_t> inside_out;  // per face: 1 = its piece is inside out
    uint32_t pieces = 0;              // number of inside-out pieces
    uint32_t cavities = 0;            // pieces correctly oriented inward
    uint32_t doubly_inside = 0;       // outward pieces inside others: winding number 2 or more
};

// Finds the closed pieces that are inside out. A piece is a closed set of faces connected across two-face
// edges; patches that are closed only in combination, around non-manifold edges, count as one piece. A piece
// inside no other must have a positive volume. A piece inside another keeps its orientation relative to the
// surrounding one (a cavity stays a cavity if both were inside out), unless the winding number inside it
// would become negative. Open and flat pieces are left alone.
PieceTurns find_inside_out_pieces(const Mesh& mesh, const EdgeTable& table);

// Swaps two corners of a face and their texture coordinates.
void turn_face(Mesh& mesh, uint32_t face);

}  // namespace trocar
