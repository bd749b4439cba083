#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cstring>
#include <map>
#include <set>

#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "tests/reference/measures.hpp"
#include "tests/reference/sample_meshes.hpp"
#include "tests/systems/advance/advance_scene.hpp"
namespace trocar {
namespace {

// Two free shells that overlap and approach: many contact constraints, some of them of edge points.
struct Collision : AdvanceScene {
    explicit Collision(const Vec3d& velocity, double friction = 0, int levels = 3) {
        params.gravity.setZero();
        margin = 2e-3;
        Tissue tissue;
        tissue.damping = 3;
        const uint32_t mesh = add_mesh(subdivided_sphere(0.03, levels, 0.01));
        add_body(mesh, Motion::kDeformable, Vec3d(0, 0, 0), tissue, AnchorFrame::kShape);
        add_body(mesh, Motion::kDeformable, Vec3d(0.05, 0.006, 0.002), tissue, AnchorFrame::kShape, from_rotation_vector({1, 2, 0}));
        for (uint32_t v = 0; v < range(0).count; ++v) set_velocity(0, v, velocity + 0.2 * offset(0, v));
        find_constraints(0, 1, friction);
        for (uint32_t constraint = 0; constraint < contact_constraints.body.size(); constraint += 5) {
            contact_constraints.vertex[constraint][1] =
                neighbour_of(contact_constraints.body[constraint], contact_constraints.vertex[constraint][0]);
            contact_constraints.along[constraint] = 0.25f;
        }
    }
    uint32_t neighbour_of(uint32_t body, uint32_t vertex) const {
        for (const Triangle& t : mesh_view(meshes, bodies.mesh[body]).triangle) {
            if (t[0] == vertex) return t[1];
        }
        return vertex;
    }
    size_t constraints_in_wide() const { return contact_constraints.body.size() - scratch.solver.prepared.size(); }
    uint32_t particle(uint32_t body, uint32_t vertex) const { return range(body).first + vertex; }
};

// A reference constraint: an impulse j along the normal adds weight[k] / mass j to particle[k].
struct ReferenceConstraint {
    std::vector<uint32_t> particle;
    std::vector<double> weight;
    Vec3d normal;
    double target_velocity = 0, effective_mass = 0, impulse = 0;
};

// Weights of the corners at a point's projection along the normal, from the definition: a linear system.
Eigen::Vector4d closest_point_by_definition(const Vec3d& point, const Vec3d& normal, const std::array<Vec3d, 3>& corner) {
    Eigen::Matrix4d m;
    for (int k = 0; k < 3; ++k) m.col(k) << corner[k], 1;
    m.col(3) << normal, 0;
    return m.fullPivLu().solve((Eigen::Vector4d() << point, 1).finished());
}

// Active constraints of a substep, from the positions at its start and the velocities after its kick.
std::vector<ReferenceConstraint> reference_constraints(const Collision& s, const std::vector<Vec3d>& position,
                                                       const std::vector<Vec3d>& velocity, double dt) {
    std::vector<ReferenceConstraint> out;
    for (uint32_t constraint = 0; constraint < s.contact_constraints.body.size(); ++constraint) {
        ReferenceConstraint r;
        Vec3d point = Vec3d::Zero(), plane = Vec3d::Zero(), v = Vec3d::Zero();
        std::array<Vec3d, 3> corner;
        const double along = s.contact_constraints.along[constraint];
        for (int i = 0; i < 2; ++i) {
            const uint32_t p = s.particle(s.contact_constraints.body[constraint], s.contact_constraints.vertex[constraint][i]);
            const double w = i == 0 ? 1 - along : along;
            point += w * position[p];
            v += w * velocity[p];
            r.particle.push_back(p);
            r.weight.push_back(w);
        }
        for (int k = 0; k < 3; ++k) {
            const uint32_t p = s.particle(s.contact_constraints.other[constraint], s.contact_constraints.triangle[constraint][k]);
            corner[k] = position[p];
            plane += double(s.contact_constraints.weight[constraint][k]) * position[p];
            v -= double(s.contact_constraints.weight[constraint][k]) * velocity[p];
            r.particle.push_back(p);
        }
        r.normal = s.contact_constraints.normal[constraint];
        const double separation = r.normal.dot(point - plane);
        if (!(separation + std::min(r.normal.dot(v), 0.0) * dt < 0)) continue;
        const Eigen::Vector4d closest = closest_point_by_definition(point, r.normal, corner);
        for (int k = 0; k < 3; ++k) r.weight.push_back(-closest[k]);
        r.target_velocity = -std::max(separation, 0.0) / dt;
        double sum = 0;
        for (size_t k = 0; k < 5; ++k) sum += r.weight[k] * r.weight[k] * s.particles.offset[r.particle[k]].w;
        r.effective_mass = 1 / sum;
        out.push_back(r);
    }
    return out;
}

// Without friction the velocities that satisfy all constraints are unique, whatever the order of the sweeps:
// many sweeps with wide constraints equal a plain Gauss-Seidel in double.
TEST(AdvanceBlocks, ManySweepsEqualAReferenceInDouble) {
    Collision s({0.3, 0.02, 0.01});
    Collision clean({0.3, 0.02, 0.01});
    clean.clear_constraints();
    clean.advance(1, 1);
    std::vector<Vec3d> position, velocity;
    for (uint32_t body = 0; body < 2; ++body) {
        for (uint32_t v = 0; v < s.range(body).count; ++v) {
            position.push_back(s.poses.origin[body] + s.offset(body, v));
            velocity.push_back(clean.velocity(body, v));
        }
    }
    std::vector<ReferenceConstraint> constraints = reference_constraints(s, position, velocity, 1e-3);
    ASSERT_GT(constraints.size(), 64u);
    for (int sweep = 0; sweep < 3000; ++sweep) {
        for (ReferenceConstraint& r : constraints) {
            Vec3d v = Vec3d::Zero();
            for (size_t k = 0; k < 5; ++k) v += r.weight[k] * velocity[r.particle[k]];
            const double impulse = std::max(0.0, r.impulse - (r.normal.dot(v) - r.target_velocity) * r.effective_mass);
            for (size_t k = 0; k < 5; ++k) {
                velocity[r.particle[k]] += r.weight[k] * s.particles.offset[r.particle[k]].w * (impulse - r.impulse) * r.normal;
            }
            r.impulse = impulse;
        }
    }
    s.params.contact.iterations = 400;
    s.params.contact.push_speed = 0;
    s.advance(1, 1);
    EXPECT_GT(s.constraints_in_wide(), 0.8 * double(s.contact_constraints.body.size()));
    EXPECT_EQ(s.result.active_constraints, constraints.size());
    EXPECT_EQ(s.result.expired_constraints, 0u);
    double worst = 0, moved = 0;
    for (uint32_t body = 0; body < 2; ++body) {
        for (uint32_t v = 0; v < s.range(body).count; ++v) {
            worst = std::max(worst, (s.velocity(body, v) - velocity[s.particle(body, v)]).norm());
            moved = std::max(moved, (s.velocity(body, v) - clean.velocity(body, v)).norm());
        }
    }
    std::printf("%zu of %zu rows act, %zu in blocks; they change velocities by up to %.3g m/s, worst error %.3g\n", constraints.size(),
                s.contact_constraints.body.size(), s.constraints_in_wide(), moved, worst);
    EXPECT_GT(moved, 0.05);
    EXPECT_LT(worst, 1e-6);
}

// With friction and correction: momentum is kept, contact only dissipates, the energy balances.
TEST(AdvanceBlocks, MomentumAndBooks) {
    for (const ResponseShare share : {ResponseShare::kMass, ResponseShare::kStiffness, ResponseShare::kHalf}) {
        Collision s({0.2, 0.05, 0}, 0.3);
        s.params.contact.share = share;
        const auto momentum = [&] {
            return Vec3d(measure_momentum(s.bodies, s.poses, s.particles, 0).linear +
                         measure_momentum(s.bodies, s.poses, s.particles, 1).linear);
        };
        const Vec3d start = momentum(), first = measure_momentum(s.bodies, s.poses, s.particles, 0).linear;
        s.open_energy_account();
        double peak = 0, worst = 0, residual = 1;
        for (int pass = 0; pass < 30; ++pass) {
            s.clear_constraints();
            s.find_constraints(0, 1, 0.3);
            s.advance(5, 40);
            if (pass == 0) {
                EXPECT_GT(s.constraints_in_wide(), 64u);
            }
            s.measure();
            peak = std::max(peak, s.energy.elastic);
            worst = std::max(worst, std::abs(s.energy.balance));
            residual = s.result.deepest_residual;
        }
        std::printf("share %d: worst balance %.3f %% of the peak, momentum %.2g\n", int(share), 100 * worst / peak,
                    (momentum() - start).norm() / start.norm());
        EXPECT_LT((momentum() - start).norm(), 1e-6 * start.norm());
        EXPECT_GT((measure_momentum(s.bodies, s.poses, s.particles, 0).linear - first).norm(), 0.2 * first.norm());
        EXPECT_LT(worst, 0.01 * peak);
        EXPECT_LT(s.energy.work_contact, 0);
        EXPECT_LT(residual, 2e-3);
    }
}

// Also if constraints expire meanwhile: the content of wide constraints does not depend on it.
TEST(AdvanceBlocks, SplitCallsGiveTheSameBits) {
    Collision whole({0.2, 1.5, 0}, 0.1), split({0.2, 1.5, 0}, 0.1);
    whole.params.contact.iterations = split.params.contact.iterations =
        1;  // with two iterations or more a call warm starts from the end of the last
    whole.advance(10, 20);
    for (int i = 0; i < 10; ++i) split.advance(1, 2);
    EXPECT_GT(whole.result.expired_constraints, 10u);
    EXPECT_LT(whole.result.expired_constraints, whole.contact_constraints.body.size());
    EXPECT_GT(whole.constraints_in_wide(), 64u);
    EXPECT_EQ(0, std::memcmp(whole.particles.offset.data(), split.particles.offset.data(), whole.particles.offset.size() * sizeof(Float4)));
    EXPECT_EQ(whole.particles.velocity_y, split.particles.velocity_y);
    EXPECT_EQ(whole.report.expired_constraints, split.report.expired_constraints);
    EXPECT_EQ(whole.contact_constraints.distance, split.contact_constraints.distance);
}

// No wide constraint contains a node pressed from opposite sides; constraints of such nodes stay scalar.
TEST(AdvanceBlocks, NodesPressedFromBothSidesStayOut) {
    Collision s({0, 0, 0});
    const size_t constraints = s.contact_constraints.body.size();
    for (size_t constraint = 0; constraint < constraints; constraint += 10) {
        const uint32_t v = s.contact_constraints.vertex[constraint][0];
        s.add_constraint(s.contact_constraints.body[constraint], v, s.contact_constraints.other[constraint],
                         s.contact_constraints.triangle[constraint], {0.3, 0.3, 0.4}, -s.contact_constraints.normal[constraint], 0.0, 0.0);
    }
    s.advance(1, 2);
    ASSERT_FALSE(s.scratch.solver.wide_constraint.empty());
    std::vector<uint8_t> turned(s.particles.offset.size(), 0);
    for (size_t constraint = constraints; constraint < s.contact_constraints.body.size(); ++constraint) {
        turned[s.particle(s.contact_constraints.body[constraint], s.contact_constraints.vertex[constraint][0])] = 1;
        for (const uint32_t v : s.contact_constraints.triangle[constraint])
            turned[s.particle(s.contact_constraints.other[constraint], v)] = 1;
    }
    for (const WideConstraint& wide_constraint : s.scratch.solver.wide_constraint) {
        for (uint32_t lane = 0; lane < 4; ++lane) {
            if (wide_constraint.constraint[lane] == kNone) continue;
            const uint32_t constraint = wide_constraint.constraint[lane];
            for (const uint32_t v : s.contact_constraints.vertex[constraint])
                EXPECT_FALSE(turned[s.particle(s.contact_constraints.body[constraint], v)]);
            for (const uint32_t v : s.contact_constraints.triangle[constraint])
                EXPECT_FALSE(turned[s.particle(s.contact_constraints.other[constraint], v)]);
        }
    }
    EXPECT_GT(s.report.opposing_planes, 0u);
}

// A sheet of overlapping soft balls: one island of many bodies. One of so many is rigid and free.
struct Sheet : AdvanceScene {
    explicit Sheet(uint32_t rigid_of = 0) {
        params.gravity.setZero();
        params.contact.push_speed = 0.5;
        margin = 6e-3;
        Tissue tissue, undamped;
        tissue.damping = 3;
        undamped.damping = 0;
        const uint32_t mesh = add_mesh(subdivided_sphere(0.03, 2, 0.02));
        constexpr int kColumns = 34, kLines = 6;
        for (int i = 0; i < kColumns; ++i)
            for (int j = 0; j < kLines; ++j) {
                const Vec3d at(0.056 * i, 0.057 * j, 0);
                if (rigid_of > 0 && bodies.mesh.size() % rigid_of == 1) {
                    EXPECT_TRUE(set_rigid_mass(meshes, add_body(mesh, Motion::kFree, at, undamped), 0.05, bodies, particles));
                } else {
                    add_body(mesh, Motion::kDeformable, at, tissue, AnchorFrame::kShape);
                }
            }
        for (int i = 0; i < kColumns; ++i) {
            for (int j = 0; j < kLines; ++j) {
                const uint32_t body = static_cast<uint32_t>(kLines * i + j);
                if (i + 1 < kColumns) find_constraints(body, body + kLines, 0.3);
                if (j + 1 < kLines) find_constraints(body, body + 1, 0.3);
            }
        }
        find_constraints(3, static_cast<uint32_t>(kLines * (kColumns - 1)), 0.3);  // none: the ends are far apart
        for (uint32_t b = 0; b < kColumns * kLines; ++b) {
            const Vec3d direction((b + b / kLines) % 3 ? -0.2 : 0.3, b % 2 ? 0.2 : -0.1, 0.1);  // neighbours of both kinds collide
            for (uint32_t v = 0; v < range(b).count; ++v) set_velocity(b, v, direction);
            if (bodies.motion[b] == Motion::kFree) poses.velocity[b] = direction;
        }
    }
    Vec3d momentum() const {
        Vec3d sum = Vec3d::Zero();
        for (uint32_t b = 0; b < bodies.mesh.size(); ++b)
            if (bodies.motion[b] == Motion::kDeformable || bodies.motion[b] == Motion::kFree)
                sum += measure_momentum(bodies, poses, particles, b).linear;
        return sum;
    }
};

// Groups of one colour share no node, every constraint is in one group, threads change nothing. Breaks when a
// constraint gets into another slab's group, or is lost or duplicated in sorting.
void expect_same_bits_on_any_threads(uint32_t rigid_of) {
    std::vector<Float4> position[2];
    std::vector<Vec3d> origin[2], spin[2];
    for (const uint32_t threads : {1u, 4u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            Sheet s(rigid_of);
            const Vec3d before = s.momentum();
            s.advance(16, 8);
            const ContactSolver& c = s.scratch.solver;
            ASSERT_GT(c.colour[1], 1u) << "one strip only: nothing is tested";
            ASSERT_GT(c.colour[4], c.colour[1] + 1);
            std::multiset<uint32_t> seen;
            for (int colour = 0; colour < 4; ++colour) {
                std::map<uint32_t, uint32_t> group_of_node;
                for (uint32_t g = c.colour[colour]; g < c.colour[colour + 1]; ++g) {
                    const auto take = [&](uint32_t node) {
                        EXPECT_EQ(group_of_node.emplace(node, g).first->second, g) << "node " << node << " in phase " << colour;
                    };
                    for (uint32_t i = c.group[g].prepared.first; i < c.group[g].prepared.end(); ++i) {
                        const PreparedConstraint& prepared = c.prepared[i];
                        seen.insert(prepared.constraint);
                        for (const uint32_t rigid : {prepared.rigid_a, prepared.rigid_b})
                            if (rigid != kNone) take(s.scratch.island.rigid[rigid].node);
                        for (int k = 0; k < 3; ++k) {
                            if (prepared.rigid_a == kNone) take(prepared.node_a[k]);
                            if (prepared.rigid_b == kNone) take(prepared.node_b[k]);
                        }
                    }
                    for (uint32_t i = c.group[g].wide_constraint.first; i < c.group[g].wide_constraint.end(); ++i) {
                        for (const uint32_t constraint : c.wide_constraint[i].constraint)
                            if (constraint != kNone) seen.insert(constraint);
                        for (const auto& part : c.wide_constraint[i].node)
                            for (const uint32_t node : part) take(node);
                    }
                }
            }
            EXPECT_EQ(seen.size(), s.contact_constraints.body.size());
            for (uint32_t constraint = 0; constraint < s.contact_constraints.body.size(); ++constraint)
                EXPECT_EQ(seen.count(constraint), 1u);
            EXPECT_GT(s.result.active_constraints, 1000u);
            EXPECT_LT((s.momentum() - before).norm(), 1e-6 * before.norm());
            position[threads > 1] = s.particles.offset;
            origin[threads > 1] = s.poses.origin;
            spin[threads > 1] = s.poses.angular_velocity;
        });
    }
    ASSERT_EQ(position[0].size(), position[1].size());
    EXPECT_EQ(0, std::memcmp(position[0].data(), position[1].data(), position[0].size() * sizeof(Float4)));
    EXPECT_EQ(origin[0], origin[1]);
    EXPECT_EQ(spin[0], spin[1]);
}
TEST(AdvanceGroups, ShareNoNodeAndGiveTheSameBitsOnAnyThreads) { expect_same_bits_on_any_threads(0); }
TEST(AdvanceGroups, OfFreeBodiesShareNoNodeAndGiveTheSameBitsOnAnyThreads) { expect_same_bits_on_any_threads(5); }

// Without friction the constrained velocities are unique; an untouched hand keeps an island in one group.
// Breaks when groups lose impulses of free bodies, or when sweeps end long before the groups converge.
TEST(AdvanceGroups, OfFreeBodiesComeToWhatOneGroupComesTo) {
    ThreadPool pool(2);
    pool.run([&] {
        Sheet split(5), whole(5), apart(5);
        whole.add_body(whole.bodies.mesh[0], Motion::kHand, Vec3d(0, 0, 5));
        apart.clear_constraints();
        for (Sheet* s : {&split, &whole, &apart}) {
            std::fill(s->contact_constraints.friction.begin(), s->contact_constraints.friction.end(), 0.0f);
            s->params.contact.push_speed = 0;
            s->advance(1, 1);
        }
        ASSERT_GT(split.scratch.solver.colour[4], 1u);
        ASSERT_EQ(whole.scratch.solver.colour[4], 1u);
        EXPECT_EQ(split.result.active_constraints, whole.result.active_constraints);
        double most = 0, change = 0;
        const auto compare = [&](const Vec3d& a, const Vec3d& b, const Vec3d& free) {
            most = std::max(most, (a - b).norm()), change = std::max(change, (b - free).norm());
        };
        for (uint32_t b = 0; b < split.bodies.mesh.size(); ++b) {
            for (uint32_t v = 0; v < split.range(b).count; ++v) compare(split.velocity(b, v), whole.velocity(b, v), apart.velocity(b, v));
            compare(split.poses.velocity[b], whole.poses.velocity[b], apart.poses.velocity[b]);
        }
        std::printf("rows change velocities by up to %.3g m/s, groups and one differ by %.3g\n", change, most);
        EXPECT_GT(change, 0.2);
        EXPECT_LT(most, 0.05 * change);
    });
}

// A sheet of balls that falls on a floor, which is upside down and rotated: its frame is not the world's.
struct SheetOnFloor : Sheet {
    explicit SheetOnFloor(Motion motion, double friction) {
        const uint32_t balls = static_cast<uint32_t>(bodies.mesh.size());
        const Quat turn = from_rotation_vector(std::numbers::pi * Vec3d(std::cos(0.4), std::sin(0.4), 0));
        const uint32_t floor = add_body(add_mesh(reference::make_box({-2, -2, -0.01}, {2, 2, 0.01})), motion, Vec3d(0.9, 0.1, -0.038), {},
                                        AnchorFrame::kWorld, turn);
        for (uint32_t b = 0; b < balls; ++b) {
            add_rows(b, floor, friction);
            for (uint32_t v = 0; v < range(b).count; ++v) set_velocity(b, v, velocity(b, v) - Vec3d(0, 0, 0.6));
        }
        for (uint32_t constraint = 0; constraint < contact_constraints.body.size(); ++constraint)
            contact_constraints.friction[constraint] = static_cast<float>(friction);
        params.contact.push_speed = 0;
    }
    size_t blocks_on_floor() const {
        return static_cast<size_t>(std::count_if(scratch.solver.wide_constraint.begin(), scratch.solver.wide_constraint.end(),
                                                 [](const WideConstraint& b) { return b.fixed != kNone; }));
    }
};

// Without friction the constrained velocities are unique: the nearest that satisfy all. A scripted floor
// without a path is as fixed as a static one, and its constraints are solved one by one: after many sweeps
// both must agree. Breaks when a fixed plane is put into the wrong frame or lane, or moves.
TEST(AdvanceGroups, RowsOfAStaticFloorInBlocksDoWhatSingleOnesDo) {
    ThreadPool pool(2);
    pool.run([&] {
        SheetOnFloor still(Motion::kStatic, 0), scripted(Motion::kKinematic, 0);
        double most = 0;
        for (SheetOnFloor* s : {&still, &scripted}) {
            s->params.contact.iterations = 400;
            s->advance(1, 1);
        }
        ASSERT_GT(still.scratch.solver.colour[4], 1u);
        EXPECT_GT(still.blocks_on_floor(), 300u);
        EXPECT_EQ(scripted.blocks_on_floor(), 0u);
        EXPECT_EQ(still.result.active_constraints, scripted.result.active_constraints);
        for (uint32_t b = 0; b + 1 < still.bodies.mesh.size(); ++b)
            for (uint32_t v = 0; v < still.range(b).count; ++v)
                most = std::max(most, (still.velocity(b, v) - scripted.velocity(b, v)).norm());
        EXPECT_LT(most, 1e-5);
    });
}

// Breaks when corrections act on a fixed floor or in the wrong direction, or depend on threads.
TEST(AdvanceGroups, AStaticFloorPushesBallsOutOnAnyThreads) {
    std::vector<Float4> position[2];
    for (const uint32_t threads : {1u, 4u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            SheetOnFloor s(Motion::kStatic, 0.3);
            s.params.contact.push_speed = 0.5;
            s.params.contact.iterations = 30;
            const double deepest = -*std::min_element(s.contact_constraints.distance.begin(), s.contact_constraints.distance.end());
            EXPECT_GT(deepest, 1.5e-3);
            s.advance(16, 8);
            EXPECT_GT(s.blocks_on_floor(), 300u);
            EXPECT_LT(s.result.deepest_residual, 0.05 * deepest);
            position[threads > 1] = s.particles.offset;
        });
    }
    ASSERT_EQ(position[0].size(), position[1].size());
    EXPECT_EQ(0, std::memcmp(position[0].data(), position[1].data(), position[0].size() * sizeof(Float4)));
}

