#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "components/haptics.hpp"
#include "engine/geometry/point_triangle.hpp"
namespace trocar {

inline constexpr double kSkin = 1e-9;  // m, the sweep stops this much deeper than the planes hold, so that sliding along
                                       // a plane is never taken for hitting it
inline constexpr double kHair = 1e-9;  // m, groups wake earlier than their distance says

// Where the surfaces of a model are at a time: positions + age * velocities, those of the body that gives way `follow`
// beyond that.
struct SurfaceTime {
    double age = 0;                // s
    Vec3d follow = Vec3d::Zero();  // m
};

// Group of the model, some triangle of which a tip may come to in a tick.
struct NearGroup {
    uint32_t group = 0;  // row of the model, and of its block
    uint32_t block = 0;
    uint32_t body = kNone;
    uint32_t seen = kNone;  // NearSurface::places when it was looked at; kNone: it was not
    double offset = 0;      // m, tip radius + half thickness: how near the centre of the tip may come
    double wake = 0;        // m, length of the tip's path before which none of its triangles is touched
};

// The triangles of a group as a tip saw them from a place, a lane each.
struct alignas(32) GroupSight {
    GroupLanes distance;               // m
    std::array<GroupLanes, 3> offset;  // m, from the tip to the nearest point
    GroupLanes doubt;                  // m, distance and point are off by less
    Vec3d at;                          // m, the place
    GroupSight() {}                    // filled when the group is looked at: zeros before that would take as long again
};

// A triangle that was asked for: where it is, exactly.
struct NearTriangle {
    uint32_t triangle = 0;  // of the model
    uint32_t body = kNone;
    bool sheet = false;
    bool has_normal = false;
    bool held = false;                       // its plane is among the planes of the present step
    uint32_t touch = 0;                      // row of HapticScratch::touched, if that one names this triangle
    double offset = 0;                       // m, as NearGroup
    std::array<Vec3d, 3> corner;             // m
    std::array<float, 3> angle{-1, -1, -1};  // rad, roughly, at its corners; below zero until it was asked for
    Vec3d normal = Vec3d::Zero();            // see normal_of
};

// Triangle of a group as the tip sees it along a step from where it is.
struct TriangleAhead {
    uint32_t triangle = 0;  // of the model
    double least = 0;       // m, no point of it is nearer to the tip's centre; below zero where every triangle is asked
    double from = 0;        // share of the step before which it is not touched
};

// The triangles that a tip may come to in a tick. Groups that it cannot touch before it went some way sleep until then; the
// others are seen eight triangles at a time, as floats, which tells the few that have to be asked exactly. That saves time
// and never changes an answer.
struct NearSurface {
    std::vector<NearGroup> group;        // ascending
    std::vector<GroupSight> sight;       // of each, since it was looked at
    std::vector<NearTriangle> triangle;  // those that were asked for, in this order
    std::vector<TriangleAhead> ahead;    // see find_within, find_ahead
    std::vector<uint32_t> place;         // of triangles of models: where in `triangle` it is, if it says so there
    Vec3d at = Vec3d::Zero();            // m, the tip's centre
    uint32_t places = 0;                 // where it was since the groups were gathered, this one included
    double path = 0;                     // m, it went since the groups were placed
    double tip_radius = 0;               // m
    SurfaceTime time;
    const LocalContactModel* model = nullptr;  // of this tick
    uint32_t found = 0;                        // triangles by the last of find_within and find_ahead
    uint32_t asked = 0;    // features that were touched and looks ahead (each as several of them), since they were gathered
    bool ask_all = false;  // tests: ask every triangle of the model exactly
};

// Speed (m/s) of the fastest surface that may come nearer than `travel` (m) to touching a tip at `centre`, or a bound on it.
double fastest_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel);
// Takes the groups of triangles that a tip may touch somewhere nearer than `travel` (m) to `centre`, as they lie then.
void gather_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel,
                 NearSurface& near);
// Puts them where they are at another time.
void place_near(const SurfaceTime& at, const Vec3d& centre, NearSurface& near);
// Moves the tip there.
void go_to(const Vec3d& centre, NearSurface& near);

// Fills near.ahead with the triangles that may be within `beyond` (m) of touching the tip where it is, ascending.
void find_within(double beyond, NearSurface& near);
// Fills near.ahead with those that the tip may come to touch along a step and does not touch beyond doubt where it is,
// ascending: distances from triangles are convex, so they lie above their tangents.
void find_ahead(const Vec3d& step, NearSurface& near);

// The row of a triangle of the model, which is placed if it was not yet.
uint32_t ask_for(NearSurface& near, uint32_t triangle);
// The row of a triangle that was asked for; else kNone.
uint32_t row_of(const NearSurface& near, uint32_t triangle);
inline double offset_of(const NearSurface& near, uint32_t row) { return near.triangle[row].offset; }
inline const Vec3d& corner_of(const NearSurface& near, uint32_t row, uint32_t k) { return near.triangle[row].corner[k]; }
// Unit, outward; zero for a triangle without area.
const Vec3d& normal_of(NearSurface& near, uint32_t row);
TrianglePoint closest_on_row(const NearSurface& near, uint32_t row, const Vec3d& point);
inline const Triangle& vertices_of(const NearSurface& near, uint32_t row) { return near.model->triangle[near.triangle[row].triangle]; }

// Motion of the surface where it is nearest to a point; none if nothing is nearer than `most` beyond touching.
struct SurfaceMotion {
    Vec3d velocity = Vec3d::Zero();  // m/s, of the model
    uint32_t body = kNone;
};
SurfaceMotion surface_motion(const Vec3d& point, double most, NearSurface& near);

}  // namespace trocar
