#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "systems/frame/frame.hpp"
#include "systems/output/deformable_energy.hpp"
#include "tests/frame/scenes_under_test.hpp"
#include "tests/reference/measures.hpp"

// Free rigid bodies in whole frames, compared with closed forms and conservation laws.
namespace {
using namespace trocar;

constexpr double kGravity = 9.81;

BodySpec body(const std::string& name, const std::string& shape, Motion motion, double size, const Vec3d& position,
              uint32_t triangles = 12) {
    BodySpec spec;
    spec.name = name;
    spec.shape = shape;
    spec.motion = motion;
    spec.size = size;
    spec.position = position;
    spec.triangles = triangles;
    spec.tissue.friction = 0;
    spec.tissue.damping = 0;
    spec.tissue.density = 1000;
    return spec;
}

void run(const SceneFile& scene, double seconds, const std::function<void(const Frame&)>& each,
         const std::function<void(const Frame&)>& last = {}) {
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
        const int passes = static_cast<int>(std::lround(seconds * 60));
        for (int pass = 0; pass < passes; ++pass) {
            frame.step();
            if (each) each(frame);
        }
        if (last) last(frame);
    });
}

Vec3d centre_of(const World& w, uint32_t b) {
    return w.poses.origin[b] + rotate(w.poses.orientation[b], find_rigid_mass(w.bodies, b)->centre);
}
Vec3d velocity_of(const World& w, uint32_t b) {
    return w.poses.velocity[b] + w.poses.angular_velocity[b].cross(centre_of(w, b) - w.poses.origin[b]);
}

// Leapfrog positions are exact under a constant force, for any rotation of the body. Breaks when the first
// kick is not a half kick, or the centre of mass is not the point that falls.
TEST(FreeBodies, FallOnTheExactParabola) {
    SceneFile scene;
    scene.bodies = {body("probe", "probe", Motion::kFree, 0.2, {0, 0, 1}, 500)};
    scene.bodies[0].velocity = {1, -2, 3};
    scene.bodies[0].spin = {0, 5, 1};
    const World start = std::move(build_scene(scene, Looks::kPlain).world);
    const Vec3d from = centre_of(start, 0), speed = velocity_of(start, 0);
    ASSERT_GT((from - start.poses.origin[0]).norm(), 0.05) << "the probe's origin is its tip";
    run(scene, 2, [&](const Frame& f) {
        const double t = seconds_of(f);
        const Vec3d exact = from + t * speed - 0.5 * t * t * Vec3d(0, 0, kGravity);
        EXPECT_LT((centre_of(f.world(), 0) - exact).norm(), 1e-12 * (1 + exact.norm()));
    });
}

struct Totals {
    Vec3d linear = Vec3d::Zero(), angular = Vec3d::Zero();
};
Totals totals_of(const World& w) {
    Totals sum;
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const Momentum m = measure_momentum(w.bodies, w.poses, w.particles, b);
        sum.linear += m.linear, sum.angular += m.angular;
    }
    return sum;
}

// Spinning boxes collide with friction, off centre and edge first: linear and angular momentum are conserved,
// the energy changes only as the energy accounting says, and never grows.
TEST(FreeBodies, CollisionsKeepMomentumAndTheBooks) {
    SceneFile scene;
    scene.settings.gravity.setZero();
    scene.settings.contact.push_speed = 0;  // position correction keeps momenta but moves bodies
    scene.bodies = {body("a", "box", Motion::kFree, 0.06, {-0.06, 0, 0}), body("b", "box", Motion::kFree, 0.04, {0.03, 0.02, 0.01}),
                    body("c", "sphere", Motion::kFree, 0.05, {0.02, -0.05, 0.02}, 320)};
    for (BodySpec& b : scene.bodies) b.tissue.friction = 0.4;
    scene.bodies[0].velocity = {0.5, 0, 0};
    scene.bodies[0].spin = {1, 7, -4};
    scene.bodies[1].spin = {-3, 2, 8};
    scene.bodies[2].velocity = {0, 0.3, 0};
    const World start = std::move(build_scene(scene, Looks::kPlain).world);
    const Totals before = totals_of(start);
    double energy = 1e9, contact = 0, first_energy = -1;
    run(
        scene, 2,
        [&](const Frame& f) {
            const World& w = f.world();
            const Totals now = totals_of(w);
            EXPECT_LT((now.linear - before.linear).norm(), 1e-12 * before.linear.norm());
            EXPECT_LT((now.angular - before.angular).norm(), 1e-9 * before.linear.norm() * 0.06) << seconds_of(f);
            if (!f.times().picture) return;
            if (first_energy < 0) first_energy = w.energy.kinetic;
            EXPECT_LE(w.energy.kinetic, energy * (1 + 1e-4));
            EXPECT_LT(std::abs(w.energy.balance), 1e-3 * first_energy);
            energy = w.energy.kinetic;
            contact = w.energy.work_contact;
        },
        [](const Frame& f) { EXPECT_GT(f.world().report.contact_events, 0u); });
    EXPECT_LT(contact, -0.05 * first_energy);
}

