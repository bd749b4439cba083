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
inline constexpr double kHair = 1e-9;  // m, triangles wake earlier than their distance says: more than it was rounded by

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
    bool sheet = false;
    bool open = false;       // it woke: its triangles wake by themselves
    double offset = 0;       // m, tip radius + half thickness: how near the centre of the tip may come
    double wake = 0;         // m, path before which none of its triangles wakes that sleep still
    double opened = 0;       // m, path when it woke ...
    GroupLanes gap{};        // m, ... and for how much more each triangle sleeps; infinite once awake
};

// A triangle that woke.
struct NearTriangle {
    uint32_t triangle = 0;  // of the model
    uint32_t body = kNone;
    bool sheet = false;
    bool has_normal = false;
    bool held = false;            // its plane is among the planes of the present step
    uint32_t touch = 0;           // row of HapticScratch::touched, if that one names this triangle
    std::array<float, 3> angle{-1, -1, -1};  // rad, roughly, at its corners; below zero until it was asked for
    Vec3d normal = Vec3d::Zero();  // see normal_of
    double overlaps_at = -1;      // m, path where it was touched last: it is held by its plane, or by that of a nearer one
};

// Four triangles as a point sees them: the points of them that are nearest to it, to kHair; of needles perhaps one of the
// plane that is nearer still.
struct FourWays {
    alignas(32) double distance[4];   // m
    alignas(32) double offset[3][4];  // m, from the point
};

// Where four of them are, side by side. Lanes that no triangle has touch nothing and never wake.
struct alignas(32) NearFour {
    double corner[3][3][4];  // m, of corner, axis, lane
    double offset[4];        // m
    double wake[4];          // m, length of the tip's path before which it cannot touch
    FourWays ways;           // from NearSurface::at, if `seen` is NearSurface::places; see ways_to
    uint32_t seen;
    NearFour() {}  // filled where it is added: zeros before that would take as long again
};

// Triangle that may be the nearest, or be touched.
struct NearCandidate {
    double least = 0;  // m, no point of it is nearer, to kHair
    uint32_t row = 0;  // of NearSurface::triangle
};

// The triangles that a tip may come to in a tick. Most of them it cannot touch before it went some way: they sleep until
// then, and of groups that do nothing else is looked at. Sleeping saves time and never changes an answer.
struct NearSurface {
    std::vector<NearGroup> group;        // ascending
    std::vector<NearTriangle> triangle;  // those that woke, as they did
    std::vector<NearFour> four;          // rows 4 k to 4 k + 3 of `triangle`
    std::vector<NearCandidate> candidate;  // scratch
    std::vector<uint32_t> place;         // of triangles of models: where in `triangle` it is, if it says so there
    Vec3d at = Vec3d::Zero();            // m, the tip's centre
    uint32_t places = 0;                 // where it was so far, this one included
    double path = 0;                     // m, it went since the groups were placed
    double horizon = -1;                 // m, path up to which nothing sleeps that may be touched
    SurfaceTime time;
    const LocalContactModel* model = nullptr;  // of this tick
    uint32_t asked = 0;                  // features that were touched and looks ahead (each as several of them), since they were gathered
    bool ask_all = false;                // tests: take the whole model and let nothing sleep
};

// Speed (m/s) of the fastest surface that may come nearer than `travel` (m) to touching a tip at `centre`, or a bound on it.
double fastest_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel);
// Takes the groups of triangles that a tip may touch somewhere nearer than `travel` (m) to `centre`, as they lie then.
void gather_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre,
                 double travel, NearSurface& near);
// Puts them where they are at another time.
void place_near(const SurfaceTime& at, const Vec3d& centre, NearSurface& near);
// Moves the tip there and wakes what it may touch within `ahead` (m) more.
void go_to(const Vec3d& centre, double ahead, NearSurface& near);

// Whether none of four wakes on a path of that length.
inline bool asleep(const NearFour& four, double path) {
    return four.wake[0] > path && four.wake[1] > path && four.wake[2] > path && four.wake[3] > path;
}
// Four triangles as the tip sees them from where it is; then they sleep for as long as it is from touching them.
const FourWays& ways_to(const NearSurface& near, NearFour& four);

inline const NearFour& four_of(const NearSurface& near, uint32_t row) { return near.four[row / 4]; }
inline double offset_of(const NearSurface& near, uint32_t row) { return four_of(near, row).offset[row % 4]; }
inline double wake_of(const NearSurface& near, uint32_t row) { return four_of(near, row).wake[row % 4]; }
inline Vec3d corner_of(const NearSurface& near, uint32_t row, uint32_t k) {
    const auto& axis = four_of(near, row).corner[k];
    return {axis[0][row % 4], axis[1][row % 4], axis[2][row % 4]};
}
// Unit, outward; zero for a triangle without area.
const Vec3d& normal_of(NearSurface& near, uint32_t row);
TrianglePoint closest_on_row(const NearSurface& near, uint32_t row, const Vec3d& point);
inline const Triangle& vertices_of(const NearSurface& near, uint32_t row) { return near.model->triangle[near.triangle[row].triangle]; }
// The row of a triangle of the model; kNone while it sleeps.
uint32_t row_of(const NearSurface& near, uint32_t triangle);

// Motion of the surface where it is nearest to a point; none if nothing is nearer than `most` beyond touching.
struct SurfaceMotion {
    Vec3d velocity = Vec3d::Zero();  // m/s, of the model
    uint32_t body = kNone;
};
SurfaceMotion surface_motion(const Vec3d& point, double most, NearSurface& near);

}  // namespace trocar
