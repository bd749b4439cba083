#include <gtest/gtest.h>

#include <cmath>

#include "engine/jobs/thread_pool.hpp"
#include "systems/frame/frame.hpp"
#include "tests/frame/scenes_under_test.hpp"

// Hard cases that need a whole frame.
namespace {
using namespace trocar;

Keyframe key(double time, double z) {
    Keyframe k;
    k.time = time;
    k.position = Vec3d(0, 0, z);
    return k;
}

// A probe in a scripted hand goes through a wall 1 mm thick; it arrives `late` seconds into a contact pass.
SceneFile wall_scene(double late, double tip_radius) {
    SceneFile scene;
    scene.settings.gravity.setZero();
    BodySpec wall;
    wall.name = "wall";
    wall.shape = "table";
    wall.triangles = 1000;
    wall.size = 0.03;
    BodySpec probe;
    probe.name = "probe";
    probe.shape = "probe";
    probe.triangles = 1000;
    probe.motion = Motion::kHand;
    probe.position = Vec3d(0, 0, 0.04);
    ToolSpec tool;
    tool.body = "probe";
    tool.tool.tip_radius = tip_radius;
    tool.path = {key(0, 0.04), key(0.05 + late, 0.04), key(0.05 + late + 0.12, -0.02), key(1, -0.02)};
    scene.bodies = {wall, probe};
    scene.tools = {tool};
    return scene;
}

// P19. At more than half a metre a second the probe covers twelve times the wall's thickness in a contact
// pass. For any phase of arrival the contact is found and the centre of the tip stays on its side. The tip is
// pushed out again unless its end has passed the middle of the wall, from where the other side is nearer. The
// haptic proxy never enters the wall.
TEST(HardCases, P19_FastToolAgainstAMillimetreWall) {
    ThreadPool pool(1);
    pool.run([] {
        int pushed_out = 0;
        for (int phase = 0; phase < 17; phase += 3) {
            BuiltScene built = build_scene(wall_scene(1e-3 * phase, 0.007), Looks::kPlain);
            Frame frame(std::move(built.world), {});
            const World& w = frame.world();
            const Box wall = w.meshes.info[w.bodies.mesh[0]].box;
            ASSERT_NEAR(wall.max.z() - wall.min.z(), 1e-3, 1e-5);
            double fastest = 0, lowest = 1, previous = 0.04;
            for (int pass = 0; pass < 30; ++pass) {
                frame.step();
                const ToolState& tool = w.haptics.state[0];
                fastest = std::max(fastest, (previous - tool.device.position.z()) / (w.clock.period * 1e-3));
                previous = tool.device.position.z();
                lowest = std::min(lowest, w.poses.origin[1].z());
                EXPECT_GE(tool.proxy.z(), 0.007 + wall.max.z() - 1e-6) << phase;
            }
            EXPECT_GT(fastest, 0.5) << phase;
            EXPECT_GT(lowest, wall.max.z()) << phase << ": the middle of the tip came to the wall";
            if (lowest > 0.007) {
                EXPECT_GT(w.poses.origin[1].z(), 0.007 + wall.max.z() - 5e-5) << phase << ": the tip stays in the wall";
                ++pushed_out;
            }
            EXPECT_GT(w.report.contact_events, 10u) << phase;
            EXPECT_GT(w.haptics.state[0].command.force.z(), 3) << phase;
        }
        EXPECT_GT(pushed_out, 0);
    });
}

}  // namespace
