#pragma once
#include "content/scene_file.hpp"
#include "engine/world.hpp"
namespace trocar {

// Fills world.links from the [[link]] and [[staple]] tables of a scene whose bodies are there, with room for all links they
// may make. Throws InputError "file:line:1: reason" when a body is missing, cannot be held or is held by itself.
void add_scene_links(const SceneFile& scene, World& world);

// Gives the regions of a deformable body their tissue; the prototype must be the body's own. Throws InputError likewise.
void add_tissue_regions(const SceneFile& scene, const BodySpec& spec, World& world, uint32_t body);

// Fills world.tears.cut from the [[cut]] tables. Throws InputError likewise, also for bodies that cannot be cut.
void add_scene_cuts(const SceneFile& scene, World& world);

// Lets springs of a body break above a strain and triangles be removed; the prototype must be the body's own. Returns its row of
// world.tears.body.
uint32_t let_tear(World& world, uint32_t body, double break_strain);

}  // namespace trocar