// Head-on collision of two balls: closed form of restitution, v1' = (m1 - e m2) v / (m1 + m2), v2' = (1 + e)
// m1 v / (m1 + m2). The deflection by facets is second order in their angle to the line of centres, 3 degrees
// here.
TEST(FreeBodies, BallsBounceByTheirRestitution) {
    const double v = 0.4;
    for (const double e : {0.0, 0.5, 1.0}) {
        for (const double ratio : {1.0, 3.0}) {
            SceneFile scene;
            scene.settings.gravity.setZero();
            scene.bodies = {body("a", "sphere", Motion::kFree, 0.05, {-0.04, 0, 0}, 1280),
                            body("b", "sphere", Motion::kFree, 0.05, {0.04, 0, 0}, 1280)};
            scene.bodies[0].velocity = {v, 0, 0};
            scene.bodies[0].tissue.restitution = e;
            scene.bodies[1].tissue.density = ratio * scene.bodies[0].tissue.density;
            run(scene, 0.5, {}, [&](const Frame& f) {
                const double a = velocity_of(f.world(), 0).x(), b = velocity_of(f.world(), 1).x();
                EXPECT_NEAR(a, (1 - e * ratio) / (1 + ratio) * v, 0.005 * v) << "restitution " << e << ", masses 1:" << ratio;
                EXPECT_NEAR(b, (1 + e) / (1 + ratio) * v, 0.005 * v) << "restitution " << e << ", masses 1:" << ratio;
                EXPECT_NEAR(a + ratio * b, v, 1e-12);
            });
        }
    }
}

// A ball hits a line of four that touch or nearly touch. With restitution 1 the energy and momentum are
// conserved through all contact constraints of the facets and all impacts, successive or simultaneous (except
// a part where a facet's separation closes just before the impact); with less, energy is lost. Breaks when
// impact impulses warm-start the next substep (three times the energy), or when constraints that separate are
// held back during an impact.
TEST(FreeBodies, ARowOfBallsMakesNoEnergy) {
    for (const double e : {0.5, 1.0}) {
        for (const double gap : {0.0, 1e-3}) {
            SceneFile scene;
            scene.settings.gravity.setZero();
            for (int k = 0; k < 5; ++k) {
                scene.bodies.push_back(body("b" + std::to_string(k), "sphere", Motion::kFree, 0.05, {k * (0.05 + gap), 0, 0}, 500));
                scene.bodies[static_cast<size_t>(k)].tissue.restitution = e;
            }
            scene.bodies[0].position.x() -= 0.06;
            scene.bodies[0].velocity = {1, 0, 0};
            double first = 0, most = 0;
            run(
                scene, 0.5,
                [&](const Frame& f) {
                    if (first == 0) first = f.world().energy.kinetic;
                    most = std::max(most, f.world().energy.kinetic);
                },
                [&](const Frame& f) {
                    Vec3d momentum = Vec3d::Zero();
                    for (uint32_t b = 0; b < 5; ++b) momentum += velocity_of(f.world(), b);
                    EXPECT_LT((momentum - Vec3d(1, 0, 0)).norm(), 1e-9);
                    EXPECT_LT(most, first * 1.001) << "restitution " << e << ", gap " << gap;
                    EXPECT_GT(f.world().energy.kinetic, (e == 1 ? 0.99 : 0.2) * first) << "restitution " << e << ", gap " << gap;
                    EXPECT_LT(f.world().energy.kinetic, (e == 1 ? 1.001 : 0.7) * first) << "restitution " << e << ", gap " << gap;
                });
        }
    }
}

