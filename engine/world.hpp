#pragma once
#include <memory>
#include <vector>

#include "components/bodies.hpp"
#include "components/clock.hpp"
#include "components/contacts.hpp"
#include "components/haptics.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/paths.hpp"
#include "components/picture.hpp"
#include "components/report.hpp"
#include "components/scene.hpp"
#include "components/springs.hpp"
#include "engine/closest_point.hpp"
#include "engine/job_graph.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// Everything a frame reads or writes, and nothing else. No logic here. Each group below is one Resource bit.
struct World {
    // constant after load
    SceneSettings settings;
    Meshes meshes;
    Springs springs;
    Bodies bodies;
    Anchors anchors;
    Paths paths;
    // state
    Clock clock;
    Poses poses;
    Particles particles;
    Haptics haptics;  // tool: constant
    Sleep sleep;
    // derived each pass
    BodyBoxes boxes;
    CandidatePairs pairs;
    std::vector<std::unique_ptr<ClosestPointTree>> trees;  // Bodies::tree names the row; rigid copies share one
    ScreenedTriangles screened;
    Occupancy occupancy;
    CandidateTriangles candidates;
    NearVertices near;
    Contacts contacts;
    Penetrations penetrations;
    ContactRows rows;
    Islands islands;
    SurfaceNormals normals;
    // output
    std::vector<LocalContactModel> local_contact;  // one per tool
    PictureSnapshot picture;
    Energy energy;
    Report report;
};

enum class Resource : uint8_t {
    kSettings,
    kMeshes,
    kSprings,
    kBodies,
    kAnchors,
    kPaths,
    kTools,
    kClock,
    kPoses,
    kParticles,
    kToolState,
    kBoxes,
    kPairs,
    kTrees,
    kScreened,
    kOccupancy,
    kCandidates,
    kNear,
    kContacts,
    kPenetrations,
    kRows,
    kIslands,
    kNormals,
    kLocalContact,
    kPicture,
    kEnergy,
    kReport,
    kSleep,
    kCount
};

template <typename... R>
constexpr ResourceMask mask(R... resources) {
    return ((ResourceMask{1} << static_cast<uint32_t>(resources)) | ... | ResourceMask{0});
}

// Short name, as in the frame table.
const char* resource_name(Resource resource);

// Hash of the bits of one resource. Trees count by the positions of their vertices.
uint64_t resource_hash(const World& world, Resource resource);

// Empties every array of the resources that `keep` does not name and poisons their plain values.
void strip_resources(World& world, ResourceMask keep);

// Hash of the state: what the next pass starts from.
uint64_t state_hash(const World& world);

inline Surfaces surfaces_of(const World& world) { return {world.meshes, world.bodies, world.poses, world.particles}; }

}  // namespace trocar
