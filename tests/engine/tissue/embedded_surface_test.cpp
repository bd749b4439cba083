#include "engine/tissue/embedded_surface.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <cstring>
#include <random>

#include "content/scene/make_solid.hpp"
#include "content/volume/organ_surface.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "tests/reference/measures.hpp"
#include "tests/systems/advance/advance_scene.hpp"

// Fine surfaces embedded in coarse tetrahedra.
namespace trocar {
namespace {

constexpr double kRadius = 0.05;  // m

Tissue soft(double damping = 0) {
    Tissue tissue;
    tissue.youngs_modulus = 5e3;
    tissue.damping = damping;
    tissue.depth = kNoFoundation;
    return tissue;
}

uint32_t add_ball(AdvanceScene& s, double cells, bool skin, const Vec3d& origin = Vec3d::Zero(), int levels = 4, double damping = 0) {
    const Prototype made = make_solid(s.meshes, s.springs, s.solids, subdivided_sphere(kRadius, levels), {}, {0, cells, skin});
    EXPECT_EQ(made.judgement.admitted_as, Admission::kSolid) << made.judgement.reason;
    return s.add_body(made.row, Motion::kDeformable, origin, soft(damping));
}

Range nodes_of(const AdvanceScene& s, uint32_t body) {
    const uint32_t skin = embedded_count(s.solids, s.bodies.mesh[body]);
    return {s.range(body).first + skin, s.solids.info[s.bodies.mesh[body]].nodes.count};
}
Vec3d rest_of(const AdvanceScene& s, uint32_t body, uint32_t vertex) {
    return s.meshes.position[s.meshes.info[s.bodies.mesh[body]].vertices.first + vertex];
}
uint32_t vertices_of(const AdvanceScene& s, uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].vertices.count; }

Vec3d position(const Particles& p, uint32_t i) { return {p.offset[i].x, p.offset[i].y, p.offset[i].z}; }
Vec3d speed(const Particles& p, uint32_t i) { return {p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]}; }

// Linear motions of the nodes, in double: tests the weights alone, without the rounding of positions.
TEST(Skin, LinearFieldIsFollowedToRoundOff) {
    AdvanceScene s;
    const uint32_t ball = add_ball(s, 5, true);
    const SolidInfo& info = s.solids.info[s.bodies.mesh[ball]];
    ASSERT_EQ(info.skin.count, vertices_of(s, ball));
    Eigen::Matrix3d slope;
    slope << 1.2, 0.3, -0.1, 0.2, 0.7, 0.4, -0.3, 0.1, 1.1;
    const auto field = [&](const Vec3d& x) -> Vec3d { return slope * x + Vec3d(0.3, -0.1, 0.2); };
    uint32_t outside = 0;
    for (uint32_t v = 0; v < info.skin.count; ++v) {
        Vec3d sum = Vec3d::Zero();
        double one = 0;
        for (int k = 0; k < 4; ++k) {
            const double w = s.solids.embedding_weight[info.skin.first + v][k];
            sum += w * field(s.solids.position[info.inner.first + s.solids.embedding_node[info.skin.first + v][k]]);
            one += w;
            outside += w < 0;
        }
        EXPECT_NEAR(one, 1, 1e-15);
        EXPECT_LT((sum - field(rest_of(s, ball, v))).norm(), 1e-14);
    }
    EXPECT_GT(outside, info.skin.count / 4) << "a ball bulges out of its chords: else nothing was extrapolated";
    // and in floats, as drawn
    const Range nodes = nodes_of(s, ball);
    for (uint32_t i = 0; i < nodes.count; ++i) {
        const Vec3d x = field(s.solids.position[info.inner.first + i]);
        s.particles.offset[nodes.first + i] = {float(x.x()), float(x.y()), float(x.z()), 1};
        s.particles.velocity_x[nodes.first + i] = float(x.y());
    }
    drape_skin(s.solids, s.bodies, ball, s.particles);
    for (uint32_t v = 0; v < info.skin.count; ++v) {
        EXPECT_LT((s.offset(ball, v) - field(rest_of(s, ball, v))).norm(), 1e-7);
        EXPECT_NEAR(s.velocity(ball, v).x(), field(rest_of(s, ball, v)).y(), 1e-7);
    }
}

