#pragma once
#include <string>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

struct CleanParams {
    double weld_tolerance = 0;  // of the diagonal of the box; 0 = only identical positions
};

// Counts of everything clean_mesh changed or had to leave.
struct CleanReport {
    uint32_t vertices_before = 0, vertices_after = 0;
    uint32_t triangles_before = 0, triangles_after = 0;
    bool refused = false;               // an invalid element (find_bad_element): nothing was changed
    uint32_t welded_vertices = 0;       // merged into a vertex of lower index
    double weld_distance = 0;           // m, largest displacement of a corner by welding
    uint32_t repeated_index_faces = 0;  // dropped: a vertex occurs twice
    uint32_t duplicate_faces = 0;       // dropped: same corners and winding as a face of lower index
    uint32_t duplicates_kept = 0;       // kept: dropping them would open the surface
    uint32_t opposite_faces = 0;        // dropped: same corners as a face of lower index, opposite winding
    uint32_t opposite_kept = 0;         // such faces kept: dropping them would open the surface
    uint32_t zero_area_faces = 0;       // dropped: collinear corners
    uint32_t zero_area_kept = 0;        // kept: dropping them would open the surface
    uint32_t faces_turned = 0;          // reversed to agree with their neighbours
    uint32_t unorientable_patches = 0;  // cannot be oriented (Moebius band); unchanged
    uint32_t pieces_turned = 0;         // closed pieces that were inside out and were reversed
    uint32_t cavities = 0;              // closed pieces with inward orientation that are cavities; unchanged
    uint32_t unused_vertices = 0;       // dropped
};

// Merges vertices closer than `tolerance` (units of the mesh; 0 = equal coordinates), each into the lowest
// earlier vertex that remains; remaining vertices are farther apart than the tolerance and do not move.
// Renumbers faces, keeps the merged vertices as unused. Returns the number merged. Requires finite
// coordinates.
uint32_t weld_vertices(Mesh& mesh, double tolerance);

// Drops the faces marked with 1, with their texture coordinates and materials. Returns the number dropped.
uint32_t drop_faces(Mesh& mesh, const std::vector<uint8_t>& dropped);

// Drops vertices that no triangle uses and keeps the order of the others. Materials and texture coordinates
// belong to triangles and are unaffected.
void drop_unused_vertices(Mesh& mesh);

// Makes a mesh fit for contact without moving a vertex beyond the weld tolerance: welds, drops degenerate and
// duplicate faces, drops zero-area faces where this does not open the surface (slivers stay), orients faces
// consistently and closed pieces outward (cavities inward), drops unused vertices. Keeps the order. A mesh
// with an invalid element (find_bad_element in content/mend/admission.hpp) is returned unchanged.
CleanReport clean_mesh(Mesh& mesh, const CleanParams& params);

// Only orients faces consistently and closed pieces outward (cavities inward), as clean_mesh does. Drops no
// face, so face indices stay valid.
CleanReport orient_mesh(Mesh& mesh);

// One text per kind of change, "12 vertices welded"; empty if there were none.
std::vector<std::string> list_cleaning(const CleanReport& report);

// The changes as one line, "12 vertices welded, 3 faces turned"; empty if there were none.
std::string describe_cleaning(const CleanReport& report);

}  // namespace trocar
