#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cstring>
#include <map>
#include <set>

#include "engine/mass_properties.hpp"
#include "engine/thread_pool.hpp"
#include "tests/reference/measures.hpp"
#include "tests/reference/sample_meshes.hpp"
#include "tests/systems/advance_scene.hpp"
namespace trocar {
namespace {

// Two free shells that overlap and move into each other: a long list of rows, some of them points of edges.
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
        find_rows(0, 1, friction);
        for (uint32_t row = 0; row < rows.body.size(); row += 5) {
            rows.vertex[row][1] = neighbour_of(rows.body[row], rows.vertex[row][0]);
            rows.along[row] = 0.25f;
        }
    }
    uint32_t neighbour_of(uint32_t body, uint32_t vertex) const {
        for (const Triangle& t : mesh_view(meshes, bodies.mesh[body]).triangle) {
            if (t[0] == vertex) return t[1];
        }
        return vertex;
    }
    size_t rows_in_blocks() const { return rows.body.size() - scratch.solver.prepared.size(); }
    uint32_t particle(uint32_t body, uint32_t vertex) const { return range(body).first + vertex; }
};

// A row of the reference: impulse j along the normal changes the velocity of particle[k] by weight[k] / mass j.
struct ReferenceRow {
    std::vector<uint32_t> particle;
    std::vector<double> weight;
    Vec3d normal;
    double least_velocity = 0, inv_sum = 0, impulse = 0;
};

// Weights of the corners for the foot of a point along the normal, from the definition: a linear system.
Eigen::Vector4d foot_by_definition(const Vec3d& point, const Vec3d& normal, const std::array<Vec3d, 3>& corner) {
    Eigen::Matrix4d m;
    for (int k = 0; k < 3; ++k) m.col(k) << corner[k], 1;
    m.col(3) << normal, 0;
    return m.fullPivLu().solve((Eigen::Vector4d() << point, 1).finished());
}

// Rows that act in a substep, from the places at its start and the velocities after its kick.
std::vector<ReferenceRow> reference_rows(const Collision& s, const std::vector<Vec3d>& place, const std::vector<Vec3d>& velocity,
                                         double dt) {
    std::vector<ReferenceRow> out;
    for (uint32_t row = 0; row < s.rows.body.size(); ++row) {
        ReferenceRow r;
        Vec3d point = Vec3d::Zero(), plane = Vec3d::Zero(), v = Vec3d::Zero();
        std::array<Vec3d, 3> corner;
        const double along = s.rows.along[row];
        for (int i = 0; i < 2; ++i) {
            const uint32_t p = s.particle(s.rows.body[row], s.rows.vertex[row][i]);
            const double w = i == 0 ? 1 - along : along;
            point += w * place[p];
            v += w * velocity[p];
            r.particle.push_back(p);
            r.weight.push_back(w);
        }
        for (int k = 0; k < 3; ++k) {
            const uint32_t p = s.particle(s.rows.other[row], s.rows.triangle[row][k]);
            corner[k] = place[p];
            plane += double(s.rows.weight[row][k]) * place[p];
            v -= double(s.rows.weight[row][k]) * velocity[p];
            r.particle.push_back(p);
        }
        r.normal = s.rows.normal[row];
        const double gap = r.normal.dot(point - plane);
        if (!(gap + std::min(r.normal.dot(v), 0.0) * dt < 0)) continue;
        const Eigen::Vector4d foot = foot_by_definition(point, r.normal, corner);
        for (int k = 0; k < 3; ++k) r.weight.push_back(-foot[k]);
        r.least_velocity = -std::max(gap, 0.0) / dt;
        double sum = 0;
        for (size_t k = 0; k < 5; ++k) sum += r.weight[k] * r.weight[k] * s.particles.offset[r.particle[k]].w;
        r.inv_sum = 1 / sum;
        out.push_back(r);
    }
    return out;
}