// Cages with slivers, some of no area at all, as simplification leaves them in flat faces: of closed noisy spheres, edges are split at a
// point on the edge or just off it, and the flat triangle between is listed first, so that ties would choose it.
// Oracle: weights are barycentric, so they sum to one, give the point back and are of order one.
TEST(Skin, SliversOfACageBearNothing) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(0, 1);
    for (uint32_t seed = 0; seed < 24; ++seed) {
        Mesh cage = subdivided_sphere(kRadius, 1, 0.05, seed + 1);
        std::vector<Triangle> slivers;
        std::vector<Vec3d> points;
        for (int split = 0; split < 12; ++split) {
            const Triangle t = cage.triangle[random() % cage.triangle.size()];
            const Vec3d &a = cage.position[t[0]], &b = cage.position[t[1]];
            const Vec3d off = seed % 3 == 0 ? 0.0 * a : std::pow(10.0, -6 - double(seed % 5)) * a;
            const uint32_t middle = static_cast<uint32_t>(cage.position.size());
            const Vec3d on = a + unit(random) * (b - a);
            slivers.push_back({t[0], t[1], middle});
            for (const double along : {0.0, 0.3, 0.7, 1.0}) points.push_back(a + along * (b - a));
            cage.position.push_back(on + off);
        }
        for (const Triangle& t : cage.triangle) {
            const double u = unit(random), v = unit(random) * (1 - u);
            points.push_back(cage.position[t[0]] + u * (cage.position[t[1]] - cage.position[t[0]]) +
                             v * (cage.position[t[2]] - cage.position[t[0]]));
        }
        cage.triangle.insert(cage.triangle.begin(), slivers.begin(), slivers.end());
        const SurfaceEmbedding skin = bind_to_surface(points, cage.position, cage.triangle);
        for (size_t i = 0; i < points.size(); ++i) {
            Vec3d sum = Vec3d::Zero();
            double one = 0, most = 0;
            for (int k = 0; k < 4; ++k) {
                sum += skin.weight[i][k] * cage.position[skin.node[i][k]];
                one += skin.weight[i][k];
                most = std::max(most, std::abs(skin.weight[i][k]));
            }
            EXPECT_NEAR(one, 1, 1e-12) << seed;
            EXPECT_LT((sum - points[i]).norm(), 1e-9 * kRadius) << seed;
            EXPECT_LT(most, 1.1) << seed;
        }
    }
    const std::vector<Vec3d> line{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
    EXPECT_THROW(bind_to_surface(line, line, std::vector<Triangle>{{0, 1, 2}}), InputError);
}

// Against all tetrahedra: a point inside one is bound to that; for other points no binding is much worse than
// the best.
TEST(Skin, BindsToTheTetrahedronThatHolds) {
    AdvanceScene s;
    const uint32_t ball = add_ball(s, 5, true, Vec3d::Zero(), 3);
    const SolidInfo& info = s.solids.info[s.bodies.mesh[ball]];
    const auto node = std::span<const Vec3d>(s.solids.position).subspan(info.inner.first, info.inner.count);
    std::vector<std::array<uint32_t, 4>> tets(info.count);
    for (uint32_t t = 0; t < info.count; ++t) {
        for (int k = 0; k < 4; ++k) tets[t][k] = s.solids.corner[k][info.tetrahedra.first + t];
    }
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::vector<Vec3d> points;
    while (points.size() < 400) {
        const Vec3d p = kRadius * Vec3d(unit(random), unit(random), unit(random));
        if (p.norm() < kRadius) points.push_back(p);
    }
    const SurfaceEmbedding skin = bind_skin(points, node, tets);
    for (size_t i = 0; i < points.size(); ++i) {
        double best = -INFINITY;
        for (const auto& t : tets) {
            Eigen::Matrix3d corner;
            for (int k = 0; k < 3; ++k) corner.col(k) = node[t[k + 1]] - node[t[0]];
            const Vec3d w = corner.partialPivLu().solve(points[i] - node[t[0]]);
            best = std::max(best, std::min(1 - w.sum(), w.minCoeff()));
        }
        const double least = *std::min_element(skin.weight[i].begin(), skin.weight[i].end());
        EXPECT_NEAR(least, best, 1e-9) << i;
    }
    EXPECT_LT(skin.outside, 0.25 * 2 * kRadius / 5);
    // a part outside the tetrahedra
    points.push_back({0, 0, 3 * kRadius});
    EXPECT_THROW(bind_skin(points, node, tets), InputError);
}

