#pragma once
#include <string>

#include "content/read/load_mesh.hpp"
namespace trocar {

// load_mesh_or_shape with a progress line on the terminal while a long file is read; its warnings go to standard error.
LoadedMesh load_file(const std::string& file);

}  // namespace trocar
