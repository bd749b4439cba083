#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/systems/detect/contact_scene.hpp"

// The depth of a pair does not depend on which body comes first, or on where both are, to the stated tolerance.
namespace trocar::test {
namespace {

TEST(DepthInvariance, ExchangeAndRigidMotion) {
    const std::vector<Mesh> shapes{make_noisy_sphere(5, 0.4, 0.2, 1), make_noisy_sphere(9, 0.5, 0, 2), make_box({0.6, 0.5, 0.9}),
                                   make_torus(0.4, 0.15, 20, 10)};
    std::mt19937 random(9);
    std::uniform_real_distribution<double> unit(-1, 1);
    const auto any = [&] { return Vec3d(unit(random), unit(random), unit(random)); };
    constexpr double kTolerance = 1e-9;  // of about a diagonal
    double worst = 0;
    uint32_t overlaps = 0;
    for (int trial = 0; trial < 24; ++trial) {
        const Mesh &a = shapes[random() % 4], &b = shapes[random() % 4];
        const Vec3d at = 0.5 * any(), away = any();
        const Quat q = turn(any(), 3 * unit(random)), turned = turn(any(), 3 * unit(random));
        std::vector<double> depth;
        for (int arrangement = 0; arrangement < 4; ++arrangement) {
            const bool moved = arrangement & 1;
            BodyInput first{a, Motion::kHand, Vec3d::Zero(), {}}, second{b, Motion::kHand, at, q};
            for (BodyInput* body : {&first, &second}) {
                if (!moved) continue;
                body->origin = rotate(turned, body->origin) + away;
                body->orientation = multiply(turned, body->orientation);
            }
            if (arrangement & 2) std::swap(first, second);
            ContactScene scene({first, second});
            scene.settings.contact.faces = true;
            scene.settings.contact.tolerance = kTolerance;
            scene.run();
            depth.push_back(scene.penetrations.pair.empty() ? 0 : scene.penetrations.depth[0]);
        }
        const auto [low, high] = std::ranges::minmax(depth);
        worst = std::max(worst, high - low);
        overlaps += high > 0;
        EXPECT_LE(high - low, kTolerance) << trial << ": " << low << " to " << high;
    }
    EXPECT_GT(overlaps, 12u);
    std::printf("[   figure ] depth of exchanged and moved pairs: at most %.1e apart\n", worst);
}

}  // namespace
}  // namespace trocar::test