// One contact constraint on one vertex: the nodes get exactly its impulse, and its moment about the vertex.
TEST(Skin, ContactGivesItsImpulseAndMomentToTheNodes) {
    AdvanceScene s;
    s.params.gravity.setZero();
    const uint32_t ball = add_ball(s, 4, true);
    s.bodies.spring_stiffness[ball] = 0;  // only the contact
    s.bodies.tissue[ball].poisson = 0.25;
    const uint32_t wall = s.add_body(s.add_mesh(flat_square(0.2), Admission::kSheet), Motion::kStatic, {0, 0, -kRadius});
    const Range nodes = nodes_of(s, ball);
    const Vec3d approach(0.02, -0.01, -0.05);
    for (uint32_t i = nodes.first; i < nodes.end(); ++i) {
        s.particles.velocity_x[i] = float(approach.x()), s.particles.velocity_y[i] = float(approach.y()),
        s.particles.velocity_z[i] = float(approach.z());
    }
    drape_skin(s.solids, s.bodies, ball, s.particles);
    uint32_t lowest = 0;
    for (uint32_t v = 0; v < vertices_of(s, ball); ++v) {
        if (rest_of(s, ball, v).z() < rest_of(s, ball, lowest).z()) lowest = v;
    }
    s.params.contact.push_speed = 0;
    s.add_constraint(ball, lowest, wall, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, 0, 0.2);
    const Particles before = s.particles;
    s.advance(1, 1);
    const Vec3d impulse = s.contact_constraints.impulse[0];
    EXPECT_GT(impulse.z(), 0);
    EXPECT_GT(impulse.head<2>().norm(), 0.1 * impulse.z()) << "friction too";
    Vec3d linear = -impulse, angular = Vec3d::Zero(), at = Vec3d::Zero();
    const uint32_t row = s.solids.info[s.bodies.mesh[ball]].skin.first + lowest;
    for (int k = 0; k < 4; ++k) at += s.solids.embedding_weight[row][k] * position(before, nodes.first + s.solids.embedding_node[row][k]);
    angular -= at.cross(impulse);
    double size = 0;
    for (uint32_t i = nodes.first; i < nodes.end(); ++i) {
        const Vec3d change = (speed(s.particles, i) - speed(before, i)) / before.offset[i].w;
        linear += change;
        angular += position(before, i).cross(change);
        size += speed(s.particles, i).norm() / before.offset[i].w;
    }
    EXPECT_LT(linear.norm(), 1.2e-7 * size);  // an ulp of the velocities
    EXPECT_LT(angular.norm(), 1.2e-7 * size * kRadius);
    // the vertex itself does not approach, except by one ulp of its position in one step
    EXPECT_NEAR(s.velocity(ball, lowest).z(), 0, 4e-9 / 1e-3);
}

