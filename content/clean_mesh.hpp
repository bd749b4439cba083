#pragma once
#include <string>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

struct CleanParams {
    double weld_tolerance = 0;  // of the diagonal of the box; 0 = only vertices at the very same place
};

// Everything clean_mesh changed or had to leave, counted.
struct CleanReport {
    uint32_t vertices_before = 0, vertices_after = 0;
    uint32_t triangles_before = 0, triangles_after = 0;
    bool refused = false;               // a bad element (find_bad_element): nothing was changed
    uint32_t welded_vertices = 0;       // joined to a lower vertex
    double weld_distance = 0;           // m, farthest that a corner moved by welding
    uint32_t repeated_index_faces = 0;  // dropped: name a vertex twice
    uint32_t duplicate_faces = 0;       // dropped: same corners, same winding as a lower face
    uint32_t duplicates_kept = 0;       // dropping them would open the surface
    uint32_t opposite_faces = 0;        // same corners as a lower face, other winding, dropped: they tore the surface
    uint32_t opposite_kept = 0;         // the same, kept: dropping them would open the surface
    uint32_t zero_area_faces = 0;       // dropped: corners in a line
    uint32_t zero_area_kept = 0;        // dropping them would open the surface
    uint32_t faces_turned = 0;          // to agree with their neighbours
    uint32_t unorientable_patches = 0;  // cannot agree (Moebius band); left as they were
    uint32_t pieces_turned = 0;         // closed pieces that were inside out
    uint32_t cavities = 0;              // closed pieces left inside out: hollows
    uint32_t unused_vertices = 0;       // dropped
};

// Joins vertices nearer than tolerance (units of the mesh; 0 = equal coordinates), each to the lowest earlier vertex
// that stands; those that stand are farther apart than the tolerance and do not move. Faces are renumbered, vertices
// stay (unused). Returns how many were joined. Needs finite coordinates.
uint32_t weld_vertices(Mesh& mesh, double tolerance);

// Drops the faces marked with 1; texture coordinates and material rows follow. Returns how many went.
uint32_t drop_faces(Mesh& mesh, const std::vector<uint8_t>& dropped);

// Drops vertices that no triangle names; the order of the rest stays. Materials and texture coordinates are of triangles.
void drop_unused_vertices(Mesh& mesh);

// Makes a mesh fit for contact without moving a vertex beyond the weld tolerance: welds, drops repeated and doubled
// faces, drops faces without area where the surface stays as closed as it was (slivers stay), turns faces to agree and
// closed pieces outward (hollows inward), drops unused vertices. Order is kept. A mesh with a bad element
// (find_bad_element in content/admission.hpp) is returned as it came.
CleanReport clean_mesh(Mesh& mesh, const CleanParams& params);

// Only turns faces to agree and closed pieces outward (hollows inward), as clean_mesh does: no face goes, so rows stay.
CleanReport orient_mesh(Mesh& mesh);

// The changes one by one, "12 vertices welded"; empty when there were none.
std::vector<std::string> list_cleaning(const CleanReport& report);

// The changes as one line, "12 vertices welded, 3 faces turned"; empty when there were none.
std::string describe_cleaning(const CleanReport& report);

}  // namespace trocar
