#pragma once
#include <array>
#include <vector>

#include "components/report.hpp"
#include "engine/body_energy.hpp"
#include "engine/sleepers.hpp"
namespace trocar {

// Reused memory.
struct EnergyScratch {
    std::vector<Energy> of_body;             // its own terms alone; one per body
    std::array<BodyEnergyScratch, 16> part;  // of bodies, measured at the same time
};

// Sets energy.kinetic, elastic, pressure, bending, links and gravity (J) from the state of all deformable and free bodies,
// and balance from `start`, which they open where it is not known yet. Sums in double, fixed order; bodies in parallel, and
// large ones within. Everything is taken at the time of the velocities, half a substep before that of the offsets: there the
// leapfrog's kinetic energy needs no knowledge of the contact impulses to come. Terms of seen sleepers are taken from the
// scratch.
void measure_energy(const EnergyInputs& inputs, EnergyStart& start, EnergyScratch& scratch, Energy& energy, const Sleepers& sleepers = {});

}  // namespace trocar