// Two embedded spheres collide freely: what one gains in momentum the other loses, and neither starts to
// rotate.
TEST(Skin, CollisionKeepsMomentum) {
    AdvanceScene s;
    s.params.gravity.setZero();
    s.params.contact.iterations = 4;
    s.params.contact.push_speed = 0;  // it changes positions without impulse, but with a moment
    const uint32_t a = add_ball(s, 4, true, Vec3d::Zero(), 3), b = add_ball(s, 5, true, Vec3d(0.03, 0.01, 2.0 * kRadius - 1e-3), 3);
    for (const uint32_t body : {a, b}) {
        const Range nodes = nodes_of(s, body);
        for (uint32_t i = nodes.first; i < nodes.end(); ++i) s.particles.velocity_z[i] = body == a ? 0.3f : -0.1f;
        drape_skin(s.solids, s.bodies, body, s.particles);
    }
    const auto total = [&] {
        Momentum sum;
        for (const uint32_t body : {a, b}) {
            const Momentum m = measure_momentum(s.bodies, s.poses, s.particles, body);
            sum.linear += m.linear, sum.angular += m.angular;
        }
        return sum;
    };
    const Momentum first = measure_momentum(s.bodies, s.poses, s.particles, a), start = total();
    uint64_t rows = 0;
    for (int pass = 0; pass < 12; ++pass) {
        s.clear_constraints();
        s.find_constraints(a, b, 0);  // friction acts at both ends of a separation that closes within the step: a moment
        rows += s.contact_constraints.body.size();
        s.advance(10, 20);
    }
    EXPECT_GT(rows, 50u);
    EXPECT_GT((measure_momentum(s.bodies, s.poses, s.particles, a).linear - first.linear).norm(), 0.5 * first.linear.norm());
    const Momentum end = total();
    const double scale = first.linear.norm();
    EXPECT_LT((end.linear - start.linear).norm(), 1e-6 * scale);
    EXPECT_LT((end.angular - start.angular).norm(), 2e-6 * scale * 2 * kRadius);
}

// The particles of an embedded surface hold no state: garbage in them changes nothing, and they follow the
// nodes with any number of threads.
TEST(Skin, IsDerivedAndTheSameForAnyThreads) {
    std::vector<Float4> first;
    for (const uint32_t threads : {1u, 2u, 4u}) {
        AdvanceScene s;
        const uint32_t ball = add_ball(s, 8, true, Vec3d::Zero(), 5, 3);
        s.particles.offset[nodes_of(s, ball).first].w = 0;
        if (threads == 2) {
            for (uint32_t v = 0; v < vertices_of(s, ball); ++v) s.particles.offset[s.range(ball).first + v].x = NAN;
        }
        ThreadPool pool(threads);
        pool.run([&] { s.advance(20, 20); });
        for (const Float4& o : s.particles.offset) ASSERT_TRUE(std::isfinite(o.x + o.y + o.z));
        EXPECT_EQ(s.result.nonfinite_particles, 0u);
        if (first.empty()) first = s.particles.offset;
        ASSERT_EQ(std::memcmp(first.data(), s.particles.offset.data(), first.size() * sizeof(Float4)), 0) << threads;
        double moved = 0;
        for (uint32_t v = 0; v < vertices_of(s, ball); ++v) moved = std::max(moved, (s.offset(ball, v) - rest_of(s, ball, v)).norm());
        EXPECT_GT(moved, 1e-4);
    }
}

