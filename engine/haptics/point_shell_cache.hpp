#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Up to four parts of a surface, one per lane, with their boxes at the time of the model, rounded outwards.
// Small, because a tick searches hundreds of nodes.
struct alignas(64) SurfaceNode {
    using Lanes = std::array<float, 4>;
    std::array<Lanes, 3> low{}, high{};                    // m, world, by axis
    std::array<Lanes, 3> velocity_low{}, velocity_high{};  // m/s, of the vertices
    std::array<Range, 4> part{};                           // ranges of LocalContactModel::triangle; empty: `first` is a node
    Lanes speed{};                                         // m/s, of the fastest of the vertices
    uint32_t lanes = 0;                                    // number of lanes with a part
    TROCAR_FIELDS(low, "m", high, "m", velocity_low, "m/s", velocity_high, "m/s", speed, "m/s", part, lanes);
};

// Tree of nodes over a body's surface in a model.
struct SurfaceTree {
    uint32_t body = kNone;
    uint32_t root = 0;          // node
    double half_thickness = 0;  // m, of a sheet, or 0
    TROCAR_FIELDS(body, root, half_thickness, "m");
};

// Triangles of one tree around a point, nearest first. While neither the point nor the surface has moved far,
// one of them remains the nearest.
struct TrianglesAround {
    std::array<uint32_t, 8> triangle{kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};  // indices; kNone where there are fewer
    std::array<double, 2> others{};  // m, lower bounds: all but the first four were at least this far away, all but these eight
};

// Point-shell cache: the surface around a point shell when its model was made.
struct PointShellCache {
    Vec3d tip = Vec3d::Zero();  // m, world, position of the shell at that time
    Quat turn;
    double grip = 0;  // rad
    std::vector<SurfaceNode> node;
    std::vector<SurfaceTree> tree;       // one per body
    std::vector<double> clear;           // m, per tree and shell point: lower bound on the distance to the surface; 0: possibly inside
    std::vector<uint32_t> nearest;       // likewise: nearest triangle of the model, or kNone if none is within reach
    std::vector<TrianglesAround> found;  // likewise, at the time of the model; none if no surface was near. An
                                         // accelerator: results do not depend on it
    std::vector<Vec3d> position;         // m, world, per shell point: its position at that time
    std::vector<double> speed;           // m/s, per tree and point: upper bound on the speed of surface within
                                         // `around` of that position ...
    double around = 0;                   // m, ...
    double ahead = 0;                    // s, ... valid up to this age of the model while it is extrapolated
    TROCAR_FIELDS(tip, "m", turn, grip, "rad", node, tree, clear, "m", nearest, position, "m", speed, "m/s", around, "m", ahead, "s");
    TROCAR_OTHER_FIELDS(found);
};

}  // namespace trocar
