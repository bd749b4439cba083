#pragma once
#include <memory>
#include <span>
#include <vector>

#include "engine/job_graph.hpp"
#include "engine/trace.hpp"
#include "engine/world.hpp"
namespace trocar {

// The stages of the frame table, in the order of a serial run: the row of each in frame_stages().
enum class StageId : uint8_t {
    kDeviceInput,
    kNodes,
    kRigidMotion,
    kComeAndGo,
    kLinks,
    kTears,
    kTornSprings,
    kBodyBoxes,
    kFastBodies,
    kJoinedBodies,
    kExcludedPairs,
    kBoxPairs,
    kCandidatePairs,
    kSleep,
    kRefitTrees,
    kImpactTimes,
    kRasterise,
    kCandidateCells,
    kPartedTriangles,
    kContours,
    kOverlap,
    kEdgePass,
    kMemoryOrder,
    kKeptEdges,
    kFacePass,
    kPenetration,
    kDeepOverlap,
    kRegions,
    kContactRows,
    kEdgeRows,
    kLoadedRows,
    kIdleRows,
    kImpliedRows,
    kWarmStart,
    kIslands,
    kLocalContact,
    kHapticSurfaces,
    kDriveYield,
    kTissueGive,
    kContactHook,
    kHoldingGroups,
    kAdvance,
    kContactMemory,
    kLinkForces,
    kHandForces,
    kSurfaceNormals,
    kEnergy,
    kPicture,
    kCount
};

// Parts of a frame: what moves by itself, comes, goes or is cut; from boxes to islands; what the haptic thread is told; from one
// pass to the next; a picture. All but the last run at the contact rate.
enum class FramePart : uint8_t { kInput, kDetection, kHaptics, kAdvance, kPicture };

// One row of the frame table.
struct FrameStage {
    StageId id;
    FramePart part;
    Stage stage;
    bool (*wanted)(const World&);  // a stage enters the frame only if the scene has what it works on
};

// See README for the table in words.
std::span<const FrameStage> frame_stages();
inline std::string_view stage_name(StageId id) { return frame_stages()[static_cast<size_t>(id)].stage.name; }

struct FrameOptions {
    bool serial = false;            // run_serial instead of the job graph
    bool clear_caches = false;      // forget hints, sweep orders and trees' shapes before every pass (tests)
    bool clear_scratch = false;     // throw away all that is not in the world between any two stages; runs serially (tests)
    bool look_at_sleepers = false;  // even where nothing has changed since the stage looked last (tests)
    bool account_energy = true;
    bool pictures = true;         // false: without the stages whose results only pictures show; snapshot_now works all the same
    bool external_ticks = false;  // live: the haptic thread ticks, the frame does not
    Trace* trace = nullptr;
};

// Called on the simulating thread as soon as the local contact models of a pass are complete; may be empty.
struct ContactHook {
    void (*published)(void* user, World& world) = nullptr;
    void* user = nullptr;
};

// How long the stages of one pass took, in the order of Frame::stage_names.
struct FrameTimes {
    std::vector<uint64_t> stage_ns;  // 0 where a stage did not run in this pass
    uint64_t response_ns = 0;        // wall time of contact rows in all substeps: their part of the islands', which run side by side
    bool picture = false;            // the end list ran
    std::vector<uint64_t> tick_ns;   // compute time of every haptic tick of the pass, tool by tool
};

// A world and the stages that its scene needs. Make and use it inside ThreadPool::run; outside of one it runs on the caller's
// thread. Passes run in the float mode of thread_pool.hpp; the caller gets its own back.
class Frame {
 public:
    // Throws InputError when the world lacks what a pass needs (find_unfinished); what else can be wrong with one that was put
    // together by hand or came from a file, find_fault (engine/world.hpp) tells: ask it first.
    Frame(World world, const FrameOptions& options);
    ~Frame();
    // One contact pass: begin, advance, and end when a picture is due at the end of the pass. Bodies may be added to world()
    // between two passes, with what they need (add_body, make_deformable or set_rigid_mass, make_trees): the stages are chosen
    // anew, so stage_names may change, and their energy goes to the books' start. Throws InputError when something of them is
    // missing or a body was taken out; bodies that come and go by themselves have slots in a pool (components/lives.hpp).
    void step();
    void set_contact_hook(const ContactHook& hook);
    // The world was set back to where the last pass began, to run it again: what is known of its sleepers holds.
    void run_pass_again();
    // A picture of the present state, outside the order of the frame.
    const PictureSnapshot& snapshot_now();
    // The stages of this frame in serial order, and where one of them is; kNone where the scene does not want it.
    std::span<const Stage> stages() const;
    uint32_t row_of(StageId id) const;
    // For tests of the table: everything of a pass before stage `row`; that stage alone.
    void step_until(uint32_t row);
    void run_stage(uint32_t row);
    World& world();
    const World& world() const;
    const std::vector<std::string>& stage_names() const;
    const FrameTimes& times() const;
    // Rows of stage_names that count as detection (body boxes to islands).
    std::span<const uint32_t> detection_stages() const;

 private:
    void take_in_bodies();
    void warm_up();
    std::unique_ptr<struct FrameState> state_;
    struct Graphs;
    std::unique_ptr<Graphs> graphs_;
};

// Detection alone (body boxes to islands) on a world at rest: what a contact report of two meshes needs. Throws as Frame does.
// show_cells: small bodies too are put into cells, which occupancy then shows; what is found is the same.
void detect_contacts(World& world, bool show_cells = true);

}  // namespace trocar