// Pairs of balls, one vertex of each below a triangle of the other, which tilts away from the plane point.
// One sweep must lift it out at its projection or, if that is beside the triangle, at the closest point.
// Breaks when corrections act at another point than measured: constraints take more sweeps, or diverge.
void expect_out_at_the_foot(uint32_t pairs, bool in_blocks, const std::array<double, 3>& closest, const std::array<double, 3>& pushed) {
    AdvanceScene s;
    s.params.gravity.setZero();
    s.params.contact.push_speed = 1e3;
    s.params.contact.iterations = 1;
    const uint32_t mesh = s.add_mesh(subdivided_sphere(0.03, 2, 0.02));
    const MeshView ball = mesh_view(s.meshes, mesh);
    const Triangle t = ball.triangle[40];
    const Vec3d corner[3] = {ball.position[t[0]], ball.position[t[1]], ball.position[t[2]]};
    const Vec3d normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
    const double deep = 2e-3, tilt = 1e-3;
    const auto weighted = [](const std::array<double, 3>& w, const Vec3d* p) { return Vec3d(w[0] * p[0] + w[1] * p[1] + w[2] * p[2]); };
    for (uint32_t i = 0; i < pairs; ++i) {
        const Vec3d at(0.2 * i, 0, 0);
        const uint32_t above = s.add_body(mesh, Motion::kDeformable, at + weighted(closest, corner) - deep * normal - ball.position[0]);
        const uint32_t below = s.add_body(mesh, Motion::kDeformable, at);
        s.add_constraint(above, 0, below, t, {0.8, 0.1, 0.1}, normal, -deep, 0);
        s.set_velocity(below, t[0], 1e3 * tilt * normal);
    }
    s.advance(1, 1);
    EXPECT_EQ(s.scratch.solver.prepared.empty(), in_blocks);
    EXPECT_LT(s.result.deepest_residual, 1e-6);
    for (uint32_t i = 0; i < pairs; ++i) {
        const auto position = [&](uint32_t body, uint32_t v) { return Vec3d(s.poses.origin[body] + s.offset(body, v)); };
        const Vec3d now[3] = {position(2 * i + 1, t[0]), position(2 * i + 1, t[1]), position(2 * i + 1, t[2])};
        EXPECT_NEAR((position(2 * i, 0) - weighted(pushed, now)).dot(normal), 0, 1e-6) << i;
        for (int k = 0; k < 3; ++k)
            EXPECT_LT((now[k] - corner[k] - s.poses.origin[2 * i + 1]).dot(normal), (k == 0 ? tilt : 0) + 1e-8) << i << " " << k;
    }
}
TEST(AdvanceBlocks, OneSweepPushesAPointOutAtItsFoot) {
    for (const bool in_blocks : {false, true}) {
        expect_out_at_the_foot(in_blocks ? 100 : 8, in_blocks, {0.1, 0.2, 0.7}, {0.1, 0.2, 0.7});
        expect_out_at_the_foot(in_blocks ? 100 : 8, in_blocks, {-0.2, 0.3, 0.9}, {0, 0.25, 0.75});
    }
}

