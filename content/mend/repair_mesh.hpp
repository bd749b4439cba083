#pragma once
#include <string>
#include <vector>

#include "content/mend/admission.hpp"
#include "content/mend/hole_filling.hpp"
namespace trocar {

struct RepairParams {
    double weld_tolerance = 1e-6;  // of the diagonal of the box
    double sliver_height = 1e-4;   // faces lower than this fraction of their longest edge are removed
    HoleLimits holes;
    uint32_t rounds = 10;      // rounds of cutting out intersecting faces and filling the hole
    double most_lost = 0.2;    // of the area; a larger loss by cutting is not a repair
    double most_beside = 0.4;  // of the area, outside the largest piece; more is not debris
};

// Changes made, and the result.
struct RepairReport {
    std::vector<std::string> done;  // one line each, with counts
    MeshJudgement before, after;
    bool solid = false;
    std::string reason;  // why it is not solid
};

// Turns a defective mesh into one closed, manifold, outward surface without self-intersections, with as few
// changes as possible: welds; drops degenerate, duplicate and flat faces; orients faces consistently;
// separates non-manifold edges and vertices; keeps the piece of largest area; fills small holes; removes
// slivers; cuts out intersecting faces with a growing ring and fills the holes (Attene, "A lightweight
// approach to repairing digitized polygon meshes", 2010). Stops once the surface is solid; a valid mesh is
// unchanged.
RepairReport repair_mesh(Mesh& mesh, const RepairParams& params);

}  // namespace trocar
