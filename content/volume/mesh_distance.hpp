#pragma once
#include "components/mesh.hpp"
#include "content/volume/isosurface_stuffing.hpp"
namespace trocar {

// The signed distance of points to a closed surface, negative inside, evaluated in parallel with the engine's
// closest-point tree. Copies the mesh. `admission`: solid or winding; other meshes have no inside.
DistanceField mesh_distance(const Mesh& mesh, Admission admission);

}  // namespace trocar
