#pragma once
#include <span>
#include <vector>

#include "components/haptics.hpp"
#include "engine/surface_tree.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

struct RingSum {
    Vec3d sum = Vec3d::Zero();  // m/s
    double count = 0;
};

struct LocalContactScratch {
    std::vector<uint8_t> beyond;          // per vertex of the body at hand: sides of the box around all that it lies beyond
    std::vector<uint64_t> beyond_each;    // likewise, a byte a box, of those that were asked for
    std::vector<uint8_t> wanted;          // per triangle of the body at hand: not beyond
    std::vector<uint32_t> vertex_row;     // local vertex of the body at hand -> row of the model; kNone between bodies
    std::vector<uint32_t> triangle_row;   // the same for triangles
    std::vector<uint32_t> triangle_used;  // local triangles of the body at hand that are in the model
    std::vector<RingSum> around;          // per vertex of the body at hand that is in the model: over the triangles around it
    SurfaceTreeScratch tree;              // for tools with a shell
    PlacedSurface placed;
    std::vector<ShellPoint> open;  // points of a tool with jaws
};

// The contact pass that a model is of.
struct ModelPass {
    double time = 0;        // s
    uint64_t sequence = 0;  // its number
    double period = 0;      // s, until the next one
    bool in_hand = true;    // the tool is
};

// Copies every triangle that a tool may touch before the next passes: those of all bodies but its own that may come nearer
// to the segment from the device to the proxy than the tool travels in params.greatest_age (told by boxes, so a few more),
// with their vertex velocities: of tissue each the mean over the triangles around it, twice, none faster against the rest
// than tools go. `boxes`: one world box per body that holds it, or empty for "look at all". Bodies ascend, triangles ascend within
// a body, vertices in the order of first use. For a tool with a
// shell all points of it, where they are and where the device would have them, take the place of the segment; its trees and
// what lies around every point are found besides. No allocation once warm.
void publish_local_contact(const HapticParams& params, const Surfaces& surfaces, std::span<const Box> boxes, const HandTool& tool,
                           const ToolState& state, const ModelPass& pass, LocalContactScratch& scratch, LocalContactModel& out,
                           std::span<const ToolJaw> jaws = {});

// The part of it that only tools with a shell need, model.shell, from the rest: trees, where the shell is, and how near
// every point of it is to every tree.
void publish_outlook(const HapticParams& params, const HandTool& tool, const ToolState& state, LocalContactScratch& scratch,
                     LocalContactModel& out);

// How the surface of the deformable or free body that a tool presses goes on until the next pass:
// - around the simulated tip tissue goes where that goes, dent and all. The velocities of single vertices do not say so: under
//   a tip that slides, what lies ahead is at rest until it is met, and what was passed springs back.
// - The share of the device's way along the force that the tip went since the pass before is what it goes on to give way
//   by; none when the device moved less than 0.1 mm or mostly along the surface. Linear in position, so that it holds
//   whatever the hand does next (Mark et al., SIGGRAPH 1996; Picinbono & Lombardo 1999), unlike a force drawn on in time.
// - The gap is what contacts left between the tip, or the points of a shell, and the surface that carries it.
// Nothing of it without contact, or while the simulated tip lags the device's behind and is farther than 0.5 mm from the
// surface; of a tool with a shell share and gap alone. Then keeps this pass in state.last_pass for the next one.
void publish_give(const Surfaces& surfaces, const HandTool& tool, ToolState& state, LocalContactScratch& scratch, LocalContactModel& out);
// The share alone: what the tip moved (m) against what the device moved (m), along a unit normal.
double give_share(const Vec3d& normal, const Vec3d& tip_way, const Vec3d& device_way);

// Makes model.group, model.block, their bounds and model.fastest from the rest of a model: groups are runs of triangles of one
// body, blocks are runs of groups.
void group_triangles(LocalContactModel& model);

}  // namespace trocar
