#pragma once
#include "content/scene_file.hpp"
#include "engine/world.hpp"
namespace trocar {

// The scene with the tree of its nodes folded into its bodies: what lies in a node is placed, scaled and moved in the world.
// Throws InputError when a parent or node is not there, or a body cannot lie where it says.
SceneFile fold_nodes(const SceneFile& scene);

// The instruments that take the place of the one in row `tool`: rows of tools of their own, laid down at first.
void add_tool_exchanges(const SceneFile& scene, const ToolSpec& spec, World& world, uint32_t tool);

// Nodes, driven bodies and switches of a scene whose bodies and tools are built. Throws InputError naming the line.
void add_scene_nodes(const SceneFile& scene, World& world);

}  // namespace trocar
