#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "content/scene/build_scene.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
#include "systems/output/deformable_energy.hpp"
#include "tests/reference/brute_force_contact.hpp"
#include "tests/reference/measures.hpp"
#include "tests/systems/detect/contact_scene.hpp"

// Contacts that neither vertices nor edges detect, and overlaps too deep for the shortest separating
// translation, in whole frames. The remaining overlap is measured by brute force from the bodies' positions
// alone.
namespace trocar::test {
namespace {

// Guaranteed after a contact is resolved: no point of either surface is deeper than contact.tolerance.
constexpr double kTolerance = 1e-4;

struct Body {
    Mesh mesh;
    Motion motion = Motion::kDeformable;
    Vec3d at = Vec3d::Zero();
    Admission admission = Admission::kSolid;
    std::vector<Keyframe> path = {};
};

World make_world(const std::vector<Body>& bodies) {
    World w;
    w.settings.gravity.setZero();
    w.settings.contact.tolerance = kTolerance;
    for (const Body& b : bodies) {
        Tissue tissue;
        tissue.friction = 0;
        tissue.damping = 20;
        const uint32_t row = add_body(w, "body", add_prototype(w.meshes, b.mesh, b.admission), b.motion, tissue, AnchorFrame::kShape);
        w.poses.origin[row] = b.at;
        w.bodies.thickness[row] = b.admission == Admission::kSheet ? 1e-3 : 0;
        if (b.motion == Motion::kDeformable) make_deformable(w, row);
        if (b.path.empty()) continue;
        w.paths.body.push_back(row);
        w.paths.keys.push_back({uint32_t(w.paths.key.size()), uint32_t(b.path.size())});
        w.paths.key.insert(w.paths.key.end(), b.path.begin(), b.path.end());
    }
    make_trees(w);
    return w;
}

template <typename Look>
void run(World world, int passes, const Look& look) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(world), {});
        for (int pass = 0; pass < passes; ++pass) frame.step();
        look(frame.world());
    });
}

Mesh ball(double radius, uint32_t n) {
    return make_sphere(n, [=](const Vec3d& p) { return Vec3d(radius * p); });
}

// m, largest depth inside the other body of a grid of points on every face of a body, by brute force; 0 =
// none is inside.
double deepest_of_faces(const World& w, uint32_t body, uint32_t other, int grid) {
    const reference::Surface own(surfaces_of(w), body), surface(surfaces_of(w), other);
    double depth = 0;
    for (const Triangle& t : own.triangle) {
        const Vec3d &p = own.position[t[0]], &q = own.position[t[1]], &r = own.position[t[2]];
        for (int i = 0; i <= grid; ++i)
            for (int j = 0; i + j <= grid; ++j)
                depth = std::max(depth, -surface.signed_distance(p + double(i) / grid * (q - p) + double(j) / grid * (r - p)));
    }
    return depth;
}

double middle_z(const World& w, uint32_t body) {
    const uint32_t count = w.meshes.info[w.bodies.mesh[body]].vertices.count;
    double sum = 0;
    for (uint32_t v = 0; v < count; ++v) sum += vertex_position(surfaces_of(w), body, v).z();
    return sum / count;
}

// A ball has passed through the middle of one large face of a sheet: no vertex and no edge of the sheet is in
// the ball. A contact constraint of the face moves its three corners; without it the ball stays stuck.
TEST(FaceRows, CoarseSheetComesOffABall) {
    for (const bool faces : {true, false}) {
        const double cell = 0.025, in_middle = cell * (1 - std::sqrt(0.5));
        const Vec3d middle(cell - in_middle, in_middle, 0);
        World w = make_world({{ball(0.01, 8), Motion::kStatic},
                              {make_sheet(4 * cell, 4), Motion::kDeformable, Vec3d(0, 0, 0.007) - middle, Admission::kSheet}});
        w.settings.contact.faces = faces;
        ASSERT_NEAR(deepest_of_faces(w, 1, 0, 12), 0.003, 3e-4) << "as laid out";
        run(std::move(w), 30, [&](const World& after) {
            const double left = deepest_of_faces(after, 1, 0, 12);
            if (faces) {
                EXPECT_LT(left, kTolerance);
                EXPECT_GT(middle_z(after, 1), 0.0075) << "it leaves over the near side";
            } else {
                EXPECT_GT(left, 1e-3) << "the row is not what frees it";
            }
        });
    }
}

