#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/haptic_surface.hpp"
#include "components/math.hpp"
#include "components/mesh.hpp"
#include "components/tool_state.hpp"
#include "engine/haptics/point_shell_cache.hpp"
#include "engine/haptics/triangle_groups.hpp"
namespace trocar {

// Compliance prediction: how a pressed surface follows the device that presses it, until the next contact
// pass updates its position.
struct SurfaceCompliance {
    uint32_t body = kNone;                  // body whose surface this is; kNone: no surface follows
    double share = 0;                       // fraction of the device's displacement along the normal, 0..1
    Vec3d normal = Vec3d::Zero();           // unit
    Vec3d device = Vec3d::Zero();           // m, device position ...
    Vec3d device_velocity = Vec3d::Zero();  // m/s, how it moved ...
    double time = 0;                        // s, ... and the time of it
    double gap = 0;                         // m, along the normal from contact to the simulated tip: contacts keep it slightly
                                            // above the surface, or let it penetrate
    Vec3d slip = Vec3d::Zero();             // m, across the normal, from the proxy to the simulated tip
    TROCAR_FIELDS(body, share, normal, device, "m", device_velocity, "m/s", time, "s", gap, "m", slip, "m");
};

// Surface near a tool, frozen at one contact pass. Immutable once published; the tick reads nothing else.
struct LocalContactModel {
    double time = 0;             // s, of the positions
    uint64_t sequence = 0;       // contact pass that made it, from 1; 0 = not yet made
    Vec3d from = Vec3d::Zero();  // m, world: contains every surface closer than reach to the segment from -> to
    Vec3d to = Vec3d::Zero();    // m
    double reach = 0;            // m, from the segment; 0 = not searched yet
    double fastest = 0;          // m/s, of its vertices
    SurfaceCompliance compliance;
    // N, of links on the simulated tool, mean over the last contact pass and over the one before. The hand
    // feels an interpolation from one to the other during the next pass: no jump, one pass late.
    Vec3d pull = Vec3d::Zero(), pull_before = Vec3d::Zero();
    double period = 0;            // s, of a pass
    std::vector<Vec3d> position;  // m, world
    std::vector<Vec3d> velocity;  // m/s
    std::vector<Triangle> triangle;
    std::vector<std::array<uint32_t, 3>> neighbour;  // kNone where the patch ends
    std::vector<uint32_t> body;                      // per triangle
    std::vector<uint32_t> source;                    // per triangle: its index in the body's mesh
    std::vector<TriangleLanes> lanes;                // one per group
    std::vector<TriangleGroup> group;                // all triangles, grouped in contiguous runs
    std::vector<TriangleGroup> block;                // all groups in contiguous runs
    std::vector<TriangleGroup> cluster;              // all blocks in contiguous runs
    std::vector<GroupBalls> ball;                    // one per block
    std::vector<GroupBalls> cluster_ball;            // one per cluster
    std::vector<double> half_thickness;              // m, per triangle; > 0: a sheet, which stops the tool on both
                                                     // sides; 0: of a closed body
    PointShellCache point_shell;                     // of a tool with a point shell
    std::vector<HapticSurface> surface;              // of bodies with surface properties other than the tool's
    bool in_hand = true;                             // false: the tool was exchanged for another instrument
    ToolExit exit;                                   // of a tool inside a body
    bool placed = false;                             // the next two members are known
    Vec3d tip = Vec3d::Zero();                       // m, of the simulated tool, where a proxy starts
    Quat turn;                                       // of it
    TROCAR_FIELDS(time, "s", sequence, from, "m", to, "m", reach, "m", fastest, "m/s", position, "m", velocity, "m/s", triangle, neighbour,
                  body, source, half_thickness, "m", lanes, group, block, cluster, ball, cluster_ball, compliance, pull, "N", pull_before,
                  "N", period, "s", point_shell, surface, in_hand, exit, placed, tip, "m", turn);
};

}  // namespace trocar
