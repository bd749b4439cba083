// Instruments that grasp: free rigid bodies and tissue, slip, hand-over.
#include <gtest/gtest.h>

#include <cmath>

#include "frame/written_scene.hpp"
namespace trocar {
namespace {

std::string text_of(double v) { return std::to_string(v); }

// A cube of 10 mm in free fall, and a stiff hand above it that holds its top from the start.
std::string held_cube(double mass, double mu, double press, double reach) {
    return R"(
gravity = [0.0, 0.0, -9.81]
[[body]]
name = "cube"
shape = "box"
size = 0.01
motion = "free"
mass = )" + text_of(mass) +
           R"(
[[body]]
name = "pen"
shape = "sphere"
size = 0.002
triangles = 100
motion = "hand"
position = [0.0, 0.0, 0.02]
apart = "cube"
[[tool]]
body = "pen"
tip_radius = 0.001
stiffness = 2000.0
damping = 100.0
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.02]
[[tool.path]]
time = 0.5
position = [0.0, 0.0, 0.02]
[[tool.path]]
time = 1.5
position = [0.0, 0.0, 0.04]
[[tool.action]]
kind = "grasp"
at = [0.0]
point = [0.0, 0.0, -0.015]
reach = )" +
           text_of(reach) + "\nfriction = " + text_of(mu) + "\npress = " + text_of(press) + "\n";
}

// Two jaws bear 2 mu N: a lighter cube hangs, and is lifted; a heavier one slides with g - 2 mu N / m until it is out of reach, and
// the accounting closes. Breaks when the pads bear once or four times mu N, when slip makes no way, or when the work of the
// hand is not accounted.
TEST(ToolGrasp, JawsHoldToMuAndSlipBeyond) {
    const double mu = 0.4, press = 0.5, bears = 2 * mu * press, g = 9.81;
    double slipped = 0;
    run(WrittenScene("held", held_cube(0.95 * bears / g, mu, press, 0.05)).build().world, 120, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        ASSERT_EQ(w.action_state.grasp.size(), 1u);
        if (pass == 20) slipped = w.action_state.grasp[0].slipped;  // while hand and pads took the load
        if (pass < 119) return;
        EXPECT_LT(slipped, 5e-5);
        EXPECT_EQ(w.action_state.grasp[0].slipped, slipped);
        EXPECT_NEAR(w.poses.origin[0].z(), 0.02, 4e-4) << "lifted by 20 mm, on springs of hand and pads";
        EXPECT_NEAR(w.haptics.state[0].link_force.z(), -0.95 * bears, 0.01 * bears) << "the hand feels it";
        std::printf("lifted: balance %.3g of %.3g J, lost %.3g J\n", w.energy.balance, w.energy.work_hand, w.energy.work_contact);
        EXPECT_LT(std::abs(w.energy.balance), 1e-3 * w.energy.work_hand);
        EXPECT_LT(w.energy.work_contact, 1e-6);
    });
    const double mass = 1.2 * bears / g, a = g - bears / mass;
    uint64_t slips = 0;
    double worst = 0, speed = 0;
    run(WrittenScene("slips", held_cube(mass, mu, press, 0.05)).build().world, 30, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        slips = w.action_state.progress[0].slips;
        worst = std::max(worst, std::abs(w.energy.balance));
        if (pass == 5) speed = -w.poses.velocity[0].z();
        if (pass != 11) return;
        const double fallen = 0.5 * a * 0.2 * 0.2;
        ASSERT_EQ(w.action_state.grasp.size(), 1u);
        EXPECT_NEAR(-w.poses.velocity[0].z() - speed, a * 0.1, 0.01 * a * 0.1);
        EXPECT_GT(w.action_state.grasp[0].slipped, fallen) << "the pads took their load late";
        EXPECT_LT(w.action_state.grasp[0].slipped, 1.05 * fallen);
        EXPECT_NEAR(w.action_state.grasp[0].largest_force, bears, 1e-3 * bears);
        EXPECT_LT(worst, 1e-3 * mass * g * fallen);
    });
    EXPECT_EQ(slips, 1u) << "out of reach after 50 mm";
}

