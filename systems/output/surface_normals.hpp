#pragma once
#include "components/picture.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

struct SurfaceNormalsScratch {
    std::vector<Vec3> face;  // cross product of two edges: twice the area, along the normal
};

// Unit normals of the vertices of every deformable body: the sum of the incident triangles' normals weighted
// by their area (Gouraud 1971 with area weights), in ascending order of the triangles. Zero where that sum
// vanishes or is not finite. Elements of other particles (padding) keep zero, those of sleeping bodies
// computed already their value.
void compute_surface_normals(const Surfaces& surfaces, SurfaceNormalsScratch& scratch, SurfaceNormals& normals,
                             const SleepingBodies& sleeping_bodies = {});

}  // namespace trocar
