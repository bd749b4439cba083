#pragma once
#include <array>
#include <vector>

#include "components/report.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/tissue/body_energy.hpp"
namespace trocar {

// Reused memory.
struct EnergyScratch {
    std::vector<Energy> of_body;             // energy of each body alone
    std::array<BodyEnergyScratch, 16> part;  // for bodies measured in parallel
};

// Sets energy.kinetic, elastic, pressure, bending, links and gravity (J) from the state of all deformable and free
// bodies, and balance from `start`, which is initialised if not known yet. Sums in double, fixed order; bodies in
// parallel, and large ones within. All terms are taken at the time of the velocities, half a substep before that of
// the offsets: there the leapfrog's kinetic energy does not depend on contact impulses still to be found. Terms of
// sleeping bodies are reused from the scratch.
void measure_energy(const EnergyInputs& inputs, EnergyStart& start, EnergyScratch& scratch, Energy& energy,
                    const SleepingBodies& sleeping_bodies = {});

}  // namespace trocar