// A sphere held at its bottom sags under its weight: the embedded surface compared with the surface of the
// same tetrahedra, from which linear interpolation between nodes h apart may deviate by sag / R^2 * h^2 / 2;
// and with that of much finer ones, for information.
TEST(Skin, SagsAsTheFineSolidDoes) {
    const auto sag = [](double cells, bool skin) {
        AdvanceScene s;
        const uint32_t ball = add_ball(s, cells, skin, Vec3d::Zero(), 4, 60);
        const Range nodes{nodes_of(s, ball)};
        for (uint32_t i = nodes.first; i < nodes.end(); ++i) {
            if (s.particles.offset[i].z < -0.4f * float(kRadius)) s.particles.offset[i].w = 0;
        }
        update_solid_dt(s.meshes, s.springs, s.solids, ball, s.particles, s.anchors, s.bodies);
        for (int i = 0; i < 40; ++i) s.advance(20, substeps_for(20e-3, s.bodies.stable_dt[ball], 1e-3));
        double top = -1, rest = -1;  // highest vertex
        for (uint32_t v = 0; v < vertices_of(s, ball); ++v) {
            top = std::max(top, s.offset(ball, v).z()), rest = std::max(rest, rest_of(s, ball, v).z());
        }
        return rest - top;
    };
    const double fine = sag(16, false), coarse = sag(6, true), middle = sag(12, true);
    std::printf("sag of the top: fine solid %.4f mm, skin on 12 cells %.4f mm, on 6 cells %.4f mm\n", fine * 1e3, middle * 1e3,
                coarse * 1e3);
    EXPECT_GT(fine, 1e-4);
    for (const double cells : {6.0, 12.0}) {
        const double plain = sag(cells, false), skin = cells == 6 ? coarse : middle, h = 2 / cells;
        std::printf("surface of the same %g cells: %.4f mm\n", cells, plain * 1e3);
        EXPECT_LT(std::abs(skin - plain), plain * h * h / 2);
    }
}

// ---- shells with an embedded surface ----

uint32_t add_caged(AdvanceScene& s, double cells, const Tissue& tissue, AnchorFrame frame = AnchorFrame::kWorld, int levels = 4) {
    const Prototype made = make_caged_shell(s.meshes, s.springs, s.solids, subdivided_sphere(kRadius, levels), {},
                                            {.cells = cells, .pressure = tissue.pressure_modulus > 0, .bending = tissue.bending > 0});
    EXPECT_EQ(made.judgement.admitted_as, Admission::kSolid) << made.judgement.reason;
    const uint32_t body = s.add_body(made.row, Motion::kKinematic, Vec3d::Zero(), tissue, frame);
    s.bodies.motion[body] = Motion::kDeformable;
    add_caged_shell_body(s.meshes, s.springs, s.solids, s.poses, body, s.bodies, s.particles, s.anchors);
    return body;
}
Tissue bedded(double damping = 0) {
    Tissue tissue = soft(damping);
    tissue.depth = 0.05;
    return tissue;
}

// A shell's fine surface on its coarse one: linear motions to round-off, weights of a triangle and an apex,
// mass conserved.
TEST(CagedShell, LinearFieldIsFollowedAndMassIsThatOfTheSkin) {
    AdvanceScene s;
    const uint32_t ball = add_caged(s, 8, bedded());
    const uint32_t prototype = s.bodies.mesh[ball];
    const SolidInfo& info = s.solids.info[prototype];
    ASSERT_EQ(info.count, 0u);
    ASSERT_EQ(info.skin.count, vertices_of(s, ball));
    EXPECT_LT(info.nodes.count, vertices_of(s, ball) / 4);
    Eigen::Matrix3d slope;
    slope << 1.2, 0.3, -0.1, 0.2, 0.7, 0.4, -0.3, 0.1, 1.1;
    uint32_t off = 0;
    for (uint32_t v = 0; v < info.skin.count; ++v) {
        Vec3d sum = Vec3d::Zero();
        double one = 0;
        for (int k = 0; k < 4; ++k) {
            const double w = s.solids.embedding_weight[info.skin.first + v][k];
            sum += w * (slope * s.solids.position[info.inner.first + s.solids.embedding_node[info.skin.first + v][k]]);
            one += w;
        }
        off += std::abs(s.solids.embedding_weight[info.skin.first + v][3]) > 1e-3;
        EXPECT_NEAR(one, 1, 1e-14);
        EXPECT_LT((sum - slope * rest_of(s, ball, v)).norm(), 1e-14);
    }
    EXPECT_GT(off, info.skin.count / 4) << "a ball bulges out of its chords: else no apex was needed";
    double mass = 0;
    const Range nodes = nodes_of(s, ball);
    for (uint32_t i = nodes.first; i < nodes.end(); ++i) mass += s.particles.offset[i].w > 0 ? 1 / double{s.particles.offset[i].w} : 0;
    const double wanted = s.bodies.tissue[ball].density * s.meshes.info[prototype].volume;
    EXPECT_NEAR(mass, wanted, 1e-6 * wanted);
    EXPECT_GT(s.bodies.stable_dt[ball], 0);
}