// Without friction the velocities that satisfy all rows are unique, whatever the order of the sweeps: those of many
// sweeps four at a time are those of a plain Gauss-Seidel in double.
TEST(AdvanceBlocks, ManySweepsEqualAReferenceInDouble) {
    Collision s({0.3, 0.02, 0.01});
    Collision clean({0.3, 0.02, 0.01});
    clean.clear_rows();
    clean.advance(1, 1);
    std::vector<Vec3d> place, velocity;
    for (uint32_t body = 0; body < 2; ++body) {
        for (uint32_t v = 0; v < s.range(body).count; ++v) {
            place.push_back(s.poses.origin[body] + s.offset(body, v));
            velocity.push_back(clean.velocity(body, v));
        }
    }
    std::vector<ReferenceRow> rows = reference_rows(s, place, velocity, 1e-3);
    ASSERT_GT(rows.size(), 64u);
    for (int sweep = 0; sweep < 3000; ++sweep) {
        for (ReferenceRow& r : rows) {
            Vec3d v = Vec3d::Zero();
            for (size_t k = 0; k < 5; ++k) v += r.weight[k] * velocity[r.particle[k]];
            const double impulse = std::max(0.0, r.impulse - (r.normal.dot(v) - r.least_velocity) * r.inv_sum);
            for (size_t k = 0; k < 5; ++k) {
                velocity[r.particle[k]] += r.weight[k] * s.particles.offset[r.particle[k]].w * (impulse - r.impulse) * r.normal;
            }
            r.impulse = impulse;
        }
    }
    s.params.contact.iterations = 400;
    s.params.contact.push_speed = 0;
    s.advance(1, 1);
    EXPECT_GT(s.rows_in_blocks(), 0.8 * double(s.rows.body.size()));
    EXPECT_EQ(s.result.active_rows, rows.size());
    EXPECT_EQ(s.result.ended_rows, 0u);
    double worst = 0, moved = 0;
    for (uint32_t body = 0; body < 2; ++body) {
        for (uint32_t v = 0; v < s.range(body).count; ++v) {
            worst = std::max(worst, (s.velocity(body, v) - velocity[s.particle(body, v)]).norm());
            moved = std::max(moved, (s.velocity(body, v) - clean.velocity(body, v)).norm());
        }
    }
    std::printf("%zu of %zu rows act, %zu in blocks; they change velocities by up to %.3g m/s, worst error %.3g\n", rows.size(),
                s.rows.body.size(), s.rows_in_blocks(), moved, worst);
    EXPECT_GT(moved, 0.05);
    EXPECT_LT(worst, 1e-6);
}

