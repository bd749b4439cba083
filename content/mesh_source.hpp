#pragma once
#include <string>

#include "content/load_mesh.hpp"
namespace trocar {

// The surface that a word on the command line names: a file (see load_mesh), or a generated shape (see make_shape)
// written "shape:NAME", "shape:NAME:TRIANGLES" or "shape:NAME:TRIANGLES:SEED". A bare NAME is a shape too where no file
// is called so. Shapes have 10000 triangles unless told. Throws InputError naming the word.
LoadedMesh load_mesh_or_shape(const std::string& source, const LoadProgress& progress = {});

}  // namespace trocar
