#include "engine/keyframe_path.hpp"
#include "systems/come_and_go.hpp"
#include "systems/device_input.hpp"
#include "systems/frame_stages.hpp"
#include "systems/haptic_device.hpp"
#include "systems/node_switching.hpp"
#include "systems/rigid_motion.hpp"
#include "systems/tear_bodies.hpp"
namespace trocar::stages {
namespace {

// Live: where a device will be a pass from now. Without this what is simulated lags behind the hand by a pass: 1.3 mm and
// 0.8 N at 40 mm/s and 30 Hz. A hand that stops is overshot by no more than kMostAhead.
Vec3d ahead(const DeviceState& device, double seconds) {
    constexpr double kMostAhead = 2e-3;  // m
    const Vec3d way = seconds * device.velocity;
    const double length = way.norm();
    return device.position + (length > kMostAhead ? kMostAhead / length : 1.0) * way;
}

// Live: what the haptic thread saw last, gone on with, reached evenly over the pass from where that led in the pass before.
void follow_live_devices(FrameState& f) {
    World& w = f.world;
    const size_t tools = w.haptics.tool.size(), per_tool = w.clock.period + 1;
    const double pass = 1.0 / w.clock.contact_rate;
    f.scratch.device.resize(tools * per_tool);
    for (size_t t = 0; t < tools; ++t) {
        const DeviceState to = foretold(w.haptics.state[t]);
        const DeviceState from = f.scratch.live_device_known ? f.scratch.live_device[t] : to;
        const Vec3d start = ahead(from, pass), way = ahead(to, pass) - start;
        for (size_t ms = 0; ms < per_tool; ++ms) {
            DeviceState& device = f.scratch.device[t * per_tool + ms];
            const double share = static_cast<double>(ms) / static_cast<double>(per_tool - 1);
            device = to;
            device.position = start + share * way;
            device.grip = from.grip + share * (to.grip - from.grip);
            const Vec3d turn = rotation_vector(from.orientation, to.orientation);
            device.orientation = normalized(multiply(from_rotation_vector(share * turn), from.orientation));
        }
        f.scratch.live_device[t] = to;
    }
    f.scratch.live_device_known = true;
}

}  // namespace

// Where every device will be at each millisecond of the pass; the first is now.
void device_input(FrameState& f) {
    World& w = f.world;
    for (ToolState& state : w.haptics.state) state.contact_impulse = state.contact_moment = Vec3d::Zero(), state.grip_moment = 0;
    if (f.options.external_ticks) {
        follow_live_devices(f);
        return;
    }
    std::array<Device, kMaxTools> device;
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) device[t] = device_of(w.haptics, w.paths, w.haptics.tool[t]);
    read_devices(std::span(device).first(w.haptics.tool.size()), w.clock.tick, w.clock.period, f.scratch.intended);
    const size_t per_tool = w.clock.period + 1;
    f.scratch.device.resize(f.scratch.intended.size());
    for (size_t t = 0; t < w.haptics.tool.size(); ++t) {
        predict_tool(w.haptics.tool[t], HapticParams{}.dt, w.haptics.state[t],
                     std::span(f.scratch.intended).subspan(t * per_tool, per_tool),
                     std::span(f.scratch.device).subspan(t * per_tool, per_tool));
        // before the first tick nothing was accepted yet
        if (!w.haptics.state[t].device_valid) w.haptics.state[t].device = f.scratch.device[t * (w.clock.period + 1)];
    }
}
void nodes(FrameState& f) {
    World& w = f.world;
    switch_nodes(pass_seconds(w), w.nodes, w.lives, w.haptics, w.poses, w.node_state, w.sleep);
}
void rigid_motion(FrameState& f) { follow_paths(f.world.paths, pass_seconds(f.world), f.world.node_state.off, f.world.poses); }
void link(FrameState& f) {
    World& w = f.world;
    link_bodies(pass_seconds(w), w.haptics.state, {surfaces_of(w), w.solids, w.trees}, f.scratch.links, w.links, w.sleep, w.energy,
                w.report);
}
void tear(FrameState& f) {
    World& w = f.world;
    const TearPass pass{pass_seconds(w), w.settings.gravity, w.springs, w.solids, w.bodies, w.poses, w.anchors};
    cut_bodies(pass, w.particles, w.meshes, w.trees, w.tears, w.sleep, {w.torn, w.torn_springs, w.energy, w.report});
    copy_torn_springs(w.springs, w.solids, w.bodies, w.tears, w.torn, w.torn_springs);
}
// Those whose life is over leave, those who are due come; a slot that becomes free in this pass is given away in the next.
void come_and_go(FrameState& f) {
    World& w = f.world;
    std::vector<uint32_t>& leaving = f.scratch.leaving;
    const EnergyInputs inputs = energy_inputs(f, {&w.solids});
    const auto energies = [&] {
        Energy sum;
        for (const uint32_t body : leaving) add_body_energy(inputs, body, f.scratch.energy.part[0], sum);
        return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity;
    };
    find_leaving(w.pools, w.lives, w.clock.tick, leaving);
    let_come(w.pools, w.clock.tick, w.lives, w.sleep);
    const double before = energies();
    send_away(w.meshes, w.solids, w.bodies, w.pools, leaving, w.lives, w.poses, w.particles, w.sleep);
    if (f.options.account_energy) w.energy.work_numeric += energies() - before;
    for (const uint32_t body : leaving)
        if (body < f.scratch.sleeps.size()) f.scratch.sleeps[body] = 0;
}
// Empty slots of a pool lie still and are nobody.
void count_out_away(World& w) {
    for (uint32_t b = 0; b < w.lives.away.size(); ++b) {
        if (!is_away(w.lives, b) || !(is_deformable(w.bodies, b) || w.bodies.motion[b] == Motion::kFree)) continue;
        --(is_asleep(w.sleep, b) ? w.report.asleep_bodies : w.report.awake_bodies);
    }
}
// Bodies that nobody moves and nothing comes near are left alone until the next pass.
void sleep(FrameState& f) {
    World& w = f.world;
    f.scratch.moving.assign(w.bodies.mesh.size(), 0);
    const double now = pass_seconds(w);
    for (size_t p = 0; p < w.paths.body.size(); ++p) {
        if (w.paths.body[p] == kNone || w.paths.keys[p].count == 0) continue;
        f.scratch.moving[w.paths.body[p]] = now <= w.paths.key[w.paths.keys[p].end() - 1].time + 2 * period_seconds(w);
    }
    for (const auto& drive : w.nodes.drive) f.scratch.moving[drive.body] = 1;
    const SleepPass pass{w.settings, w.clock.period, w.bodies, f.scratch.moving, linked_bodies(f)};
    fall_asleep_and_wake(pass, f.scratch.sleep, w.sleep, w.particles, w.poses, w.pairs, w.energy, w.report);
    count_out_away(w);
    number_sleeps(f);
}

}  // namespace trocar::stages
