#pragma once
#include <array>
#include <vector>

#include "components/haptics.hpp"
#include "engine/geometry/four_points.hpp"
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
    std::array<FourPoints, 3> corner;  // m, world
    FourBoxes box;
};

// Runs of triangles of a tree, a lane each, and what bounds them: at the time of the model they lie in the boxes, and no
// vertex is faster than those say. Lanes left over are beyond everything.
struct FourRuns {
    FourBoxes box;
    FourBoxes velocity;  // m/s
    std::array<Range, 4> triangles{};  // of the model
    std::array<uint32_t, 4> node{};    // of the tree
};

// All runs of a tree that come nearer than `within` to a place until the model is 50 ms old: listed once for one who asks, whose point
// hardly goes farther than that until the next model.
struct RunsAround {
    uint32_t root = kNone;        // of the tree; kNone: not listed
    Vec3d place = Vec3d::Zero();  // m, world, had the surface not followed
    double within = 0;            // m
    Range fours;                  // rows of PlacedSurface::listed
};

// The triangles that were asked for at one moment, and what is known of where others are for longer.
struct PlacedSurface {
    struct Run {
        uint64_t stamp = 0;  // of the moment at which it was placed
        uint32_t first = 0;  // row of four
    };
    SurfaceMoment moment;
    uint64_t stamp = 0;
    std::vector<FourPlaced> four;  // run after run as they were asked for
    std::vector<Run> run;          // per node
    std::vector<RunsAround> around;  // of who asked
    std::vector<FourRuns> listed;
};

// What lies between runs of triangles and their tree while it is built.
struct SurfaceTreeScratch {
    std::vector<SurfaceNode> run;
    std::vector<uint32_t> order;
};

// Makes model.shell.node: per body a tree over runs of up to 16 triangles that follow each other, halved at the median
// along the longest axis. No allocation once warm.
void build_surface_trees(SurfaceTreeScratch& scratch, LocalContactModel& model);

// Root of the first tree is node 0; of the next, the one after it and all below.
inline uint32_t next_tree(const LocalContactModel& model, uint32_t root) { return model.shell.node[root].next; }
uint32_t tree_count(const LocalContactModel& model);

// Another model than before, with that many askers: forgets what was listed.
void begin_model(uint32_t askers, PlacedSurface& placed);
// Another moment.
void begin_moment(const LocalContactModel& model, const SurfaceMoment& moment, PlacedSurface& placed);

// Nearest triangle of one tree; on equal distances the lowest row. triangle == kNone if none is nearer than `reach` (m).
struct NearestTriangle {
    uint32_t triangle = kNone;
    TrianglePoint at;
    Vec3d point = Vec3d::Zero();  // m, world, on the triangle
};
// `hint`: a triangle likely to be near, or kNone; the answer does not depend on it.
// `asker`: less than begin_model was told, the same for points that move little between one question and the next; or kNone: likewise.
NearestTriangle find_nearest(const LocalContactModel& model, uint32_t root, const Vec3d& point, uint32_t hint,
                             double reach, PlacedSurface& placed, uint32_t asker = kNone);

// Speed (m/s) that no vertex of the triangles of a tree that are nearer than `around` (m) to a point at the model's time goes
// beyond.
double fastest_around(const LocalContactModel& model, uint32_t root, const Vec3d& point, double around);

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
SurfaceSide side_of(const LocalContactModel& model, const NearestTriangle& nearest, double before,
                    const PlacedSurface& placed);

}  // namespace trocar