// One contact constraint on one vertex of the embedded surface: the nodes get all of its impulse and moment.
TEST(CagedShell, ContactGivesItsImpulseAndMomentToTheNodes) {
    AdvanceScene s;
    s.params.gravity.setZero();
    const uint32_t ball = add_caged(s, 6, bedded());
    s.bodies.spring_stiffness[ball] = 0;  // only the contact
    std::fill(s.anchors.stiffness.begin(), s.anchors.stiffness.end(), 0.0f);
    const uint32_t wall = s.add_body(s.add_mesh(flat_square(0.2), Admission::kSheet), Motion::kStatic, {0, 0, -kRadius});
    const Range nodes = nodes_of(s, ball);
    for (uint32_t i = nodes.first; i < nodes.end(); ++i) s.particles.velocity_x[i] = 0.02f, s.particles.velocity_z[i] = -0.05f;
    drape_skin(s.solids, s.bodies, ball, s.particles);
    uint32_t lowest = 0;
    for (uint32_t v = 0; v < vertices_of(s, ball); ++v) {
        if (rest_of(s, ball, v).z() < rest_of(s, ball, lowest).z()) lowest = v;
    }
    s.params.contact.push_speed = 0;
    s.add_constraint(ball, lowest, wall, {0, 1, 2}, {0.4, 0.3, 0.3}, {0, 0, 1}, 0, 0.2);
    const Particles before = s.particles;
    s.advance(1, 1);
    const Vec3d impulse = s.contact_constraints.impulse[0];
    EXPECT_GT(impulse.z(), 0);
    Vec3d linear = -impulse, angular = Vec3d::Zero(), at = Vec3d::Zero();
    const uint32_t row = s.solids.info[s.bodies.mesh[ball]].skin.first + lowest;
    for (int k = 0; k < 4; ++k) at += s.solids.embedding_weight[row][k] * position(before, nodes.first + s.solids.embedding_node[row][k]);
    angular -= at.cross(impulse);
    double size = 0;
    for (uint32_t i = nodes.first; i < nodes.end(); ++i) {
        const Vec3d change = (speed(s.particles, i) - speed(before, i)) / before.offset[i].w;
        linear += change;
        angular += position(before, i).cross(change);
        size += speed(s.particles, i).norm() / before.offset[i].w;
    }
    EXPECT_LT(linear.norm(), 1.2e-7 * size);  // an ulp of the velocities
    EXPECT_LT(angular.norm(), 1.2e-7 * size * kRadius);
}

