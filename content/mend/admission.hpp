#pragma once
#include <string>

#include "components/mesh.hpp"
namespace trocar {

// Properties of a mesh, measured without repairing it (clean_mesh repairs), and what contact may use it for.
struct MeshJudgement {
    uint32_t vertices = 0;  // used or not
    uint32_t triangles = 0;
    bool closed = false;              // no edge with an odd number of faces
    bool manifold = false;            // at most two faces per edge, one fan per vertex
    bool oriented = false;            // no flipped edges where two or more faces meet; no piece inside out
    uint32_t components = 0;          // number of edge-connected pieces
    uint32_t degenerate = 0;          // faces no higher than 1e-7 of their longest edge (float's epsilon)
    uint32_t zero_area = 0;           // of these: corners exactly collinear, or a repeated vertex
    uint32_t duplicate = 0;           // faces with the corners of a face of lower index, any winding
    uint32_t boundary_edges = 0;      // edges with one face
    uint32_t non_manifold_edges = 0;  // edges with three faces or more
    uint32_t flipped_edges = 0;       // edges that two faces use in the same direction
    uint32_t bow_tie_vertices = 0;    // vertices with several fans of faces, away from non-manifold edges
    uint32_t inside_out = 0;          // closed pieces with inward orientation
    uint32_t doubly_inside = 0;       // outward pieces inside a region that is already inside
    uint32_t unused_vertices = 0;
    bool self_crossing_tested = false;
    uint32_t self_crossing = 0;                                // pairs of faces that intersect or overlap
    uint32_t self_touching = 0;                                // pairs of faces that only touch
    double volume = 0;                                         // units^3, signed; open: cone to the origin
    double area = 0;                                           // units^2
    Vec3d bbox_min = Vec3d::Zero(), bbox_max = Vec3d::Zero();  // bounds of the used vertices
    Admission admitted_as = Admission::kRefused;
    std::string reason;  // one line
};

// Judges a welded mesh. solid: closed, manifold at edges and vertices, oriented outward, no piece inside a
// solid part, no zero-area face, no two faces meeting away from shared corners and edges. winding: not solid,
// but every edge is used equally often in both directions and the mesh encloses a volume. sheet: everything
// else with an area. refused: no face with an area, or an invalid element.
MeshJudgement judge_mesh(const Mesh& mesh, bool test_self_crossing = true);

// Contact finds candidates in float, whose squares end above.
inline constexpr double kFarthestCoordinate = 1e30;

// Names the first invalid element, counted from 0: a coordinate that is not finite or beyond that, an index out of
// range, or uv or triangle_material that are neither empty nor one per face. Empty if there is none.
std::string find_bad_element(const Mesh& mesh);

// "solid", "winding", "sheet" or "refused".
const char* admission_name(Admission admission);

}  // namespace trocar
