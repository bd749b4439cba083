#pragma once
#include <array>
#include <vector>

#include "components/haptics.hpp"
#include "systems/haptic_near.hpp"
#include "systems/haptic_planes.hpp"
#include "systems/haptic_shell.hpp"
namespace trocar {

// Part of a near triangle that the tip touches.
struct TouchedFeature {
    uint32_t near = 0;      // row of NearSurface::triangle
    uint32_t triangle = 0;  // of the model
    Feature feature = Feature::kFace;
    Triangle vertex{};             // of the triangle
    Vec3d offset = Vec3d::Zero();  // m, from the tip's centre to the closest point
    double distance = 0;           // m
    bool shadowed = false;         // a neighbour is touched nearer
};

// What holds the tip at a place.
struct Planes {
    HalfSpaces half_spaces;  // relative to the centre of the tip
    bool inside = false;     // the nearest feature is seen from behind
};

struct HapticScratch {
    NearSurface near;
    std::vector<TouchedFeature> touched;
    bool touched_crowd = false;  // and more than these are
    Planes planes;               // of near.places = planes_place
    uint32_t planes_place = kNone;
    ShellScratch shell;  // of a tool that has one
};

// Takes the triangles that a tip may come to in a tick: see gather_near.
void gather_surface(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel,
                    HapticScratch& scratch);

// Fills scratch.touched with the features nearer to `centre` than their offset, and only those that are nearest points
// of the surface around them: the rest belong to a neighbour that is touched nearer.
void find_touched(const Vec3d& centre, HapticScratch& scratch);

struct ProxySearch {
    Vec3d proxy = Vec3d::Zero();
    uint32_t active = 0;  // planes that hold it
    bool inside = false;  // inside tissue, and nothing says that it was outside before
    bool left = false;    // a crowd that was to be left
};

// Room that the triangles at hand show: the proxy may go there in this tick, the rest of a longer way in the next.
struct Room {
    Vec3d origin = Vec3d::Zero();
    double travel = 0;  // m
};

// Moves the tip from `start` to the point nearest to `goal` that it can slide to along a path that passes no surface
// (the god-object of Zilles & Salisbury, IROS 1995, with the finite radius of Ruspini, Kolarov & Khatib, SIGGRAPH 1997);
// friction by the cone of Harwin & Melder (Eurohaptics 2002). It gets as far as a tick has time for, told by the number of
// its steps and of what they asked since the triangles were gathered: places of many triangles take several ticks, a step
// of 0.3 mm in each at least.
// `leave_crowd`: where so much is touched that there is time for one step alone, none is made.
ProxySearch find_proxy(const Vec3d& start, const Vec3d& goal, const Room& room, double friction, bool was_outside, HapticScratch& scratch,
                       bool leave_crowd = false);

}  // namespace trocar
