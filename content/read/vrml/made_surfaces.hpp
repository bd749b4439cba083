#pragma once
#include "content/read/vrml/scene.hpp"
namespace trocar::vrml {

// Faces in the format of an IndexedFaceSet, converted from other geometry nodes. Reused between surfaces.
struct FaceList {
    std::vector<double> point;     // x, y, z; empty if the points are those of a coordinate node
    std::vector<double> index;     // corners of each face, then -1
    std::vector<double> uv;        // u, v; empty if the node has no texture coordinates
    std::vector<double> uv_index;  // like index; empty = equal to index
};

// Upper bound on the node's triangles; `points` is the size of its coordinate node, if it uses one.
uint64_t count_made_triangles(const Scene& scene, NodeId id, uint64_t points);

// The faces of a set of triangles, fans, strips, quadrilaterals or polygons (X3D 11.4, Inventor) over
// `points` points. Counts beyond the points are cut off.
void make_set(const Scene& scene, NodeId id, uint64_t points, FaceList& faces);

// VRML97 6.17: xDimension * zDimension heights; no faces if there are fewer.
void make_elevation_grid(const Scene& scene, NodeId id, FaceList& faces);

// VRML97 6.18: the cross-section swept along the spine, with the requested caps if the spine is not closed.
void make_extrusion(const Scene& scene, NodeId id, FaceList& faces);

}  // namespace trocar::vrml