// Three-sided prism along z from `low` to `high`, with two triangles per side and one at each end.
Mesh prism(double radius, double low, double high) {
    Mesh mesh;
    for (const double z : {low, high})
        for (int k = 0; k < 3; ++k)
            mesh.position.push_back(Vec3d(radius * std::cos(2 * M_PI * k / 3), radius * std::sin(2 * M_PI * k / 3), z));
    mesh.triangle = {{0, 2, 1}, {3, 4, 5}};
    for (uint32_t k = 0; k < 3; ++k) {
        const uint32_t next = (k + 1) % 3;
        mesh.triangle.push_back({k, next, next + 3});
        mesh.triangle.push_back({k, next + 3, k + 3});
    }
    return mesh;
}

// The end of one prism inside a slightly wider one: corners and edges are 1 mm deep, sideways; the middle of
// the end 3 mm, axially. Only the contact constraint of the face separates them axially.
TEST(FaceRows, EndFaceOfAPrism) {
    for (const bool faces : {true, false}) {
        World w = make_world({{prism(0.022, 0, 0.04), Motion::kStatic}, {prism(0.02, -0.04, 0.003)}});
        w.settings.contact.faces = faces;
        ASSERT_NEAR(deepest_of_faces(w, 1, 0, 12), 0.003, 1e-6) << "as laid out";
        run(std::move(w), 5, [&](const World& after) {
            const double left = std::max(deepest_of_faces(after, 1, 0, 12), deepest_of_faces(after, 0, 1, 12));
            if (faces) {
                EXPECT_LT(left, kTolerance);
                EXPECT_LT(middle_z(after, 1), -0.0195) << "it leaves along the axis";
            } else {
                EXPECT_GT(left, 2.5e-3) << "the row is not what frees it";
            }
        });
    }
}

// A small ball in the middle of a large face of a box: the contact constraint of the ball's deepest vertex
// moves the face's three corners in proportion to their weights, and the remaining overlap is below the
// tolerance.
TEST(FaceRows, SmallBallInALargeFaceOfABox) {
    const Vec3d at(0.008, 0.003, 0.03 + 0.005 - 0.002);  // 2 mm below the top face, near a triangle corner
    World w = make_world({{make_box({0.06, 0.06, 0.06})}, {ball(0.005, 8), Motion::kStatic, at}});
    std::vector<Vec3d> before;
    for (uint32_t v = 0; v < 8; ++v) before.push_back(vertex_position(surfaces_of(w), 0, v));
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(w), {});
        const World& now = frame.world();
        frame.step();
        const Penetrations& p = now.penetrations;
        ASSERT_EQ(p.pair.size(), 1u);
        EXPECT_NEAR(p.depth[0], 0.002, 1e-6);
        const uint32_t witness = p.witness[0];
        ASSERT_EQ(now.contacts.body[witness], 1u) << "the ball's vertex";
        const auto row = size_t(std::find(now.contact_constraints.contact.begin(), now.contact_constraints.contact.end(), witness) -
                                now.contact_constraints.contact.begin());
        ASSERT_LT(row, now.contact_constraints.contact.size());
        // the single deepest constraint did nearly all of it: the displacements of the corners have the ratio
        // of their weights
        const Triangle& t = now.contact_constraints.triangle[row];
        double sum = 0;
        for (int k = 0; k < 3; ++k) {
            const double down = before[t[k]].z() - vertex_position(surfaces_of(now), 0, t[k]).z();
            EXPECT_GT(now.contact_constraints.weight[row][k], 0.05f);
            sum += now.contact_constraints.weight[row][k] * down;
        }
        EXPECT_GT(sum, 1e-3) << "the point under the vertex went down";
        for (int pass = 0; pass < 20; ++pass) frame.step();
        EXPECT_LT(deepest_of_faces(now, 1, 0, 4), kTolerance);
        EXPECT_LT(deepest_of_faces(now, 0, 1, 40), kTolerance);
    });
}

// ---- too deep for the shortest separating translation ----

