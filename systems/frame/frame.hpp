#pragma once
#include <memory>
#include <span>
#include <vector>

#include "engine/jobs/job_graph.hpp"
#include "engine/jobs/trace.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// The stages of the frame table, in serial order: the index of each in frame_stages().
enum class StageId : uint8_t {
    kDeviceInput,
    kNodes,
    kRigidMotion,
    kComeAndGo,
    kActions,
    kHeat,
    kSutures,
    kLinks,
    kTears,
    kTornSprings,
    kToolCuts,
    kLensFog,
    kBodyBoxes,
    kFastBodies,
    kJoinedBodies,
    kThreadedBodies,
    kExcludedPairs,
    kBoxPairs,
    kCandidatePairs,
    kSleep,
    kRefitTrees,
    kImpactTimes,
    kRasterise,
    kCandidateCells,
    kSeparatingAxisCulling,
    kContours,
    kOverlap,
    kEdgePass,
    kMemoryOrder,
    kKeptEdges,
    kFacePass,
    kConvexManifolds,
    kPenetration,
    kDeepOverlap,
    kRegions,
    kToolsInside,
    kContactConstraints,
    kEdgeConstraints,
    kLoadedConstraints,
    kCulledConstraints,
    kRedundantConstraints,
    kWarmStart,
    kSelfContacts,
    kIslands,
    kLocalContact,
    kHapticSurfaces,
    kDriveYield,
    kCompliancePrediction,
    kContactHook,
    kHoldingGroups,
    kAdvance,
    kPassedSurfaces,
    kContactMemory,
    kSelfContactForces,
    kHeldSurfaces,
    kLinkForces,
    kHandForces,
    kThreads,
    kThreadForces,
    kFluidSources,
    kFilms,
    kDrops,
    kSurfaceNormals,
    kSelfCrossings,
    kEnergy,
    kPicture,
    kCount
};

// Parts of a frame: scripted motion, spawning, removal and cuts; from boxes to islands; data for the haptic
// thread; from one pass to the next; a picture. All but the last run at the contact rate.
enum class FramePart : uint8_t { kInput, kDetection, kHaptics, kAdvance, kPicture };

// One entry of the frame table.
struct FrameStage {
    StageId id;
    FramePart part;
    Stage stage;
    bool (*wanted)(const World&);  // a stage is part of the frame only if the scene has its inputs
};

// See README for the table in words.
std::span<const FrameStage> frame_stages();
inline std::string_view stage_name(StageId id) { return frame_stages()[static_cast<size_t>(id)].stage.name; }

struct FrameOptions {
    bool serial = false;                  // run_serial instead of the job graph
    bool clear_caches = false;            // clears hints, sweep orders and tree shapes before every pass (tests)
    bool clear_scratch = false;           // discards all data outside the world between any two stages; runs serially (tests)
    bool update_sleeping_bodies = false;  // processes sleeping bodies even if unchanged since the stage's last run (tests)
    bool account_energy = true;
    bool pictures = true;         // false: without stages that only pictures need; snapshot_now still works
    bool external_ticks = false;  // live: the haptic thread ticks, the frame does not
    Trace* trace = nullptr;
};

// Called on the simulating thread as soon as the local contact models of a pass are complete; may be empty.
struct ContactHook {
    void (*published)(void* user, World& world) = nullptr;
    void* user = nullptr;
};

// Times of the stages of one pass, in the order of Frame::stage_names.
struct FrameTimes {
    std::vector<uint64_t> stage_ns;  // 0 where a stage did not run in this pass
    uint64_t response_ns = 0;        // contact response in all substeps: its share of the islands' wall time
    double deepest = 0;              // m, deepest overlap that a round of the pass found
    bool picture = false;            // the end list ran
    std::vector<uint64_t> tick_ns;   // compute time of every haptic tick of the pass, tool by tool
    std::vector<double> tick_force;  // N, on the hand within limits, of the same ticks
};

// A world and the stages that its scene needs. Make and use it inside ThreadPool::run; outside it runs on the
// caller's thread. Passes run in the float mode of thread_pool.hpp; the caller's is restored.
class Frame {
 public:
    // Throws InputError if the world lacks inputs of a pass (find_unfinished). For worlds built by hand or
    // read from a file call find_fault (engine/world/world.hpp) first, which finds all other errors.
    Frame(World world, const FrameOptions& options);
    ~Frame();
    // One contact pass: begin, advance, and end if a picture is due then; in rounds, with contacts found anew in each, while free
    // bodies are fast and nothing is soft or held, or while a hand is fast near something soft and its ticks are the
    // frame's own (systems/detect/broad/rounds.hpp). Bodies may be added to world()
    // between two passes, with their data (add_body, make_deformable or set_rigid_mass, make_trees): the
    // stages are chosen anew, so stage_names may change, and their energy is added to the initial one. Throws
    // InputError if data is missing or a body was removed; bodies that come and go use an object pool
    // (components/spawning.hpp).
    void step();
    void set_contact_hook(const ContactHook& hook);
    // Call after the world was set back to the start of the last pass: keeps data on its sleeping bodies.
    void run_pass_again();
    // Call after the state of world() was replaced by that of another time or another world of the same scene: drops all that
    // the frame remembers of the former one, and restores surfaces that tear.
    void state_replaced();
    // A picture of the present state, independent of the frame's schedule.
    const PictureSnapshot& snapshot_now();
    // The stages of this frame in serial order, and the position of one of them; kNone if the scene does not
    // need it.
    std::span<const Stage> stages() const;
    uint32_t row_of(StageId id) const;
    // For tests of the table: all stages of a pass before stage `index`; that stage alone.
    void step_until(uint32_t index);
    void run_stage(uint32_t index);
    World& world();
    const World& world() const;
    const std::vector<std::string>& stage_names() const;
    const FrameTimes& times() const;
    // Indices in stage_names of the detection stages (body boxes to islands).
    std::span<const uint32_t> detection_stages() const;

 private:
    void take_in_bodies();
    void warm_up();
    uint32_t count_rounds_of(uint32_t left);
    void run_rounds();
    std::unique_ptr<struct FrameState> state_;
    struct Graphs;
    std::unique_ptr<Graphs> graphs_;
};

// Detection alone (body boxes to islands) on a world at rest, for a contact report of two meshes. Throws as
// Frame does. show_cells: puts small bodies into cells too, for occupancy; contacts are equal.
void detect_contacts(World& world, bool show_cells = true);

}  // namespace trocar
