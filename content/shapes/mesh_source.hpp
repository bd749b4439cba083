#pragma once
#include <string>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Loads the surface named on a command line: a file (see load_mesh), or a generated shape (see make_shape) as
// "shape:NAME", "shape:NAME:TRIANGLES" or "shape:NAME:TRIANGLES:SEED". A plain NAME is a shape if no such
// file exists. Shapes have 10000 triangles by default. Throws InputError naming the argument.
LoadedMesh load_mesh_or_shape(const std::string& source, const LoadOptions& options = {});

}  // namespace trocar
