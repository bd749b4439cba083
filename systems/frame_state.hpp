#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "engine/device.hpp"
#include "engine/sleepers.hpp"
#include "engine/world.hpp"
#include "systems/advance.hpp"
#include "systems/candidate_cells.hpp"
#include "systems/candidate_pairs.hpp"
#include "systems/contact_memory.hpp"
#include "systems/contact_rows.hpp"
#include "systems/contours.hpp"
#include "systems/deformable_energy.hpp"
#include "systems/edge_pass.hpp"
#include "systems/edge_rows.hpp"
#include "systems/face_depth.hpp"
#include "systems/fast_bodies.hpp"
#include "systems/frame.hpp"
#include "systems/haptic_tool.hpp"
#include "systems/idle_rows.hpp"
#include "systems/implied_rows.hpp"
#include "systems/islands.hpp"
#include "systems/link_bodies.hpp"
#include "systems/local_contact_model.hpp"
#include "systems/overlap.hpp"
#include "systems/parted_triangles.hpp"
#include "systems/rasterise.hpp"
#include "systems/reachable_pairs.hpp"
#include "systems/refit_trees.hpp"
#include "systems/regions.hpp"
#include "systems/sleep.hpp"
#include "systems/surface_normals.hpp"
namespace trocar {

// Pairs that were left in a pass of a length (s) in which nothing of the last sweep moved.
struct PairsAtRest {
    double period = 0;
    CandidatePairs pairs;
};

// Reused buffers of the systems; their content means nothing between passes but speed.
struct FrameScratch {
    CandidatePairsScratch pairs;
    std::vector<std::array<uint32_t, 2>> apart;  // bodies that do not meet
    std::vector<Box> swept_box;                  // what the last sweep was made over
    std::vector<std::array<uint32_t, 2>> swept_apart;
    CandidatePairs swept;                // and what it found
    std::array<PairsAtRest, 2> at_rest;  // passes alternate between two lengths at most
    ReachablePairsScratch reachable;
    RefitTreesScratch refit;
    RasteriseScratch rasterise;
    CandidateCellsScratch cells;
    PartedTrianglesScratch parted;
    OverlapScratch overlap;
    ContoursScratch contours;
    EdgePassScratch edges;
    FaceDepthScratch faces;
    PairMemory ways_before;
    RegionsScratch regions;
    ContactRowsScratch rows;
    EdgeRowsScratch edge_rows;
    IdleRowsScratch idle_rows;
    ImpliedRowsScratch implied_rows;
    ContactMemoryScratch memory;
    IslandsScratch islands;
    LinkScratch links;
    HoldingGroups holding;                        // of this pass
    std::vector<std::array<uint32_t, 2>> joined;  // bodies, by links
    SleepScratch sleep;
    std::vector<uint64_t> sleeps;  // per body: which sleep it is in, 0 = awake
    uint64_t last_sleep = 0;
    std::array<std::vector<uint64_t>, 5> seen;  // per stage and body: see Sleepers
    uint64_t next_pass = 0;                     // a clock that was put elsewhere means another state
    std::vector<uint32_t> leaving;              // bodies whose life is over in this pass
    std::vector<uint8_t> moving;                // per body: by its script
    SurfaceNormalsScratch normals;
    EnergyScratch energy;
    Poses coming;                             // poses with the coming speed of hands and free bodies
    std::vector<FastBody> fast;               // of this pass
    std::vector<double> touch;                // per pair, s into the pass
    std::vector<double> stop;                 // s into the pass, per body where a fast one first touches; or empty
    std::vector<AdvanceScratch> advance;      // per thread, for the islands that share
    std::vector<AdvanceScratch> own_advance;  // of the islands that do not
    std::vector<uint32_t> awake;              // islands to be advanced
    std::vector<uint32_t> island_size;        // as awake: particles
    std::vector<uint32_t> island_order;
    std::vector<uint32_t> own_memory;           // as awake: row of own_advance or kNone
    std::vector<AdvanceResult> advance_result;  // as awake
    std::vector<uint64_t> response_ns;          // as awake: of contact rows
    std::vector<uint64_t> island_ns;            // as awake: of the whole island
    std::vector<DeviceState> intended;          // tools * (period + 1): where the hands mean to be at every millisecond
    std::vector<DeviceState> device;            // the same for where the tools are
    LocalContactScratch local_contact;
    std::array<HapticScratch, kMaxTools> haptic;
    std::array<DeviceState, kMaxTools> live_device;  // live: of the pass before
    bool live_device_known = false;
};

struct FrameState {
    World world;
    FrameScratch scratch;
    FrameOptions options;
    FrameTimes times;
    ContactHook contact_hook;
    std::vector<std::string_view> island_name;  // with a trace, per body: of the island whose first body it is
    uint32_t face_queries = 2000;               // of a pair, for its deepest point in a face: 2 ms
    uint64_t direct_tests = 1 << 18;            // of a pair, up to which its triangles are compared without cells
    size_t bodies = 0, prototypes = 0;          // that the stages were chosen for
    double energy_start = 0;                    // J, when the books were opened, and of bodies that have come since
    bool energy_open = false;
};

inline double period_seconds(const World& w) { return w.clock.period * 1e-3; }
inline double pass_seconds(const World& w) { return static_cast<double>(w.clock.tick) * 1e-3; }

// Which bodies a stage may pass over: those that sleep as they did when it looked last.
enum SleeperStage { kSeenByBoxes, kSeenByPairs, kSeenByNormals, kSeenByEnergy, kSeenByPicture };
Sleepers sleepers(FrameState& frame, SleeperStage stage);
// Gives every body that sleeps a number for this sleep.
void number_sleeps(FrameState& frame);
// Pairs of bodies that links and jaws join; valid until the next call.
std::span<const std::array<uint32_t, 2>> linked_bodies(FrameState& frame);
OtherForces other_forces(FrameState& frame);
EnergyInputs energy_inputs(FrameState& frame, const OtherForces& other);

}  // namespace trocar
