#pragma once
#include <algorithm>
#include <cmath>
#include <random>

#include "components/clock.hpp"
#include "engine/devices/device.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/world/world.hpp"
#include "systems/frame/frame.hpp"
#include "systems/haptics/tick.hpp"
#include "systems/haptics/tool.hpp"
namespace trocar::reference {

// An arm that pokes tissue at several positions, and the energy exchanged with the device, from the commanded
// forces.

// Highest point of a body's surface within `near` (m) of a vertical line.
inline Vec3d highest_near(const World& world, uint32_t body, double x, double y, double near) {
    const MeshInfo& info = world.meshes.info[world.bodies.mesh[body]];
    Vec3d top(x, y, -1e9);
    for (uint32_t v = info.vertices.first; v < info.vertices.end(); ++v) {
        const Vec3d p = world.poses.origin[body] + world.meshes.position[v];
        if (std::hypot(p.x() - x, p.y() - y) < near && p.z() > top.z()) top.z() = p.z();
    }
    return top;
}

// Gives the first tool's hand an arm (0.2 kg, 300 N/m) that pokes `body`, which must not be rotated, from
// above for `seconds`: 1 to 2 Hz, at nine positions, with target depths of 2 to 20 mm; some pokes come to
// rest, some slide 10 mm while deep.
inline void poke_at(World& world, uint32_t body, double seconds, uint32_t seed) {
    std::mt19937 random(seed);
    const auto between = [&](double low, double high) { return low + (high - low) * (random() / 4294967296.0); };
    HandTool& tool = world.haptics.tool[0];
    tool.hand = {};
    tool.hand.mass = 0.2, tool.hand.damping = 0.5, tool.hand.stiffness = 300, tool.hand.arm_damping = 4;
    std::vector<Vec3d> position;
    for (const double x : {-0.03, 0.0, 0.03})
        for (const double y : {-0.02, 0.0, 0.02}) position.push_back(highest_near(world, body, x, y, 5e-3));
    std::vector<Keyframe> keys;
    const auto go = [&](double time, const Vec3d& to) { keys.push_back({time, to, {}, 0, 0}); };
    for (double time = 0; time < seconds;) {
        const Vec3d top = position[random() % position.size()] + Vec3d(0, 0, tool.tip_radius);
        const double period = between(0.5, 1), travel_time = between(0.15, 0.4) * period, deep = between(2e-3, 20e-3);
        const bool slides = random() % 3 == 0, rests = random() % 3 == 0;
        const Vec3d above = top + Vec3d(0, 0, 0.01), below = top - Vec3d(0, 0, deep);
        const Vec3d left = slides ? Vec3d(below + Vec3d(between(-0.01, 0.01), between(-0.01, 0.01), 0)) : below;
        const double held = rests || slides ? 0.2 * period : 0;
        go(time, above);
        go(time + 0.35 * period, above);
        go(time + 0.35 * period + travel_time, below);
        if (held > 0) go(time + 0.35 * period + travel_time + held, left);
        go(time + 0.35 * period + 2 * travel_time + held, left + Vec3d(0, 0, deep + 0.01));
        time += 0.45 * period + 2 * travel_time + held;
    }
    const uint32_t path = tool.path;
    world.paths.keys[path] = {static_cast<uint32_t>(world.paths.key.size()), static_cast<uint32_t>(keys.size())};
    world.paths.key.insert(world.paths.key.end(), keys.begin(), keys.end());
}

struct PokeEnergy {
    double given = 0;       // J, total from the hand to the device
    double least = 0;       // J, minimum of that over time
    double least_poke = 0;  // J, minimum since the start of a poke (0.1 s without a force), over all pokes
    double observer = 0;    // J, minimum of the device's own passivity observer
    double largest = 0;     // N
    uint32_t pokes = 0;
    uint64_t unlike = 0;  // passes after which the frame had commanded a different force
};

// Recomputes the first tool's ticks alongside the frame's.
struct PokeMeter {
    static constexpr uint32_t kSilence = 100;  // ticks; the tissue has recovered by then
    HandTool tool;
    Device device;  // reads from the world while it is stepped
    HapticScratch scratch;
    ToolState state;
    PokeEnergy energy;
    double since_poke = 0;       // J
    uint32_t silent = kSilence;  // ticks

    void tick(const World& w, double time) {
        const Vec3d from = state.hand.position, force = state.output.force;
        const bool placed = state.hand.placed;
        const HapticParams params = haptic_params(w.clock.contact_rate);
        const DeviceState sample = hand_sample(tool, read_device(device, time), params.dt, state.output, state.hand);
        tick_tool(params, w.local_contact[0], time, tool, {}, sample, scratch, state);
        if (!placed) return;
        const double given = -force.dot(state.hand.position - from);  // the force is held for a tick
        energy.given += given, since_poke += given;
        energy.least = std::min(energy.least, energy.given), energy.least_poke = std::min(energy.least_poke, since_poke);
        energy.largest = std::max(energy.largest, state.output.force.norm());
        const bool felt = state.output.force.squaredNorm() > 0;
        if (felt && silent >= kSilence) ++energy.pokes, since_poke = 0;
        silent = felt ? 0 : silent + 1;
    }
};

// Steps a world for `seconds` in lockstep.
inline PokeEnergy poke_energy(World world, double seconds) {
    PokeMeter meter;
    ThreadPool pool(0);
    pool.run([&] {
        Frame frame(std::move(world), {});
        const World& w = frame.world();
        meter.tool = w.haptics.tool[0];
        meter.device = device_of(w.haptics, w.paths, meter.tool);
        const auto on_pass = [](void* user, World& at) {
            for (uint64_t k = 0; k < at.clock.period; ++k)
                static_cast<PokeMeter*>(user)->tick(at, static_cast<double>(at.clock.tick + k) * 1e-3);
        };
        frame.set_contact_hook({on_pass, &meter});
        while (static_cast<double>(w.clock.tick) * 1e-3 < seconds) {
            frame.step();
            meter.energy.unlike += (w.haptics.state[0].output.force - meter.state.output.force).squaredNorm() > 0;
        }
        meter.energy.observer = w.haptics.state[0].safety.lowest_energy;
    });
    return meter.energy;
}

}  // namespace trocar::reference
