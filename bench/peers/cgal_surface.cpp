#include "bench/peers/cgal_surface.hpp"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>

#include <cmath>
namespace trocar::bench {
namespace {

template <typename Kernel>
struct Searched {
    using Surface = CGAL::Surface_mesh<typename Kernel::Point_3>;
    using Primitive = CGAL::AABB_face_graph_triangle_primitive<Surface, CGAL::Default, CGAL::Tag_true, CGAL::Tag_true>;
    using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;
    using Side = CGAL::Side_of_triangle_mesh<Surface, Kernel, CGAL::Default, Tree>;
    Surface surface;
    Tree tree;

    Searched(std::span<const Vec3d> position, std::span<const Triangle> triangle) {
        std::vector<typename Surface::Vertex_index> vertex;
        for (const Vec3d& x : position) vertex.push_back(surface.add_vertex({x.x(), x.y(), x.z()}));
        for (const Triangle& t : triangle) surface.add_face(vertex[t[0]], vertex[t[1]], vertex[t[2]]);
        tree.insert(faces(surface).first, faces(surface).second, surface);
        tree.build();
    }
};

using Fast = CGAL::Exact_predicates_inexact_constructions_kernel;
using Exact = CGAL::Exact_predicates_exact_constructions_kernel;

}  // namespace

struct CgalSurface::Impl {
    Searched<Fast> searched;
    Searched<Fast>::Side side;
    Impl(std::span<const Vec3d> position, std::span<const Triangle> triangle) : searched(position, triangle), side(searched.tree) {
        searched.tree.accelerate_distance_queries();
    }
};

CgalSurface::CgalSurface(std::span<const Vec3d> position, std::span<const Triangle> triangle)
    : impl_(std::make_unique<Impl>(position, triangle)) {}
CgalSurface::~CgalSurface() = default;

void CgalSurface::query(std::span<const Vec3d> points, std::span<double> signed_distance) const {
    for (size_t i = 0; i < points.size(); ++i) {
        const Fast::Point_3 p(points[i].x(), points[i].y(), points[i].z());
        const auto [closest, face] = impl_->searched.tree.closest_point_and_primitive(p);
        const double d = std::sqrt(CGAL::squared_distance(p, closest));
        signed_distance[i] = impl_->side(p) == CGAL::ON_BOUNDED_SIDE ? -d : d;
    }
}

void cgal_exact_sides(std::span<const Vec3d> position, std::span<const Triangle> triangle, std::span<const Vec3d> points,
                      std::span<int> side) {
    const Searched<Exact> searched(position, triangle);
    const Searched<Exact>::Side side_of(searched.tree);
    for (size_t i = 0; i < points.size(); ++i) {
        const CGAL::Bounded_side s = side_of(Exact::Point_3(points[i].x(), points[i].y(), points[i].z()));
        side[i] = s == CGAL::ON_BOUNDED_SIDE ? -1 : s == CGAL::ON_BOUNDARY ? 0 : 1;
    }
}

}  // namespace trocar::bench
