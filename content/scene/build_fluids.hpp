#pragma once
#include "content/scene/scene_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// Lets the bodies of a scene be wet and adds its wounds, if it has [fluid], a [[wound]] or a tool that irrigates or sucks. Call once all
// bodies, tools and cuts exist. Throws InputError "file:line:1: reason".
void add_scene_fluids(const SceneFile& scene, World& world);

}  // namespace trocar
