#pragma once
#include "content/scene/scene_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// Fills world.links from the [[link]] and [[staple]] tables, once the bodies exist, and reserves room for all
// links they may create. Throws InputError "file:line:1: reason" if a body is missing, unsuitable or holds
// itself.
void add_scene_links(const SceneFile& scene, World& world);

// Applies a body's tissue regions; the body must not share its prototype. Throws InputError likewise.
void add_tissue_regions(const SceneFile& scene, const BodySpec& spec, World& world, uint32_t body);

// Fills world.tears.cut from the [[cut]] tables. Throws InputError likewise, also if a body cannot be cut.
void add_scene_cuts(const SceneFile& scene, World& world);

// Enables tearing for a body: springs break above a strain, and triangles may be removed. The body must not
// share its prototype. Returns its index in world.tears.body.
uint32_t let_tear(World& world, uint32_t body, double break_strain);

}  // namespace trocar
