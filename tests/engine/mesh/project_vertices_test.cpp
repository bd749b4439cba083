#include "engine/mesh/project_vertices.hpp"

#include <gtest/gtest.h>

#include "engine/mesh/sum_velocities.hpp"
#include "tests/systems/detect/contact_scene.hpp"

namespace {
using namespace trocar;
using namespace trocar::test;

// Projections equal those of world positions to rounding, for deformable and rotated rigid bodies, also for
// vertex counts that are no multiple of four.
TEST(ProjectVertices, PlacesAlongADirection) {
    const Quat turned = from_rotation_vector({0.3, -1.1, 2.0});
    ContactScene scene({{make_noisy_sphere(7, 0.1, 0.1, 0), Motion::kDeformable, Vec3d(1, 2, 3), {}},
                        {make_noisy_sphere(9, 0.2, 0.1, 1), Motion::kStatic, Vec3d(-4, 0.5, 1), turned}});
    const Surfaces s = scene.surfaces();
    const Vec3d base(0.5, -1, 2), direction(0.7, -0.2, 1.9);
    std::vector<double> along;
    for (const uint32_t body : {0u, 1u}) {
        project_vertices(s, body, base, direction, along);
        ASSERT_EQ(along.size(), s.meshes.info[s.bodies.mesh[body]].vertices.count);
        for (uint32_t v = 0; v < along.size(); ++v)
            EXPECT_NEAR(along[v], (vertex_position(s, body, v) - base).dot(direction), 1e-14 * 10) << body << " " << v;
    }
}

// The sum equals the sequential one, to the bit; non-finite vertices are skipped and not counted.
TEST(SumVelocities, LeavesOutWhatIsNotFinite) {
    Particles p;
    for (uint32_t i = 0; i < 23; ++i) {
        const float x = 0.1f * float(i), y = 1.0f / (1.0f + float(i)), z = -3.0f * x * y;
        p.velocity_x.push_back(x), p.velocity_y.push_back(y), p.velocity_z.push_back(z);
    }
    p.velocity_y[6] = std::numeric_limits<float>::quiet_NaN();
    p.velocity_z[21] = std::numeric_limits<float>::infinity();
    Vec3d sum = Vec3d::Zero();
    for (uint32_t i = 3; i < 23; ++i)
        if (i != 6 && i != 21) sum += Vec3d(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]);
    const VelocitySum got = sum_velocities(p, 3, 20);
    EXPECT_EQ(got.sum, sum);
    EXPECT_EQ(got.count, 18u);
}

}  // namespace