// A ball is placed 23 mm deeper into a soft plate of 20 mm at once, past its middle: the shortest separating
// translation now leads out through the far side. With the stored separation direction the plate returns to
// below the ball.
TEST(DeepOverlap, BallShotIntoAPlateLeavesWhereItCameFrom) {
    for (const DeepResponse deep : {DeepResponse::kLastFree, DeepResponse::kNone}) {
        for (const ResponseDirection direction : {ResponseDirection::kLocal, ResponseDirection::kThesis}) {
            const double pressed = 0.0155;
            Body probe{ball(0.006, 6), Motion::kKinematic, Vec3d(0.0007, 0.0004, pressed), Admission::kSolid, {}};
            for (const auto& [time, z, jump] : {std::tuple{0.0, pressed, 0}, {0.2, pressed - 0.023, 1}, {10.0, pressed - 0.023, 0}}) {
                probe.path.push_back({time, Vec3d(0.0007, 0.0004, z), Quat{}, uint64_t(jump)});
            }
            World w = make_world({{make_box({0.04, 0.04, 0.02}, {10, 10, 5})}, probe});
            w.settings.contact.deep = deep;
            w.settings.contact.direction = direction;
            run(std::move(w), 90, [&](const World& after) {
                const double left = std::max(deepest_of_faces(after, 0, 1, 2), deepest_of_faces(after, 1, 0, 2));
                const bool below = middle_z(after, 0) < after.poses.origin[1].z();
                if (deep == DeepResponse::kLastFree) {
                    EXPECT_TRUE(below) << "it went on through";
                    EXPECT_LT(left, kTolerance);
                } else {
                    EXPECT_FALSE(below && left < kTolerance) << "nothing was deep: the mode is not what helps";
                }
            });
        }
    }
}

// Two equal balls start past each other's centres, without a stored direction: the shortest translations of single points
// would draw them together. `last_free` takes the shortest translation that surely separates the bodies; without it a soft body
// that nothing holds is moved out as it is.
TEST(DeepOverlap, BallsThatStartPastTheirCentresArePartedTheShortWay) {
    for (const DeepResponse deep : {DeepResponse::kLastFree, DeepResponse::kNone}) {
        const double radius = 0.01, apart = 0.3 * radius;
        World w = make_world({{ball(radius, 6), Motion::kStatic}, {ball(radius, 6), Motion::kDeformable, Vec3d(0, 0, apart)}});
        w.settings.contact.deep = deep;
        run(std::move(w), 120, [&](const World& after) {
            const double left = std::max(deepest_of_faces(after, 0, 1, 2), deepest_of_faces(after, 1, 0, 2));
            EXPECT_LT(left, kTolerance);
            EXPECT_GT(middle_z(after, 1), 1.9 * radius) << "on the side where it was";
        });
    }
}

// One-sided (the other body is static) and two-sided response, for every distribution and direction: an
// overlap of 2 mm falls to the tolerance and stays there.
TEST(Response, OneSidedAndTwoSidedReachTheStatedResidual) {
    for (const Motion other : {Motion::kStatic, Motion::kDeformable}) {
        for (const ResponseShare share : {ResponseShare::kMass, ResponseShare::kStiffness, ResponseShare::kHalf}) {
            for (const ResponseDirection direction : {ResponseDirection::kLocal, ResponseDirection::kThesis}) {
                World w = make_world({{ball(0.03, 5)}, {ball(0.02, 4), other, Vec3d(0.001, 0.002, 0.0475)}});
                w.settings.contact.direction = direction;
                w.settings.contact.share = share;
                const Vec3d before = vertex_position(surfaces_of(w), 1, 0);
                const std::string what =
                    std::to_string(int(other)) + " share " + std::to_string(int(share)) + " direction " + std::to_string(int(direction));
                run(std::move(w), 20, [&](const World& after) {
                    EXPECT_LT(std::max(deepest_of_faces(after, 0, 1, 2), deepest_of_faces(after, 1, 0, 2)), kTolerance) << what;
                    EXPECT_EQ(vertex_position(surfaces_of(after), 1, 0) == before, other == Motion::kStatic) << what;
                });
            }
        }
    }
}

