#pragma once
#include "content/vrml/scene.hpp"
namespace trocar::vrml {

// Faces as an IndexedFaceSet writes them, made from a node that writes them in another way. Kept between surfaces.
struct FaceList {
    std::vector<double> point;     // x, y, z; empty when the points are those of a coordinate node
    std::vector<double> index;     // corners of each face and -1
    std::vector<double> uv;        // u, v; empty when the node says nothing about them
    std::vector<double> uv_index;  // like index; empty = the same numbers
};

// Triangles the node gives at most; `points` is the number of points of its coordinate node, if it takes one.
uint64_t count_made_triangles(const Scene& scene, NodeId id, uint64_t points);

// The faces of a set of triangles, fans, strips, quadrilaterals or polygons (X3D 11.4, Inventor) over `points` points.
// What a count asks for beyond the points is left out.
void make_set(const Scene& scene, NodeId id, uint64_t points, FaceList& faces);

// VRML97 6.17: xDimension * zDimension heights; nothing when there are fewer.
void make_elevation_grid(const Scene& scene, NodeId id, FaceList& faces);

// VRML97 6.18: the cross-section carried along the spine, caps where they are asked for and the spine is not closed.
void make_extrusion(const Scene& scene, NodeId id, FaceList& faces);

}  // namespace trocar::vrml
