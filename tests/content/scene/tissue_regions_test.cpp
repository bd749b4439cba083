// Regions of tissue: stiffness, density and fixed nodes that differ within a body.
#include "content/scene/tissue_regions.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>

#include "content/scene/make_solid.hpp"
#include "engine/base/error.hpp"
#include "tests/reference/solid_double.hpp"
#include "tests/systems/advance/advance_scene.hpp"
namespace trocar {
namespace {

Tissue soft(double damping) {
    Tissue tissue;
    tissue.youngs_modulus = 1e4;
    tissue.density = 1000;
    tissue.poisson = 0.35;
    tissue.damping = damping;
    tissue.depth = kNoFoundation;
    return tissue;
}

uint32_t add_bar(AdvanceScene& scene, int cells, double h, const Tissue& tissue, AnchorFrame frame = AnchorFrame::kWorld) {
    TetMesh tets;
    reference::lattice_box(2, 2, cells, h, 0, tets.position, tets.tetrahedron);
    return scene.add_body(add_tet_mesh(scene.meshes, scene.springs, scene.solids, tets, {}).row, Motion::kDeformable, Vec3d::Zero(), tissue,
                          frame);
}

uint32_t node_count(const AdvanceScene& s, uint32_t body) {
    return is_solid(s.solids, s.bodies.mesh[body]) ? s.solids.info[s.bodies.mesh[body]].nodes.count
                                                   : s.meshes.info[s.bodies.mesh[body]].vertices.count;
}
NodeTissue plain(const AdvanceScene& s, uint32_t body) {
    const uint32_t n = node_count(s, body);
    return {std::vector<double>(n, 1.0), std::vector<double>(n, 1.0), std::vector<uint8_t>(n, 0)};
}
void vary(AdvanceScene& s, uint32_t body, const NodeTissue& nodes) {
    vary_tissue(nodes, s.meshes, body, s.springs, s.solids, s.bodies, s.particles, s.anchors);
}

// A bar of two halves, one four times as stiff, drawn out by 0.2 %: the same force
// passes through both, so their strains are as 1 to 4. Disturbances: ends and the seam, which decay as exp(-4
// distance / width) or faster, two widths away 3e-4 (Saint-Venant; the slowest decay of a square bar is 4.2
// per width); the geometry, of the order of the strains, 0.5 %; and floats, 3e-8 m of 8e-5.
TEST(TissueRegions, StrainsOfTwoHalvesAreAsTheirModuli) {
    const int cells = 24;
    const double h = 0.01, length = cells * h, ratio = 4, stretch = 2e-3;
    AdvanceScene s;
    s.params.gravity.setZero();
    const uint32_t bar = add_bar(s, cells, h, soft(30));
    NodeTissue nodes = plain(s, bar);
    std::vector<Vec3d> rest;
    for (uint32_t v = 0; v < node_count(s, bar); ++v) {
        rest.push_back(s.offset(bar, v));
        // the seam is between two layers of nodes: none is half and half
        nodes.stiffness[v] = rest[v].z() > length / 2 + 1e-6 ? ratio : 1;
        nodes.fixed[v] = rest[v].z() < 1e-6 || rest[v].z() > length - 1e-6;
    }
    vary(s, bar, nodes);
    for (uint32_t v = 0; v < rest.size(); ++v) s.particles.offset[s.range(bar).first + v].z *= static_cast<float>(1 + stretch);
    const uint32_t substeps = count_substeps(s.bodies, s.moving(), 0.1, 1e-3);
    for (int n = 0; n < 30; ++n) s.advance(100, substeps);
    const auto strain = [&](double from, double to) {
        std::array<double, 2> displacement{}, count{};
        for (uint32_t v = 0; v < rest.size(); ++v) {
            for (int end = 0; end < 2; ++end) {
                if (std::abs(rest[v].z() - (end == 0 ? from : to)) > 1e-6) continue;
                displacement[end] += s.offset(bar, v).z() - rest[v].z(), ++count[end];
            }
        }
        return (displacement[1] / count[1] - displacement[0] / count[0]) / (to - from);
    };
    const double width = 2 * h, soft_half = strain(2 * width, length / 2 - 2 * width),
                 stiff_half = strain(length / 2 + 2 * width, length - 2 * width);
    std::printf("bar: strains %.4g and %.4g, ratio %.4f for %.0f\n", soft_half, stiff_half, soft_half / stiff_half, ratio);
    EXPECT_NEAR(soft_half / stiff_half, ratio, ratio * (2 * 3e-4 + soft_half + 2 * 3e-8 / (4 * h * stiff_half)));
    EXPECT_GT(soft_half, stretch);
}
// A region that is the whole body, E times 4 and density times 2, equals a body of that tissue: the same
// forces, masses and stable step, solid and shell, with anchors and bending.
void expect_another_tissue(Integrator integrator) {
    for (const bool solid : {true, false}) {
        if (solid && integrator != Integrator::kLeapfrog) continue;
        AdvanceScene a, b;
        for (AdvanceScene* s : {&a, &b}) {
            Tissue tissue = soft(5);
            tissue.depth = 0.05;
            if (!solid) tissue.bending = 1e4, tissue.pressure_modulus = 0;
            if (s == &b) tissue.youngs_modulus *= 4, tissue.bending *= 4, tissue.density *= 2;
            const uint32_t body =
                solid ? add_bar(*s, 4, 0.01, tissue)
                      : s->add_body(s->add_mesh(subdivided_sphere(0.05, 2, 0.05)), Motion::kDeformable, Vec3d::Zero(), tissue);
            if (s == &a) {
                NodeTissue nodes = plain(a, body);
                nodes.stiffness.assign(nodes.stiffness.size(), 4);
                nodes.density.assign(nodes.density.size(), 2);
                vary(a, body, nodes);
            }
            for (uint32_t v = 0; v < node_count(*s, body); v += 3) s->set_velocity(body, v, {0.05, -0.1, 0.02});
        }
        EXPECT_NEAR(a.bodies.stable_dt[0], b.bodies.stable_dt[0], 1e-4 * b.bodies.stable_dt[0]) << solid;
        uint32_t substeps = count_substeps(b.bodies, b.moving(), 0.02, 1e-3);
        for (AdvanceScene* s : {&a, &b}) {
            if (integrator == Integrator::kLeapfrog) break;
            s->bodies.stepping.assign(1, {integrator, 60, 1e-6, 1});
            substeps = 20;
        }
        for (int n = 0; n < 5; ++n) a.advance(20, substeps), b.advance(20, substeps);
        double apart = 0, moved = 0;
        for (uint32_t v = 0; v < node_count(a, 0); ++v) {
            apart = std::max(apart, (a.offset(0, v) - b.offset(0, v)).norm());
            moved = std::max(moved, (a.offset(0, v) - Vec3d(a.anchors.rest_x[v], a.anchors.rest_y[v], a.anchors.rest_z[v])).norm());
        }
        EXPECT_GT(moved, 1e-4);
        EXPECT_LT(apart, 1e-3 * moved) << solid << ' ' << int(integrator);
    }
}
TEST(TissueRegions, OfAllOfABodyIsAnotherTissue) {
    for (const Integrator integrator : {Integrator::kLeapfrog, Integrator::kBackwardEuler}) expect_another_tissue(integrator);
}

// The stable step includes an inclusion: as short as its stiffest part needs, and no shorter. It holds for
// any shape, where springs may pull in every direction; at rest they pull along themselves only and a longer
// one would do: up to sqrt 2 in a sheet, where they share two directions, more at the seam.
TEST(TissueRegions, AnInclusionIsInTheStableStep) {
    const auto bar = [](AdvanceScene& s, double factor) {
        s.params.gravity.setZero();
        const uint32_t body = s.add_body(s.add_mesh(subdivided_sphere(0.05, 2, 0.05)), Motion::kDeformable, Vec3d::Zero(), soft(0));
        NodeTissue nodes = plain(s, body);
        for (uint32_t v = 0; v < nodes.stiffness.size(); ++v) nodes.stiffness[v] = s.offset(body, v).z() > 0.03 ? factor : 1;
        vary(s, body, nodes);
        return body;
    };
    AdvanceScene one;
    const double uniform = one.bodies.stable_dt[bar(one, 1)];
    for (const double share : {0.99, 1.8}) {
        AdvanceScene s;
        const uint32_t body = bar(s, 25);
        const double dt = share * s.bodies.stable_dt[body] / kStableShare;
        EXPECT_LT(s.bodies.stable_dt[body], uniform / 4);
        EXPECT_GE(s.bodies.stable_dt[body], uniform / 5 * 0.99);
        for (uint32_t v = 0; v < node_count(s, body); ++v) s.set_velocity(body, v, {1e-4 * (v % 3), -1e-4 * (v % 5), 1e-4 * (v % 2)});
        double fastest = 0;
        const uint32_t ticks = static_cast<uint32_t>(std::ceil(dt * 2000 * 1e3));
        const uint32_t substeps = static_cast<uint32_t>(std::llround(ticks * 1e-3 / dt));
        s.advance(ticks, substeps);
        for (uint32_t v = 0; v < node_count(s, body); ++v) fastest = std::max(fastest, s.velocity(body, v).norm());
        if (share < 1) {
            EXPECT_LT(fastest, 0.02);
            EXPECT_EQ(s.report.nonfinite_particles, 0u);
        } else {
            EXPECT_TRUE(fastest > 0.1 || s.report.nonfinite_particles > 0) << fastest;
        }
    }
}

// Fixed nodes of a region do not move; a denser region falls no faster but pulls its springs more.
TEST(TissueRegions, FixedNodesStay) {
    AdvanceScene s;
    s.params.gravity = Vec3d(0, 0, -9.81);
    const uint32_t bar = add_bar(s, 4, 0.01, soft(10));
    NodeTissue nodes = plain(s, bar);
    std::vector<Vec3d> rest;
    for (uint32_t v = 0; v < node_count(s, bar); ++v) rest.push_back(s.offset(bar, v)), nodes.fixed[v] = rest[v].z() > 0.035;
    vary(s, bar, nodes);
    for (int n = 0; n < 10; ++n) s.advance(20, 20);
    for (uint32_t v = 0; v < rest.size(); ++v) {
        if (nodes.fixed[v]) {
            EXPECT_EQ(s.offset(bar, v), rest[v]);
        } else {
            EXPECT_LT(s.offset(bar, v).z(), rest[v].z() - 1e-6);
        }
    }
}

// A painted field: the value of the nearest vertex of a PLY file, text or binary; or one clear error.
TEST(TissueRegions, PaintedField) {
    const auto path = std::filesystem::temp_directory_path() / "trocar_painted.ply";
    std::ofstream(path) << "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                           "property double stiffness\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
                           "0 0 0 1.5\n1 0 0 2.5\n0 1 0 40\n3 0 1 2\n";
    const PaintedField field = read_painted_field(path, "stiffness");
    ASSERT_EQ(field.value, (std::vector<double>{1.5, 2.5, 40}));
    EXPECT_EQ(value_at(field, {0.9, 0.1, 3}), 2.5);
    EXPECT_EQ(value_at(field, {0.1, 0.7, 0}), 40);
    for (const std::string wanted : {"hardness", "x "}) {
        try {
            read_painted_field(path, wanted);
            ADD_FAILURE() << wanted;
        } catch (const InputError& e) {
            EXPECT_NE(std::string(e.what()).find("have no number \"" + wanted + "\""), std::string::npos) << e.what();
        }
    }
    std::filesystem::remove(path);
    EXPECT_THROW(read_painted_field(path, "stiffness"), InputError);
}

}  // namespace
}  // namespace trocar