// The corners of a soft block are inside a floor and a wall at once. For any order of the three bodies in the
// scene, and whether the other two are static or deformable, these vertices come out of both and stay out, no
// body remains inside another, and the total momentum of three free bodies stays zero.
TEST(NBody, VerticesInTwoBodiesObeyBothInAnyOrder) {
    for (const Motion other : {Motion::kStatic, Motion::kDeformable}) {
        const double in = 0.0015;
        const std::vector<Body> bodies{{make_box({0.03, 0.03, 0.03}, {3, 3, 3}), Motion::kDeformable, Vec3d(0.015 - in, 0, 0.015 - in)},
                                       {make_box({0.08, 0.06, 0.02}, {4, 3, 1}), other, Vec3d(0.02, 0, -0.01)},
                                       {make_box({0.02, 0.06, 0.08}, {1, 3, 4}), other, Vec3d(-0.01, 0, 0.037)}};
        std::array<uint32_t, 3> order{0, 1, 2};
        do {
            std::array<uint32_t, 3> row;  // index of each body
            std::vector<Body> shuffled;
            for (uint32_t i = 0; i < 3; ++i) row[order[i]] = i, shuffled.push_back(bodies[order[i]]);
            World w = make_world(shuffled);
            const auto count_in_both = [&](const World& now) {
                const reference::Surface block(surfaces_of(now), row[0]), floor(surfaces_of(now), row[1]), wall(surfaces_of(now), row[2]);
                uint32_t count = 0;
                for (const Vec3d& p : block.position)
                    count += floor.signed_distance(p) < -kTolerance && wall.signed_distance(p) < -kTolerance;
                return count;
            };
            EXPECT_GE(count_in_both(w), 4u) << "as laid out";
            const std::string what = "order " + std::to_string(order[0]) + std::to_string(order[1]) + std::to_string(order[2]);
            run(std::move(w), 40, [&](const World& after) {
                for (const uint32_t body : {1u, 2u}) {
                    EXPECT_LT(deepest_of_faces(after, row[0], row[body], 2), kTolerance) << what << " block in " << body;
                    EXPECT_LT(deepest_of_faces(after, row[body], row[0], 2), kTolerance) << what << " in the block " << body;
                }
                EXPECT_EQ(count_in_both(after), 0u) << what;
                if (other == Motion::kStatic) return;
                Vec3d sum = Vec3d::Zero();
                double all = 0;
                for (uint32_t body = 0; body < 3; ++body) {
                    double mass = 0;
                    const Range range = after.bodies.particles[body];
                    for (uint32_t p = range.first; p < range.end(); ++p)
                        if (const float inverse = after.particles.offset[p].w; inverse > 0) mass += 1 / static_cast<double>(inverse);
                    sum += measure_momentum(after.bodies, after.poses, after.particles, body).linear;
                    all += mass * after.settings.contact.push_speed;
                }
                // 40 passes are at least 667 substeps, each of which rounds velocities to 2^-24 of those with which bodies part
                EXPECT_LT(sum.norm(), 667 * 0x1p-24 * all) << what;
            });
        } while (std::next_permutation(order.begin(), order.end()));
    }
}

// Overlap left by one pass, for each direction of the response: both remove most of it.
TEST(ResponseDirection, WhatOnePassLeaves) {
    double left[2] = {0, 0};
    for (const ResponseDirection direction : {ResponseDirection::kLocal, ResponseDirection::kThesis}) {
        World w = make_world({{ball(0.03, 7)}, {ball(0.02, 5), Motion::kStatic, Vec3d(0.001, 0.002, 0.048)}});
        w.settings.contact.direction = direction;
        const double before = std::max(deepest_of_faces(w, 0, 1, 2), deepest_of_faces(w, 1, 0, 2));
        ASSERT_GT(before, 1e-3);
        run(std::move(w), 1, [&](const World& after) {
            double& rest = left[direction == ResponseDirection::kThesis];
            rest = std::max(deepest_of_faces(after, 0, 1, 2), deepest_of_faces(after, 1, 0, 2));
            EXPECT_LT(rest, 0.5 * before);
        });
    }
    std::printf("[          ] left after one pass: local %.4f mm, thesis %.4f mm\n", 1e3 * left[0], 1e3 * left[1]);
}

// Two soft balls that start 3 mm inside each other come apart and stay so: what the surfaces show, not what the planes of the last
// pass say. (With direction = thesis points on the flanks may stay.)
TEST(ResponseDirection, NothingIsLeftInTheEnd) {
    World w = make_world({{ball(0.03, 6)}, {ball(0.02, 6), Motion::kDeformable, Vec3d(0.003, 0.002, 0.0468)}});
    ASSERT_GT(std::max(deepest_of_faces(w, 0, 1, 2), deepest_of_faces(w, 1, 0, 2)), 2e-3);
    double left = 0;
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(w), {});
        for (int pass = 0; pass < 90; ++pass) {
            frame.step();
            if (pass < 80) continue;
            left = std::max({left, deepest_of_faces(frame.world(), 0, 1, 2), deepest_of_faces(frame.world(), 1, 0, 2)});
        }
    });
    EXPECT_LT(left, kTolerance);
}

}  // namespace
}  // namespace trocar::test
