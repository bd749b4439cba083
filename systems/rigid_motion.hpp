#pragma once
#include "components/bodies.hpp"
#include "components/paths.hpp"
namespace trocar {

// Puts every scripted body where its path says it is at a time (s), with the velocity it has there. Bodies without a
// path are left alone. Order of paths.
void follow_paths(const Paths& paths, double time, Poses& poses);

}  // namespace trocar
