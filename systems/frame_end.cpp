#include "systems/frame_stages.hpp"
#include "systems/picture_snapshot.hpp"
namespace trocar::stages {

void surface_normals(FrameState& f) {
    compute_surface_normals(surfaces_of(f.world), f.scratch.normals, f.world.normals, sleepers(f, kSeenByNormals));
}
void energy(FrameState& f) {
    World& w = f.world;
    measure_energy(energy_inputs(f, other_forces(f)), 0, f.scratch.energy, w.energy, sleepers(f, kSeenByEnergy));
    if (!f.energy_open) f.energy_start = w.energy.balance, f.energy_open = true;
    w.energy.balance -= f.energy_start;
}
void picture(FrameState& f) {
    World& w = f.world;
    const PictureInputs inputs{w.clock.picture, pass_seconds(w), surfaces_of(w), w.normals,
                               w.contacts,      w.penetrations,  w.haptics,      &w.tears};
    write_picture_snapshot(inputs, w.picture, sleepers(f, kSeenByPicture));
    for (uint32_t body = 0; body < w.lives.away.size(); ++body)
        if (is_away(w.lives, body)) w.picture.body[body].mesh = kNone;
    for (uint32_t body = 0; body < w.node_state.off.size(); ++body)
        if (is_off(w.node_state, body)) w.picture.body[body].mesh = kNone;
}

}  // namespace trocar::stages
