#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/sleepers.hpp"
#include "engine/world.hpp"
#include "systems/advance_islands.hpp"
#include "systems/candidate_cells.hpp"
#include "systems/candidate_pairs.hpp"
#include "systems/come_and_go.hpp"
#include "systems/contact_memory.hpp"
#include "systems/contact_rows.hpp"
#include "systems/contours.hpp"
#include "systems/deformable_energy.hpp"
#include "systems/edge_pass.hpp"
#include "systems/edge_rows.hpp"
#include "systems/face_depth.hpp"
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

// Stages that pass over bodies that sleep as they did when the stage looked last.
enum SleeperStage { kSeenByBoxes, kSeenByPairs, kSeenByNormals, kSeenByEnergy, kSeenByPicture, kSleeperStages };

// What stages know of sleeping bodies: see Sleepers.
struct SleeperCache {
    std::vector<uint64_t> number;  // per body: which sleep it is in, 0 = awake
    uint64_t last = 0;             // number given
    std::array<std::vector<uint64_t>, kSleeperStages> seen;
    std::vector<uint32_t> generation;  // per slot of a pool: of the body that the number is of
    uint64_t next_pass = 0;            // a clock that was put elsewhere means another state
};

// Reused buffers and caches of the systems. Their content means nothing but speed: all of it may be thrown away between any
// two stages (FrameOptions::clear_scratch). What a stage leaves for another one is a resource of World.
struct FrameScratch {
    SleeperCache sleepers;
    ComeAndGoScratch come_and_go;
    LinkScratch links;
    CandidatePairsScratch pairs;
    ReachablePairsScratch reachable;
    SleepScratch sleep;
    RefitTreesScratch refit;
    std::vector<double> touch;  // of find_stops
    RasteriseScratch rasterise;
    CandidateCellsScratch cells;
    PartedTrianglesScratch parted;
    ContoursScratch contours;
    OverlapScratch overlap;
    EdgePassScratch edges;
    ContactMemoryScratch memory;
    FaceDepthScratch faces;
    PairMemory ways_before;  // of find_ways_out
    RegionsScratch regions;
    ContactRowsScratch rows;
    EdgeRowsScratch edge_rows;
    IdleRowsScratch idle_rows;
    ImpliedRowsScratch implied_rows;
    IslandsScratch islands;
    LocalContactScratch local_contact;
    AdvanceIslandsScratch advance;
    std::array<HapticScratch, kMaxTools> haptic;
    SurfaceNormalsScratch normals;
    EnergyScratch energy;
};

// What a frame spends at most, and where.
struct FrameLimits {
    uint32_t face_queries = 2000;     // of a pair, for its deepest point in a face: 2 ms
    uint64_t direct_tests = 1 << 18;  // of a pair, up to which its triangles are compared without cells
    // Up to so many bodies the search before the first pass looks as far ahead for bodies at rest as for moving ones, so that the
    // memory is there for what a tool will touch. A lattice of a thousand at rest would see all its neighbours and hold
    // several times the memory of any pass.
    size_t most_warmed_bodies = 64;
};

struct FrameState {
    World world;
    FrameScratch scratch;
    FrameOptions options;
    FrameLimits limits;
    FrameTimes times;
    ContactHook contact_hook;
    std::vector<std::string_view> island_name;  // with a trace, per body: of the island whose first body it is
    size_t bodies = 0, prototypes = 0;          // that the stages were chosen for
};

inline double period_seconds(const World& w) { return w.clock.period * 1e-3; }
inline double pass_seconds(const World& w) { return static_cast<double>(w.clock.tick) * 1e-3; }

Sleepers sleepers(FrameState& frame, SleeperStage stage);
// Gives every body that sleeps a number for this sleep; before the stages that look at sleepers, and when bodies fall asleep or wake.
void number_sleeps(FrameState& frame);
OtherForces other_forces(World& world);
EnergyInputs energy_inputs(World& world);

}  // namespace trocar
