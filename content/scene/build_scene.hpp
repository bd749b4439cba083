#pragma once
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "content/scene/scene_file.hpp"
#include "content/shapes/looks.hpp"
#include "engine/world/add_body.hpp"
namespace trocar {

// To build a world in code, call in this order: make_prototype; add_body, and set the pose; make_deformable or
// set_rigid_mass for bodies moved by forces; links; make_trees after all bodies; find_fault; Frame. Bodies are added
// to a running Frame in the same order between two passes, with make_trees again at the end.

// Makes springs, particles and anchors of a deformable body at its pose (engine/tissue/deformable_setup.hpp);
// vertices whose rest z (m, body frame) is below `fixed_below` are fixed.
void make_deformable(World& world, uint32_t body, double fixed_below = -std::numeric_limits<double>::infinity());

// Makes the closest-point trees: one per deformable body, one per prototype for all its rigid bodies. Call it
// after all prototypes and bodies, and again after adding more: trees point into arrays that may reallocate.
void make_trees(World& world);

// A scene ready to run: the world, camera and picture settings, and notes on its meshes.
struct BuiltScene {
    World world;
    Camera camera;
    PictureParams picture;
    std::vector<std::string> notes;  // one line per body: its kind and what the import changed
    std::vector<std::string> warnings;
};

// Loads or generates every mesh of a scene, cleans and judges it, and places the bodies. Reads textures of
// files; paints those of generated shapes unless kPlain. Throws InputError naming the scene line or the mesh
// file.
BuiltScene build_scene(const SceneFile& scene, Looks looks = Looks::kPainted);

}  // namespace trocar
