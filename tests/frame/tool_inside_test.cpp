#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "engine/mesh/contact_kernels.hpp"
#include "frame/written_scene.hpp"
#include "systems/haptics/contact/push_out.hpp"

// Tools that start inside a body, and what reaches a device whose tool wants more than it gives.
namespace trocar {
namespace {

std::string organ_and_tool(const std::string& shape, const std::string& tool, int dof, const Vec3d& at, double size, bool solid) {
    char text[1600];
    std::snprintf(text, sizeof text, R"(
gravity = [0, 0, 0]
[[body]]
name = "organ"
shape = "%s"
triangles = 2000
motion = "deformable"
fixed_below = -0.02
%s
[body.tissue]
youngs_modulus = 5000
damping = 60
[[body]]
name = "tool"
shape = "%s"
triangles = 400
motion = "hand"
mass = 0.05
position = [%.9f, %.9f, %.9f]
size = %.4f
[[tool]]
body = "tool"
dof = %d
stiffness = 500
max_force = 3.3
path = [{time = 0, position = [%.9f, %.9f, %.9f]}]
)",
                  shape.c_str(), solid ? "model = \"solid\"\nspacing = 0.015" : "", tool.c_str(), at.x(), at.y(), at.z(), size, dof, at.x(),
                  at.y(), at.z());
    return text;
}

struct Stay {
    double first_out = -1;                    // s, when the tool was outside
    double steepest = 0;                      // N, largest change of the force in a pass while it was pushed
    double fastest = 0;                       // m, largest step of the tool in a pass while it was pushed
    double most = 0;                          // N
    double tissue_inside = 0;                 // N, on the tool while it was inside
    Vec3d felt = Vec3d::Zero(), tissue = {};  // N, at the end
    uint64_t found = 0;
};

Stay stay_inside(const std::string& name, const std::string& text, double seconds) {
    Stay stay;
    const WrittenScene scene(name, text);
    Vec3d before = Vec3d::Zero();
    double force_before = 0;
    const int passes = static_cast<int>(seconds * 60);
    run(scene.build().world, passes, [&](const Frame& frame, int pass) {
        const World& w = frame.world();
        const ToolState& state = w.haptics.state[0];
        const double force = state.output.force.norm(), impulse = state.contact_impulse.norm() * 60;
        const Vec3d place = w.poses.origin[1];
        if (state.exit.body != kNone) {
            if (pass > 0) stay.fastest = std::max(stay.fastest, (place - before).norm());
            stay.steepest = std::max(stay.steepest, std::abs(force - force_before));
            stay.tissue_inside = std::max(stay.tissue_inside, impulse);
        } else if (stay.first_out < 0) {
            stay.first_out = static_cast<double>(w.clock.tick) * 1e-3;
        }
        stay.most = std::max(stay.most, force);
        before = place, force_before = force;
        stay.felt = state.output.force, stay.tissue = state.contact_impulse * 60;
        stay.found = w.report.tools_inside;
    });
    return stay;
}

// Twenty-four random places inside organs, shells and solids, 3 and 6 degrees of freedom: let go at once, out at the speed of
// push_out.hpp, the force never steeper than stiffness times that speed; then contact as always: what the hand
// feels is what the tissue does.
TEST(ToolInside, IsPushedOutGentlyThenTouches) {
    std::mt19937 random(44);
    std::uniform_real_distribution<double> any(-1, 1);
    for (int i = 0; i < 12; ++i) {  // each kind with each other one
        const int dof = i % 2 == 0 ? 3 : 6;
        const bool sphere = i % 3 != 0, solid = i % 4 >= 2;
        const Vec3d at(0.015 * any(random), 0.01 * any(random), 0.012 * any(random));
        const Stay stay = stay_inside("inside" + std::to_string(i),
                                      organ_and_tool("liver", sphere ? "sphere" : "box", dof, at, 0.012 + 0.004 * any(random), solid), 2.0);
        SCOPED_TRACE(std::to_string(i) + (dof == 3 ? ", 3" : ", 6") + (sphere ? " sphere" : " box") +
                     (solid ? " in a solid" : " in a shell"));
        EXPECT_EQ(stay.found, 1);
        EXPECT_GT(stay.first_out, 0);
        EXPECT_LT(stay.first_out, 1.5);
        EXPECT_EQ(stay.tissue_inside, 0);
        EXPECT_LT(stay.fastest, 1.8 * kPushOutSpeed / 60);  // the coupling overshoots as it starts
        EXPECT_LT(stay.steepest, 1.3 * 500 * kPushOutSpeed / 60);
        EXPECT_LE(stay.most, 3.3);
        EXPECT_GT(stay.felt.norm(), 0.02);  // little by a box, which three degrees of freedom feel as a ball
        EXPECT_GT(stay.tissue.norm(), 0.1);
    }
}

// The way out is the shortest: of a box it is through the nearest face.
TEST(ToolInside, LeavesByTheShortestWay) {
    for (const int dof : {3, 6})
        for (const double z : {0.02, -0.02, 0.01}) {
            const WrittenScene scene("shortest", organ_and_tool("box", "sphere", dof, {0.002, 0.001, z}, 0.01, false));
            run(scene.build({{"organ.size", "0.08"}}).world, 2, [&](const Frame& frame, int) {
                const ToolExit& exit = frame.world().haptics.state[0].exit;
                ASSERT_EQ(exit.body, 0);
                EXPECT_GT(exit.direction.z() * (z > 0 ? 1 : -1), 0.999) << z;
                EXPECT_NEAR(exit.goal.norm(), 0.04 - std::abs(z) + 0.005, 1.3e-3);  // clear of the face, and a pass of lag
            });
        }
}

// The body that lets a tool go is the other one, also where the deepest point is one of the tissue inside the tool. Breaks when that
// point's other body, the tool, is taken.
TEST(ToolInside, IsInsideTheOtherBody) {
    for (const int dof : {3, 6})
        for (const double size : {0.012, 0.04, 0.06})
            for (const char* tool : {"sphere", "box"}) {
                const WrittenScene scene("other", organ_and_tool("box", tool, dof, {0.002, 0.001, 0.003}, size, false));
                run(scene.build({{"organ.size", "0.02"}}).world, 1, [&](const Frame& frame, int) {
                    EXPECT_EQ(frame.world().haptics.state[0].exit.body, 0u) << tool << " of " << size << " m";
                });
            }
}

// Nothing above the cap is sent; what was wanted is kept apart.
TEST(ToolInside, SentAndWantedForcesAreReportedApart) {
    for (const int dof : {3, 6}) {
        std::string text = organ_and_tool("liver", "sphere", dof, {0, 0, 0.08}, 0.014, false);
        text.replace(
            text.find("path ="), std::string::npos,
            "path = [{time = 0, position = [0, 0, 0.08]}, {time = 0.1, position = [0, 0, 0.03]}, {time = 0.2, position = [0, 0, 0.05]}, "
            "{time = 0.3, position = [0, 0, 0.005]}]\n");
        const WrittenScene scene("cap", text);
        double most = 0;
        run(scene.build().world, 30, [&](const Frame& frame, int) {
            const Haptics& h = frame.world().haptics;
            most = std::max(most, h.state[0].output.force.norm());
            EXPECT_LE(h.max_force, 3.3);
            EXPECT_LE(most, h.max_force);
            EXPECT_GE(h.max_force_wanted, h.max_force);
        });
        EXPECT_GT(most, 3.2);
    }
}

}  // namespace
}  // namespace trocar
