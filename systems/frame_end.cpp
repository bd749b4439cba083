#include "systems/frame_stages.hpp"
#include "systems/picture_snapshot.hpp"
namespace trocar::stages {

void surface_normals(FrameState& f) {
    compute_surface_normals(surfaces_of(f.world), f.scratch.normals, f.world.normals, sleepers(f, kSeenByNormals));
}
void energy(FrameState& f) {
    World& w = f.world;
    measure_energy(energy_inputs(w), w.energy_start, f.scratch.energy, w.energy, sleepers(f, kSeenByEnergy));
}
void picture(FrameState& f) {
    World& w = f.world;
    write_picture_snapshot({w.clock.picture, pass_seconds(w), surfaces_of(w), w.normals, w.contacts, w.penetrations, w.haptics, &w.tears,
                            &w.lives, &w.node_state},
                           w.picture, sleepers(f, kSeenByPicture));
}

}  // namespace trocar::stages
