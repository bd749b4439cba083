#pragma once
#include "content/scene/scene_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// The scene with its node tree folded into the bodies: everything in a node is positioned, scaled and moved
// in world coordinates. Throws InputError if a parent or node is missing or a body cannot be in its node.
SceneFile fold_nodes(const SceneFile& scene);

// Adds the instruments that can replace tool `tool`, as tools of their own that start inactive.
void add_tool_exchanges(const SceneFile& scene, const ToolSpec& spec, World& world, uint32_t tool);

// Adds nodes, driven bodies and switches once bodies and tools exist. Throws InputError naming the line.
void add_scene_nodes(const SceneFile& scene, World& world);

}  // namespace trocar
