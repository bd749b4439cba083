#pragma once
#include <string>

#include "components/mesh.hpp"
namespace trocar {

// What a mesh is, counted as it stands (nothing is repaired: clean_mesh does that), and what contact may use it for.
struct MeshJudgement {
    uint32_t vertices = 0;  // used or not
    uint32_t triangles = 0;
    bool closed = false;              // no edge with an odd number of faces
    bool manifold = false;            // at most two faces an edge, one fan a vertex
    bool oriented = false;            // every edge with two or more faces is used equally in both directions, no piece inside out
    uint32_t components = 0;          // edge-connected pieces
    uint32_t degenerate = 0;          // faces lower than 1e-7 of their longest edge, a float's unit, or less
    uint32_t zero_area = 0;           // of those: corners exactly in a line, or a vertex named twice
    uint32_t duplicate = 0;           // faces with the corners of a lower face, in either winding
    uint32_t boundary_edges = 0;      // one face
    uint32_t non_manifold_edges = 0;  // three faces or more
    uint32_t flipped_edges = 0;       // two faces that run along it the same way
    uint32_t bow_tie_vertices = 0;    // faces around it form several fans, away from non-manifold edges
    uint32_t inside_out = 0;          // closed pieces that point the wrong way
    uint32_t doubly_inside = 0;       // outward pieces inside what is inside already
    uint32_t unused_vertices = 0;
    bool self_crossing_tested = false;
    uint32_t self_crossing = 0;  // pairs of faces that cut or overlap each other
    uint32_t self_touching = 0;  // pairs of faces that touch away from shared corners and edges
    double volume = 0;           // units^3, signed, divergence theorem; of an open surface: its cone to the origin
    double area = 0;             // units^2
    Vec3d bbox_min = Vec3d::Zero(), bbox_max = Vec3d::Zero();  // of the used vertices
    Admission admitted_as = Admission::kRefused;
    std::string reason;  // one line, why
};

// Judges a welded mesh. solid: closed, manifold at edges and vertices, oriented outward, no piece inside a solid
// part, no face without area, no two faces that meet away from shared corners and edges. winding: every edge is used
// equally in both directions and something is enclosed, but it is not solid. sheet: everything else with an area.
// refused: no face with an area, or a bad element.
MeshJudgement judge_mesh(const Mesh& mesh, bool test_self_crossing = true);

// What nothing can be computed with: a coordinate that is not finite, an index out of range, uv or triangle_material that are
// neither empty nor one row per face. Names the first such element, counted from 0; empty when there is none.
std::string find_bad_element(const Mesh& mesh);

// "solid", "winding", "sheet" or "refused".
const char* admission_name(Admission admission);

}  // namespace trocar
