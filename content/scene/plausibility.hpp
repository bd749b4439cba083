#pragma once
#include <string>
#include <vector>

#include "content/scene/scene_file.hpp"
#include "engine/world/world.hpp"
namespace trocar {

// Warnings about what a built scene probably does not mean, one line each: no body; a body from a file beyond 1 mm to 2 m
// (its unit); fixed_below that fixes nothing or everything; tissue below 500 Pa, softer than any organ; a tool whose path stays
// farther than 0.3 m from everything.
std::vector<std::string> find_doubts(const SceneFile& scene, const World& world);

}  // namespace trocar
