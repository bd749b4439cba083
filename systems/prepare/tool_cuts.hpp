#pragma once
#include <memory>
#include <span>

#include "components/actions.hpp"
#include "components/haptics.hpp"
#include "components/report.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/body_energy.hpp"
#include "engine/tissue/cut_solid_setup.hpp"
namespace trocar {

// What cuts change. No other body's elements move.
struct CutWorld {
    const Bodies& bodies;
    Actions& actions;  // what heat needs of the surface that is cut
    std::span<const HandTool> tools;
    Vec3d gravity;       // m/s^2
    double period = 0;   // s, of the pass
    bool links = false;  // a later stage notes the forces of links and threads on the tools
    Poses& poses;        // velocities of the tools
    Particles& particles;
    Meshes& meshes;
    Springs& springs;
    Solids& solids;
    Anchors& anchors;
    std::span<std::unique_ptr<ClosestPointTree>> trees;
    std::span<ToolState> states;
    ActionState& state;
    Sleep& sleep;
    Energy& energy;
};

// Parts the surfaces and solids that the edges of cutting tools swept through since the last pass, while their triggers are
// pulled (act has followed them): see cut_surface and cut_lattice. Mass is conserved: vertices share that of their triangles,
// nodes that of the parts of their tetrahedra. New particles move with the edge that they split, or the node that they were copied
// from. The elastic, kinetic and anchor energy that changes is in the accounting (work_links). The work of the new surface,
// toughness times area, is taken from the tool's motion, what that cannot give at once from the next passes, and from the next
// stroke what is owed when one ends: it enters as work of the hand and leaves as work_cuts, and the hand feels its mean force. A cut
// beyond the reserved elements is not made, and counted.
void cut_with_tools(const CutWorld& world);

}  // namespace trocar
