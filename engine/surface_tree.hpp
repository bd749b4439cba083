#pragma once
#include <array>
#include <vector>

#include "components/haptics.hpp"
#include "engine/geometry/four_triangles.hpp"
#include "engine/geometry/point_triangle.hpp"
namespace trocar {

// When a local contact model is looked at: positions + age * velocities, those of one body `follow` beyond that.
struct SurfaceMoment {
    double age = 0;  // s
    uint32_t follower = kNone;
    Vec3d follow = Vec3d::Zero();  // m
};

// Boxes side by side, a lane each.
struct FourBoxes {
    FourPoints low, high;  // m, world
};

// Up to four triangles of a run where they are at a moment, a lane each; lanes left over repeat the last one.
struct FourPlaced {
    FourTriangles corner;  // m, world
    FourBoxes box;
};

// A node where it is at a moment, had its parts not followed.
struct NodePlaced {
    FourBoxes box;
    std::array<Range, 4> part{};  // as of SurfaceNode
    uint32_t lanes = 0;
};

// The nodes and triangles that were asked for at one moment: points that lie together ask for the same ones.
struct PlacedSurface {
    struct Row {
        uint64_t stamp = 0;  // of the moment at which it was placed
        uint32_t first = 0;  // row of what was placed
    };
    SurfaceMoment moment;
    uint64_t stamp = 0;
    std::vector<NodePlaced> node;  // the first `nodes` of them, as they were asked for
    std::vector<FourPlaced> four;  // the first `fours` of them, run after run likewise
    uint32_t nodes = 0, fours = 0;
    std::vector<Row> node_row;  // per node
    std::vector<Row> run;       // per lane of a node
};

// Triangles that follow each other, and what bounds them.
struct TriangleRun {
    Box box;           // m, world
    Box velocity;      // m/s, of the vertices
    double speed = 0;  // m/s, of the fastest of them
    Range triangles;
};

// What lies between runs of triangles and their tree while it is built.
struct SurfaceTreeScratch {
    std::vector<TriangleRun> run;
    std::vector<uint32_t> order;
};

// Makes model.shell.node and .tree: per body a tree over runs of up to 16 triangles that follow each other, halved at the
// median along the longest axis, two halvings a node. No allocation once warm.
void build_surface_trees(SurfaceTreeScratch& scratch, LocalContactModel& model);

// Puts the surfaces where they are at another moment.
void begin_moment(const LocalContactModel& model, const SurfaceMoment& moment, PlacedSurface& placed);

// Nearest triangle of one tree; on equal distances the lowest row. triangle == kNone if none is nearer than `reach` (m).
struct NearestTriangle {
    uint32_t triangle = kNone;
    TrianglePoint at;
    Vec3d point = Vec3d::Zero();  // m, world, on the triangle
};
// `hint`: a triangle likely to be near, or kNone; the answer does not depend on it.
NearestTriangle find_nearest(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, uint32_t hint, double reach,
                             PlacedSurface& placed);

// The answer of find_nearest, and the triangles within `around` (m) of the nearest or as near as eight of them.
NearestTriangle find_nearest_around(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, uint32_t hint,
                                    double reach, double around, PlacedSurface& placed, TrianglesAround& found);
// The answer of find_nearest from triangles that find_nearest_around found before. The point and the surface went no farther
// than `gone` (m) in sum since; triangles that are not nearer than `far` (m) may have gone farther. False if one that was not
// found then may be nearer.
bool nearest_of(const LocalContactModel& model, const TrianglesAround& found, const Vec3d& point, double gone, double far, double reach,
                const PlacedSurface& placed, NearestTriangle& nearest);

// Speed (m/s) of the fastest of a tree's triangles that may come nearer than `around` (m) to a point within `ahead` (s) before
// or after the model's time, each in a straight line at the speed of its fastest vertex, or a bound on it.
double fastest_around(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, double around, double ahead);

// A point beside its nearest triangle: signed distance (m, negative inside a closed body or within a sheet's thickness)
// and the way out.
struct SurfaceSide {
    double distance = 0;
    Vec3d normal = Vec3d::Zero();    // unit: the gradient of the distance
    Vec3d velocity = Vec3d::Zero();  // m/s, of the surface there, of the model
    double side = 1;                 // of a sheet that the point belongs to; 1: where the normals of its triangles point
};
// Sign by the angle-weighted pseudonormal (Baerentzen & Aanaes, TVCG 11(3), 2005). A sheet has no inside: it keeps the
// point on the side `before` that it was on (1 or -1), or where it is (0); round its rim it is a wire.
SurfaceSide side_of(const LocalContactModel& model, const NearestTriangle& nearest, double before, const PlacedSurface& placed);

}  // namespace trocar
