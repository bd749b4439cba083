#pragma once
#include <array>
#include <functional>
#include <map>
#include <tuple>

#include "components/mesh.hpp"
#include "content/polygon.hpp"
#include "content/vrml/made_surfaces.hpp"
#include "content/vrml/scene.hpp"
namespace trocar::vrml {

// Affine map of points, row by row; exact for the identity.
struct Placement {
    std::array<double, 12> m{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
};

// What a surface inherits from the nodes around and before it.
struct State {
    Placement placement;
    NodeId coordinate, texture_coordinate, material, material_binding, texture, texture_transform;
    bool clockwise = false;
};

// One surface to build: a geometry node and the state it stands in.
struct Instance {
    State state;
    NodeId geometry;
};

// What the surfaces have used of one coordinate node.
struct CoordinateUse {
    std::vector<bool> used;  // per point
    std::set<std::array<double, 12>> placements;
};

// Building surfaces into one mesh. Caches make a node that is used often cost its building only.
struct SurfaceBuilder {
    Scene& scene;
    Mesh& mesh;
    std::map<std::tuple<NodeId, NodeId, NodeId, uint32_t>, uint16_t> material_row{};  // material, colour, texture, entry
    std::map<std::pair<std::array<float, 8>, NodeId>, uint16_t> material_of_look{};   // look, texture
    std::map<NodeId, std::pair<std::string, Image>> texture{};                        // file name and pixels
    std::map<NodeId, CoordinateUse> coordinate_use{};
    std::vector<uint32_t> vertex_of_point{}, stamp{};  // vertex made for a point by the surface with that stamp
    uint32_t surface = 0;
    uint64_t image_bytes = 0;  // of all materials
    FaceList made{};
    std::vector<bool> made_used{};
    PolygonScratch polygon{};
    std::vector<Vec3d> corner{};
    std::vector<uint32_t> corner_point{}, corner_place{};  // point number and position in coordIndex
    std::vector<Triangle> cut{};
    uint64_t faces_outside = 0;  // dropped: a corner is not among the points
    uint64_t faces_short = 0;    // dropped: fewer than three corners
    uint64_t faces_fanned = 0;   // no ears found
    uint64_t corners_without_uv = 0;
    std::function<void()> report = [] {};  // called now and then while a large surface is built
    std::string first_outside{};           // place of the first such corner
};

Placement combine(const Placement& outer, const Placement& inner);

// Throws InputError unless the node's `point` is whole and finite; `width` numbers make a point.
void check_points(const Scene& scene, NodeId coordinate, uint32_t width);

// Triangles a surface will give at most.
uint64_t count_triangles(const Scene& scene, const Instance& instance);

// Appends the triangles of one surface. The points were checked before.
void build_surface(SurfaceBuilder& builder, const Instance& instance);

// Distinct points of the coordinate nodes used, once for each placement, at which no face has a corner.
uint64_t count_unused_points(const SurfaceBuilder& builder);

}  // namespace trocar::vrml
