#pragma once
#include <functional>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

struct RemeshParams {
    uint32_t triangles = 10000;  // met exactly or exceeded by one, unless a collapse would damage the surface
    uint32_t rounds = 12;        // rounds of flips and relaxation
};

// Nearest point (approximately) on the target surface; called from several threads.
using SurfaceProjection = std::function<Vec3d(const Vec3d&)>;

// Coarsens a closed manifold surface with even triangles: collapses the shortest edges first (link condition,
// no folds), then alternates flips towards six edges per vertex with relaxation along the surface, and ends
// with Delaunay flips. Every new position is projected by `project`. Keeps genus and components; drops unused
// vertices; keeps the order of the others. For explicit dynamics, where the shortest edges and smallest
// vertex areas limit the step. Botsch and Kobbelt, "A remeshing approach to multiresolution modeling" (2004),
// section 4.
void remesh_evenly(const RemeshParams& params, const SurfaceProjection& project, std::vector<Vec3d>& position,
                   std::vector<Triangle>& triangle);

}  // namespace trocar
