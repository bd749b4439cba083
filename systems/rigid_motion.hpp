#pragma once
#include <span>

#include "components/bodies.hpp"
#include "components/paths.hpp"
namespace trocar {

// Puts every scripted body where its path says it is at a time (s), with the velocity it has there. Bodies without a
// path, or `off` (one per body, or empty), are left alone. Order of paths.
void follow_paths(const Paths& paths, double time, std::span<const uint8_t> off, Poses& poses);

}  // namespace trocar
