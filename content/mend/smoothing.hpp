#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar {

// Two-step smoothing: `lambda` shrinks towards the neighbours' mean, `mu` inflates, so that bumps shorter
// than the pass band vanish and the volume stays. These values end the pass band at 0.1 of the highest
// frequency.
struct TaubinParams {
    uint32_t rounds = 10;
    double lambda = 0.5;
    double mu = -0.526;
};

// Smooths the vertices of a surface with equal weights for all neighbours; triangles are unchanged. A
// neighbour along a boundary counts half. Vertices without a triangle stay. Load-time code: allocates.
// Taubin, "A signal processing approach to fair surface design" (1995), section 3.
void smooth_taubin(const TaubinParams& params, std::span<const Triangle> triangles, std::span<Vec3d> position);

// Moves every vertex along its normal by one common distance so that the closed surface encloses `volume`:
// three Newton steps on that distance. The normal is the gradient of the volume, the sum of the area vectors
// around the vertex. Meant for changes of a few per cent at most. Returns the distance.
double restore_volume(double volume, std::span<const Triangle> triangles, std::span<Vec3d> position);

}  // namespace trocar
