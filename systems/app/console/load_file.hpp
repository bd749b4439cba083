#pragma once
#include <string>

#include "content/read/load_mesh.hpp"
namespace trocar {

// load_mesh_or_shape with a progress line on the terminal while a long file is read; prints its warnings. `roots` as in LoadOptions.
LoadedMesh load_file(const std::string& file, const FileRoots& roots);

}  // namespace trocar
