#pragma once
#include <Eigen/Dense>
#include <array>
#include <functional>
#include <map>
#include <tuple>

#include "components/mesh.hpp"
#include "content/read/vrml/made_surfaces.hpp"
#include "content/read/vrml/scene.hpp"
#include "content/text/polygon.hpp"
namespace trocar::vrml {

// Affine map of points.
struct Placement {
    Eigen::Matrix3d linear = Eigen::Matrix3d::Identity();
    Vec3d shift = Vec3d::Zero();
};

// State that a surface inherits from surrounding and preceding nodes.
struct State {
    Placement placement;
    NodeId coordinate, texture_coordinate, material, material_binding, texture, texture_transform;
    bool clockwise = false;
};

// One surface to build: a geometry node and its state.
struct Instance {
    State state;
    NodeId geometry;
    NodeId named{};      // the nearest node at or above it that has a DEF name
    uint64_t visit = 0;  // of that node, which USE may visit again
};

// Points of one coordinate node used by surfaces.
struct CoordinateUse {
    std::vector<bool> used;  // per point
    std::set<std::array<double, 12>> placements;
};

// Builds surfaces into one mesh. With the caches, repeated use of a node costs only building its faces.
struct SurfaceBuilder {
    Scene& scene;
    Mesh& mesh;
    std::map<std::tuple<NodeId, NodeId, NodeId, uint32_t>, uint16_t> material_row{};  // material, colour, texture, entry
    std::map<std::pair<std::array<float, 8>, NodeId>, uint16_t> material_of_look{};   // appearance, texture
    std::map<NodeId, std::pair<std::string, Image>> texture{};                        // file name and pixels
    std::map<NodeId, CoordinateUse> coordinate_use{};
    std::vector<uint32_t> vertex_of_point{}, stamp{};  // vertex that the surface `stamp` made for a point
    uint32_t surface = 0;
    uint64_t image_bytes = 0;  // of all materials
    FaceList made{};
    std::vector<bool> made_used{};
    PolygonScratch polygon{};
    std::vector<Vec3d> corner{};
    std::vector<uint32_t> corner_point{}, corner_index_of{};  // point index, and position in coordIndex
    std::vector<Triangle> cut{};
    uint64_t faces_outside = 0;  // dropped: a corner index is invalid
    uint64_t faces_short = 0;    // dropped: fewer than three corners
    uint64_t faces_fanned = 0;   // ear clipping failed, made a fan
    uint64_t corners_without_uv = 0;
    std::function<void()> report = [] {};  // called occasionally while a large surface is built
    std::string first_outside{};           // position of the first invalid corner
};

inline Placement combine(const Placement& outer, const Placement& inner) {
    return {outer.linear * inner.linear, outer.linear * inner.shift + outer.shift};
}

// Throws InputError unless the node's `point` has only complete, finite points; `width` numbers per point.
void check_points(const Scene& scene, NodeId coordinate, uint32_t width);

// Upper bound on the triangles of a surface.
uint64_t count_triangles(const Scene& scene, const Instance& instance);

// Appends the triangles of one surface. The points must have been checked.
void build_surface(SurfaceBuilder& builder, const Instance& instance);

// Distinct points (per placement) of the used coordinate nodes at which no face has a corner.
uint64_t count_unused_points(const SurfaceBuilder& builder);

}  // namespace trocar::vrml
