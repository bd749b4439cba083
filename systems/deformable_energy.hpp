#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/report.hpp"
#include "components/springs.hpp"
namespace trocar {

// Reused memory of measure_energy.
struct EnergyScratch {
    std::vector<double> sums;
};

// Sets energy.kinetic, elastic and gravity (J) from the state of all deformable and free bodies, and balance from `start`
// (kinetic + elastic + gravity when the books were opened). Sums in double, fixed
// order; large bodies in parallel. Everything is taken at the time of the
// velocities, half a substep before that of the offsets: there the leapfrog's kinetic energy needs no knowledge of the
// contact impulses to come.
void measure_energy(const Springs& springs, const Bodies& bodies, const Poses& poses, const Particles& particles,
                    const Anchors& anchors, const Vec3d& gravity, double start, EnergyScratch& scratch, Energy& energy);

// Linear momentum (kg m/s) and angular momentum about the world origin (kg m^2/s) of one deformable or free body.
struct Momentum {
    Vec3d linear = Vec3d::Zero();
    Vec3d angular = Vec3d::Zero();
};
Momentum measure_momentum(const Bodies& bodies, const Poses& poses, const Particles& particles, uint32_t body);

}  // namespace trocar
