#pragma once
#include <array>
#include <vector>

#include "engine/geometry/four_triangles.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/haptics/local_contact_model.hpp"
namespace trocar {

// Time of evaluation of a local contact model: positions + age * velocities, plus `follow` for the yielding
// body.
struct SurfaceMoment {
    double age = 0;  // s
    uint32_t follower = kNone;
    Vec3d follow = Vec3d::Zero();  // m
};

// Four boxes, one per lane.
struct FourBoxes {
    FourPoints low, high;  // m, world
};

// Up to four triangles of a run at one time, one per lane; unused lanes repeat the last one.
struct FourPlaced {
    FourTriangles corner;  // m, world
    FourBoxes box;
};

// A node at one time, without compliance prediction.
struct NodePlaced {
    FourBoxes box;
    std::array<Range, 4> part{};  // as of SurfaceNode
    uint32_t lanes = 0;
};

// The nodes and triangles evaluated at one time: neighbouring points use the same ones.
struct PlacedSurface {
    struct Slot {
        uint64_t stamp = 0;  // identifies the time at which it was placed
        uint32_t first = 0;  // index of the placed data
    };
    SurfaceMoment moment;
    uint64_t stamp = 0;
    std::vector<NodePlaced> node;  // the first `nodes` elements, in the order of evaluation
    std::vector<FourPlaced> four;  // the first `fours` elements, likewise run after run
    uint32_t nodes = 0, fours = 0;
    std::vector<Slot> node_slot;  // per node
    std::vector<Slot> run;        // per lane of a node
};

// Consecutive triangles with their bounds.
struct TriangleRun {
    Box box;           // m, world
    Box velocity;      // m/s, of the vertices
    double speed = 0;  // m/s, of the fastest of them
    Range triangles;
};

// Working memory of a tree under construction.
struct SurfaceTreeScratch {
    std::vector<TriangleRun> run;
    std::vector<uint32_t> order;
};

// Builds model.point_shell.node and .tree: per body a tree over runs of up to 16 consecutive triangles, halved at
// the median along the longest axis, two halvings per node. No allocation once warm.
void build_surface_trees(SurfaceTreeScratch& scratch, LocalContactModel& model);

// Moves the surfaces to another time.
void begin_moment(const LocalContactModel& model, const SurfaceMoment& moment, PlacedSurface& placed);

// Nearest triangle of one tree; ties go to the lowest index. triangle == kNone beyond `reach` (m).
struct NearestTriangle {
    uint32_t triangle = kNone;
    TrianglePoint at;
    Vec3d point = Vec3d::Zero();  // m, world, on the triangle
};
// `hint`: a triangle likely to be near, or kNone; the result does not depend on it.
NearestTriangle find_nearest(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, uint32_t hint, double reach,
                             PlacedSurface& placed);

// The result of find_nearest, and up to eight triangles within `around` (m) of the nearest.
NearestTriangle find_nearest_around(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, uint32_t hint,
                                    double reach, double around, PlacedSurface& placed, TrianglesAround& found);
// The result of find_nearest from triangles that find_nearest_around found earlier. Point and surface have
// moved at most `gone` (m) in sum since then, except triangles that are not nearer than `far` (m). False if a
// triangle outside that set may now be nearer.
bool nearest_of(const LocalContactModel& model, const TrianglesAround& found, const Vec3d& point, double gone, double far, double reach,
                const PlacedSurface& placed, NearestTriangle& nearest);

// Upper bound (m/s) on the speed of those triangles of a tree that may come nearer than `around` (m) to a
// point within `ahead` (s) before or after the model's time, each moving in a straight line at the speed of
// its fastest vertex.
double fastest_around(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, double around, double ahead);

// A point relative to its nearest triangle: signed distance (m, negative inside a closed body or within a
// sheet's thickness) and separation direction.
struct SurfaceSide {
    double distance = 0;
    Vec3d normal = Vec3d::Zero();    // unit: the gradient of the distance
    Vec3d velocity = Vec3d::Zero();  // m/s, of the surface of the model at that point
    double side = 1;                 // for a sheet: the side of the point, 1 if that of its triangles' normals
};
// Sign by the angle-weighted pseudonormal (Baerentzen & Aanaes, TVCG 11(3), 2005). A sheet has no inside: the
// point stays on its side `before` (1 or -1), or on the present one (0); its rim acts as a wire.
SurfaceSide side_of(const LocalContactModel& model, const NearestTriangle& nearest, double before, const PlacedSurface& placed);

}  // namespace trocar
