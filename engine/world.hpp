#pragma once
#include <memory>
#include <string>
#include <vector>

#include "components/bodies.hpp"
#include "components/body_jolt.hpp"
#include "components/clock.hpp"
#include "components/contacts.hpp"
#include "components/fast_bodies.hpp"
#include "components/haptics.hpp"
#include "components/links.hpp"
#include "components/lives.hpp"
#include "components/mesh.hpp"
#include "components/nodes.hpp"
#include "components/particles.hpp"
#include "components/paths.hpp"
#include "components/picture.hpp"
#include "components/report.hpp"
#include "components/scene.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
#include "engine/closest_point.hpp"
#include "engine/holding_groups.hpp"
#include "engine/job_graph.hpp"
#include "engine/surfaces.hpp"
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
    // state
    Clock clock;
    Poses poses;
    Particles particles;
    Haptics haptics;  // tool: constant
    PairMemory pair_memory;
    ContactMemory contact_memory;
    Sleep sleep;
    Links links;
    Torn torn;
    Lives lives;
    NodeState node_state;
    // what only a live run and its replay know: put back by whoever records them
    std::vector<DeviceState> live_devices;  // per tool, where the pass before led to; empty: there was none
    EnergyStart energy_start;
    // derived each pass
    DeviceSamples devices;
    BodyBoxes boxes;
    std::vector<FastBody> fast_bodies;                     // ascending by body
    std::vector<double> impact_times;                      // s into the pass, per body: see find_stops; or empty
    std::vector<std::array<uint32_t, 2>> joined_bodies;    // held together by links and jaws
    std::vector<std::array<uint32_t, 2>> excluded_pairs;   // a < b, ascending: never in contact
    CandidatePairs box_pairs;                              // of which the boxes meet
    CandidatePairs pairs;                                  // of these, what may come into contact in the pass
    std::vector<BodyJolt> displacement_bounds;             // per body: what others may do to it in the pass
    std::vector<std::unique_ptr<ClosestPointTree>> trees;  // Bodies::tree names the row; rigid copies share one
    ScreenedTriangles screened;
    Occupancy occupancy;
    CandidateTriangles candidates;
    NearVertices near;
    Contacts contacts;
    ContactMemoryOrder memory_order;
    Penetrations penetrations;
    Contours contours;
    OverlapRegions regions;
    ContactRows rows;
    std::vector<uint8_t> loaded_rows;  // per row, as made: see mark_loaded
    Islands islands;
    SurfaceNormals normals;
    TornSprings torn_springs;
    HoldingGroups holding_groups;
    // output
    std::vector<LocalContactModel> local_contact;  // one per tool
    PictureSnapshot picture;
    Energy energy;
    Report report;
};

struct CaptureRecord;