// A rod that is held beside its middle turns down between the pads once its torque is more than 4/3 mu N r.
TEST(ToolGrasp, PadsBearATorqueAndTurnBeyond) {
    const double mu = 0.5, press = 10, pad = 1.5e-3, most = 4.0 / 3 * mu * press * pad, g = 9.81;
    const auto turned = [&](double torque) {
        const double mass = torque / (g * 5e-3);
        std::string text = held_cube(mass, mu, press, 2e-3);
        text.replace(text.find("point = [0.0, 0.0, -0.015]"), 26, "point = [0.005, 0.0, -0.020]");  // the middle of a side
        double turned = 0;
        run(WrittenScene("turns", text).build().world, 24, [&](Frame& frame, int) {
            ASSERT_EQ(frame.world().action_state.grasp.size(), 1u);
            turned = frame.world().action_state.grasp[0].turned;
        });
        return turned;
    };
    EXPECT_LT(turned(0.9 * most), 1e-3);
    EXPECT_GT(turned(1.1 * most), 0.01);
}

// Two fingers press a cube by contact alone: it stays up while it weighs less than 2 mu N, with the N that the hands feel.
TEST(ToolGrasp, TwoFingersHoldToMuAndSlipBeyond) {
    const double mu = 0.3;
    const auto fallen = [&](double mass, double& felt) {
        const auto finger = [&](const char* name, double sign) {
            const auto at = [&](double x) { return "position = [" + text_of(sign * x) + ", 0.0, 0.0]\n"; };
            return "[[body]]\nname = \"" + std::string(name) +
                   "\"\nshape = \"sphere\"\nsize = 0.006\ntriangles = 200\nmotion = \"hand\"\n" + at(0.02) + "[[tool]]\nbody = \"" + name +
                   "\"\ntip_radius = 0.003\nfriction = 0.3\n[[tool.path]]\ntime = 0.0\n" + at(0.02) + "[[tool.path]]\ntime = 0.4\n" +
                   at(0.0074);
        };
        const std::string text = R"(
gravity = [0.0, 0.0, -9.81]
[[body]]
name = "cube"
shape = "box"
size = 0.01
motion = "free"
mass = )" + text_of(mass) + R"(
[body.tissue]
friction = 0.3
[[body]]
name = "table"
shape = "box"
size = 0.05
motion = "kinematic"
apart = ["left", "right"]
[[body.path]]
time = 0.0
position = [0.0, 0.0, -0.0301]
[[body.path]]
time = 0.6
position = [0.0, 0.0, -0.0301]
[[body.path]]
time = 0.7
position = [0.0, 0.0, -0.06]
)" + finger("left", -1) + finger("right", 1);
        double z = 0;
        run(WrittenScene("fingers", text).build().world, 54, [&](Frame& frame, int pass) {
            const World& w = frame.world();
            if (pass == 34) felt = w.haptics.state[0].output.force.norm();
            z = w.poses.origin[0].z();
        });
        return -z;
    };
    double felt = 0, none = 0;
    fallen(0.01, felt);  // how hard they press
    EXPECT_NEAR(felt, 0.3, 0.06);
    const double bears = 2 * mu * felt / 9.81;
    EXPECT_LT(fallen(0.9 * bears, none), 5e-4) << "pressed with " << felt << " N";
    EXPECT_GT(fallen(1.1 * bears, none), 5e-3);
}

// One hand holds a cube, a second one takes it over: neither the force of a hand nor their sum jumps beyond 1.05 of the weight.
TEST(ToolGrasp, HandOverWithoutAJump) {
    const double mass = 0.03, weight = mass * 9.81;
    const auto hand = [&](const char* name, double sign, const char* at) {
        const std::string place = "position = [" + text_of(sign * 0.02) + ", 0.0, 0.0]\n";
        return "[[body]]\nname = \"" + std::string(name) + "\"\nshape = \"sphere\"\nsize = 0.002\ntriangles = 100\nmotion = \"hand\"\n" +
               place + "apart = \"cube\"\n[[tool]]\nbody = \"" + name +
               "\"\ntip_radius = 0.001\nstiffness = 1000.0\ndamping = 40.0\n[[tool.path]]\ntime = 0.0\n" + place +
               "[[tool.action]]\nkind = \"grasp\"\nfriction = 0.5\npress = 5.0\npoint = [" + text_of(-sign * 0.015) +
               ", 0.0, 0.0]\nat = " + at + "\n";
    };
    const std::string text =
        "gravity = [0.0, 0.0, -9.81]\n[[body]]\nname = \"cube\"\nshape = \"box\"\nsize = 0.01\nmotion = \"free\"\nmass = " + text_of(mass) +
        "\n" + hand("left", -1, "[0.0, 0.8]") + hand("right", 1, "[0.5]");
    double most_of_one = 0, most_of_both = 0, least_of_both = 10, last = 0;
    run(WrittenScene("hand_over", text).build().world, 90, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        Vec3d sum = Vec3d::Zero();
        for (const ToolGrasp& grasp : w.action_state.grasp) {
            const double force = grasp.impulse.z() / (1e-3 * w.clock.period);
            sum.z() += force;
            most_of_one = std::max(most_of_one, force);
            last = force;
        }
        if (pass < 20) return;
        EXPECT_EQ(w.action_state.grasp.size(), pass < 30 ? 1u : pass < 48 ? 2u : 1u) << pass;
        most_of_both = std::max(most_of_both, sum.z()), least_of_both = std::min(least_of_both, sum.z());
        EXPECT_EQ(w.action_state.progress[0].slips + w.action_state.progress[1].slips, 0u);
    });
    std::printf("weight %.4f N: a hand at most %.4f, both %.4f to %.4f, then %.4f N\n", weight, most_of_one, least_of_both, most_of_both,
                last);
    EXPECT_LT(most_of_one, 1.05 * weight);
    EXPECT_LT(most_of_both, 1.05 * weight);
    EXPECT_NEAR(last, weight, 0.01 * weight);
}

