#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "components/mesh.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/haptics/local_contact_model.hpp"
namespace trocar {

inline constexpr double kSkin = 1e-9;  // m, the sweep stops this far inside the planes, so that sliding along a plane
                                       // is never taken for hitting it
inline constexpr double kHair = 1e-9;  // m, groups wake this much earlier than their distance requires

// Surfaces of a model at a time: positions + age * velocities, plus `follow` for the yielding body.
struct SurfaceTime {
    double age = 0;                // s
    Vec3d follow = Vec3d::Zero();  // m
};

// Group of the model with a triangle that a tip may reach in a tick.
struct NearGroup {
    uint32_t group = 0;  // index in the model
    uint32_t body = kNone;
    uint32_t seen = kNone;  // NearSurface::places when it was evaluated; kNone: not yet
    double offset = 0;      // m, tip radius + half thickness: contact distance of the tip's centre
    double wake = 0;        // m, length of the tip's path before which none of its triangles is in contact
};

// The triangles of a group as seen from a tip position, one per lane.
struct alignas(32) GroupSight {
    GroupLanes distance;               // m
    std::array<GroupLanes, 3> offset;  // m, from the tip to the nearest point
    GroupLanes doubt;                  // m, error bound on distance and point
    Vec3d at;                          // m, the tip position
    GroupSight() {}                    // left uninitialised: zeroing would take as long as the evaluation that fills it
};

// A triangle evaluated in double precision.
struct NearTriangle {
    uint32_t triangle = 0;  // of the model
    uint32_t body = kNone;
    bool sheet = false;
    bool has_normal = false;
    bool held = false;                       // its plane is among the planes of the present step
    uint32_t touch = 0;                      // index into HapticScratch::touched, if that element refers to this triangle
    double offset = 0;                       // m, as NearGroup
    std::array<Vec3d, 3> corner;             // m
    std::array<float, 3> angle{-1, -1, -1};  // rad, approximate, at its corners; negative until computed
    Vec3d normal = Vec3d::Zero();            // see normal_of
};

// Triangle of a group relative to a tip along a step from its position.
struct TriangleAhead {
    uint32_t triangle = 0;  // of the model
    double least = 0;       // m, lower bound on the distance from the tip's centre; negative where every triangle is evaluated
    double from = 0;        // fraction of the step before which it is not in contact
};

// The triangles that a tip may reach in a tick. Groups that it cannot reach within some distance sleep for
// that distance. The others are evaluated in float, eight triangles at a time, which selects the few to be
// evaluated in double. That saves time and never changes a result.
struct NearSurface {
    std::vector<NearGroup> group;          // ascending
    std::vector<GroupSight> sight;         // of each group, since it was evaluated
    std::vector<NearTriangle> triangle;    // evaluated in double, in this order
    std::vector<TriangleAhead> ahead;      // see find_within, find_ahead
    std::vector<uint32_t> triangle_index;  // per triangle of the models: index into `triangle`, valid if that element refers back
    Vec3d at = Vec3d::Zero();              // m, the tip's centre
    uint32_t triangle_count = 0;           // positions since the groups were gathered, including the present one
    double path = 0;                       // m, path length since the groups were placed
    double tip_radius = 0;                 // m
    SurfaceTime time;
    const LocalContactModel* model = nullptr;  // of this tick
    uint32_t found = 0;                        // triangles found by the last call of find_within or find_ahead
    uint32_t asked = 0;                        // features in contact and sweeps (each counted as several) since the groups were gathered
    bool ask_all = false;                      // tests: evaluate every triangle of the model in double
};

// Bound on the speed (m/s) of the surfaces that may come within `travel` (m) of contact with a tip at
// `centre`.
double fastest_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel);
// Gathers the groups of triangles, at that time, that a tip may touch within `travel` (m) of `centre`.
void gather_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel,
                 NearSurface& near);
// Moves the tip there.
void go_to(const Vec3d& centre, NearSurface& near);

// Fills near.ahead with the triangles that may be within `beyond` (m) of contact at the tip, ascending.
void find_within(double beyond, NearSurface& near);
// Fills near.ahead with the triangles that may come into contact along a step and are not certainly in
// contact now, ascending. The distance from a triangle is convex along the step, so it is above its tangents.
void find_ahead(const Vec3d& step, NearSurface& near);

// Index of a triangle of the model among the evaluated ones; evaluates it if necessary.
uint32_t ask_for(NearSurface& near, uint32_t triangle);
// Index of an evaluated triangle; else kNone.
uint32_t index_of(const NearSurface& near, uint32_t triangle);
inline double offset_of(const NearSurface& near, uint32_t index) { return near.triangle[index].offset; }
inline const Vec3d& corner_of(const NearSurface& near, uint32_t index, uint32_t k) { return near.triangle[index].corner[k]; }
// Unit, outward; zero for a triangle of zero area.
const Vec3d& normal_of(NearSurface& near, uint32_t index);
TrianglePoint closest_on_triangle(const NearSurface& near, uint32_t index, const Vec3d& point);
inline const Triangle& vertices_of(const NearSurface& near, uint32_t index) { return near.model->triangle[near.triangle[index].triangle]; }

// The nearest triangle to a point, among those nearer than `most` (m) to contact; ties go to the first in the model.
struct NearestIndex {
    uint32_t index = kNone;
    TrianglePoint at;
};
NearestIndex nearest_within(const Vec3d& point, double most, NearSurface& near);

// Barycentric weights of a point of a triangle.
Vec3d weights_at(const std::array<Vec3d, 3>& corner, const Vec3d& point);

// A triangle of a body in a model at a time; not found beyond the model's reach.
struct TrianglePlaced {
    bool found = false;
    std::array<Vec3d, 3> corner;  // m
    Vec3d at(const Vec3d& weight) const { return weight[0] * corner[0] + weight[1] * corner[1] + weight[2] * corner[2]; }
};
TrianglePlaced place_anchor(const LocalContactModel& model, const SurfaceTime& at, const ContactAnchor& anchor);

// Velocity of the surface at its closest point to a point; none if nothing is nearer than `most` to contact.
struct SurfaceMotion {
    Vec3d velocity = Vec3d::Zero();  // m/s, of the model
    uint32_t body = kNone;
    ContactAnchor anchor;
};
SurfaceMotion surface_motion(const Vec3d& point, double most, NearSurface& near);

}  // namespace trocar
