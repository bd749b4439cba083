#pragma once
#include <span>
#include <vector>

#include "components/paths.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
#include "engine/haptics/local_contact_model.hpp"
#include "engine/haptics/surface_tree.hpp"
#include "engine/mesh/surfaces.hpp"
#include "systems/haptics/contact/proxy.hpp"
namespace trocar {

struct RingSum {
    Vec3d sum = Vec3d::Zero();  // m/s
    double count = 0;
};

struct LocalContactScratch {
    std::vector<uint8_t> beyond;           // per vertex of the present body: sides of the box around all boxes that it stays beyond
    std::vector<uint64_t> beyond_each;     // likewise, one byte per box, for the vertices tested
    std::vector<uint8_t> wanted;           // per triangle of the present body: may come to a box
    std::vector<uint32_t> vertex_index;    // local vertex of the present body -> index in the model; kNone between bodies
    std::vector<uint32_t> triangle_index;  // the same for triangles
    std::vector<uint32_t> triangle_used;   // local triangles of the present body that are in the model
    std::vector<RingSum> around;           // per vertex of the present body that is in the model: sum over the triangles around it
    SurfaceTreeScratch tree;               // for tools with a shell
    PlacedSurface placed;
    std::vector<ShellPoint> open;  // points of a tool with jaws
    HapticScratch proxy;           // of a tip that rests on the surface
};

// The contact pass that a model is of.
struct ModelPass {
    double time = 0;        // s
    uint64_t sequence = 0;  // its number
    double period = 0;      // s, until the next one
    bool in_hand = true;    // the tool is
};

// Copies every triangle that a tool may touch while the model is in use: those of other bodies that may come nearer
// to the segment from device to proxy than the tool travels in params.greatest_age (a conservative test by boxes).
// Vertex velocities are copied too; those of tissue are limited to the speed of tools, then averaged twice over the
// triangles around a vertex. `boxes`: a world box around each body, or empty to test all bodies. Bodies ascend,
// triangles ascend within a body, vertices are in the order of first use. For a tool with a point shell, its points
// at the present and at the device's pose replace the segment, and the point-shell cache is computed too. No
// allocation once warm.
void publish_local_contact(const HapticParams& params, const Surfaces& surfaces, std::span<const Box> boxes, const HandTool& tool,
                           const ToolState& state, const ModelPass& pass, LocalContactScratch& scratch, LocalContactModel& out,
                           std::span<const ToolJaw> jaws = {});

// Sets the velocities of scripted bodies to their mean until the next pass, `period` s away: a model extrapolated with
// them leads to where the bodies will be, also where they start or stop on the way.
void foresee_paths(const Paths& paths, double time, double period, std::span<const uint8_t> off, Poses& poses);

// The part that only tools with a point shell need, model.point_shell (point-shell cache), from the rest of the
// model: trees, the pose of the shell, and the distance of every point from every tree.
void publish_point_shell_cache(const HapticParams& params, const HandTool& tool, const ToolState& state, LocalContactScratch& scratch,
                               LocalContactModel& out);

// Compliance prediction: motion, until the next pass, of the surface of the deformable or free body that a
// tool presses.
// - Around the simulated tip, tissue moves with the tip, dent included. Single vertex velocities do not
//   describe this: under a sliding tip the surface ahead is at rest until it is reached, and the surface
//   behind springs back.
// - The surface continues to yield by the fraction of the device's displacement along the force that the tip
//   covered since the preceding pass; by none if the device moved less than 0.1 mm or mostly along the
//   surface. Linear in position, so valid for any motion of the hand (Mark et al., SIGGRAPH 1996; Picinbono &
//   Lombardo 1999), unlike a force extrapolated in time.
// - The gap is the separation that contacts left between the tip, or the points of a shell, and the surface
//   in contact. Of a tip, whose mesh may have facets and which may rest on several places, it is that with which
//   the proxy of the next tick rests as high as the simulated tip.
// None of this without contact, or while the simulated tip lags behind the device's and is farther than 0.5
// mm from the surface; a tool with a point shell uses fraction and gap only. Finally stores this pass in
// state.last_pass for the next one.
void publish_compliance(const Surfaces& surfaces, const HandTool& tool, ToolState& state, LocalContactScratch& scratch,
                        LocalContactModel& out);
// That fraction: displacement of the tip (m) over displacement of the device (m), along a unit normal.
double give_share(const Vec3d& normal, const Vec3d& tip_travel, const Vec3d& device_travel);

// Computes model.group, model.block, their bounds and model.fastest from the rest of a model: groups are runs
// of triangles of one body, blocks are runs of groups.
void group_triangles(LocalContactModel& model);

}  // namespace trocar
