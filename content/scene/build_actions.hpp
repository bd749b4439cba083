#pragma once
#include "content/scene/scene_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// Whether an instrument of the scene heats this body, or cuts it.
bool is_heated_by_tools(const SceneFile& scene, const std::string& body);
bool is_cut_by_tools(const SceneFile& scene, const std::string& body);

// Adds what the instruments do, once all bodies and tools exist, and reserves room for their staples. Throws
// InputError for what cannot be done.
void add_scene_actions(const SceneFile& scene, World& world);

}  // namespace trocar
