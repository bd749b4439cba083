// Shells stepped implicitly under a tool in the hand give what leapfrog gives. Contact is solved inside the
// step: with impulses on single masses between steps contact did 86 J of work where the hand did 6 mJ.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/frame/written_scene.hpp"
namespace {
using namespace trocar;

struct Press {
    double force = 0, hand = 0, elastic = 0, gained = 0, lost = 0, contact = 0;  // N, J
    uint64_t steps = 0;                                                 // implicit
};

Press press(const char* integrator, double modulus, int rate) {
    const std::string scene = R"(
gravity = [0.0, 0.0, 0.0]
[contact]
rate = )" + std::to_string(rate) +
                              R"(
[[body]]
name = "organ"
shape = "box"
size = 0.08
triangles = 600
motion = "deformable"
fixed_below = -0.02
integrator = ")" + integrator +
                              R"("
[body.tissue]
youngs_modulus = )" + std::to_string(modulus) +
                              R"(
damping = 40.0
[[body]]
name = "probe"
shape = "probe"
triangles = 1000
motion = "hand"
position = [0.0, 0.0, 0.07]
[[tool]]
body = "probe"
tip_radius = 0.007
max_force = 3.3
path = [{time = 0.0, position = [0.0, 0.0, 0.052]}, {time = 0.3, position = [0.0, 0.0, 0.039]}, {time = 0.5, position = [0.0, 0.0, 0.039]}]
)";
    Press p;
    run(std::move(WrittenScene("implicit_under_tools", scene).build({}).world), rate / 2, [&](const Frame& f, int) {
        const World& w = f.world();
        for (const ToolState& tool : w.haptics.state) p.force = std::max(p.force, tool.largest_force);
        p.hand = std::max(p.hand, w.energy.work_hand);
        p.elastic = std::max(p.elastic, w.energy.elastic);
        p.contact = std::max(p.contact, std::abs(w.energy.work_contact));
        p.gained = std::max(p.gained, w.energy.work_numeric), p.lost = std::max(p.lost, -w.energy.work_numeric);
        p.steps = w.report.implicit_steps;
        EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u);
    });
    return p;
}

TEST(ImplicitUnderTools, AsLeapfrog) {
    for (const double modulus : {4.1e3, 2.55e5}) {
        for (const int rate : {60, 120}) {
            const Press wanted = press("leapfrog", modulus, rate), found = press("implicit", modulus, rate);
            const std::string what = std::to_string(modulus) + " " + std::to_string(rate);
            EXPECT_GT(wanted.force, 0.05) << what;
            EXPECT_NEAR(found.force, wanted.force, 0.02 * wanted.force) << what;
            EXPECT_LE(found.elastic, 1.01 * found.hand) << what;
            EXPECT_LE(found.contact, 1.2 * wanted.contact + 0.01 * wanted.hand) << what;
            EXPECT_LE(found.gained, 1e-3 * found.hand) << what;
            EXPECT_LE(found.lost, 0.02 * found.hand) << what << ": by backward Euler while the tool moves";
            EXPECT_GE(found.steps, 400u) << what << ": also in contact";
        }
    }
}

}  // namespace
