#include <gtest/gtest.h>

#include <cstring>
#include <memory>

#include "content/scene/make_prototype.hpp"
#include "tests/systems/advance/advance_scene.hpp"

// Hard cases of the mass-spring system.
namespace trocar {
namespace {

// M15. Faces with a repeated vertex and duplicate faces, as in real files: dropped and counted at import, so
// that no spring joins a vertex to itself and none counts twice.
TEST(HardCases, M15_SpringsToItselfAndTwice) {
    Mesh mesh = subdivided_sphere(0.05, 1);
    const size_t good = mesh.triangle.size();
    const Triangle t = mesh.triangle[3], u = mesh.triangle[9];
    mesh.triangle.push_back({t[0], t[0], t[1]});
    mesh.triangle.push_back({t[2], t[1], t[2]});
    mesh.triangle.push_back(u);
    mesh.triangle.push_back({u[1], u[2], u[0]});
    AdvanceScene s;
    const Prototype made = make_prototype(s.meshes, mesh, {});
    ASSERT_EQ(made.row, 0u);
    EXPECT_EQ(made.cleaning.repeated_index_faces, 2u);
    EXPECT_EQ(made.cleaning.duplicate_faces, 2u);
    EXPECT_EQ(made.cleaning.triangles_after, good);
    add_springs(s.springs, s.meshes, 0);
    const MeshInfo& info = s.meshes.info[0];
    uint32_t half_edges = 0;
    for (uint32_t v = 0; v < info.vertices.count; ++v) {
        std::vector<uint32_t> far_ends;
        const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
        for (uint32_t c = s.springs.slice_column[slice]; c < s.springs.slice_column[slice + 1]; ++c) {
            const uint32_t far_end = s.springs.neighbour[c * kSliceWidth + lane];
            const float rest = s.springs.rest_length[c * kSliceWidth + lane];
            if (far_end == v) {
                EXPECT_EQ(rest, 0.0f) << "only padding names the vertex itself";
                continue;
            }
            EXPECT_GT(rest, 0.0f);
            far_ends.push_back(far_end);
        }
        half_edges += static_cast<uint32_t>(far_ends.size());
        std::sort(far_ends.begin(), far_ends.end());
        EXPECT_TRUE(std::adjacent_find(far_ends.begin(), far_ends.end()) == far_ends.end()) << "vertex " << v;
    }
    EXPECT_EQ(half_edges, 3 * good) << "each of the 3n/2 edges of a closed surface once from either end";
    // and a padding spring has no force: a body at rest stays, to the bit
    s.params.gravity.setZero();
    const uint32_t body = s.add_body(0, Motion::kDeformable);
    const auto before = s.particles.offset;
    s.advance(20, 20);
    for (uint32_t v = 0; v < info.vertices.count; ++v)
        EXPECT_LT((s.offset(body, v) - Vec3d(before[v].x, before[v].y, before[v].z)).norm(), 1e-9);
}

// M16. Two parts of one mesh without a common edge, in one body held by its surroundings: an action on one
// keeps the bits of the other, although they share slices of 16.
TEST(HardCases, M16_DisconnectedPartsAreIndependent) {
    Mesh both = subdivided_sphere(0.04, 2, 0.02);
    const uint32_t first = static_cast<uint32_t>(both.position.size());
    ASSERT_NE(first % kSliceWidth, 0u);
    Mesh other = subdivided_sphere(0.03, 2, 0.02, 2);
    for (const Vec3d& p : other.position) both.position.push_back(p + Vec3d(0.1, 0, 0));
    for (const Triangle& t : other.triangle) both.triangle.push_back({t[0] + first, t[1] + first, t[2] + first});
    const auto run = [&](bool poked) {
        auto s = std::make_unique<AdvanceScene>();
        s->add_body(s->add_mesh(both), Motion::kDeformable);
        s->params.gravity = Vec3d(0, 0, -9.81);
        if (poked) {
            for (uint32_t v = 0; v < first; v += 3) s->particles.offset[v].y += 0.005f;
            s->set_velocity(0, 5, {1, 2, 3});
        }
        s->advance(100, 100);
        return s;
    };
    const auto quiet = run(false), poked = run(true);
    ASSERT_EQ(quiet->meshes.info[0].components, 2u);
    const uint32_t all = static_cast<uint32_t>(both.position.size());
    EXPECT_NE(0, std::memcmp(&quiet->particles.offset[0], &poked->particles.offset[0], first * sizeof(Float4)));
    EXPECT_EQ(0, std::memcmp(&quiet->particles.offset[first], &poked->particles.offset[first], (all - first) * sizeof(Float4)));
    EXPECT_EQ(0, std::memcmp(&quiet->particles.velocity_z[first], &poked->particles.velocity_z[first], (all - first) * sizeof(float)));
}

struct Energies {
    double total = 0;
    bool finite = true;
};
Energies energies(AdvanceScene& s) {
    s.measure();
    const double total = s.energy.kinetic + s.energy.elastic + s.energy.gravity;
    return {total, std::isfinite(total) && std::isfinite(s.energy.balance)};
}

bool all_finite(const AdvanceScene& s, uint32_t body) {
    for (uint32_t v = 0; v < s.meshes.info[s.bodies.mesh[body]].vertices.count; ++v)
        if (!s.offset(body, v).allFinite() || !s.velocity(body, v).allFinite()) return false;
    return true;
}

// M17. A vertex at 1e6 m/s, and a body stretched to a hundred times its size: nothing overflows, the energy
// put in is accounted for (to 1 % of its peak, DESIGN 6.9) and never grows, and the shape recovers. Speeds
// are not clamped: a particle that ends a call over 1000 km away counts as lost, its body is restored (M10).
TEST(HardCases, M17_AMillionMetresASecondAndAHundredfoldStretch) {
    for (const bool stretched : {false, true}) {
        AdvanceScene s;
        const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 2, 0.02)), Motion::kDeformable);
        s.bodies.tissue[body].damping = 30;
        update_stable_dt(s.springs, body, s.particles, s.anchors, s.bodies);
        s.params.gravity.setZero();
        const std::vector<Float4> rest = s.particles.offset;
        const uint32_t substeps = count_substeps(s.bodies, std::vector<uint32_t>{body}, 0.01, 1e-3);
        double put_in = 0;
        if (!stretched) {
            s.set_velocity(body, 17, {0, 1e6, 0});
            put_in = 0.5e12 / s.particles.offset[17].w;
        } else {
            for (Float4& o : s.particles.offset) o.x *= 100, o.y *= 100, o.z *= 100;
        }
        s.open_energy_account();
        const double start = energies(s).total;
        if (!stretched) {
            EXPECT_NEAR(start, put_in, 1e-5 * put_in);
        }
        double peak = start;
        for (int k = 0; k < 100; ++k) {
            s.advance(10, substeps);
            ASSERT_TRUE(all_finite(s, body)) << stretched << " call " << k;
            const Energies now = energies(s);
            ASSERT_TRUE(now.finite) << stretched << " call " << k;
            peak = std::max(peak, now.total);
        }
        EXPECT_LE(peak, start * (1 + 1e-3)) << stretched;
        EXPECT_EQ(s.report.nonfinite_particles, 0u);
        EXPECT_LT(std::abs(s.energy.balance), 1e-2 * start) << stretched;
        // 1 s at 30/s: e^-30 of the energy is left, 3e-7 of the displacement
        for (uint32_t v = 0; v < s.meshes.info[0].vertices.count; ++v) {
            const double far = (s.offset(body, v) - Vec3d(rest[v].x, rest[v].y, rest[v].z)).norm();
            EXPECT_LT(far, stretched ? 1e-4 : 0.1) << stretched << " vertex " << v;
        }
    }
}

}  // namespace
}  // namespace trocar
