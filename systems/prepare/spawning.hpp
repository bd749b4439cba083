#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/report.hpp"
#include "components/solids.hpp"
#include "components/spawning.hpp"
#include "engine/tissue/body_energy.hpp"
namespace trocar {

struct ComeAndGoScratch {
    std::vector<uint32_t> leaving;  // bodies whose lifetime ends in this pass
    BodyEnergyScratch energy;
};

struct ComeAndGoInputs {
    uint64_t tick = 0;  // ms, at the start of the pass
    bool account_energy = true;
    const Pools& pools;
    const Meshes& meshes;
    const Solids& solids;
    const Springs& springs;
    const Bodies& bodies;
    const Anchors& anchors;
    Vec3d gravity;  // m/s^2
};

struct ComeAndGoState {
    SpawnState& spawning;
    Poses& poses;
    Particles& particles;
    Sleep& sleep;
    Energy& energy;
};

// Removes bodies whose lifetime has ended, then spawns those that are due, each in the lowest free slot of its pool,
// or in a later pass when no slot is free. A free slot holds a sleeping body at its rest position. A slot freed in
// this pass is reused in the next one at the earliest, with its generation raised. The energy of removed bodies
// goes to work_numeric.
void spawning(const ComeAndGoInputs& in, ComeAndGoScratch& scratch, ComeAndGoState state);

}  // namespace trocar