// A box that falls flat on a floor and bounces stays flat: its four corners receive equal impulses. The
// bounce heights follow from restitution, h e^2, h e^4; it reverses up to v dt (one substep) above the floor.
// Breaks when an impact is solved corner by corner and not to convergence, or when a body stopped by CCD
// continues to fall for the rest of the substep (2 % of the height).
TEST(FreeBodies, ABoxThatFallsFlatBouncesFlat) {
    for (const double e : {0.7, 1.0}) {
        const double height = 0.2, fall = std::sqrt(2 * height / kGravity);
        SceneFile scene;
        scene.bodies = {body("floor", "box", Motion::kStatic, 2, {0, 0, -1}),
                        body("box", "box", Motion::kFree, 0.05, {0, 0, height + 0.025})};
        scene.bodies[1].tissue.restitution = e;
        std::array<double, 2> top{};
        double steepest = 0;
        run(scene, fall * (1 + 2 * e + 2 * e * e) - 0.02, [&](const Frame& f) {
            const double t = seconds_of(f), second = fall * (1 + 2 * e);
            double& rise = top[t > second];
            if (t > fall) rise = std::max(rise, centre_of(f.world(), 1).z() - 0.025);
            const Quat& q = f.world().poses.orientation[1];
            steepest = std::max(steepest, 2 * std::hypot(q.x, q.y));
        });
        std::printf("restitution %g: rises %.2f %% and %.2f %% too high\n", e, 100 * (top[0] / (e * e * height) - 1),
                    100 * (top[1] / (std::pow(e, 4) * height) - 1));
        const double early = (1 - e * e) * kGravity * fall * 1e-3;  // m, reversal up to v dt above the floor
        EXPECT_NEAR(top[0], e * e * height, early + 1e-3 * height);
        EXPECT_NEAR(top[1], std::pow(e, 4) * height, 2 * e * early + 1e-3 * height);
        EXPECT_LT(steepest, 1e-3) << "rad";
    }
}

// A block on a slope (gravity rotated by the slope angle) holds below the angle of friction and slides above
// it with g (sin - mu cos).
SceneFile slope(double tangent, double friction) {
    const double angle = std::atan(tangent);
    SceneFile scene;
    scene.settings.gravity = kGravity * Vec3d(std::sin(angle), 0, -std::cos(angle));
    scene.bodies = {body("table", "table", Motion::kStatic, 2, Vec3d::Zero()), body("block", "table", Motion::kFree, 0.1, Vec3d::Zero())};
    scene.bodies[0].tissue.friction = friction;
    scene.bodies[1].above = "table";
    scene.bodies[1].gap = 0;
    return scene;
}

TEST(FreeBodies, BlockHoldsOnASlopeBelowTheAngleOfFriction) {
    run(slope(0.45, 0.5), 2, {}, [](const Frame& f) {
        EXPECT_LT(f.world().poses.origin[1].head<2>().norm(), 1e-5) << "creeps";
        EXPECT_LT(velocity_of(f.world(), 1).norm(), 1e-5);
    });
}

TEST(FreeBodies, BlockSlidesOnASlopeAsCoulombSays) {
    for (const double friction : {0.0, 0.2, 0.5}) {
        const double angle = std::atan(0.6), exact = kGravity * (std::sin(angle) - friction * std::cos(angle));
        run(slope(0.6, friction), 0.5, {}, [&](const Frame& f) {
            const double t = seconds_of(f);
            EXPECT_NEAR(f.world().poses.origin[1].x() / (0.5 * exact * t * t), 1, 0.01) << "friction " << friction;
            EXPECT_NEAR(velocity_of(f.world(), 1).x() / (exact * t), 1, 0.01) << "friction " << friction;
            EXPECT_LT(find_rigid_mass(f.world().bodies, 1)->mass * velocity_of(f.world(), 1).cwiseAbs().z(), 1e-3);
        });
    }
}

