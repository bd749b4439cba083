#include "bench/peers/overlap_peers.hpp"

#include <memory>
#ifdef TROCAR_WITH_FCL
#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/narrowphase/collision.h>
#endif
#ifdef TROCAR_WITH_CGAL
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Rigid_triangle_mesh_collision_detection.h>
#include <CGAL/Surface_mesh.h>
#endif
namespace trocar::bench {
namespace {

#ifdef TROCAR_WITH_FCL
using FclModel = fcl::BVHModel<fcl::OBBRSS<double>>;

std::shared_ptr<FclModel> fcl_model(const std::vector<Vec3d>& position, std::span<const Triangle> triangle) {
    auto model = std::make_shared<FclModel>();
    std::vector<fcl::Vector3<double>> points;
    std::vector<fcl::Triangle> faces;
    for (const Vec3d& p : position) points.emplace_back(p.x(), p.y(), p.z());
    for (const Triangle& t : triangle) faces.emplace_back(t[0], t[1], t[2]);
    model->beginModel();
    model->addSubModel(points, faces);
    model->endModel();
    return model;
}
#endif

#ifdef TROCAR_WITH_CGAL
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using CgalMesh = CGAL::Surface_mesh<Kernel::Point_3>;

CgalMesh cgal_mesh(const std::vector<Vec3d>& position, std::span<const Triangle> triangle) {
    CgalMesh mesh;
    std::vector<CgalMesh::Vertex_index> row;
    for (const Vec3d& p : position) row.push_back(mesh.add_vertex({p.x(), p.y(), p.z()}));
    for (const Triangle& t : triangle) mesh.add_face(row[t[0]], row[t[1]], row[t[2]]);
    return mesh;
}

// Both meshes, with trees built in advance.
struct CgalPair {
    CgalMesh a, b;
    CGAL::Rigid_triangle_mesh_collision_detection<CgalMesh> detection;
    size_t row = 0;
};
#endif

}  // namespace

std::vector<OverlapPeer> make_overlap_peers([[maybe_unused]] const std::vector<Vec3d>& position_a,
                                            [[maybe_unused]] std::span<const Triangle> triangle_a,
                                            [[maybe_unused]] const std::vector<Vec3d>& position_b,
                                            [[maybe_unused]] std::span<const Triangle> triangle_b) {
    std::vector<OverlapPeer> peers;
#ifdef TROCAR_WITH_FCL
    const auto a = fcl_model(position_a, triangle_a), b = fcl_model(position_b, triangle_b);
    peers.push_back({"FCL", [a, b] {
                         const fcl::CollisionRequest<double> request(1, false);
                         fcl::CollisionResult<double> result;
                         const auto here = fcl::Transform3<double>::Identity();
                         return fcl::collide<double>(a.get(), here, b.get(), here, request, result) > 0;
                     }});
#endif
#ifdef TROCAR_WITH_CGAL
    const auto pair = std::make_shared<CgalPair>();
    pair->a = cgal_mesh(position_a, triangle_a);
    pair->b = cgal_mesh(position_b, triangle_b);
    pair->row = pair->detection.add_mesh(pair->a);
    pair->detection.add_mesh(pair->b);
    peers.push_back({"CGAL", [pair] { return !pair->detection.get_all_intersections_and_inclusions(pair->row).empty(); }});
#endif
    return peers;
}

}  // namespace trocar::bench
