#pragma once
#include <memory>
#include <string>
#include <vector>

#include "components/actions.hpp"
#include "components/bodies.hpp"
#include "components/clock.hpp"
#include "components/contacts.hpp"
#include "components/device.hpp"
#include "components/external_displacement.hpp"
#include "components/fast_bodies.hpp"
#include "components/fluid.hpp"
#include "components/haptics.hpp"
#include "components/lens.hpp"
#include "components/links.hpp"
#include "components/mesh.hpp"
#include "components/nodes.hpp"
#include "components/particles.hpp"
#include "components/passed_surfaces.hpp"
#include "components/paths.hpp"
#include "components/picture.hpp"
#include "components/relaxation.hpp"
#include "components/report.hpp"
#include "components/scene.hpp"
#include "components/self_contact.hpp"
#include "components/self_crossing.hpp"
#include "components/solids.hpp"
#include "components/spawning.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "components/thread.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/haptics/local_contact_model.hpp"
#include "engine/jobs/job_graph.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/holding_groups.hpp"
namespace trocar {

// Everything a frame reads or writes, and nothing else. No logic here. Each group below is one Resource bit.
struct World {
    // constant after load
    SceneSettings settings;
    Meshes meshes;
    Springs springs;
    Solids solids;
    Bodies bodies;
    Anchors anchors;
    Paths paths;
    Tears tears;
    Pools pools;
    Nodes nodes;
    Actions actions;
    Fluids fluids;
    Threads threads;
    // state
    Clock clock;
    Poses poses;
    Particles particles;
    Relaxation relaxation;
    Haptics haptics;  // tool: constant
    PairMemory pair_memory;
    ContactMemory contact_memory;
    SelfContacts self_contacts;
    CrossedSurfaces crossed_surfaces;
    Sleep sleep;
    Links links;
    Torn torn;
    SpawnState spawning;
    NodeState node_state;
    ActionState action_state;
    FluidState fluid_state;
    ThreadState thread_state;
    Lenses lenses;
    // known only to a live run and its replay, which restore them
    std::vector<DeviceState> live_devices;  // per tool, where the pass before led to; empty: there was none
    EnergyStart energy_start;
    // derived each pass
    DeviceSamples devices;
    BodyBoxes boxes;
    std::vector<CcdBody> fast_bodies;                       // ascending by body
    std::vector<double> impact_times;                       // s into the pass, per body: see find_times_of_impact; or empty
    std::vector<std::array<uint32_t, 2>> joined_bodies;     // connected by links and jaws
    std::vector<std::array<uint32_t, 2>> excluded_pairs;    // a < b, ascending: never in contact
    BroadPhasePairs box_pairs;                              // with overlapping boxes
    BroadPhasePairs pairs;                                  // of these, those that may come into contact in the pass
    std::vector<ExternalDisplacement> displacement_bounds;  // per body: external displacement bound in the period
    std::vector<std::unique_ptr<ClosestPointTree>> trees;   // indexed by Bodies::tree; rigid copies share one
    ScreenedTriangles screened;
    Occupancy occupancy;
    CandidateTriangles candidates;
    NearVertices near;
    Contacts contacts;
    ContactMemoryOrder memory_order;
    Penetrations penetrations;
    Contours contours;
    OverlapRegions regions;
    ContactConstraints contact_constraints;
    std::vector<uint8_t> loaded_constraints;  // per constraint, as detected: see mark_loaded
    Islands islands;
    SurfaceNormals normals;
    SelfCrossingCounts self_crossings;
    SelfContactStart self_contact_start;
    TornSprings torn_springs;
    HoldingGroups holding_groups;
    // output
    std::vector<LocalContactModel> local_contact;  // one per tool
    PictureSnapshot picture;
    Energy energy;
    PassedSurfaces passed_surfaces;
    Report report;
};

struct CaptureRecord;

// All resources, one line each, numbered in this order: bit, member of World, name in the frame table, kind.
#define TROCAR_RESOURCES(R)                                                      \
    R(kSettings, settings, "settings", kConstant)                                \
    R(kMeshes, meshes, "meshes", kConstant)                                      \
    R(kSprings, springs, "springs", kConstant)                                   \
    R(kSolids, solids, "solids", kConstant)                                      \
    R(kBodies, bodies, "bodies", kConstant)                                      \
    R(kAnchors, anchors, "anchors", kConstant)                                   \
    R(kPaths, paths, "paths", kConstant)                                         \
    R(kTools, haptics, "tools", kConstant)                                       \
    R(kClock, clock, "clock", kState)                                            \
    R(kPoses, poses, "poses", kState)                                            \
    R(kParticles, particles, "particles", kState)                                \
    R(kToolState, haptics, "tool state", kState)                                 \
    R(kPairMemory, pair_memory, "pair memory", kState)                           \
    R(kContactMemory, contact_memory, "contact memory", kState)                  \
    R(kBoxes, boxes, "boxes", kDerived)                                          \
    R(kPairs, pairs, "pairs", kDerived)                                          \
    R(kTrees, trees, "trees", kDerived)                                          \
    R(kScreened, screened, "screened", kDerived)                                 \
    R(kOccupancy, occupancy, "occupancy", kDerived)                              \
    R(kCandidates, candidates, "candidates", kDerived)                           \
    R(kNear, near, "near", kDerived)                                             \
    R(kContacts, contacts, "contacts", kDerived)                                 \
    R(kPenetrations, penetrations, "penetrations", kDerived)                     \
    R(kContours, contours, "contours", kDerived)                                 \
    R(kRegions, regions, "regions", kDerived)                                    \
    R(kContactConstraints, contact_constraints, "contact constraints", kDerived) \
    R(kIslands, islands, "islands", kDerived)                                    \
    R(kNormals, normals, "normals", kDerived)                                    \
    R(kLocalContact, local_contact, "local contact", kOutput)                    \
    R(kPicture, picture, "picture", kOutput)                                     \
    R(kEnergy, energy, "energy", kAccounts)                                      \
    R(kReport, report, "report", kAccounts)                                      \
    R(kSleep, sleep, "sleep", kState)                                            \
    R(kLinks, links, "links", kState)                                            \
    R(kTears, tears, "tears", kConstant)                                         \
    R(kTorn, torn, "torn", kState)                                               \
    R(kTornSprings, torn_springs, "torn springs", kDerived)                      \
    R(kPools, pools, "pools", kConstant)                                         \
    R(kSpawning, spawning, "spawning", kState)                                   \
    R(kNodes, nodes, "nodes", kConstant)                                         \
    R(kNodeState, node_state, "node state", kState)                              \
    R(kLiveDevices, live_devices, "live devices", kRun)                          \
    R(kEnergyStart, energy_start, "energy start", kRun)                          \
    R(kDevices, devices, "devices", kDerived)                                    \
    R(kFastBodies, fast_bodies, "fast bodies", kDerived)                         \
    R(kImpactTimes, impact_times, "impact times", kDerived)                      \
    R(kJoinedBodies, joined_bodies, "joined bodies", kDerived)                   \
    R(kExcludedPairs, excluded_pairs, "excluded pairs", kDerived)                \
    R(kBoxPairs, box_pairs, "box pairs", kDerived)                               \
    R(kDisplacementBounds, displacement_bounds, "displacement bounds", kDerived) \
    R(kMemoryOrder, memory_order, "memory order", kDerived)                      \
    R(kLoadedConstraints, loaded_constraints, "loaded constraints", kDerived)    \
    R(kHoldingGroups, holding_groups, "holding groups", kDerived)                \
    R(kSelfCrossings, self_crossings, "self-crossings", kDerived)                \
    R(kPassedSurfaces, passed_surfaces, "passed surfaces", kAccounts)            \
    R(kActions, actions, "actions", kConstant)                                   \
    R(kActionState, action_state, "action state", kState)                        \
    R(kLenses, lenses, "lenses", kState)                                         \
    R(kSelfContacts, self_contacts, "self-contacts", kState)                     \
    R(kSelfContactStart, self_contact_start, "self-contact start", kDerived)     \
    R(kFluids, fluids, "fluids", kConstant)                                      \
    R(kFluidState, fluid_state, "fluid state", kState)                           \
    R(kCrossedSurfaces, crossed_surfaces, "crossed surfaces", kState)            \
    R(kRelaxation, relaxation, "relaxation", kState)                             \
    R(kThreads, threads, "threads", kConstant)                                   \
    R(kThreadState, thread_state, "thread state", kState)

enum class Resource : uint8_t {
#define TROCAR_RESOURCE_BIT(bit, ...) bit,
    TROCAR_RESOURCES(TROCAR_RESOURCE_BIT)
#undef TROCAR_RESOURCE_BIT
        kCount
};
static_assert(static_cast<uint32_t>(Resource::kCount) <= 8 * sizeof(ResourceMask));

template <typename... R>
constexpr ResourceMask mask(R... resources) {
    return ((ResourceMask{1} << static_cast<uint32_t>(resources)) | ... | ResourceMask{0});
}

// The group of World that a resource belongs to: the scene's constant data, the state at the start of a pass,
// further such data of live runs or of the accounting (neither hashed nor saved with the state), sums over
// the run, data recomputed in each pass, output.
enum class ResourceKind : uint8_t { kConstant, kState, kRun, kAccounts, kDerived, kOutput };
ResourceKind resource_kind(Resource resource);

// Short name, as in the frame table.
const char* resource_name(Resource resource);

// Hash of the bits of one resource. Trees contribute the positions of their vertices.
uint64_t resource_hash(const World& world, Resource resource);

// Empties every array of the resources not in `keep` and poisons their plain values.
void strip_resources(World& world, ResourceMask keep);

// Adds every array of a resource to a record, by its name in World; trees are omitted.
void save_resource(const World& world, Resource resource, CaptureRecord& record);
// The same over the arrays of a record from index `at` on, reusing their memory; returns the next index.
size_t save_resource(const World& world, Resource resource, CaptureRecord& record, size_t at);
// The reverse. Throws InputError naming an array that is missing or of another kind; indices are not checked.
void load_resource(const CaptureRecord& record, Resource resource, World& world);

// Describes why a world from an external source cannot be simulated: an index beyond its array, arrays of
// inconsistent sizes, or a position, gravity or other quantity for which a step would never end or be
// meaningless. Checks every element of the scene's data, but no trees: make_trees builds them from a world
// without fault. Empty if there is no fault.
std::string find_fault(const World& world);

// Names the functions not yet called on a hand-made world that a pass needs: particles, masses, trees, the
// clock and the settings. Fast: a Frame checks before its first pass and after bodies were added.
std::string find_unfinished(const World& world);

// Hash of the state at the start of a pass.
uint64_t state_hash(const World& world);

inline Surfaces surfaces_of(const World& world) { return {world.meshes, world.bodies, world.poses, world.particles}; }

}  // namespace trocar
