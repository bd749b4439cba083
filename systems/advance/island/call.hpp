#pragma once
#include <algorithm>
#include <limits>
#include <span>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/device.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/paths.hpp"
#include "components/report.hpp"
#include "components/springs.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
#include "engine/tissue/other_forces.hpp"
namespace trocar {

// Called around the contact response of every substep, on the thread that runs it; may be empty.
struct ResponseObserver {
    void (*begin)(void* user) = nullptr;
    void (*end)(void* user) = nullptr;
    void* user = nullptr;
};

// Called at the start of every millisecond of a call; needs substeps to be a multiple of ticks. May be empty.
struct TickHook {
    void (*run)(void* user, uint32_t ms) = nullptr;
    void* user = nullptr;
};

// One call: `ticks` ms from `tick` in `substeps` equal steps. Splitting a call into shorter ones with the
// same step gives the same bits.
struct AdvanceParams {
    uint64_t tick = 0;      // ms since the start
    uint32_t ticks = 1;     // ms
    uint32_t substeps = 1;  // of the whole call
    Vec3d gravity = Vec3d(0, 0, -9.81);
    ContactParams contact;
    bool account_energy = true;
    ResponseObserver observer;
    TickHook tick_hook;
};

// The world as an island sees it; constant during the call except for the state of the island's own bodies.
struct AdvanceInputs {
    const Meshes& meshes;
    const Springs& springs;
    const Bodies& bodies;
    const Anchors& anchors;
    const Paths& paths;
    std::span<const HandTool> tools;
    // Intended tip poses: tool t at millisecond k of the call in devices[t * device_stride + k], k = 0 ..
    // ticks. Between milliseconds a device moves and rotates at constant rates.
    std::span<const DeviceState> devices;
    uint32_t device_stride = 2;
    OtherForces other;
    // Per body, time of impact in s after the start of the call: a hand or free body stops moving there,
    // where it first touches something without a contact constraint, but keeps its velocity. Empty: no stops.
    std::span<const double> stop = {};
    std::span<const ToolJaw> jaws = {};  // of the tools
    // Per contact constraint: 1 = its overlap at the start of the call counts as none; empty: none is. See part_bodies.
    std::span<const uint8_t> left = {};
    bool leapfrog = false;               // implicit bodies take leapfrog in this call: needs_leapfrog
};
inline Stepping stepping_of(const AdvanceInputs& inputs, uint32_t body) {
    const Stepping stepping = stepping_of(inputs.bodies, body);
    return inputs.leapfrog && stepping.integrator == Integrator::kBackwardEuler ? Stepping{} : stepping;
}

// State that a call changes: only that of the island's own bodies, contact constraints and tools.
struct AdvanceState {
    Particles& particles;
    Poses& poses;
    ContactConstraints& constraints;
    std::span<ToolState> tools;
};

// Works and counts of an island over its calls; counts are merged as TROCAR_REPORT says. Work in J on its
// deformable bodies.
struct AdvanceWork {
    double work_hand = 0;
    double work_contact = 0;
    double work_damping = 0;
    double work_push = 0;
    double work_numeric = 0;
    double work_links = 0;  // energy of links and springs when they broke, negative
};
struct AdvanceResult : IslandReport, AdvanceWork {
    uint64_t active_constraints = 0;  // contact constraints that acted, summed over the substeps
};

// The read-only inputs of a call of advance_island, and the current substep.
struct AdvanceCall {
    const AdvanceParams& params;
    const AdvanceInputs& inputs;
    double dt;             // s, of a substep
    uint32_t substep = 0;  // the current one
};

// Part of the substep during which a hand or free body moves, s.
inline double moving_time(const AdvanceCall& call, uint32_t body) {
    if (call.inputs.stop.empty()) return call.dt;
    return std::clamp(call.inputs.stop[body] - call.substep * call.dt, 0.0, call.dt);
}

// Time at the start of a substep, s: a quotient of integers, hence independent of how calls are split.
double substep_time(const AdvanceParams& params, uint32_t substep);

}  // namespace trocar
