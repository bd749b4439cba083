#pragma once
#include <string>

#include "components/mesh.hpp"
namespace trocar::reference {

// Elementary properties of a surface, from maps over its edges; shares no code with the product.
struct SurfaceFacts {
    bool closed = false;           // every directed edge occurs once, and so does its opposite
    bool one_fan = false;          // the triangles around every vertex form one ring
    uint32_t components = 0;       // edge-connected
    uint32_t unused_vertices = 0;  // vertices in no triangle
    int euler = 0;                 // vertices - edges + triangles
    double volume = 0;             // signed, positive when oriented outward
    double area = 0;
    Vec3d centroid = Vec3d::Zero();  // of the volume
    Vec3d extent = Vec3d::Zero();    // of the bounding box
};
SurfaceFacts survey_surface(const Mesh& mesh);

// Shape quality of the triangles.
struct ShapeFacts {
    double min_angle = 0;  // degrees, smallest of all corners
    double angle_p1 = 0;   // degrees, 1st percentile of the smallest angle per triangle
    double angle_p50 = 0;  // degrees, median of the same
    double min_edge = 0;   // m
    double mean_edge = 0;  // m
    double max_edge = 0;   // m
    double min_area = 0;   // m^2, minimum over vertices of a third of the adjacent triangles' area
    double mean_area = 0;  // m^2, mean of the same
};
ShapeFacts survey_shape(const Mesh& mesh);

// Number of intersecting pairs of triangles without a common vertex, plus pairs with one common vertex where
// the opposite edge of one intersects the other. Segment-triangle tests in double; pairs found by sorting
// along x.
uint32_t count_crossings(const Mesh& mesh);

// 64-bit hash of every byte of a mesh.
uint64_t hash_mesh(const Mesh& mesh);

}  // namespace trocar::reference
