#pragma once
#include <string>

#include "content/load_mesh.hpp"
namespace trocar {

// load_mesh_or_shape with a line of progress on a terminal while a long file is read.
LoadedMesh load_file(const std::string& file);

}  // namespace trocar
