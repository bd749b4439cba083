#include "systems/haptics/contact/passed_surfaces.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <random>

#include "engine/world/world.hpp"
#include "frame/written_scene.hpp"
#include "systems/haptics/contact/local_contact_model.hpp"

namespace trocar {
namespace {

constexpr double kHalf = 0.05;  // m

// A square sheet of 2 kHalf in the plane z = 0 of its body, of n x n cells.
void write_sheet(const std::filesystem::path& path, int n) {
    std::ofstream file(path);
    for (int i = 0; i <= n; ++i)
        for (int j = 0; j <= n; ++j) file << "v " << kHalf * (2.0 * i / n - 1) << " " << kHalf * (2.0 * j / n - 1) << " 0\n";
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const int a = i * (n + 1) + j + 1, b = a + n + 1;
            file << "f " << a << " " << b << " " << b + 1 << "\nf " << a << " " << b + 1 << " " << a + 1 << "\n";
        }
}

// The model of a pass is made with a sheet and a tool at their places; then both move along straight lines, the sheet without
// turning. Closed form: in the sheet's frame the centre of the tip goes straight through the plane of the sheet, within its border or
// beside it, or it does not.
TEST(PassedSurfaces, AreThoseThatTheTipsWayCrosses) {
    const auto mesh = std::filesystem::temp_directory_path() / ("trocar_passed_" + std::to_string(getpid()) + ".obj");
    write_sheet(mesh, 7);
    const WrittenScene scene("passed", R"(
gravity = [0, 0, 0]
[[body]]
name = "sheet"
file = ")" + mesh.string() + R"("
motion = "deformable"
thickness = 0.001
[[body]]
name = "tool"
shape = "sphere"
triangles = 80
size = 0.004
motion = "hand"
[[tool]]
body = "tool"
tip_radius = 0.002
path = [{time = 0, position = [0, 0, 0]}]
)");
    World world = scene.build().world;
    std::filesystem::remove(mesh);
    std::mt19937 random(7);
    const auto any = [&](double size) { return size * (random() / 2147483648.0 - 1); };
    const std::vector<Float4> rest = world.particles.offset;
    HandTool& tool = world.haptics.tool[0];
    ToolState& state = world.haptics.state[0];
    HapticParams params;
    params.reach_margin = 0.1;
    LocalContactScratch scratch;
    PassedSurfacesScratch passed_scratch;
    size_t through = 0, beside = 0, border = 0;
    for (int i = 0; i < 2000; ++i) {
        tool.tip_radius = i % 2 == 0 ? 0.002 : 5e-5;
        const Vec3d from(any(0.06), any(0.06), any(0.01)), to = from + Vec3d(any(0.02), any(0.02), any(0.02)),
                                                           sheet(any(0.01), any(0.01), any(0.01));
        const Vec3d way = to - from - sheet;
        world.particles.offset = rest;
        world.poses.origin[1] = from;
        state.device.position = from, state.device.velocity = Vec3d::Zero(), state.proxy_valid = false;
        std::vector<LocalContactModel> model(1);
        publish_local_contact(params, surfaces_of(world), {}, tool, state, {1.0, 1, 0.016}, scratch, model[0]);
        for (Float4& o : world.particles.offset)
            o.x += static_cast<float>(sheet.x()), o.y += static_cast<float>(sheet.y()), o.z += static_cast<float>(sheet.z());
        world.poses.origin[1] = to;
        PassedSurfaces passed;
        Report report;
        find_passed_surfaces(1.0, surfaces_of(world), model, world.haptics, passed_scratch, passed, report);

        const double side = from.z() > 0 ? 1 : -1, height = side * from.z(), end = side * (from.z() + way.z());
        const Vec3d at = from + height / (height - end) * way;
        const double inside = kHalf - std::max(std::abs(at.x()), std::abs(at.y()));
        if (end < 0 && std::abs(inside) < 1e-5) continue;  // on the border, where floats decide
        const bool expected = end < 0 && inside > 0;
        EXPECT_EQ(report.passed_surfaces, expected ? 1u : 0u) << i << ", " << inside << " m from the border";
        EXPECT_EQ(passed.body[0], expected ? 0 : kNone);
        EXPECT_EQ(passed.times[0], report.passed_surfaces);
        through += expected, beside += end >= 0, border += end < 0 && inside < 0;
    }
    EXPECT_GT(through, 300u);
    EXPECT_GT(beside, 300u);
    EXPECT_GT(border, 100u);
    // a model of another pass says nothing
    std::vector<LocalContactModel> old(1);
    publish_local_contact({}, surfaces_of(world), {}, tool, state, {0.5, 1, 0.016}, scratch, old[0]);
    PassedSurfaces passed;
    Report report;
    find_passed_surfaces(1.0, surfaces_of(world), old, world.haptics, passed_scratch, passed, report);
    EXPECT_EQ(report.passed_surfaces, 0u);
}

// Balls inside a box of 20 x 4 x 2 mm as its shell gives them: none may be larger than half of its thickness, and their centres
// lie in it.
TEST(PassedSurfaces, CoreOfABoxIsInside) {
    HandTool tool;
    const Vec3d half(0.01, 0.002, 0.001);
    for (int axis = 0; axis < 3; ++axis)
        for (const double side : {-1.0, 1.0})
            for (int i = -20; i <= 20; ++i)
                for (int j = -8; j <= 8; ++j) {
                    ShellPoint& p = tool.point_shell.emplace_back();
                    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
                    p.arm[axis] = side * half[axis], p.arm[u] = half[u] * i / 20, p.arm[v] = half[v] * j / 8;
                    p.inward[axis] = -side;
                }
    std::vector<CoreBall> core;
    find_core(tool, core);
    ASSERT_FALSE(core.empty());
    for (const CoreBall& ball : core) {
        EXPECT_LE(ball.radius, half.z() * 1.05);
        EXPECT_GE(ball.radius, 0.4 * half.z());
        for (int axis = 0; axis < 3; ++axis) EXPECT_LT(std::abs(ball.arm[axis]), half[axis]);
    }
}

}  // namespace
}  // namespace trocar
