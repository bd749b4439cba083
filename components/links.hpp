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

// Where the region of a link lies: in the frame of the body that holds, moving with it; in that of the body that is held,
// at rest; in the world.
enum class RegionFrame : uint8_t { kHolder, kRest, kWorld };

enum class LinkPhase : uint8_t { kWaiting, kHolding, kDone };

// Nodes of a deformable body that another body holds, from one moment to another. A node is pulled to a point of a rigid
// holder, or to a node of a deformable one. Freed groups have no body; their generation tells old names from new ones.
struct LinkGroup {
    Entity entity;  // index = the group's own row
    std::string name;
    uint32_t body = kNone;  // deformable: held
    uint32_t holder = kNone;
    LinkPhase phase = LinkPhase::kWaiting;
    Region region;  // which nodes
    RegionFrame frame = RegionFrame::kHolder;
    uint32_t material = kNone;                                // and of which material of the mesh
    double within = std::numeric_limits<double>::infinity();  // m, and how near to the holder's surface (rigid) or nodes
    uint32_t most = kNone;                                    // of them: those nearest to region.a
    double stiffness = 0;                                     // N/m, of each link
    double rest = -1;                                         // m, of links between nodes; negative = as far apart as they are when made
    double break_strain = std::numeric_limits<double>::infinity();
    double gauge = 0;                                      // m, the length that strain refers to where a link has no rest length
    double begin = 0;                                      // s
    double end = std::numeric_limits<double>::infinity();  // s
    uint32_t tool = kNone;                                 // row of tools: holds while its first button is down, instead of begin and end
    Range rows;                                            // of Links
    uint64_t made = 0, broken = 0;                         // links so far
    Vec3d impulse = Vec3d::Zero();                         // N s, of the holder on the body, last pass
    double largest_force = 0;                              // N, mean over a pass, so far
    double largest_strain = 0;                             // so far
    TROCAR_FIELDS(entity, name, body, "row of bodies or none", holder, "row of bodies or none", phase, region, frame, material, within, "m",
                  most, stiffness, "N/m", rest, "m", break_strain, gauge, "m", begin, "s", end, "s", tool, "row of tools or none", rows,
                  "rows of links", made, broken, impulse, "N s", largest_force, "N", largest_strain);
};

// Springs between bodies, group after group. State: what is linked changes while a scene runs. Room is kept from load on.
struct Links {
    std::vector<LinkGroup> group;
    std::vector<uint32_t> node;      // of group's body
    std::vector<uint32_t> far_node;  // of its holder; kNone where that is rigid
    std::vector<Vec3d> point;        // m, frame of a rigid holder
    std::vector<float> rest;         // m; 0 towards a point
    std::vector<double> stretch;     // m, at the time of the velocities: what Energy::links is measured from
    std::vector<uint8_t> whole;      // 0 = has broken, is taken away before the next pass
    std::vector<double> stable_dt;   // s, one per body: limit of the explicit step with its links; empty without links
    TROCAR_FIELDS(group, node, far_node, point, "m", rest, "m", stretch, "m", whole, stable_dt, "s");
};

}  // namespace trocar