// Ten boxes dropped on each other from 2 mm stand stacked and still: within two seconds none is faster than 1
// mm/s, none vibrates by 0.05 mm, and the remaining overlap does not grow.
TEST(FreeBodies, StackOfTenBoxesSettles) {
    SceneFile scene;
    scene.bodies = {body("table", "box", Motion::kStatic, 0.3, {0, 0, -0.15})};
    scene.bodies[0].tissue.friction = 0.5;
    for (int i = 1; i <= 10; ++i) {
        scene.bodies.push_back(body("box" + std::to_string(i), "box", Motion::kFree, 0.04, Vec3d::Zero()));
        scene.bodies.back().above = i == 1 ? "table" : "box" + std::to_string(i - 1);
        scene.bodies.back().gap = 0.002;
        scene.bodies.back().tissue.friction = 0.5;
    }
    double fastest = 0, residual = 0;
    std::vector<Vec3d> resting;
    double trembling = 0;
    run(
        scene, 3,
        [&](const Frame& f) {
            const World& w = f.world();
            if (seconds_of(f) < 2) return;
            if (resting.empty()) resting = w.poses.origin;
            for (uint32_t b = 1; b <= 10; ++b) {
                fastest = std::max(fastest, velocity_of(w, b).norm() + w.poses.angular_velocity[b].norm() * 0.035);
                trembling = std::max(trembling, (w.poses.origin[b] - resting[b]).norm());
            }
            residual = std::max(residual, w.report.deepest_residual);
        },
        [](const Frame& f) {
            for (uint32_t b = 1; b <= 10; ++b) EXPECT_NEAR(f.world().poses.origin[b].z(), 0.04 * b - 0.02, 2e-5) << b;
        });
    EXPECT_LT(fastest, 1e-3);
    EXPECT_LT(trembling, 5e-5);
    EXPECT_LT(residual, 5e-6);
    RecordProperty("fastest_um_s", static_cast<int>(fastest * 1e6));
    std::printf("stack of ten: fastest %.3g mm/s, moved %.3g um, overlap %.3g um\n", fastest * 1e3, trembling * 1e6, residual * 1e6);
}

// Columns of eleven boxes, each box offset by 2 mm, dropped from 1 mm: one island whose columns share no
// contact constraint. They come to rest in place without swaying: residuals of substeps do not accumulate.
// Breaks when columns are solved by sweeps only (0.1 mm/s forever).
TEST(FreeBodies, ColumnsSideBySideStandStill) {
    constexpr int kHigh = 11;
    constexpr double kEdge = 0.045;
    const auto position_at = [](int column, int i) {
        const double askew = 1.5e-3 * std::sin(2.3 * i + column);
        return Vec3d(column * 0.05 + askew, 1.5e-3 * std::cos(1.7 * i + column), 0.0255 + 0.051 * i);
    };
    SceneFile scene;
    scene.settings.sleep_speed = 0;
    scene.bodies = {body("floor", "box", Motion::kStatic, 0.6, {0, 0, -0.3})};
    for (int column = 0; column < 2; ++column)
        for (int i = 0; i < kHigh; ++i)
            scene.bodies.push_back(body("b" + std::to_string(scene.bodies.size()), "box", Motion::kFree, kEdge, position_at(column, i)));
    for (BodySpec& b : scene.bodies) b.tissue.friction = 0.5;
    double fastest = 0;
    const auto look = [&](const Frame& f) {
        const World& w = f.world();
        for (uint32_t b = 1; b <= 2 * kHigh && seconds_of(f) > 1; ++b)
            fastest = std::max(fastest, velocity_of(w, b).norm() + w.poses.angular_velocity[b].norm() * kEdge);
    };
    run(scene, 2, look, [&](const Frame& f) {
        for (int i = 0; i < 2 * kHigh; ++i) {
            const Vec3d at = f.world().poses.origin[static_cast<size_t>(i + 1)], from = position_at(i / kHigh, i % kHigh);
            const double height = (i % kHigh + 0.5) * kEdge;
            EXPECT_LT((at - Vec3d(from.x(), from.y(), height)).norm(), 2e-4) << i;
            EXPECT_NEAR(at.z(), height, 5e-6 * (i % kHigh + 1)) << i;  // separation below 5 um per contact
        }
    });
    EXPECT_LT(fastest, 3e-6);
    std::printf("columns of eleven: fastest %.3g um/s\n", fastest * 1e6);
}

