#include "systems/output/surface_normals.hpp"

#include <algorithm>
#include <cmath>

#include "engine/jobs/parallel.hpp"

namespace trocar {
namespace {

constexpr uint32_t kGrain = 2048;

void compute_body_normals(const MeshView& mesh, const Float4* offset, SurfaceNormalsScratch& scratch, Vec3* normal) {
    const auto position = [offset](uint32_t v) { return Vec3(offset[v].x, offset[v].y, offset[v].z); };
    const uint32_t triangles = static_cast<uint32_t>(mesh.triangle.size());
    if (scratch.face.size() < triangles) scratch.face.resize(triangles);
    Vec3* face = scratch.face.data();
    parallel_for(triangles, kGrain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t t = begin; t < end; ++t) {
            const Triangle& corner = mesh.triangle[t];
            const Vec3 a = position(corner[0]);
            face[t] = (position(corner[1]) - a).cross(position(corner[2]) - a);
        }
    });
    parallel_for(static_cast<uint32_t>(mesh.position.size()), kGrain, [&](uint32_t begin, uint32_t end) {
        for (uint32_t v = begin; v < end; ++v) {
            Vec3d sum = Vec3d::Zero();
            for (uint32_t i = mesh.incident_first[v]; i < mesh.incident_first[v + 1]; ++i) sum += face[mesh.incident[i]].cast<double>();
            const double length = std::sqrt(sum.squaredNorm());
            normal[v] = length > 0 && std::isfinite(length) ? Vec3((sum / length).cast<float>()) : Vec3(Vec3::Zero());
        }
    });
}

}  // namespace

void compute_surface_normals(const Surfaces& surfaces, SurfaceNormalsScratch& scratch, SurfaceNormals& normals,
                             const SleepingBodies& sleeping_bodies) {
    if (normals.normal.size() != surfaces.particles.offset.size()) {
        normals.normal.assign(surfaces.particles.offset.size(), Vec3::Zero());
        std::fill(sleeping_bodies.seen.begin(), sleeping_bodies.seen.end(), 0);
    }
    for (uint32_t body = 0; body < surfaces.bodies.mesh.size(); ++body) {
        if (surfaces.bodies.mesh[body] == kNone || !is_deformable(surfaces.bodies, body) || was_seen(sleeping_bodies, body)) continue;
        const uint32_t first = surfaces.bodies.particles[body].first;
        compute_body_normals(mesh_view(surfaces.meshes, surfaces.bodies.mesh[body]), surfaces.particles.offset.data() + first, scratch,
                             normals.normal.data() + first);
    }
}

}  // namespace trocar