// With friction and push-out: linear momentum is kept, friction and contact only take energy, the books close.
TEST(AdvanceBlocks, MomentumAndBooks) {
    for (const ResponseShare share : {ResponseShare::kMass, ResponseShare::kStiffness, ResponseShare::kHalf}) {
        Collision s({0.2, 0.05, 0}, 0.3);
        s.params.contact.share = share;
        const auto momentum = [&] {
            return Vec3d(measure_momentum(s.bodies, s.poses, s.particles, 0).linear +
                         measure_momentum(s.bodies, s.poses, s.particles, 1).linear);
        };
        const Vec3d start = momentum(), first = measure_momentum(s.bodies, s.poses, s.particles, 0).linear;
        s.open_books();
        double peak = 0, worst = 0, residual = 1;
        for (int pass = 0; pass < 30; ++pass) {
            s.clear_rows();
            s.find_rows(0, 1, 0.3);
            s.advance(5, 40);
            if (pass == 0) {
                EXPECT_GT(s.rows_in_blocks(), 64u);
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

// Also where rows end on the way: what a block holds does not depend on it.
TEST(AdvanceBlocks, SplitCallsGiveTheSameBits) {
    Collision whole({0.2, 1.5, 0}, 0.1), split({0.2, 1.5, 0}, 0.1);
    whole.params.contact.iterations = split.params.contact.iterations =
        1;  // from two on a call starts from what rows carried at the end of the last
    whole.advance(10, 20);
    for (int i = 0; i < 10; ++i) split.advance(1, 2);
    EXPECT_GT(whole.result.ended_rows, 10u);
    EXPECT_LT(whole.result.ended_rows, whole.rows.body.size());
    EXPECT_GT(whole.rows_in_blocks(), 64u);
    EXPECT_EQ(0, std::memcmp(whole.particles.offset.data(), split.particles.offset.data(), whole.particles.offset.size() * sizeof(Float4)));
    EXPECT_EQ(whole.particles.velocity_y, split.particles.velocity_y);
    EXPECT_EQ(whole.report.ended_rows, split.report.ended_rows);
    EXPECT_EQ(whole.rows.distance, split.rows.distance);
}

// No row of a block acts on a node that others press from the other side; those rows stay out of blocks.
TEST(AdvanceBlocks, NodesPressedFromBothSidesStayOut) {
    Collision s({0, 0, 0});
    const size_t rows = s.rows.body.size();
    for (size_t row = 0; row < rows; row += 10) {
        const uint32_t v = s.rows.vertex[row][0];
        s.add_row(s.rows.body[row], v, s.rows.other[row], s.rows.triangle[row], {0.3, 0.3, 0.4}, -s.rows.normal[row], 0.0, 0.0);
    }
    s.advance(1, 2);
    ASSERT_FALSE(s.scratch.solver.block.empty());
    std::vector<uint8_t> turned(s.particles.offset.size(), 0);
    for (size_t row = rows; row < s.rows.body.size(); ++row) {
        turned[s.particle(s.rows.body[row], s.rows.vertex[row][0])] = 1;
        for (const uint32_t v : s.rows.triangle[row]) turned[s.particle(s.rows.other[row], v)] = 1;
    }
    for (const ContactBlock& block : s.scratch.solver.block) {
        for (uint32_t lane = 0; lane < 4; ++lane) {
            if (block.row[lane] == kNone) continue;
            const uint32_t row = block.row[lane];
            for (const uint32_t v : s.rows.vertex[row]) EXPECT_FALSE(turned[s.particle(s.rows.body[row], v)]);
            for (const uint32_t v : s.rows.triangle[row]) EXPECT_FALSE(turned[s.particle(s.rows.other[row], v)]);
        }
    }
    EXPECT_GT(s.report.opposing_planes, 0u);
}

// A sheet of soft balls of which each overlaps its neighbours: one island of many bodies. One of so many is rigid and free.
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
                if (i + 1 < kColumns) find_rows(body, body + kLines, 0.3);
                if (j + 1 < kLines) find_rows(body, body + 1, 0.3);
            }
        }
        find_rows(3, static_cast<uint32_t>(kLines * (kColumns - 1)), 0.3);  // none: the ends are far apart
        for (uint32_t b = 0; b < kColumns * kLines; ++b) {
            const Vec3d way((b + b / kLines) % 3 ? -0.2 : 0.3, b % 2 ? 0.2 : -0.1, 0.1);  // neighbours of both kinds meet
            for (uint32_t v = 0; v < range(b).count; ++v) set_velocity(b, v, way);
            if (bodies.motion[b] == Motion::kFree) poses.velocity[b] = way;
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

// Groups that run at the same time share no node, every row is in one group, and threads change nothing. Breaks when a row
// gets into a group of another strip, or is lost or doubled when rows are sorted.
void expect_same_bits_on_any_threads(uint32_t rigid_of) {
    std::vector<Float4> place[2];
    std::vector<Vec3d> origin[2], spin[2];
    for (const uint32_t threads : {1u, 4u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            Sheet s(rigid_of);
            const Vec3d before = s.momentum();
            s.advance(16, 8);
            const ContactSolver& c = s.scratch.solver;
            ASSERT_GT(c.phase[1], 1u) << "one strip only: nothing is tested";
            ASSERT_GT(c.phase[4], c.phase[1] + 1);
            std::multiset<uint32_t> seen;
            for (int phase = 0; phase < 4; ++phase) {
                std::map<uint32_t, uint32_t> group_of_node;
                for (uint32_t g = c.phase[phase]; g < c.phase[phase + 1]; ++g) {
                    const auto take = [&](uint32_t node) {
                        EXPECT_EQ(group_of_node.emplace(node, g).first->second, g) << "node " << node << " in phase " << phase;
                    };
                    for (uint32_t i = c.group[g].prepared.first; i < c.group[g].prepared.end(); ++i) {
                        const PreparedConstraint& plan = c.prepared[i];
                        seen.insert(plan.row);
                        for (const uint32_t rigid : {plan.rigid_a, plan.rigid_b})
                            if (rigid != kNone) take(s.scratch.island.rigid[rigid].node);
                        for (int k = 0; k < 3; ++k) {
                            if (plan.rigid_a == kNone) take(plan.node_a[k]);
                            if (plan.rigid_b == kNone) take(plan.node_b[k]);
                        }
                    }
                    for (uint32_t i = c.group[g].block.first; i < c.group[g].block.end(); ++i) {
                        for (const uint32_t row : c.block[i].row)
                            if (row != kNone) seen.insert(row);
                        for (const auto& part : c.block[i].node)
                            for (const uint32_t node : part) take(node);
                    }
                }
            }
            EXPECT_EQ(seen.size(), s.rows.body.size());
            for (uint32_t row = 0; row < s.rows.body.size(); ++row) EXPECT_EQ(seen.count(row), 1u);
            EXPECT_GT(s.result.active_rows, 1000u);
            EXPECT_LT((s.momentum() - before).norm(), 1e-6 * before.norm());
            place[threads > 1] = s.particles.offset;
            origin[threads > 1] = s.poses.origin;
            spin[threads > 1] = s.poses.angular_velocity;
        });
    }
    ASSERT_EQ(place[0].size(), place[1].size());
    EXPECT_EQ(0, std::memcmp(place[0].data(), place[1].data(), place[0].size() * sizeof(Float4)));
    EXPECT_EQ(origin[0], origin[1]);
    EXPECT_EQ(spin[0], spin[1]);
}
TEST(AdvanceGroups, ShareNoNodeAndGiveTheSameBitsOnAnyThreads) { expect_same_bits_on_any_threads(0); }
TEST(AdvanceGroups, OfFreeBodiesShareNoNodeAndGiveTheSameBitsOnAnyThreads) { expect_same_bits_on_any_threads(5); }

// Without friction the velocities that rows ask for are one point; a hand beside, which nothing touches, keeps an island in
// one group. Breaks when groups lose impulses of free bodies, or when the sweeps end long before the groups agree.
TEST(AdvanceGroups, OfFreeBodiesComeToWhatOneGroupComesTo) {
    ThreadPool pool(2);
    pool.run([&] {
        Sheet split(5), whole(5), apart(5);
        whole.add_body(whole.bodies.mesh[0], Motion::kHand, Vec3d(0, 0, 5));
        apart.clear_rows();
        for (Sheet* s : {&split, &whole, &apart}) {
            std::fill(s->rows.friction.begin(), s->rows.friction.end(), 0.0f);
            s->params.contact.push_speed = 0;
            s->advance(1, 1);
        }
        ASSERT_GT(split.scratch.solver.phase[4], 1u);
        ASSERT_EQ(whole.scratch.solver.phase[4], 1u);
        EXPECT_EQ(split.result.active_rows, whole.result.active_rows);
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

// A sheet of balls that falls on a floor, which lies upside down and turned: its frame is not the world's.
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
        for (uint32_t row = 0; row < rows.body.size(); ++row) rows.friction[row] = static_cast<float>(friction);
        params.contact.push_speed = 0;
    }
    size_t blocks_on_floor() const {
        return static_cast<size_t>(std::count_if(scratch.solver.block.begin(), scratch.solver.block.end(),
                                                 [](const ContactBlock& b) { return b.fixed != kNone; }));
    }
};

// Without friction the velocities that rows ask for are one point, the nearest that all allow. A scripted floor without a
// path stands as still as a static one, and its rows are worked on one by one: after many sweeps both ways must have come
// to the same. Breaks when a fixed plane is put into the wrong frame or lane, or moves.
TEST(AdvanceGroups, RowsOfAStaticFloorInBlocksDoWhatSingleOnesDo) {
    ThreadPool pool(2);
    pool.run([&] {
        SheetOnFloor still(Motion::kStatic, 0), scripted(Motion::kKinematic, 0);
        double most = 0;
        for (SheetOnFloor* s : {&still, &scripted}) {
            s->params.contact.iterations = 400;
            s->advance(1, 1);
        }
        ASSERT_GT(still.scratch.solver.phase[4], 1u);
        EXPECT_GT(still.blocks_on_floor(), 300u);
        EXPECT_EQ(scripted.blocks_on_floor(), 0u);
        EXPECT_EQ(still.result.active_rows, scripted.result.active_rows);
        for (uint32_t b = 0; b + 1 < still.bodies.mesh.size(); ++b)
            for (uint32_t v = 0; v < still.range(b).count; ++v)
                most = std::max(most, (still.velocity(b, v) - scripted.velocity(b, v)).norm());
        EXPECT_LT(most, 1e-5);
    });
}

// Breaks when pushes of fixed planes go to the floor or the wrong way, or depend on threads.
TEST(AdvanceGroups, AStaticFloorPushesBallsOutOnAnyThreads) {
    std::vector<Float4> place[2];
    for (const uint32_t threads : {1u, 4u}) {
        ThreadPool pool(threads);
        pool.run([&] {
            SheetOnFloor s(Motion::kStatic, 0.3);
            s.params.contact.push_speed = 0.5;
            s.params.contact.iterations = 30;
            const double deepest = -*std::min_element(s.rows.distance.begin(), s.rows.distance.end());
            EXPECT_GT(deepest, 1.5e-3);
            s.advance(16, 8);
            EXPECT_GT(s.blocks_on_floor(), 300u);
            EXPECT_LT(s.result.deepest_residual, 0.05 * deepest);
            place[threads > 1] = s.particles.offset;
        });
    }
    ASSERT_EQ(place[0].size(), place[1].size());
    EXPECT_EQ(0, std::memcmp(place[0].data(), place[1].data(), place[0].size() * sizeof(Float4)));
}

// Pairs of balls, of each pair one vertex below a triangle of the other, which tilts meanwhile, away from the plane point of their row.
// One sweep lifts it out at its foot, as places say, or if that is beside the triangle at the point near it. Breaks when pushes are
// measured at another point than they act on: rows then take more sweeps, or run away together.
void expect_out_at_the_foot(uint32_t pairs, bool in_blocks, const std::array<double, 3>& foot, const std::array<double, 3>& pushed) {
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
        const uint32_t above = s.add_body(mesh, Motion::kDeformable, at + weighted(foot, corner) - deep * normal - ball.position[0]);
        const uint32_t below = s.add_body(mesh, Motion::kDeformable, at);
        s.add_row(above, 0, below, t, {0.8, 0.1, 0.1}, normal, -deep, 0);
        s.set_velocity(below, t[0], 1e3 * tilt * normal);
    }
    s.advance(1, 1);
    EXPECT_EQ(s.scratch.solver.prepared.empty(), in_blocks);
    EXPECT_LT(s.result.deepest_residual, 1e-6);
    for (uint32_t i = 0; i < pairs; ++i) {
        const auto place = [&](uint32_t body, uint32_t v) { return Vec3d(s.poses.origin[body] + s.offset(body, v)); };
        const Vec3d now[3] = {place(2 * i + 1, t[0]), place(2 * i + 1, t[1]), place(2 * i + 1, t[2])};
        EXPECT_NEAR((place(2 * i, 0) - weighted(pushed, now)).dot(normal), 0, 1e-6) << i;
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

// Two vertices that meet across the border of two strips. A deep push lifts one off; the other is pressed into a wedge of two planes,
// whose pushes undo a part of each other: it slides from sweep to sweep and catches up only in a late one. The border then pushes the
// first one, and that into a plane of its own strip, which has pushed nothing since the first sweep. Breaks when a group does not see
// what others push.
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
        s.clear_rows();
        for (Vec3d& origin : s.poses.origin) origin *= 1.1;  // none touches another
        for (uint32_t b = 0; b < balls; ++b)
            for (uint32_t v = 0; v < s.range(b).count; ++v) s.set_velocity(b, v, Vec3d::Zero());
        for (uint32_t b = 0; b + 1 < balls; ++b)
            if (b % kLines > 2) s.find_rows(b, b + 1, 0.3);  // that there are enough for strips; not of the two
        // The rightmost corner of one meets the leftmost of the other.
        const MeshView ball = mesh_view(s.meshes, s.bodies.mesh[0]);
        const auto by_x = [&](const Triangle& a, const Triangle& b) { return ball.position[a[0]].x() < ball.position[b[0]].x(); };
        const auto [leftmost, rightmost] = std::minmax_element(ball.triangle.begin(), ball.triangle.end(), by_x);
        const Triangle left = *leftmost, right = *rightmost;
        s.poses.origin[kNear] = s.poses.origin[kFar] + ball.position[left[0]] - ball.position[right[0]];
        const auto press_on_plane = [&](uint32_t body, const Triangle& corners, const Vec3d& normal, double overlap) {
            const Vec3d origin = s.poses.origin[body] + overlap * normal;  // the plane is through the same vertex of another ball
            s.add_row(body, corners[0], s.add_body(s.bodies.mesh[0], Motion::kStatic, origin), corners, {1, 0, 0}, normal, -overlap, 0);
        };
        // Ways of a wedge are 117 degrees apart, less than opposed ones. A sweep leaves 0.2 of what was left of the slide.
        const double cosine = -0.45, sine = std::sqrt(1 - cosine * cosine), deep = 0.01;
        const Vec3d first(cosine, sine, 0), second(1, 0, 0), slide(0, deep / sine, 0);
        press_on_plane(kFar, left, first, deep);
        press_on_plane(kFar, left, second, 0);
        const Vec3d across(0, 0.5, std::sqrt(0.75)), back = cosine * across + sine * second;
        const Vec3d up = sine * across - cosine * second;  // square to back
        s.add_row(kNear, right[0], kFar, left, {1, 0, 0}, across, 0, 0);
        press_on_plane(kNear, right, up, 0.98 * across.dot(slide) / across.dot(up));
        press_on_plane(kNear, right, back, 0);
        // Rows that touch act if what they are of meets.
        s.set_velocity(kFar, left[0], -1e-4 * (first + second));
        s.set_velocity(kNear, right[0], -1e-4 * (across + back));
        s.advance(1, 1);
        ASSERT_EQ(s.scratch.solver.phase[1], 2u);
        EXPECT_EQ(s.result.active_rows, 5u);
        EXPECT_EQ(s.result.opposing_planes, 0u);
        for (uint32_t group = 0; group < 3; ++group) EXPECT_GT(s.scratch.solver.group[group].pushed_in, 2) << group;
        EXPECT_LE(s.result.deepest_residual, s.params.contact.tolerance);
    });
}

}  // namespace
}  // namespace trocar