// Two bars crossed at 45 degrees touch only with their edges where the upper one tips over the lower one's
// side.
TEST(FreeBodies, P08_BoxTurnedOnABoxStandsOnItsEdges) {
    SceneFile scene;
    scene.bodies = {body("lower", "box", Motion::kStatic, 0.04, {0, 0, -0.02}), body("upper", "box", Motion::kFree, 0.04, {0, 0, 0.0205})};
    scene.bodies[1].orientation = from_rotation_vector({0, 0, std::numbers::pi / 4});
    scene.bodies[1].tissue.friction = 0.5;
    run(scene, 1, {}, [](const Frame& f) {
        EXPECT_LT((f.world().poses.origin[1] - Vec3d(0, 0, 0.02)).norm(), 1e-4) << f.world().poses.origin[1].transpose();
        EXPECT_LT(velocity_of(f.world(), 1).norm(), 1e-3);
    });
}

// More sweeps than the constraints need: a converged solution is kept. Breaks when the conjugate direction is
// divided by a zero change (0 / 0 spread to every body of the island).
TEST(FreeBodies, SweepsBeyondTheSolutionChangeNothing) {
    SceneFile scene;
    scene.bodies = {body("floor", "box", Motion::kStatic, 0.4, {0, 0, -0.2}), body("box", "box", Motion::kFree, 0.09, {0, 0, 0.06})};
    for (BodySpec& b : scene.bodies) b.tissue.friction = 0.4;
    scene.settings.contact.iterations = 12;
    run(scene, 1.0, {}, [](const Frame& f) {
        const World& w = f.world();
        EXPECT_EQ(w.report.nonfinite_particles, 0u);
        EXPECT_NEAR(centre_of(w, 1).z(), 0.045, 1e-4);
        EXPECT_LT(velocity_of(w, 1).norm(), 1e-3);
    });
}

// A steel ball hits a soft body of equal mass: momentum is transferred. The soft body's particles store
// momentum in floats; a second of their rounding may change the total by 1e-6.
TEST(FreeBodies, BallOnASoftBodyKeepsMomentum) {
    SceneFile scene;
    scene.settings.gravity.setZero();
    scene.settings.contact.push_speed = 0;
    scene.bodies = {body("soft", "sphere", Motion::kDeformable, 0.08, Vec3d::Zero(), 1280),
                    body("ball", "sphere", Motion::kFree, 0.04, {0.01, 0.005, 0.066}, 320)};
    scene.bodies[0].anchor_frame = AnchorFrame::kShape;
    for (BodySpec& b : scene.bodies) b.tissue.friction = 0.3;
    scene.bodies[1].tissue.density = 8000;
    scene.bodies[1].velocity = {0.05, 0, -0.4};
    scene.bodies[1].spin = {0, 6, 0};
    const World start = std::move(build_scene(scene, Looks::kPlain).world);
    const Totals before = totals_of(start);
    const double scale = before.linear.norm();
    double lost = 0;
    run(
        scene, 1,
        [&](const Frame& f) {
            const Totals now = totals_of(f.world());
            EXPECT_LT((now.linear - before.linear).norm(), 1e-6 * scale);
            EXPECT_LT((now.angular - before.angular).norm(), 1e-6 * scale * (0.066 + 0.04)) << "about the farthest arm";
            lost = f.world().energy.work_contact;
            EXPECT_LT(std::abs(f.world().energy.balance), 1e-2 * 0.5 * scale * 0.4) << seconds_of(f);
        },
        [&](const Frame& f) {
            EXPECT_GT(velocity_of(f.world(), 1).z(), -0.3) << "the ball was not slowed down";
            EXPECT_GT(f.world().report.contact_events, 3u);
        });
    EXPECT_LT(lost, 0);
}

