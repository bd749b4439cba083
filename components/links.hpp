#pragma once
#include <string>
#include <vector>

#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

enum class RegionKind : uint8_t { kAll, kSphere, kBox, kCapsule };

// A part of space.
struct Region {
    RegionKind kind = RegionKind::kAll;
    Vec3d a = Vec3d::Zero(), b = Vec3d::Zero();  // m: centre | lowest and highest corner | ends of the axis
    double radius = 0;                           // m, sphere and capsule
    TROCAR_FIELDS(kind, a, "m", b, "m", radius, "m");
};

// Frame of a link's region: that of the holder, moving with it; that of the held body at rest; or the world.
enum class RegionFrame : uint8_t { kHolder, kRest, kWorld };

enum class LinkPhase : uint8_t { kWaiting, kHolding, kDone };

// Nodes of a deformable body that a holder attaches for a span of time. Each is joined by a spring to a point
// of a rigid holder or to a node of a deformable one. A free slot has no body; its generation marks stale
// names.
struct LinkGroup {
    Entity entity;  // index = index of the group itself
    std::string name;
    uint32_t body = kNone;  // deformable: held
    uint32_t holder = kNone;
    LinkPhase phase = LinkPhase::kWaiting;
    Region region;  // which nodes
    RegionFrame frame = RegionFrame::kHolder;
    uint32_t material = kNone;                                // and of which material of the mesh
    double within = std::numeric_limits<double>::infinity();  // m, largest distance from the holder's surface (rigid) or nodes
    uint32_t most = kNone;                                    // at most this many: the nearest to region.a
    double stiffness = 0;                                     // N/m, of each link
    double rest = -1;                                         // m, rest length of links between nodes; negative =
                                                              // their distance at creation
    double break_strain = std::numeric_limits<double>::infinity();
    double gauge = 0;                                      // m, reference length of strain where a link has no rest length
    double begin = 0;                                      // s
    double end = std::numeric_limits<double>::infinity();  // s
    uint32_t tool = kNone;                                 // index into tools: active while its first button is
                                                           // pressed, instead of begin and end
    Range links;                                           // of Links
    uint64_t made = 0, broken = 0;                         // number of links so far
    Vec3d impulse = Vec3d::Zero();                         // N s, of the holder on the body, last pass
    double largest_force = 0;                              // N, mean over a pass, so far
    double largest_strain = 0;                             // so far
    TROCAR_FIELDS(entity, name, body, "index of bodies or none", holder, "index of bodies or none", phase, region, frame, material, within,
                  "m", most, stiffness, "N/m", rest, "m", break_strain, gauge, "m", begin, "s", end, "s", tool, "index of tools or none",
                  links, "range of links", made, broken, impulse, "N s", largest_force, "N", largest_strain);
};

// Springs between bodies, in the order of their groups. State: links change while a scene runs. Capacity is
// reserved at load.
struct Links {
    std::vector<LinkGroup> group;
    std::vector<uint32_t> node;      // of group's body
    std::vector<uint32_t> far_node;  // of its holder; kNone if the holder is rigid
    std::vector<Vec3d> point;        // m, frame of a rigid holder
    std::vector<float> rest;         // m; 0 towards a point
    std::vector<double> stretch;     // m, at the time of the velocities: Energy::links refers to it
    std::vector<uint8_t> whole;      // 0 = broken, removed before the next pass
    std::vector<double> stable_dt;   // s, one per body: limit of the explicit step with its links; empty without links
    TROCAR_FIELDS(group, node, far_node, point, "m", rest, "m", stretch, "m", whole, stable_dt, "s");
};

}  // namespace trocar