// Every resource, a line each, numbered in this order: its bit, the member of World, its name in the frame table, its kind.
#define TROCAR_RESOURCES(R)                                     \
    R(kSettings, settings, "settings", kConstant)               \
    R(kMeshes, meshes, "meshes", kConstant)                     \
    R(kSprings, springs, "springs", kConstant)                  \
    R(kSolids, solids, "solids", kConstant)                     \
    R(kBodies, bodies, "bodies", kConstant)                     \
    R(kAnchors, anchors, "anchors", kConstant)                  \
    R(kPaths, paths, "paths", kConstant)                        \
    R(kTools, haptics, "tools", kConstant)                      \
    R(kClock, clock, "clock", kState)                           \
    R(kPoses, poses, "poses", kState)                           \
    R(kParticles, particles, "particles", kState)               \
    R(kToolState, haptics, "tool state", kState)                \
    R(kPairMemory, pair_memory, "pair memory", kState)          \
    R(kContactMemory, contact_memory, "contact memory", kState) \
    R(kBoxes, boxes, "boxes", kDerived)                         \
    R(kPairs, pairs, "pairs", kDerived)                         \
    R(kTrees, trees, "trees", kDerived)                         \
    R(kScreened, screened, "screened", kDerived)                \
    R(kOccupancy, occupancy, "occupancy", kDerived)             \
    R(kCandidates, candidates, "candidates", kDerived)          \
    R(kNear, near, "near", kDerived)                            \
    R(kContacts, contacts, "contacts", kDerived)                \
    R(kPenetrations, penetrations, "penetrations", kDerived)    \
    R(kContours, contours, "contours", kDerived)                \
    R(kRegions, regions, "regions", kDerived)                   \
    R(kRows, rows, "rows", kDerived)                            \
    R(kIslands, islands, "islands", kDerived)                   \
    R(kNormals, normals, "normals", kDerived)                   \
    R(kLocalContact, local_contact, "local contact", kOutput)   \
    R(kPicture, picture, "picture", kOutput)                    \
    R(kEnergy, energy, "energy", kBooks)                        \
    R(kReport, report, "report", kBooks)                        \
    R(kSleep, sleep, "sleep", kState)                           \
    R(kLinks, links, "links", kState)                           \
    R(kTears, tears, "tears", kConstant)                        \
    R(kTorn, torn, "torn", kState)                              \
    R(kTornSprings, torn_springs, "torn springs", kDerived)     \
    R(kPools, pools, "pools", kConstant)                        \
    R(kLives, lives, "lives", kState)                           \
    R(kNodes, nodes, "nodes", kConstant)                        \
    R(kNodeState, node_state, "node state", kState)             \
    R(kLiveDevices, live_devices, "live devices", kRun)         \
    R(kEnergyStart, energy_start, "energy start", kRun)         \
    R(kDevices, devices, "devices", kDerived)                   \
    R(kFastBodies, fast_bodies, "fast bodies", kDerived)        \
    R(kImpactTimes, impact_times, "impact times", kDerived)     \
    R(kJoinedBodies, joined_bodies, "joined bodies", kDerived)  \
    R(kExcludedPairs, excluded_pairs, "excluded pairs", kDerived) \
    R(kBoxPairs, box_pairs, "box pairs", kDerived)              \
    R(kDisplacementBounds, displacement_bounds, "displacement bounds", kDerived) \
    R(kMemoryOrder, memory_order, "memory order", kDerived)     \
    R(kLoadedRows, loaded_rows, "loaded rows", kDerived)        \
    R(kHoldingGroups, holding_groups, "holding groups", kDerived)

enum class Resource : uint8_t {
#define TROCAR_RESOURCE_BIT(bit, ...) bit,
    TROCAR_RESOURCES(TROCAR_RESOURCE_BIT)
#undef TROCAR_RESOURCE_BIT
        kCount
};

template <typename... R>
constexpr ResourceMask mask(R... resources) {
    return ((ResourceMask{1} << static_cast<uint32_t>(resources)) | ... | ResourceMask{0});
}

// The group of World that a resource belongs to: what a scene is made of, what a pass starts from, what it starts from besides
// in a live run or for its accounts alone (neither hashed nor saved with the state), sums over the run, what a pass works out
// anew, what others read.
enum class ResourceKind : uint8_t { kConstant, kState, kRun, kBooks, kDerived, kOutput };
ResourceKind resource_kind(Resource resource);

// Short name, as in the frame table.
const char* resource_name(Resource resource);

// Hash of the bits of one resource. Trees count by the positions of their vertices.
uint64_t resource_hash(const World& world, Resource resource);

// Empties every array of the resources that `keep` does not name and poisons their plain values.
void strip_resources(World& world, ResourceMask keep);

// Adds every array of a resource to a record, by its name in World; trees are left out.
void save_resource(const World& world, Resource resource, CaptureRecord& record);
// The same over the arrays of a record from row `at` on, whose memory is used again; returns the row after the last.
size_t save_resource(const World& world, Resource resource, CaptureRecord& record, size_t at);
// The reverse. Throws InputError naming the array that is missing or of another kind; indices are not looked at.
void load_resource(const CaptureRecord& record, Resource resource, World& world);

// Why a world that came from outside cannot be simulated: an index beyond its array, arrays that do not fit together, a
// place, gravity or other quantity with which a step is endless or nothing. Looks at every row of what a scene is made of.
// Trees are left out: make_trees makes them of a world without fault. Empty when there is none.
std::string find_fault(const World& world);

// What a world that was put together by hand still lacks for a pass, by the function that was forgotten: particles, masses,
// trees; besides, the clock and the settings. Quick: a Frame asks before its first pass and when bodies have come.
std::string find_unfinished(const World& world);

// Hash of the state: what the next pass starts from.
uint64_t state_hash(const World& world);

inline Surfaces surfaces_of(const World& world) { return {world.meshes, world.bodies, world.poses, world.particles}; }

}  // namespace trocar
