#pragma once
#include <span>
#include <vector>

#include "components/haptics.hpp"
#include "components/passed_surfaces.hpp"
#include "components/report.hpp"
#include "engine/haptics/local_contact_model.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// A ball inside a tool, axes of the tool.
struct CoreBall {
    Vec3d arm = Vec3d::Zero();  // m, from the tip to its centre
    double radius = 0;          // m
};

// Balls inside a tool that touch its surface from within: the tip's sphere, or with a point shell up to 16 that are not smaller
// than half of the largest, spread over the instrument without its jaws (the medial axis by shrinking balls: Ma, Bae & Choi, The
// Visual Computer 28, 2012).
void find_core(const HandTool& tool, std::vector<CoreBall>& core);

struct PassedSurfacesScratch {
    std::vector<std::vector<CoreBall>> core;     // per tool
    std::vector<const ShellPoint*> core_of;      // its points, of which the core is
    std::vector<Vec3d> end, normal, end_normal;  // per vertex of a model: at the end of the pass, unit normals
};

// Counts the surfaces of deformable bodies that went over the centre of a tool's core ball in the pass, from either side: that of
// a shell that has folded comes from behind. Over balls of less than 0.2 mm only closed surfaces that go on until they are 0.2 mm
// from its front, from the front: what overlaps less is contact's to resolve. Exact for linear motion between both ends of the
// pass (first_passing). `begin`: s, of the pass; a model of another one says nothing of it. Not counted: bodies that the tool
// pierces by intent (pass_through), and while one lets it go.
void find_passed_surfaces(double begin, const Surfaces& surfaces, std::span<const LocalContactModel> models, const Haptics& haptics,
                          PassedSurfacesScratch& scratch, PassedSurfaces& passed, Report& report);

}  // namespace trocar