// Two vertices that meet across the border of two slabs. A deep correction lifts one off; the other is
// pressed into a wedge of two planes, whose corrections partly cancel: it catches up only in a late sweep.
// The border then pushes the first one, into a plane of its own slab, inactive since the first sweep. Breaks
// when a group does not see the corrections of others.
TEST(AdvanceGroups, LateSweepsPushOnFromStripToStrip) {
    ThreadPool pool(2);
    pool.run([&] {
        Sheet s;
        constexpr uint32_t kLines = 6, kNear = 16 * kLines + 2, kFar = 17 * kLines + 2;  // on either side of the border
        const uint32_t balls = static_cast<uint32_t>(s.bodies.mesh.size());
        s.params.contact.push_speed = 1e3;
        s.params.contact.iterations = 2;
        s.params.contact.tolerance = 1e-6;
        s.margin = 0.02;
        s.clear_constraints();
        for (Vec3d& origin : s.poses.origin) origin *= 1.1;  // none touches another
        for (uint32_t b = 0; b < balls; ++b)
            for (uint32_t v = 0; v < s.range(b).count; ++v) s.set_velocity(b, v, Vec3d::Zero());
        for (uint32_t b = 0; b + 1 < balls; ++b)
            if (b % kLines > 2) s.find_constraints(b, b + 1, 0.3);  // enough constraints for slabs; none of the two bodies
        // The rightmost corner of one against the leftmost of the other.
        const MeshView ball = mesh_view(s.meshes, s.bodies.mesh[0]);
        const auto by_x = [&](const Triangle& a, const Triangle& b) { return ball.position[a[0]].x() < ball.position[b[0]].x(); };
        const auto [leftmost, rightmost] = std::minmax_element(ball.triangle.begin(), ball.triangle.end(), by_x);
        const Triangle left = *leftmost, right = *rightmost;
        s.poses.origin[kNear] = s.poses.origin[kFar] + ball.position[left[0]] - ball.position[right[0]];
        const auto press_on_plane = [&](uint32_t body, const Triangle& corners, const Vec3d& normal, double overlap) {
            const Vec3d origin = s.poses.origin[body] + overlap * normal;  // the plane is through the same vertex of another ball
            s.add_constraint(body, corners[0], s.add_body(s.bodies.mesh[0], Motion::kStatic, origin), corners, {1, 0, 0}, normal, -overlap,
                             0);
        };
        // The wedge's normals are 117 degrees apart, not conflicting. A sweep leaves 0.2 of the slide.
        const double cosine = -0.45, sine = std::sqrt(1 - cosine * cosine), deep = 0.01;
        const Vec3d first(cosine, sine, 0), second(1, 0, 0), slide(0, deep / sine, 0);
        press_on_plane(kFar, left, first, deep);
        press_on_plane(kFar, left, second, 0);
        const Vec3d across(0, 0.5, std::sqrt(0.75)), back = cosine * across + sine * second;
        const Vec3d up = sine * across - cosine * second;  // perpendicular to back
        s.add_constraint(kNear, right[0], kFar, left, {1, 0, 0}, across, 0, 0);
        press_on_plane(kNear, right, up, 0.98 * across.dot(slide) / across.dot(up));
        press_on_plane(kNear, right, back, 0);
        // Touching constraints act if their points approach.
        s.set_velocity(kFar, left[0], -1e-4 * (first + second));
        s.set_velocity(kNear, right[0], -1e-4 * (across + back));
        s.advance(1, 1);
        ASSERT_EQ(s.scratch.solver.colour[1], 2u);
        EXPECT_EQ(s.result.active_constraints, 5u);
        EXPECT_EQ(s.result.opposing_planes, 0u);
        for (uint32_t group = 0; group < 3; ++group) EXPECT_GT(s.scratch.solver.group[group].corrected_in, 2) << group;
        EXPECT_LE(s.result.deepest_residual, s.params.contact.tolerance);
    });
}

}  // namespace
}  // namespace trocar
