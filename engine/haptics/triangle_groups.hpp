#pragma once
#include <array>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Corners of the triangles of a group, one lane per triangle: after s seconds a corner has moved by s
// velocity. Lanes without a triangle are placed kFarLane away.
inline constexpr uint32_t kGroupTriangles = 8, kBlockGroups = 16;
using GroupLanes = std::array<float, kGroupTriangles>;
using BlockLanes = std::array<float, kBlockGroups>;
inline constexpr float kFarLane = 1e9F;  // m
struct TriangleLanes {
    std::array<std::array<GroupLanes, 3>, 3>
        corner{};  // m, by corner and world axis, from the centre of the group, at the time of the model
    std::array<std::array<GroupLanes, 3>, 3> velocity{};  // m/s, likewise, relative to the group
    TROCAR_FIELDS(corner, "m", velocity, "m/s");
};
// Balls around the groups of a block, or the blocks of a cluster: after s seconds the whole group is within
// radius + spread |s| of its centre, which has moved by s velocity.
struct GroupBalls {
    std::array<BlockLanes, 3> centre{};    // m, world axes, from the centre of the block, at the time of the model
    std::array<BlockLanes, 3> velocity{};  // m/s, relative to the block
    BlockLanes radius{};                   // m; -infinity: no group
    BlockLanes spread{};                   // m/s
    BlockLanes speed{};                    // m/s, upper bound on every speed in it
    TROCAR_FIELDS(centre, "m", velocity, "m/s", radius, "m", spread, "m/s", speed, "m/s");
};
// Relative rounding error of the lanes, with respect to the sum of the lengths involved: distance from the
// centre of the group or block to the query point, its radius and its spread.
inline constexpr double kLaneRounding = 4e-6;

// Neighbouring triangles of a body in a local contact model with a ball around them; or neighbouring groups,
// or neighbouring blocks.
struct TriangleGroup {
    Range triangles;  // range of triangle; in a block, of group; in a cluster, of block
    uint32_t body = kNone;
    double half_thickness = 0;       // m, see LocalContactModel
    Vec3d centre = Vec3d::Zero();    // m, world, at the time of the model
    double radius = 0;               // m
    Vec3d velocity = Vec3d::Zero();  // m/s, mean of the corners
    double spread = 0;               // m/s, largest deviation of a corner's velocity from the mean
    TROCAR_FIELDS(triangles, body, half_thickness, "m", centre, "m", radius, "m", velocity, "m/s", spread, "m/s");
};

}  // namespace trocar