// Tissue between the jaws follows them, and slips out at 2 mu N. The accounting closes.
TEST(ToolGrasp, TissueIsPulledUntilItSlipsOut) {
    const std::string text = R"(
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "ball"
shape = "sphere"
size = 0.04
triangles = 2000
motion = "deformable"
anchor = "world"
[body.tissue]
youngs_modulus = 2e4
damping = 20.0
[[body]]
name = "pen"
shape = "sphere"
size = 0.002
triangles = 100
motion = "hand"
position = [0.0, 0.0, 0.022]
apart = "ball"
[[tool]]
body = "pen"
tip_radius = 0.001
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.022]
[[tool.path]]
time = 0.2
position = [0.0, 0.0, 0.022]
[[tool.path]]
time = 4.2
position = [0.0, 0.0, 0.042]
[[tool.action]]
kind = "grasp"
at = [0.1]
point = [0.0, 0.0, -0.002]
reach = 5e-3
friction = 0.5
press = 0.3
)";
    double slipped_at = 0, worst = 0, entered = 0, held = 0;
    run(WrittenScene("tissue", text).build().world, 240, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const ActionProgress& p = w.action_state.progress[0];
        if (pass == 30) held = static_cast<double>(w.links.node.size());
        if (p.slips == 1 && slipped_at == 0) slipped_at = p.largest_force, entered = w.energy.work_hand;
        worst = std::max(worst, std::abs(w.energy.balance));
        if (pass < 239) return;
        EXPECT_EQ(p.done, 1u);
        EXPECT_EQ(p.slips, 1u);
        EXPECT_TRUE(w.action_state.grasp.empty());
        EXPECT_TRUE(w.links.node.empty());
        EXPECT_EQ(find_fault(w), "");
    });
    std::printf("%g nodes held, slipped out at %.4f N, balance at most %.3g of %.3g J\n", held, slipped_at, worst, entered);
    EXPECT_GT(held, 3);
    EXPECT_GE(slipped_at, 0.3);
    EXPECT_LT(slipped_at, 0.31);
    EXPECT_LT(worst, 1e-3 * entered);
}

TEST(ToolGrasp, SameBitsForThreadsAndWithoutScratch) {
    const WrittenScene scene("grasp_bits", held_cube(0.02, 0.4, 0.5, 2e-3));
    expect_same_bits(scene, 60, [](const Frame& frame) { EXPECT_EQ(frame.world().action_state.progress[0].done, 1u); });
}

TEST(ToolGrasp, MissesAreCountedAndNonsenseRefused) {
    std::string far = held_cube(0.02, 0.4, 0.5, 2e-3);
    far.replace(far.find("point = [0.0, 0.0, -0.015]"), 26, "point = [0.0, 0.02, -0.01]");
    run(WrittenScene("miss", far).build().world, 2, [&](Frame& frame, int) {
        EXPECT_EQ(frame.world().action_state.progress[0].misfires, 1u);
        EXPECT_TRUE(frame.world().action_state.grasp.empty());
    });
    const auto complains = [&](double mu, double press, const std::string& about) {
        const std::string error = WrittenScene("nonsense", held_cube(0.02, mu, press, 2e-3)).error();
        EXPECT_NE(error.find(about), std::string::npos) << error;
        EXPECT_NE(error.find(".toml:"), std::string::npos) << error;
    };
    complains(0, 0.5, "friction");
    complains(0.4, 0, "press");
}

}  // namespace
}  // namespace trocar
