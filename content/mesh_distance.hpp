#pragma once
#include "components/mesh.hpp"
#include "content/isosurface_stuffing.hpp"
namespace trocar {

// The signed distance of points to a closed surface, negative inside, as the engine's closest-point tree answers it;
// in parallel. The mesh is copied. Admission as judged: a sheet or refused mesh has no inside and is misuse.
DistanceField mesh_distance(const Mesh& mesh, Admission admission);

}  // namespace trocar
