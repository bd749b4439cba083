#pragma once
#include <string>
#include <vector>

#include "components/picture.hpp"
#include "content/looks.hpp"
#include "content/scene_file.hpp"
#include "engine/add_body.hpp"
namespace trocar {

// A world by hand, in this order: make_prototype; add_body and its pose; make_deformable or set_rigid_mass of what moves by
// forces; links; make_trees once everybody is there; find_fault; Frame. A body of a running Frame is added in the same way
// between two passes, make_trees again at the end.

// Gives a deformable body that stands at its pose its springs, particles and anchors (engine/deformable_setup.hpp);
// vertices whose rest z (m, body frame) lies below `fixed_below` are fixed.
void make_deformable(World& world, uint32_t body, double fixed_below = -std::numeric_limits<double>::infinity());

// What scene files call "auto": midpoint where leapfrog would need more than five steps a millisecond, the body is held
// (anchors in the world, or fixed vertices: midpoint takes energy from what is free) and an error of 0.1 mm is good
// enough; else leapfrog, which is the most exact for its time. `why` gets the reason in words.
Integrator pick_integrator(const World& world, uint32_t body, double wanted_error, std::string& why);

// Makes the closest-point trees: one per deformable body, one per prototype for all its rigid bodies. Call it once all
// prototypes and bodies are there, and again when one has come since: trees look at rows that prototypes move.
void make_trees(World& world);

// A scene ready to run: the world, how it is looked at, and what had to be done to its meshes.
struct BuiltScene {
    World world;
    Camera camera;
    PictureParams picture;
    std::vector<std::string> notes;  // one line per body: what it is and what import changed
    std::vector<std::string> warnings;
};

// Loads or generates every mesh of a scene, cleans and judges it, and places the bodies; textures of files are read, those of generated
// shapes painted unless they are to be plain. Throws InputError that names the scene's line or the mesh file.
BuiltScene build_scene(const SceneFile& scene, Looks looks = Looks::kPainted);

}  // namespace trocar