// Stacked boxes, a ball on a soft body and a fast one: bit-identical for any number of threads, in either
// order of execution and with cleared caches.
TEST(FreeBodies, SameHashForAnyThreadsAndCaches) {
    SceneFile scene;
    scene.bodies = {body("table", "table", Motion::kStatic, 0.6, {0, 0, -0.01}, 400),
                    body("low", "box", Motion::kFree, 0.04, {0, 0, 0.021}),
                    body("high", "box", Motion::kFree, 0.03, {0.005, 0, 0.058}),
                    body("soft", "sphere", Motion::kDeformable, 0.06, {0.1, 0, 0.032}, 1000),
                    body("ball", "sphere", Motion::kFree, 0.02, {0.1, 0.005, 0.075}, 320),
                    body("fast", "sphere", Motion::kFree, 0.02, {-0.1, 0, 0.3}, 320)};
    scene.bodies[3].anchor_frame = AnchorFrame::kShape;
    scene.bodies[5].velocity = {0, 0, -8};
    for (BodySpec& b : scene.bodies) b.tissue.friction = 0.4;
    const auto hash = [&](uint32_t threads, bool serial, bool clear_caches) {
        uint64_t value = 0;
        ThreadPool pool(threads);
        pool.run([&] {
            FrameOptions options;
            options.serial = serial;
            options.clear_caches = clear_caches;
            Frame frame(std::move(build_scene(scene, Looks::kPlain).world), options);
            for (int pass = 0; pass < 40; ++pass) frame.step();
            EXPECT_GT(frame.world().report.contact_events, 20u);
            value = state_hash(frame.world());
        });
        return value;
    };
    const uint64_t reference = hash(1, true, false);
    for (const uint32_t threads : {1u, 2u, 4u}) EXPECT_EQ(hash(threads, false, false), reference) << threads;
    EXPECT_EQ(hash(2, false, true), reference) << "caches cleared";
}

// M18. A ball squeezed by two scripted jaws to less than its diameter. Nothing can yield, so the remaining
// overlap follows from geometry, on both sides or on one; it does not grow while the jaws hold, and the ball
// stays between them.
TEST(HardCases, M18_RigidBallSqueezedBetweenJaws) {
    SceneFile scene;
    scene.settings.gravity.setZero();
    const double gap = 0.0396;
    for (const double side : {-1.0, 1.0}) {
        BodySpec jaw = body(side < 0 ? "left" : "right", "box", Motion::kKinematic, 0.04, {side * 0.05, 0, 0});
        Keyframe open, closed;
        open.position = jaw.position;
        closed.position = Vec3d(side * (0.02 + 0.5 * gap), 0, 0);
        closed.time = 0.5;
        jaw.path = {open, closed};
        scene.bodies.push_back(jaw);
    }
    scene.bodies.push_back(body("ball", "sphere", Motion::kFree, 0.04, {0.001, 0.002, 0.0}, 1280));
    scene.bodies[2].tissue.friction = 0.5;
    double at_close = 0, later = 0;
    run(
        scene, 1.5,
        [&](const Frame& f) {
            const double t = seconds_of(f);
            double& worst = t < 0.8 ? at_close : later;  // until then the ball turns from facet to facet
            for (const double depth : f.world().penetrations.depth) worst = std::max(worst, depth);
        },
        [](const Frame& f) { EXPECT_LT(f.world().poses.origin[2].norm(), 0.01); });
    EXPECT_LT(at_close, 0.04 - gap + 1e-4);
    EXPECT_LT(later, at_close + 1e-5);
    EXPECT_GT(later, 0.4 * (0.04 - gap)) << "never squeezed";
}

// P19. A ball thrown at a 20 mm table at up to 10 m/s moves past the table's middle in one pass. For any
// phase it must never be found below the table, and it bounces with its restitution.
TEST(HardCases, P19_FastBallAgainstATable) {
    for (const double speed : {2.0, 5.0, 10.0}) {
        for (const double phase : {0.0, 0.013, 0.031}) {
            SceneFile scene;
            scene.settings.gravity.setZero();
            scene.bodies = {body("table", "table", Motion::kStatic, 0.6, {0, 0, -0.01}, 400),
                            body("ball", "sphere", Motion::kFree, 0.01, {0.02, 0.01, 0.1 + phase}, 320)};
            scene.bodies[1].velocity = {0.3, 0, -speed};
            scene.bodies[1].tissue.restitution = 0.5;
            double lowest = 1;
            run(
                scene, 0.2, [&](const Frame& f) { lowest = std::min(lowest, centre_of(f.world(), 1).z()); },
                [&](const Frame& f) { EXPECT_NEAR(velocity_of(f.world(), 1).z() / speed, 0.5, 0.01) << speed << " " << phase; });
            EXPECT_GT(lowest, 0.005 - 3e-4) << speed << " m/s, " << phase;
        }
    }
}

