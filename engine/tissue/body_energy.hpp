#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "components/report.hpp"
#include "components/springs.hpp"
#include "engine/tissue/other_forces.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {

// Reused memory, of one body at a time.
struct BodyEnergyScratch {
    std::vector<double> sums;
    std::vector<Float4> offset;   // half a substep back, of a body with other forces
    std::vector<float> gradient;  // 3 fields, as offset
    TetEnergyScratch tets;
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

// Adds the energies of a free body, J.
void add_free_energy(const RigidMass& free, const Poses& poses, const Particles& particles, const Vec3d& gravity, Energy& energy);

// Adds the energies of one body, J: none where neither forces nor springs move it. Where instruments act (other.actions),
// what they part rings near the stable step h, and there leapfrog conserves the kinetic energy at the middle of a step plus
// V - h^2 v K v / 8 rather than V (for linear forces: v^2 M / 2 + x0 K x1 / 2, with x0 and x1 at both ends of the step): then
// potential energies are 2 V(middle) - (V(start) + V(end)) / 2, which is that, to fourth order for any V.
void add_body_energy(const EnergyInputs& inputs, uint32_t body, BodyEnergyScratch& scratch, Energy& energy);

}  // namespace trocar
