#include "systems/come_and_go.hpp"
#include "systems/frame_stages.hpp"
#include "systems/haptic_input.hpp"
#include "systems/node_switching.hpp"
#include "systems/rigid_motion.hpp"
#include "systems/tear_bodies.hpp"
namespace trocar::stages {

void device_input(FrameState& f) {
    World& w = f.world;
    if (f.options.external_ticks)
        follow_devices(w.clock, w.haptics, w.live_devices, w.devices);
    else
        sample_devices(w.clock, w.paths, w.haptics, w.devices);
}
void nodes(FrameState& f) {
    World& w = f.world;
    switch_nodes(pass_seconds(w), w.nodes, w.lives, w.haptics, w.poses, w.node_state, w.sleep);
}
void rigid_motion(FrameState& f) { follow_paths(f.world.paths, pass_seconds(f.world), f.world.node_state.off, f.world.poses); }
void bodies_come_and_go(FrameState& f) {
    World& w = f.world;
    come_and_go({w.clock.tick, f.options.account_energy, w.pools, w.meshes, w.solids, w.springs, w.bodies, w.anchors, w.settings.gravity},
                f.scratch.come_and_go, {w.lives, w.poses, w.particles, w.sleep, w.energy});
}
void link(FrameState& f) {
    World& w = f.world;
    link_bodies(pass_seconds(w), w.haptics.state, {surfaces_of(w), w.solids, w.trees}, f.scratch.links, w.links, w.sleep, w.energy,
                w.report);
}
void tear(FrameState& f) {
    World& w = f.world;
    const TearPass pass{pass_seconds(w), w.settings.gravity, w.springs, w.solids, w.bodies, w.poses, w.anchors};
    cut_bodies(pass, w.particles, w.meshes, w.trees, w.tears, w.sleep, {w.torn, w.torn_springs, w.energy, w.report});
}
void torn_springs(FrameState& f) {
    World& w = f.world;
    copy_torn_springs(w.springs, w.solids, w.bodies, w.tears, w.torn, w.torn_springs);
}

}  // namespace trocar::stages
