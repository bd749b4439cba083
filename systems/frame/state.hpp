#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/contact/sleeping_bodies.hpp"
#include "engine/world/world.hpp"
#include "systems/advance/held_surfaces.hpp"
#include "systems/advance/islands.hpp"
#include "systems/advance/parting_bodies.hpp"
#include "systems/advance/untangle.hpp"
#include "systems/constrain/contact_constraints.hpp"
#include "systems/constrain/contact_memory.hpp"
#include "systems/constrain/culled_constraints.hpp"
#include "systems/constrain/edge_constraints.hpp"
#include "systems/constrain/islands.hpp"
#include "systems/constrain/redundant_constraints.hpp"
#include "systems/constrain/self_contacts.hpp"
#include "systems/detect/broad/broad_phase_pairs.hpp"
#include "systems/detect/broad/candidate_cells.hpp"
#include "systems/detect/broad/rasterise.hpp"
#include "systems/detect/broad/reachable_pairs.hpp"
#include "systems/detect/broad/refit_trees.hpp"
#include "systems/detect/broad/separating_axis_culling.hpp"
#include "systems/detect/narrow/contours.hpp"
#include "systems/detect/narrow/convex_manifolds.hpp"
#include "systems/detect/narrow/edge_pass.hpp"
#include "systems/detect/narrow/face_depth.hpp"
#include "systems/detect/narrow/overlap.hpp"
#include "systems/detect/narrow/parting_pairs.hpp"
#include "systems/detect/narrow/regions.hpp"
#include "systems/fluid/drops.hpp"
#include "systems/fluid/films.hpp"
#include "systems/fluid/sources.hpp"
#include "systems/frame/frame.hpp"
#include "systems/haptics/contact/local_contact_model.hpp"
#include "systems/haptics/contact/passed_surfaces.hpp"
#include "systems/haptics/tool.hpp"
#include "systems/output/deformable_energy.hpp"
#include "systems/output/picture_snapshot.hpp"
#include "systems/output/self_crossings.hpp"
#include "systems/output/surface_normals.hpp"
#include "systems/prepare/link_bodies.hpp"
#include "systems/prepare/sleep.hpp"
#include "systems/prepare/spawning.hpp"
#include "systems/prepare/tool_sutures.hpp"
namespace trocar {

// Stages that skip bodies that have slept since the stage's last run.
enum SleepStage { kSeenByBoxes, kSeenByPairs, kSeenByNormals, kSeenByEnergy, kSeenByPicture, kSleeperStages };

// Records of stages about sleeping bodies: see SleepingBodies.
struct SleeperCache {
    std::vector<uint64_t> number;  // per body: number of its present sleep, 0 = awake
    uint64_t last = 0;             // number given
    std::array<std::vector<uint64_t>, kSleeperStages> seen;
    std::vector<uint32_t> generation;  // per slot of a pool: of the body to which the number belongs
    uint32_t round = 0;                // ms, period of the boxes; in scenes with rounds
    uint64_t next_pass = 0;            // a clock set to another time means another state
};

// Reused buffers and caches of the systems. They affect only speed, and may be discarded between any two
// stages (FrameOptions::clear_scratch). Data that one stage leaves for another is a resource of World.
struct FrameScratch {
    SleeperCache sleeping_bodies;
    ComeAndGoScratch spawning;
    LinkScratch links;
    BroadPhaseScratch pairs;
    ReachablePairsScratch reachable;
    SleepScratch sleep;
    RefitTreesScratch refit;
    std::vector<double> pair_time_of_impact;  // of find_times_of_impact
    RasteriseScratch rasterise;
    CandidateCellsScratch cells;
    SeparatingAxisScratch separating_axis;
    ContoursScratch contours;
    OverlapScratch overlap;
    EdgePassScratch edges;
    ContactMemoryScratch memory;
    FaceDepthScratch faces;
    ConvexManifoldsScratch manifolds;
    PairMemory directions_before;  // of find_separation_directions
    PartingPairsScratch parting_pairs;
    PartingBodiesScratch parting_bodies;
    RegionsScratch regions;
    ContactConstraintsScratch constraints;
    EdgeConstraintsScratch edge_constraints;
    CulledConstraintsScratch culled_constraints;
    RedundantConstraintsScratch redundant_constraints;
    SelfContactScratch self_contacts;
    HeldSurfacesScratch held_surfaces;
    UntangleScratch untangle;
    IslandsScratch islands;
    LocalContactScratch local_contact;
    Poses foreseen;  // of foresee_paths
    AdvanceIslandsScratch advance;
    PassedSurfacesScratch passed_surfaces;
    std::array<HapticScratch, kMaxTools> haptic;
    SurfaceNormalsScratch normals;
    CrossingFacesScratch crossing_faces;
    EnergyScratch energy;
    FluidSourcesScratch fluid_sources;
    FilmsScratch films;
    DropsScratch drops;
    PictureLiquidScratch picture_liquid;
    SewScratch sew;
    LoneThreadScratch lone_threads;
};

// Limits on a frame's work.
struct FrameLimits {
    uint32_t face_queries = 2000;     // per pair, for its deepest point in a face: 2 ms
    uint64_t direct_tests = 1 << 18;  // of a pair, up to which its triangles are compared without cells
    // Up to this number of bodies the contact search before the first pass gives resting bodies the
    // speculative margin of moving ones, to allocate the memory for later contacts. In a lattice of a
    // thousand at rest all neighbours would be in contact, in several times the memory of any pass.
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
    size_t bodies = 0, prototypes = 0;          // for which the stages were chosen
    ConvexHulls hulls;                          // of the prototypes of rigid bodies, made with the stages
};

inline double period_seconds(const World& w) { return w.clock.period * 1e-3; }
inline double pass_seconds(const World& w) { return static_cast<double>(w.clock.tick) * 1e-3; }

SleepingBodies sleeping_bodies(FrameState& frame, SleepStage stage);
// Numbers the present sleep of every sleeping body; before the stages that skip them, and when bodies fall
// asleep or wake.
void number_sleeps(FrameState& frame);
OtherForces other_forces(World& world);
EnergyInputs energy_inputs(World& world);
// `normals`: of compute_surface_normals, those of the world where it has the stage.
PictureInputs picture_inputs(const World& world, const SurfaceNormals& normals, PictureLiquidScratch& liquid);

}  // namespace trocar
