#include "systems/detect/narrow/separation.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/reference/hull_depth.hpp"
#include "tests/systems/detect/contact_scene.hpp"

// The translation that separates two bodies, against closed forms.
namespace trocar::test {
namespace {

Mesh ball(double radius, uint32_t n) {
    return make_sphere(n, [=](const Vec3d& p) { return Vec3d(radius * p); });
}

// Sphere elongated along z by `half` in both directions.
Mesh capsule(double radius, double half, uint32_t n) {
    return make_sphere(n, [=](const Vec3d& p) { return Vec3d(radius * p + Vec3d(0, 0, p.z() >= 0 ? half : -half)); });
}

// Sagitta of the chords of a made sphere.
double sagitta(const ContactScene& scene, uint32_t body, double radius) {
    return 1.5 * std::pow(scene.meshes.info[body].max_edge, 2) / (6 * radius);
}

Separation separate(ContactScene& scene, uint32_t most_probes = 800) {
    const Vec3d home = scene.poses.origin[1];
    const Surfaces surfaces = scene.surfaces();
    const std::array bodies{separated_body(surfaces, *scene.trees[0], 0), separated_body(surfaces, *scene.trees[1], 1)};
    SeparationParams params;
    params.most_probes = most_probes;
    const Separation found = find_separation(params, bodies, [&](const Vec3d& t) {
        scene.poses.origin[1] = home + t;
        scene.run_with_regions();
        SeparationAnswer answer;
        answer.free = scene.penetrations.pair.empty() && scene.contours.curve.empty();
        if (!scene.penetrations.pair.empty()) answer.depth = scene.penetrations.depth[0];
        for (uint32_t i = 0; i < scene.contacts.pair.size(); ++i) {
            if (!(scene.contacts.distance[i] < 0)) continue;
            const Vec3d n = scene.contacts.normal[i];
            answer.directions.push_back({scene.contacts.body[i] == 0 ? Vec3d(-n) : n, -scene.contacts.distance[i]});
        }
        return answer;
    });
    // proven: free at that position
    scene.poses.origin[1] = home + found.translation;
    scene.run_with_regions();
    EXPECT_TRUE(scene.penetrations.pair.empty());
    EXPECT_TRUE(scene.contours.curve.empty());
    EXPECT_NEAR(found.translation.norm(), found.upper, 1e-12);
    EXPECT_LE(found.lower, found.upper);
    EXPECT_LE(found.probes, most_probes + 1);
    scene.poses.origin[1] = home;
    return found;
}

// [truth - slack, truth] contains the mesh's own answer; upper is within 1 % of it, lower at most it and at least 5 % less.
void expect_bracket(ContactScene& scene, double truth, double slack, const std::string& what) {
    const Separation s = separate(scene);
    EXPECT_LE(s.upper, 1.01 * truth) << what;
    EXPECT_GE(s.upper, truth - slack) << what;
    EXPECT_LE(s.lower, truth + 1e-12) << what;
    EXPECT_GE(s.lower, 0.95 * s.upper) << what;
}

TEST(Separation, SpheresShallowDeepAndConcentric) {
    for (const double d : {0.85, 0.6, 0.3, 0.0}) {
        ContactScene scene({{ball(0.5, 7), Motion::kHand, Vec3d::Zero(), turn({1, 2, 3}, 1)},
                            {ball(0.4, 7), Motion::kHand, d * Vec3d(1, 2, 2) / 3, turn({3, 1, 2}, 2)}});
        expect_bracket(scene, 0.9 - d, sagitta(scene, 0, 0.5) + sagitta(scene, 1, 0.4), "distance " + std::to_string(d));
    }
}

TEST(Separation, SphereAndBox) {
    const Vec3d half(0.5, 0.3, 0.4);
    for (const Vec3d& c : {Vec3d(0.1, 0.45, 0.05), Vec3d(0.55, 0.35, 0.1), Vec3d(0.6, 0.4, 0.5), Vec3d(0.1, 0.2, -0.1)}) {
        ContactScene scene(
            {{make_box(2 * half, {3, 3, 3}), Motion::kHand, Vec3d::Zero(), {}}, {ball(0.25, 8), Motion::kHand, c, turn({3, 1, 2}, 2)}});
        const Vec3d nearest = c.cwiseMax(-half).cwiseMin(half);
        const bool inside = nearest == c;
        const double truth = inside ? 0.25 + (half - c.cwiseAbs()).minCoeff() : 0.25 - (c - nearest).norm();
        expect_bracket(scene, truth, sagitta(scene, 1, 0.25), "centre " + std::to_string(c.x()));
    }
}

// Half of the meshes against a plane: the support of any shape, convex or not, is exact for its mesh.
TEST(Separation, AnyShapeAndAPlane) {
    const std::vector<Mesh> shapes{make_noisy_sphere(8, 0.4, 0.2, 1), capsule(0.2, 0.3, 8), make_torus(0.4, 0.15, 24, 12),
                                   make_box({0.5, 0.3, 0.4})};
    for (size_t i = 0; i < shapes.size(); ++i) {
        const Quat q = turn({1, 0.3, 2}, 1.0 + double(i));
        double lowest = 0;
        for (const Vec3d& p : shapes[i].position) lowest = std::min(lowest, rotate(q, p).z());
        for (const double depth : {0.02, 0.2}) {
            ContactScene scene({{make_box({40, 40, 20}), Motion::kHand, Vec3d(3, -2, -10), {}},
                                {shapes[i], Motion::kHand, Vec3d(0, 0, -lowest - depth), q}});
            expect_bracket(scene, depth, 1e-12, "shape " + std::to_string(i));
        }
    }
}

TEST(Separation, CapsulesCrossed) {
    for (const double angle : {0.0, 0.7, M_PI / 2}) {
        ContactScene scene({{capsule(0.2, 0.5, 8), Motion::kHand, Vec3d::Zero(), {}},
                            {capsule(0.15, 0.4, 8), Motion::kHand, Vec3d(0.25, 0, 0.05), turn({1, 0, 0}, angle)}});
        expect_bracket(scene, 0.1, sagitta(scene, 0, 0.2) + sagitta(scene, 1, 0.15), "angle " + std::to_string(angle));
    }
}

// P07: vertices have no depth, the surface 0.5, the separating translation is 1.5.
TEST(HardCases, P07_AlignedCubesBracket) {
    ContactScene scene(
        {{make_box({2, 2, 2}), Motion::kHand, Vec3d::Zero(), {}}, {make_box({2, 2, 2}), Motion::kHand, Vec3d(0.5, 0, 0), {}}});
    const Separation s = separate(scene);
    EXPECT_NEAR(s.lower, 1.5, 1e-9);
    EXPECT_GE(s.upper, 1.5);
    EXPECT_LE(s.upper, 1.001 * 1.5);
    EXPECT_NEAR(std::abs(s.translation.x()), s.upper, 0.3 * s.upper);
}

// Rotated boxes: the separating-axis theorem, 3 + 3 + 9 axes, is the truth.
TEST(Separation, TurnedBoxesEqualTheAxesTheorem) {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(-1, 1);
    uint32_t edge_edge = 0;
    for (int trial = 0; trial < 12; ++trial) {
        const Vec3d a(0.5, 0.35, 0.6), b(0.3, 0.55, 0.4), at = 0.75 * Vec3d(unit(random), unit(random), unit(random));
        const Quat q = turn({unit(random), unit(random), unit(random)}, 3 * unit(random));
        std::vector<Vec3d> axes;
        for (int i = 0; i < 3; ++i) axes.push_back(Vec3d::Unit(i)), axes.push_back(rotate(q, Vec3d::Unit(i)));
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) axes.push_back(Vec3d::Unit(i).cross(rotate(q, Vec3d::Unit(j))).normalized());
        double truth = 1e9;
        size_t least = 0;
        for (size_t i = 0; i < axes.size(); ++i) {
            double reach = -std::abs(axes[i].dot(at));
            for (int k = 0; k < 3; ++k) {
                reach += a[k] * std::abs(axes[i][k]) + b[k] * std::abs(axes[i].dot(rotate(q, Vec3d::Unit(k))));
            }
            if (reach < truth) truth = reach, least = i;
        }
        if (!(truth > 0.01)) continue;
        edge_edge += least >= 6;
        ContactScene scene(
            {{make_box(2 * a, {2, 2, 2}), Motion::kHand, Vec3d::Zero(), {}}, {make_box(2 * b, {2, 2, 2}), Motion::kHand, at, q}});
        expect_bracket(scene, truth, 1e-9, "trial " + std::to_string(trial));
    }
    EXPECT_GT(edge_edge, 0u);
}

TEST(Separation, SphereAndTorus) {
    const double R = 1, r = 0.3;
    {  // outside the hole: straight away from the core
        ContactScene scene({{make_torus(R, r, 40, 16), Motion::kHand, Vec3d::Zero(), {}},
                            {ball(0.25, 8), Motion::kHand, Vec3d(1.2, 0, 0.38), turn({3, 1, 2}, 2)}});
        const double truth = 0.25 - (std::hypot(0.2, 0.38) - r);
        expect_bracket(scene, truth, 0.03, "beside the core");
    }
    // P14: plugging the hole, depth 0.01 and a separating translation of 0.142
    ContactScene plug({{make_torus(R, r, 40, 16), Motion::kHand, Vec3d::Zero(), {}},
                       {ball(0.71, 10), Motion::kHand, Vec3d::Zero(), turn({0, 0, 1}, 0.3)}});
    const Separation s = separate(plug);
    EXPECT_LE(s.upper, 1.01 * std::sqrt(std::pow(r + 0.71, 2) - R * R));
    EXPECT_LT(plug.penetrations.depth[0], 0.012);
    EXPECT_GT(s.lower, 0.95 * s.upper);
}

// Hulls of random points, shallow to deep and stretched to 1:20, against every direction that the difference of two
// hulls can have a face in.
TEST(Separation, A14_ConvexPairsAreExact) {
    std::mt19937 random(14);
    std::uniform_real_distribution<double> unit(-1, 1);
    double worst = 0;
    for (int trial = 0; trial < 40; ++trial) {
        std::vector<Vec3d> points[2];
        for (int body = 0; body < 2; ++body) {
            const Vec3d stretch(1, trial % 4 == 0 ? 0.05 : 0.6, trial % 3 == 0 ? 0.2 : 1);
            const Quat q = turn({unit(random), unit(random), unit(random)}, 3 * unit(random));
            for (int i = 0; i < 6 + trial % 7; ++i)
                points[body].push_back(rotate(q, Vec3d(unit(random), unit(random), unit(random)).cwiseProduct(stretch)));
        }
        const Vec3d at = 0.4 * Vec3d(unit(random), unit(random), unit(random));
        const Mesh a = reference::hull_of(points[0]), b = reference::hull_of(points[1]);
        const double truth = reference::hull_depth(a, b, at);
        if (!(truth > 1e-3)) continue;
        ContactScene scene({{a, Motion::kHand, Vec3d::Zero(), {}}, {b, Motion::kHand, at, {}}});
        const Separation s = separate(scene);
        worst = std::max(worst, s.upper / truth - 1);
        EXPECT_LE(s.upper, 1.001 * truth + 1e-9) << trial;
        EXPECT_GE(s.upper, truth * (1 - 1e-9)) << trial;
        EXPECT_LE(s.lower, truth * (1 + 1e-9)) << trial;
        EXPECT_GE(s.lower, 0.998 * truth) << trial;
    }
    std::printf("[   figure ] separating translation of convex pairs: worst excess %.1e of it\n", worst);
}

// Deep pairs that are not convex: the bracket is narrow.
TEST(Separation, A14_DeepPairsThatAreNotConvexHaveNarrowBrackets) {
    const std::vector<Mesh> shapes{make_noisy_sphere(8, 0.4, 0.25, 1), make_noisy_sphere(6, 0.35, 0.4, 2), make_torus(0.4, 0.15, 24, 12),
                                   make_torus(0.3, 0.1, 20, 10)};
    std::mt19937 random(15);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int trial = 0; trial < 10; ++trial) {
        ContactScene scene({{shapes[random() % 4], Motion::kHand, Vec3d::Zero(), {}},
                            {shapes[random() % 4], Motion::kHand, 0.2 * Vec3d(unit(random), unit(random), unit(random)),
                             turn({unit(random), unit(random), unit(random)}, 3 * unit(random))}});
        const Separation s = separate(scene);
        EXPECT_GE(s.lower, 0.95 * s.upper) << trial << ": " << s.lower << " to " << s.upper << ", " << s.probes << " probes";
    }
}

// A separated pair, and a search that exceeds its budget: still a proven answer.
TEST(Separation, FreeBodiesAndASmallBudget) {
    ContactScene apart({{ball(0.5, 4), Motion::kHand, Vec3d::Zero(), {}}, {ball(0.4, 4), Motion::kHand, Vec3d(1, 0, 0), {}}});
    const Separation none = separate(apart);
    EXPECT_EQ(none.upper, 0);
    EXPECT_EQ(none.probes, 1u);
    ContactScene deep({{ball(0.5, 4), Motion::kHand, Vec3d::Zero(), {}}, {ball(0.4, 4), Motion::kHand, Vec3d(0.2, 0, 0), {}}});
    const Separation some = separate(deep, 40);
    EXPECT_LT(some.upper, 1);
    EXPECT_GT(some.upper, 0.6);
}

}  // namespace
}  // namespace trocar::test
