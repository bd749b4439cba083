#pragma once
#include "content/scene/scene_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// Makes the [[thread]]s of a scene, once its bodies, tools and actions exist, and says what their needles sew. Throws InputError
// "file:line:1: reason".
void add_scene_threads(const SceneFile& scene, World& world);

}  // namespace trocar
