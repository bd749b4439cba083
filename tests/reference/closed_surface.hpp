#pragma once
#include <string>

#include "components/mesh.hpp"
namespace trocar::reference {

// Obvious facts about a surface, from maps over its edges; no code shared with the product.
struct SurfaceFacts {
    bool closed = false;           // every directed edge once, and its opposite once
    bool one_fan = false;          // the triangles around every vertex form one ring
    uint32_t components = 0;       // edge-connected
    uint32_t unused_vertices = 0;  // in no triangle
    int euler = 0;                 // vertices - edges + triangles
    double volume = 0;             // signed, positive when oriented outward
    double area = 0;
    Vec3d centroid = Vec3d::Zero();  // of the volume
    Vec3d extent = Vec3d::Zero();    // of the bounding box
};
SurfaceFacts survey_surface(const Mesh& mesh);

// How well shaped the triangles are.
struct ShapeFacts {
    double min_angle = 0;  // degrees, smallest of all corners
    double angle_p1 = 0;   // degrees, 1st percentile over triangles of their smallest angle
    double angle_p50 = 0;  // degrees, median of the same
    double min_edge = 0;   // m
    double mean_edge = 0;  // m
    double max_edge = 0;   // m
    double min_area = 0;   // m^2, smallest third of the triangles around a vertex
    double mean_area = 0;  // m^2, mean of the same
};
ShapeFacts survey_shape(const Mesh& mesh);

// Number of pairs of triangles without a common vertex that cut each other, plus pairs with one common vertex where the
// far edge of one cuts the other. By segment against triangle in double; pairs found by a sort along x.
uint32_t count_crossings(const Mesh& mesh);

// 64-bit hash of every byte a mesh is made of.
uint64_t hash_mesh(const Mesh& mesh);

}  // namespace trocar::reference
