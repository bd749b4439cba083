#pragma once
#include <array>
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/report.hpp"
#include "components/springs.hpp"
#include "engine/other_forces.hpp"
#include "engine/sleepers.hpp"
#include "engine/tet_forces.hpp"
namespace trocar {

// Reused memory: of one body at a time, and of measure_energy.
struct BodyEnergyScratch {
    std::vector<double> sums;
    std::vector<Float4> offset;   // half a substep back, of a body with other forces
    std::vector<float> gradient;  // 3 fields, as offset
    TetEnergyScratch tets;
};
struct EnergyScratch {
    std::vector<Energy> of_body;             // its own terms alone; one per body
    std::array<BodyEnergyScratch, 16> part;  // of bodies, measured at the same time
};

// What the energies follow from.
struct EnergyInputs {
    const Springs& springs;
    const Bodies& bodies;
    const Poses& poses;
    const Particles& particles;
    const Anchors& anchors;
    Vec3d gravity;  // m/s^2
    OtherForces other = {};
};

// Sets energy.kinetic, elastic, pressure, bending, links and gravity (J) from the state of all deformable and free bodies,
// and balance from `start` (J, their sum when the books were opened). Sums in double, fixed order; bodies in parallel, and
// large ones within. Everything is taken at the time of the velocities, half a substep before that of the offsets: there the
// leapfrog's kinetic energy needs no knowledge of the contact impulses to come. Terms of seen sleepers are taken from the
// scratch.
void measure_energy(const EnergyInputs& inputs, double start, EnergyScratch& scratch, Energy& energy, const Sleepers& sleepers = {});

// Adds the energies of one body, J: none where neither forces nor springs move it.
void add_body_energy(const EnergyInputs& inputs, uint32_t body, BodyEnergyScratch& scratch, Energy& energy);

}  // namespace trocar
