#pragma once
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/haptics.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/paths.hpp"
#include "components/report.hpp"
#include "components/springs.hpp"
#include "engine/other_forces.hpp"
#include "systems/advance_scratch.hpp"
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

// One call: `ticks` ms from `tick` in `substeps` equal steps. A call cut into shorter ones with the same step gives the
// same bits.
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

// The world as an island sees it; constant during the call but for the state of the island's own bodies.
struct AdvanceInputs {
    const Meshes& meshes;
    const Springs& springs;
    const Bodies& bodies;
    const Anchors& anchors;
    const Paths& paths;
    std::span<const HandTool> tools;
    // Where the hands hold the tips: of tool t at millisecond k of the call in devices[t * device_stride + k], k = 0 ..
    // ticks. Between milliseconds a device moves linearly and turns evenly.
    std::span<const DeviceState> devices;
    uint32_t device_stride = 2;
    OtherForces other;
    // Per body, s after the start of the call: a hand or free body goes no farther than it has come by then, but keeps its
    // velocity: there it first touches what no row holds yet. Empty: none is held.
    std::span<const double> stop = {};
    std::span<const ToolJaw> jaws = {};  // of the tools
};

// What a call moves on: only the rows of the island's own bodies, contact rows and tools.
struct AdvanceState {
    Particles& particles;
    Poses& poses;
    ContactRows& rows;
    std::span<ToolState> tools;
};

// What calls did to an island, added up; the deepest residual and the opposing planes are of the last call alone. Work in J on its
// deformable bodies.
struct AdvanceResult : IslandReport {
    double work_hand = 0;
    double work_contact = 0;
    double work_damping = 0;
    double work_push = 0;
    double work_numeric = 0;
    double work_links = 0;     // what links and springs held as they broke, negative
    uint64_t active_rows = 0;  // rows that acted, summed over the substeps
};

// Adds a call's works and counters to the books. Islands are added in their order.
void add_advance_result(const AdvanceResult& result, Energy& energy, Report& report);

// Whole number of substeps in `seconds` that the bodies of an island need: none longer than the stable step of a body
// stepped by leapfrog or `largest`, nor than the step of one that is stepped otherwise, nor than Links::stable_dt.
uint32_t count_substeps(const Bodies& bodies, std::span<const uint32_t> island_bodies, double seconds, double largest,
                        std::span<const double> linked = {});

// Moves the bodies of one island through params.ticks ms under their springs, tetrahedra, anchors, links, damping, gravity
// and contact rows: deformable ones by the integrator of each (leapfrog or midpoint), free ones, those that a node
// drives, and tools in the hand. Reads static and scripted bodies through poses and paths and writes none of them. Rows
// start from rows.carried (where iterations > 1) and leave there what they carry at the end. Adds to rows.impulse and to
// ToolState.contact_impulse of the island's rows and tools; a row that a point has left behind gets an infinite
// rows.distance and rests from then on. A body that became non-finite, or whose energy grew without input, gets its state at
// the start of the call back, at rest. State is complete between calls. Same bits for any number of threads. Distinct
// islands may run at the same time, each with its own scratch.
void advance_island(const AdvanceParams& params, const AdvanceInputs& inputs, std::span<const uint32_t> island_bodies,
                    std::span<const uint32_t> island_rows, AdvanceScratch& scratch, AdvanceState state, AdvanceResult& result);

// Gives every scratch the room of the roomiest, so that after a pass it does not matter which thread runs which island:
// none allocates for what another has done before.
void share_room(std::span<AdvanceScratch> scratches);

}  // namespace trocar
