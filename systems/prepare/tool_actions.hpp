#pragma once
#include <span>

#include "components/actions.hpp"
#include "components/haptics.hpp"
#include "components/nodes.hpp"
#include "components/spawning.hpp"
#include "engine/tissue/links.hpp"
namespace trocar {

// Inputs of what instruments do in a contact pass.
struct ActionPass {
    double now = 0;  // s, at the start of the pass
    LinkWorld world;
    std::span<const HandTool> tools;
    std::span<const ToolJaw> jaws;
    std::span<const ToolState> states;
    const Actions& actions;
    const SpawnState* spawning = nullptr;   // bodies that are away are not acted on; or null
    const NodeState* node_state = nullptr;  // nor are those of disabled nodes; or null
    const Nodes* nodes = nullptr;           // bodies with one degree of freedom are not grasped; or null
    double period = 0;                      // s, of a pass
};

// Follows the triggers of all actions. Where that of a staple is pulled, joins the two surfaces that are nearest to
// its point: the nearest deformable one is held by the other, with one link between the nearest nodes (a rigid body
// is held where that node is), which breaks at pull_out. Both must be within reach, and the tool pressed with `press`;
// else, or with an empty magazine, it is a misfire. Forgets staples that were pulled out. Stapled bodies wake up.
// While that of a grasp is pulled, the tool holds every body whose surface is within reach of its point: nodes of a
// deformable one within reach, at least the nearest, by links; a free rigid one as systems/advance/rigid/grasped_bodies.hpp
// says. A deformable body that pulls with more than 2 friction press_force, mean over a pass, and a rigid one that has slid
// farther than the reach slip out. A grasp that finds nothing is a misfire.
void act(const ActionPass& pass, LinkScratch& scratch, ActionState& state, Links& links, Sleep& sleep, Energy& energy);

inline void wake_body(Sleep& sleep, uint32_t body) {
    if (body < sleep.still.size()) sleep.still[body] = 0;
}

// The nearest point of a body's surface, at most `reach` (m) from a point of the world; distance infinite if there is
// none. Rigid bodies by their trees, deformable ones by their present triangles.
struct StapledSurface {
    uint32_t body = kNone;
    double distance = std::numeric_limits<double>::infinity();  // m
};
StapledSurface nearest_surface(const LinkWorld& world, uint32_t body, const Vec3d& point, double reach);

}  // namespace trocar