// Pressure and bending with an embedded surface are those of the coarse surface alone: nodes, step and
// energies are, bitwise, those of a shell made of only that surface, with the same masses and anchors.
TEST(CagedShell, SwellsAndBendsAsTheShellThatCarriesIt) {
    Tissue tissue = bedded(5);
    tissue.pressure_modulus = 2e4, tissue.bending = 5e4, tissue.wall = 4e-3;
    AdvanceScene caged, plain;
    const uint32_t ball = add_caged(caged, 8, tissue);
    const SolidInfo& info = caged.solids.info[caged.bodies.mesh[ball]];
    Mesh cage = subdivided_sphere(kRadius, 4);
    const double spacing = 2 * kRadius / 8, area = caged.meshes.info[0].area;
    cage.position.assign(caged.meshes.position.begin(), caged.meshes.position.end());
    cage.triangle.assign(caged.meshes.triangle.begin(), caged.meshes.triangle.end());
    simplify_mesh(cage, static_cast<uint32_t>(area / (0.25 * std::sqrt(3.0) * spacing * spacing)));
    ASSERT_EQ(cage.position.size(), info.nodes.count);
    const uint32_t shell = plain.add_body(plain.add_mesh(cage), Motion::kDeformable, Vec3d::Zero(), tissue);
    const Range nodes = nodes_of(caged, ball), rows = plain.range(shell);
    for (uint32_t v = 0; v < nodes.count; ++v) {
        ASSERT_EQ(position(caged.particles, nodes.first + v), position(plain.particles, rows.first + v));
        plain.particles.offset[rows.first + v].w = caged.particles.offset[nodes.first + v].w;
        plain.anchors.stiffness[rows.first + v] = caged.anchors.stiffness[nodes.first + v];
        const Vec3d push = 0.2 * Vec3d(std::sin(3.0 * v), std::cos(5.0 * v), std::sin(7.0 * v));
        plain.set_velocity(shell, v, push);
        caged.set_velocity(ball, nodes.first + v - caged.range(ball).first, push);
    }
    update_stable_dt(plain.springs, shell, plain.particles, plain.anchors, plain.bodies);
    EXPECT_EQ(plain.bodies.stable_dt[shell], caged.bodies.stable_dt[ball]);
    for (AdvanceScene* s : {&caged, &plain}) {
        s->open_energy_account();
        for (int i = 0; i < 10; ++i) s->advance(5, substeps_for(5e-3, plain.bodies.stable_dt[shell], 1e-3));
        s->measure();
        EXPECT_GT(s->energy.pressure, 1e-6);
        EXPECT_GT(s->energy.bending, 1e-6);
        EXPECT_LT(std::abs(s->energy.balance), 1e-2 * s->energy.kinetic);
    }
    EXPECT_EQ(plain.energy.pressure, caged.energy.pressure);
    EXPECT_EQ(plain.energy.bending, caged.energy.bending);
    for (uint32_t v = 0; v < nodes.count; ++v)
        EXPECT_EQ(position(caged.particles, nodes.first + v), position(plain.particles, rows.first + v)) << v;
}

// The gain in step: that of the cage over that of the fine surface's own springs is about the ratio of edges,
// because masses grow with their square and stiffness does not. And under its weight on its elastic
// foundation the cage sinks as the shell does.
TEST(CagedShell, GainsStepAndSinksAsTheShellDoes) {
    AdvanceScene fine, coarse;
    Tissue tissue = soft(60);
    tissue.depth = 0.05;
    const uint32_t shell = fine.add_body(fine.add_mesh(subdivided_sphere(kRadius, 4)), Motion::kDeformable, Vec3d::Zero(), tissue);
    const uint32_t caged = add_caged(coarse, 8, bedded(60));
    const double gained = coarse.bodies.stable_dt[caged] / fine.bodies.stable_dt[shell];
    const double edges = coarse.springs.info[coarse.bodies.mesh[caged]].mean_rest / fine.springs.info[0].mean_rest;
    std::printf("shell under a skin: %.3g times the step, edges %.3g times as long\n", gained, edges);
    EXPECT_GT(gained, 0.6 * edges);
    EXPECT_GT(edges, 2);
    for (AdvanceScene* s : {&fine, &coarse}) {
        for (int i = 0; i < 40; ++i) s->advance(20, substeps_for(20e-3, s->bodies.stable_dt[0], 1e-3));
    }
    double sag[2] = {0, 0};
    for (uint32_t v = 0; v < vertices_of(fine, shell); ++v) sag[0] -= (fine.offset(shell, v) - rest_of(fine, shell, v)).z();
    for (uint32_t v = 0; v < vertices_of(coarse, caged); ++v) sag[1] -= (coarse.offset(caged, v) - rest_of(coarse, caged, v)).z();
    EXPECT_GT(sag[0], 0);
    EXPECT_NEAR(sag[1] / sag[0], 1, 0.05);
}

}  // namespace
}  // namespace trocar
