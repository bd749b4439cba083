#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
namespace trocar {

// A mesh is convex if no point of it is farther than this from its hull, in radii of the mesh. Flat faces of meshes that were stored
// as floats bend by 1e-7 radii.
constexpr double kConvexTolerance = 1e-5;
// Meshes of more faces, after coplanar triangles are merged, have no hull: the search for a separating direction looks at each face.
constexpr uint32_t kMostHullFaces = 512;

struct HullFace {
    Vec3d normal = Vec3d::Zero();  // unit, outward
    double offset = 0;             // m, of the plane along the normal: the farthest of the face's vertices
    Range corners;                 // range of corner
    uint32_t triangle = kNone;     // one of the mesh's triangles on it
};

struct HullEdge {
    std::array<uint32_t, 2> ends{}, faces{};  // indices of point, of face
    double cosine = 1;                        // between the normals of its faces
};

// Convex surface of a prototype: triangles in one plane are one face, and vertices inside faces and edges are left out. Body frame.
struct ConvexHull {
    uint32_t mesh = kNone;         // the prototype
    double radius = 0;             // m, of the mesh, from the origin of the body frame
    Vec3d centre = Vec3d::Zero();  // m, mean of its points
    std::vector<Vec3d> point;      // m
    std::vector<uint32_t> vertex;  // per point: local vertex of the mesh
    std::vector<HullFace> face;
    std::vector<uint32_t> corner;  // indices of point, counter-clockwise seen from outside
    std::vector<HullEdge> edge;
    std::vector<uint32_t> around_first;  // per point: range of around; one more element than points
    std::vector<uint32_t> around;        // faces at a point, ascending
};

// The hulls of the prototypes of rigid bodies.
struct ConvexHulls {
    std::vector<uint32_t> of_mesh;  // per prototype: index of hull, or kNone; empty without free bodies
    std::vector<ConvexHull> hull;

    // The hull of a body; nullptr if its mesh has none or it is deformable.
    const ConvexHull* of(const Bodies& bodies, uint32_t body) const {
        if (bodies.mesh[body] >= of_mesh.size() || bodies.motion[body] == Motion::kDeformable) return nullptr;
        const uint32_t index = of_mesh[bodies.mesh[body]];
        return index == kNone ? nullptr : &hull[index];
    }
};

// Describes a closed, convex prototype as a hull. False if it is not convex within kConvexTolerance, is in several pieces, is no solid,
// or has too many faces.
bool make_convex_hull(const Meshes& meshes, uint32_t prototype, ConvexHull& hull);

// The hulls of all prototypes of rigid bodies, if any body is free; else none. None of those of bodies with restitution.
ConvexHulls make_convex_hulls(const Meshes& meshes, const Bodies& bodies);

}  // namespace trocar
