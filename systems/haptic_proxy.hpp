#pragma once
#include <array>
#include <vector>

#include "components/haptics.hpp"
#include "engine/closest_point.hpp"
#include "systems/haptic_shell.hpp"
namespace trocar {

inline constexpr double kSkin = 1e-9;  // m, the sweep stops this much deeper than the planes hold, so that sliding along
                                       // a plane is never taken for hitting it

// Where the surfaces of a model are at a time: positions + age * velocities, those of the body that gives way `follow`
// beyond that.
struct SurfaceTime {
    double age = 0;                // s
    Vec3d follow = Vec3d::Zero();  // m
};

// Disc around a triangle of the model near the proxy, at the time of the tick: what is asked first, so it lies apart.
struct NearDisc {
    Vec3d centre = Vec3d::Zero();  // m
    Vec3d normal = Vec3d::Zero();  // unit, outward; zero for a triangle without area
    double radius = 0;             // m
    double slack = 0;              // m, the triangle may stand out of the disc by this; 0 once its corners were taken
    double offset = 0;             // m, tip radius + half thickness: how near the centre of the tip may come
};

struct NearTriangle {
    Triangle vertex;              // of the model
    uint32_t body = kNone;
    bool sheet = false;
    bool held = false;            // its plane is among the planes of the present step
    bool placed = false;          // the corners were taken
    uint32_t touch = 0;           // row of HapticScratch::touched, if that one names this triangle
    double overlaps_at = -1;      // m, path where it was touched last: it is held by its plane, or by that of a nearer one
    std::array<Vec3d, 3> corner;  // m
};

// The triangles that a tip may come to in a tick. Most of them it cannot touch before it went some way: they sleep until
// then. Sleeping saves time and never changes an answer.
struct NearSurface {
    std::vector<uint32_t> row;           // of the model, ascending
    std::vector<NearTriangle> triangle;  // one per row
    std::vector<NearDisc> disc;          // one per triangle
    std::vector<double> wake;            // m, one per triangle: length of the tip's path before which it cannot touch
    std::vector<uint32_t> awake;         // rows whose `wake` is at most `horizon`, ascending
    Vec3d at = Vec3d::Zero();            // m, the tip's centre
    double path = 0;                     // m, it went since the triangles were placed
    double horizon = -1;                 // m
    SurfaceTime time;
    const LocalContactModel* model = nullptr;  // of this tick
    uint32_t touched = 0;                // features that the tip touched since the triangles were gathered, step by step
    bool ask_all = false;                // tests: take the whole model and let nothing sleep
};

// Part of a near triangle that the tip touches.
struct TouchedFeature {
    uint32_t near = 0;  // row of NearSurface::triangle
    Feature feature = Feature::kFace;
    Triangle vertex{};             // of the triangle
    Vec3d offset = Vec3d::Zero();  // m, from the tip's centre to the closest point
    double distance = 0;           // m
    bool shadowed = false;         // a neighbour is touched nearer
};

// Triangle that the tip may touch along a step.
struct SweptTriangle {
    double from = 0;    // share of the step before which it cannot
    uint32_t near = 0;  // row of NearSurface::triangle
};

struct HapticScratch {
    NearSurface near;
    std::vector<TouchedFeature> touched;
    std::vector<SweptTriangle> ahead;
    ShellScratch shell;  // of a tool that has one
};

// Speed (m/s) of the fastest surface that may come nearer than `travel` (m) to touching a tip at `centre`, or a bound on it.
double fastest_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel);
// Takes the triangles that a tip may touch somewhere nearer than `travel` (m) to `centre`, as they lie then.
void gather_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre,
                 double travel, NearSurface& near);
// Puts the triangles at hand where they are at another time.
void place_near(const SurfaceTime& at, const Vec3d& centre, NearSurface& near);

// Fills scratch.touched with the features nearer to `centre` than their offset, and only those that are nearest points
// of the surface around them: the rest belong to a neighbour that is touched nearer.
void find_touched(const Vec3d& centre, HapticScratch& scratch);

// Motion of the surface where it is nearest to a point; none if nothing is nearer than `most` beyond touching.
struct SurfaceMotion {
    Vec3d velocity = Vec3d::Zero();  // m/s, of the model
    uint32_t body = kNone;
};
SurfaceMotion surface_motion(const Vec3d& point, double most, NearSurface& near);

struct ProxySearch {
    Vec3d proxy = Vec3d::Zero();
    uint32_t active = 0;  // planes that hold it
    bool inside = false;  // inside tissue, and nothing says that it was outside before
};

// Room that the triangles at hand show: the proxy may go there in this tick, the rest of a longer way in the next.
struct Room {
    Vec3d origin = Vec3d::Zero();
    double travel = 0;  // m
};

// Moves the tip from `start` to the point nearest to `goal` that it can slide to along a path that passes no surface
// (the god-object of Zilles & Salisbury, IROS 1995, with the finite radius of Ruspini, Kolarov & Khatib, SIGGRAPH 1997);
// friction by the cone of Harwin & Melder (Eurohaptics 2002). It gets as far as a tick has time for, told by
// the number of its steps and of the features that they touched since the triangles were gathered: places of many
// triangles take several ticks, a step of 0.3 mm in each at least.
ProxySearch find_proxy(const Vec3d& start, const Vec3d& goal, const Room& room, double friction, bool was_outside,
                       HapticScratch& scratch);

}  // namespace trocar
