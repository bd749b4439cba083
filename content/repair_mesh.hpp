#pragma once
#include <string>
#include <vector>

#include "content/admission.hpp"
#include "content/hole_filling.hpp"
namespace trocar {

struct RepairParams {
    double weld_tolerance = 1e-6;  // of the diagonal of the box
    double sliver_height = 1e-4;   // faces lower than this of their longest edge go
    HoleLimits holes;
    uint32_t rounds = 10;      // of cutting out faces that cross and closing the hole
    double most_lost = 0.2;    // of the area, by cutting out; more is no repair
    double most_beside = 0.4;  // of the area, in pieces beside the largest; more is no debris, nor a part of an instrument's hinge
};

// Everything that was done, and what came of it.
struct RepairReport {
    std::vector<std::string> done;  // one line each, with counts
    MeshJudgement before, after;
    bool solid = false;
    std::string reason;  // why it is not
};

// Makes one closed, manifold, outward surface without self-crossings of a dirty one, changing as little as it can:
// welds, drops repeated, doubled and flat faces, turns faces to agree, takes apart what touches itself in edges and
// vertices, keeps the piece of the largest area, fills small holes, removes slivers; faces that cross are cut out with
// a ring that grows and the hole is filled again (Attene, "A lightweight approach to repairing digitized polygon
// meshes", 2010). Ends as soon as the surface is solid. A sound mesh comes back as it is.
RepairReport repair_mesh(Mesh& mesh, const RepairParams& params);

}  // namespace trocar
