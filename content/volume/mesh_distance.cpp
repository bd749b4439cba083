#include "content/volume/mesh_distance.hpp"

#include <array>
#include <limits>
#include <memory>

#include "engine/base/check.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/mesh_topology.hpp"
namespace trocar {
namespace {

// The tree and the mesh it refers to.
struct Surface {
    Meshes meshes;
    std::unique_ptr<ClosestPointTree> tree;
};

}  // namespace

DistanceField mesh_distance(const Mesh& mesh, Admission admission) {
    TROCAR_ASSERT(has_inside(admission));
    const auto surface = std::make_shared<Surface>();
    const uint32_t row = add_prototype(surface->meshes, mesh, admission);
    surface->tree = std::make_unique<ClosestPointTree>(mesh_view(surface->meshes, row));
    return [surface](std::span<const Vec3d> points, std::span<double> distance) {
        constexpr uint32_t kGrain = 512;
        parallel_for(static_cast<uint32_t>(points.size()), kGrain, [&](uint32_t begin, uint32_t end) {
            std::array<SurfacePoint, kGrain> found;
            std::array<double, kGrain> radius;
            radius.fill(std::numeric_limits<double>::infinity());
            QueryCounters counters;
            const uint32_t count = end - begin;
            surface->tree->query(points.subspan(begin, count), std::span(radius).first(count), {}, std::span(found).first(count), counters);
            for (uint32_t i = 0; i < count; ++i) distance[begin + i] = found[i].distance;
        });
    };
}

}  // namespace trocar