// A blade lands on one end and slaps down with the other end, half as fast again: all of it stays above the
// table, as checked by its vertices. Breaks when the raised end, whose edges run down through the table's
// plane, has no contact constraints (8 mm below).
TEST(HardCases, P19_ABladeSlapsDownOnATable) {
    double lowest = 0;
    for (int tilt = 0; tilt < 6; ++tilt) {
        SceneFile scene;
        scene.bodies = {body("table", "table", Motion::kStatic, 0.6, {0, 0, -0.01}, 400),
                        body("blade", "scissor_blade", Motion::kFree, 0.05, {0, 0, 0.09}, 300)};
        scene.bodies[1].orientation = from_rotation_vector(Vec3d(1.2 + 0.1 * tilt, 0.3, 0));
        scene.bodies[1].spin = {0, 4, 2};
        scene.bodies[1].tissue.density = 7800;
        scene.bodies[1].tissue.friction = 0.3;
        run(scene, 0.5, [&](const Frame& f) {
            const World& w = f.world();
            const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[1]);
            for (const Vec3d& p : mesh.position) lowest = std::min(lowest, (w.poses.origin[1] + rotate(w.poses.orientation[1], p)).z());
        });
    }
    EXPECT_GT(lowest, -0.1e-3);
    std::printf("blade on a table: %.2f mm below it at worst\n", -1e3 * lowest);
}

// The same for a hand: the probe's tip is driven through the table and far below it in one pass.
TEST(HardCases, P19_FastHandAgainstATable) {
    for (const double phase : {0.0, 0.005, 0.011}) {
        SceneFile scene;
        scene.settings.gravity.setZero();
        scene.bodies = {body("table", "table", Motion::kStatic, 0.6, {0, 0, -0.01}, 400),
                        body("probe", "probe", Motion::kHand, 0, {0.02, 0.01, 0.05}, 1000)};
        ToolSpec tool;
        tool.body = "probe";
        tool.tool.tip_radius = 0.007;
        Keyframe above, start, through;
        above.position = start.position = Vec3d(0.02, 0.01, 0.05);
        start.time = 0.1 + phase;
        through.position = Vec3d(0.02, 0.01, -0.06);
        through.time = start.time + 0.03;
        tool.path = {above, start, through};
        scene.tools = {tool};
        double lowest = 1;
        run(scene, 0.5, [&](const Frame& f) { lowest = std::min(lowest, f.world().poses.origin[1].z()); });
        EXPECT_GT(lowest, -0.01) << "its tip's middle passed the middle of the table, phase " << phase;
        EXPECT_LT(lowest, 0.0075) << "it never came near";
    }
}

// A hand jabs into tissue and stays there: it must feel the tissue's force on the tool. Breaks when CCD holds
// the tool at the surface, far behind the hand: then no surface is between them and the force is zero.
TEST(HardCases, P19_AJabIntoTissueIsFelt) {
    ThreadPool pool(1);
    pool.run([] {
        Frame frame(std::move(small_scene("probe_on_liver").world), {});
        const World& w = frame.world();
        double felt = 0, pressed = 0;
        while (w.clock.tick < 4200) {
            frame.step();
            if (w.clock.tick < 3900) continue;  // the jab is at 3.6 s
            felt += w.haptics.state[0].command.force.norm();
            pressed += w.haptics.state[0].contact_impulse.norm() / (w.clock.period * 1e-3);
        }
        EXPECT_GT(pressed, 1) << "nothing was pressed: the test shows nothing";
        EXPECT_NEAR(felt, pressed, 0.2 * pressed);
    });
}

}  // namespace
