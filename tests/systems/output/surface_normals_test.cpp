#include "systems/output/surface_normals.hpp"

#include <gtest/gtest.h>

#include <cstring>

#include "engine/jobs/thread_pool.hpp"
#include "tests/reference/picture_scene.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

using reference::PictureScene;

// every triangle of the mesh, in double, from the definition
Vec3d brute_normal(const PictureScene& scene, uint32_t body, uint32_t vertex) {
    const MeshView mesh = mesh_view(scene.meshes, scene.bodies.mesh[body]);
    Vec3d sum = Vec3d::Zero();
    for (const Triangle& t : mesh.triangle) {
        if (t[0] != vertex && t[1] != vertex && t[2] != vertex) continue;
        const auto p = [&](uint32_t k) { return vertex_in_frame(scene.surfaces(), body, t[k]); };
        sum += 0.5 * (p(1) - p(0)).cross(p(2) - p(0));
    }
    return sum.normalized();
}

// fails when a triangle is left out, counted twice, flipped, or read from another body's range
TEST(SurfaceNormals, EqualTheAreaWeightedSumOverAllTriangles) {
    PictureScene scene;
    const uint32_t sphere = scene.add_mesh(reference::make_sphere({0.1, 0.2, -0.3}, 0.05, 3));
    const uint32_t box = scene.add_mesh(reference::make_box({0, 0, 0}, {0.1, 0.03, 0.02}));
    scene.add_body(box, Motion::kDeformable);
    scene.add_body(box, Motion::kStatic);
    scene.add_body(sphere, Motion::kDeformable, {1e5, 0, 0});
    compute_surface_normals(scene.surfaces(), scene.scratch, scene.normals);
    for (const uint32_t body : {0u, 2u}) {
        const uint32_t count = scene.meshes.info[scene.bodies.mesh[body]].vertices.count;
        for (uint32_t v = 0; v < count; ++v) {
            const Vec3 normal = scene.normals.normal[scene.bodies.particles[body].first + v];
            EXPECT_NEAR((normal.cast<double>() - brute_normal(scene, body, v)).norm(), 0, 2e-6);
        }
    }
}

// three unit-direction faces of areas 2, 1, 1/2 around one corner: the normal is (area_x, area_y, area_z) normalised.
// Angle weights or equal weights would give (1, 1, 1).
TEST(SurfaceNormals, WeighByArea) {
    PictureScene scene;
    Mesh m;
    const double a = 1, b = 1, c = 2;  // legs along x, y, z
    m.position = {{0, 0, 0}, {-a, 0, 0}, {0, -b, 0}, {0, 0, -c}};
    m.triangle = {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}};
    scene.add_body(scene.add_mesh(m), Motion::kDeformable);
    compute_surface_normals(scene.surfaces(), scene.scratch, scene.normals);
    const Vec3d expected = Vec3d(b * c, a * c, a * b).normalized();
    EXPECT_NEAR((scene.normals.normal[0].cast<double>() - expected).norm(), 0, 1e-6);
}

TEST(SurfaceNormals, AreZeroForNonFiniteVerticesAndPaddingOnly) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 1, 2)), Motion::kDeformable);
    scene.particles.offset[0].y = std::numeric_limits<float>::quiet_NaN();
    compute_surface_normals(scene.surfaces(), scene.scratch, scene.normals);
    const MeshView mesh = mesh_view(scene.meshes, 0);
    std::vector<bool> touched(mesh.position.size(), false);
    for (const Triangle& t : mesh.triangle)
        if (t[0] == 0 || t[1] == 0 || t[2] == 0)
            for (const uint32_t v : t) touched[v] = true;
    ASSERT_EQ(scene.normals.normal.size(), scene.particles.offset.size());
    for (uint32_t v = 0; v < scene.normals.normal.size(); ++v) {
        const bool live = v < touched.size() && !touched[v];
        EXPECT_NEAR(scene.normals.normal[v].norm(), live ? 1 : 0, 1e-6) << v;
    }
}

TEST(SurfaceNormals, AreTheSameBitsForAnyNumberOfThreads) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 1, 6)), Motion::kDeformable);
    compute_surface_normals(scene.surfaces(), scene.scratch, scene.normals);
    const std::vector<Vec3> serial = scene.normals.normal;
    ThreadPool pool(4);
    pool.run([&] { compute_surface_normals(scene.surfaces(), scene.scratch, scene.normals); });
    EXPECT_EQ(std::memcmp(serial.data(), scene.normals.normal.data(), serial.size() * sizeof(Vec3)), 0);
}

TEST(SurfaceNormals, AllocateNothingOnceWarm) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 1, 3)), Motion::kDeformable);
    compute_surface_normals(scene.surfaces(), scene.scratch, scene.normals);
    const Vec3 *face = scene.scratch.face.data(), *normal = scene.normals.normal.data();
    compute_surface_normals(scene.surfaces(), scene.scratch, scene.normals);
    EXPECT_EQ(face, scene.scratch.face.data());
    EXPECT_EQ(normal, scene.normals.normal.data());
}

}  // namespace
}  // namespace trocar
