#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar {

// Two-step smoothing: `lambda` shrinks towards the neighbours' mean, `mu` inflates back, so that bumps shorter than the
// pass band go and the volume stays. With these values the pass band ends at 0.1 of the highest frequency.
struct TaubinParams {
    uint32_t rounds = 10;
    double lambda = 0.5;
    double mu = -0.526;
};

// Smooths the vertices of a surface with equal weights for all neighbours; the triangles stay. A neighbour along a rim
// counts half. Vertices of no triangle stay. Load-time code: allocates. Taubin, "A signal processing approach to
// fair surface design" (1995), section 3.
void smooth_taubin(const TaubinParams& params, std::span<const Triangle> triangles, std::span<Vec3d> position);

// Moves every vertex along its normal by one common distance, so that the closed surface encloses `volume`: Newton's
// method on that distance, three steps. The normal is the volume's gradient, the sum of the area vectors around the
// vertex. Meant for a few per cent at most; the distance is returned.
double restore_volume(double volume, std::span<const Triangle> triangles, std::span<Vec3d> position);

}  // namespace trocar
