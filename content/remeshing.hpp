#pragma once
#include <functional>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

struct RemeshParams {
    uint32_t triangles = 10000;  // wanted; reached exactly (or one above) unless a collapse would harm the surface
    uint32_t rounds = 12;        // of flips and relaxation
};

// Point of the wanted surface near a given point; threads may ask at once.
using SurfaceProjection = std::function<Vec3d(const Vec3d&)>;

// Makes a closed manifold surface coarser and its triangles even: collapses the shortest edges first (link condition,
// no fold), then alternates flips towards six edges a vertex with relaxation along the surface, and ends with Delaunay
// flips. Every new place goes through `project`. Genus and components stay; unused vertices go; the order of the rest
// stays. For explicit dynamics: the shortest edges and the smallest vertex areas limit the step. After Botsch and
// Kobbelt, "A remeshing approach to multiresolution modeling" (2004), section 4.
void remesh_evenly(const RemeshParams& params, const SurfaceProjection& project, std::vector<Vec3d>& position,
                   std::vector<Triangle>& triangle);

}  // namespace trocar
