#pragma once
#include <array>
#include <vector>

#include "components/mesh.hpp"
#include "components/tool.hpp"
#include "engine/haptics/local_contact_model.hpp"
#include "systems/haptics/contact/half_spaces.hpp"
#include "systems/haptics/contact/near_surface.hpp"
#include "systems/haptics/contact/point_shell_contact.hpp"
namespace trocar {

// Part of a near triangle in contact with the tip.
struct TouchedFeature {
    uint32_t near = 0;      // index into NearSurface::triangle
    uint32_t triangle = 0;  // of the model
    Feature feature = Feature::kFace;
    Triangle vertex{};             // of the triangle
    Vec3d offset = Vec3d::Zero();  // m, from the tip's centre to the closest point
    double distance = 0;           // m
    bool shadowed = false;         // a neighbour is touched nearer
};

// Constraints on the tip at a position.
struct Planes {
    HalfSpaces half_spaces;  // relative to the centre of the tip
    bool inside = false;     // the nearest feature is seen from behind
};

struct HapticScratch {
    NearSurface near;
    std::vector<TouchedFeature> touched;
    bool touched_crowd = false;  // `touched` is full: more features may be in contact
    Planes planes;               // at the position near.places = planes_place
    uint32_t planes_place = kNone;
    PointShellScratch point_shell;  // of a tool with a point shell
};

// Gathers the triangles that a tip may reach in a tick: see gather_near.
void gather_surface(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel,
                    HapticScratch& scratch);

// Fills scratch.touched with the features nearer to `centre` than their offset that are closest points of the
// surface around them: the others belong to a neighbour with a nearer contact.
void find_touched(const Vec3d& centre, HapticScratch& scratch);

// Whether a point is inside a closed body whose surface is within `most` (m) of contact, and the point just outside
// it by the shortest way.
struct Exit {
    bool found = false;  // the surface
    bool inside = false;
    Vec3d point = Vec3d::Zero();
};
Exit nearest_exit(const Vec3d& centre, double most, HapticScratch& scratch);

struct ProxySearch {
    Vec3d proxy = Vec3d::Zero();
    uint32_t active = 0;      // constraining planes
    bool inside = false;      // inside tissue, and not known to have been outside
    bool left = false;        // stopped early, see leave_crowd
    bool hovers = false;      // it is short of the goal without constraining planes
    bool unfinished = false;  // the room or the work of a tick ended before the goal
};

// Region covered by the gathered triangles: the proxy may move there in this tick; the rest of a longer
// displacement follows in the next.
struct Room {
    Vec3d origin = Vec3d::Zero();
    double travel = 0;  // m
};

// Moves the tip from `start` to the point nearest to `goal` that it can slide to without passing through a
// surface (the god-object of Zilles & Salisbury, IROS 1995, with the finite radius of Ruspini, Kolarov &
// Khatib, SIGGRAPH 1997); friction by the cone of Harwin & Melder (Eurohaptics 2002). The work of a tick is
// limited by counting its steps and evaluations since the triangles were gathered: in regions of many
// triangles a motion takes several ticks of at least 0.3 mm each. `leave_crowd`: makes no step where so many
// features are in contact that only one step would fit.
ProxySearch find_proxy(const Vec3d& start, const Vec3d& goal, const Room& room, double friction, bool was_outside, HapticScratch& scratch,
                       bool leave_crowd = false);

}  // namespace trocar
