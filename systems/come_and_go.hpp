#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/lives.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/report.hpp"
#include "components/solids.hpp"
#include "engine/body_energy.hpp"
namespace trocar {

struct ComeAndGoScratch {
    std::vector<uint32_t> leaving;  // bodies whose life is over in this pass
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
    Lives& lives;
    Poses& poses;
    Particles& particles;
    Sleep& sleep;
    Energy& energy;
};

// Bodies whose life is over leave: their slots lie at their places at rest, asleep, until somebody comes; what energy they
// took with them goes to work_numeric. Those who are due come into the lowest free slot first; who finds none comes when one is
// free: a slot that becomes free in this pass is given away in the next. Their generation is that of the slot, which rose when the
// last one left.
void come_and_go(const ComeAndGoInputs& in, ComeAndGoScratch& scratch, ComeAndGoState state);

}  // namespace trocar
