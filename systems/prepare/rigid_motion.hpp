#pragma once
#include <span>

#include "components/bodies.hpp"
#include "components/paths.hpp"
namespace trocar {

// Sets the pose and velocity of every scripted body from its path at a time (s). Bodies without a path, and
// bodies that are `off` (one element per body, or empty), are unchanged. Order of paths.
void follow_paths(const Paths& paths, double time, std::span<const uint8_t> off, Poses& poses);

}  // namespace trocar
