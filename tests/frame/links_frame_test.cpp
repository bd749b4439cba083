// Links, staples, breaking and cuts in whole scenes: read from files, scripted, stepped by the frame.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstring>
#include <fstream>

#include "engine/error.hpp"
#include "engine/thread_pool.hpp"
#include "systems/frame.hpp"
#include "tests/frame/scenes_under_test.hpp"
namespace {
using namespace trocar;
namespace fs = std::filesystem;

// A scene written down in a test.
struct WrittenScene {
    fs::path path;
    WrittenScene(const std::string& name, const std::string& text) : path(fs::temp_directory_path() / ("trocar_" + name + ".toml")) {
        std::ofstream(path) << text;
    }
    ~WrittenScene() { fs::remove(path); }
    BuiltScene build(const std::vector<Override>& overrides = {}) const { return build_scene(read_scene_file(path, overrides)); }
    std::string error(const std::vector<Override>& overrides = {}) const {
        try {
            build(overrides);
        } catch (const InputError& e) {
            return e.what();
        }
        return "";
    }
};

constexpr const char* kTwoBalls = R"(
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "a"
shape = "sphere"
size = 0.1
triangles = 300
motion = "deformable"
anchor = "shape"
[[body.group]]
name = "top"
sphere = [0.0, 0.0, 0.05, 0.03]
[[body]]
name = "b"
shape = "sphere"
size = 0.1
triangles = 300
motion = "deformable"
anchor = "shape"
position = [0.0, 0.0, 0.102]
[[body]]
name = "c"
shape = "sphere"
size = 0.1
triangles = 300
motion = "deformable"
anchor = "shape"
position = [1.0, 0.0, 0.0]
[[body]]
name = "rod"
shape = "sphere"
size = 0.02
triangles = 100
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.16]
[[body.path]]
time = 1.0
position = [0.0, 0.0, 0.20]
)";

template <typename Look>
void run(World world, int passes, const Look& look, uint32_t threads = 1) {
    ThreadPool pool(threads);
    pool.run([&] {
        Frame frame(std::move(world), {});
        for (int i = 0; i < passes; ++i) {
            frame.step();
            look(frame, i);
        }
    });
}

// Every mistake in a table is one line that names it and its place.
TEST(LinksInScenes, MistakesAreNamed) {
    const auto with = [](const std::string& table) { return WrittenScene("links_bad", kTwoBalls + table); };
    const auto expect = [&](const std::string& table, const std::string& part) {
        const std::string error = with(table).error();
        EXPECT_NE(error.find(part), std::string::npos) << table << "\n-> " << error;
        EXPECT_NE(error.find(".toml:"), std::string::npos) << error;
    };
    expect("[[link]]\nto = \"b\"\n", "a [[link]] needs a body");
    expect("[[link]]\nbody = \"a\"\nto = \"b\"\n", "which nodes?");
    expect("[[link]]\nbody = \"a\"\nto = \"b\"\ngroup = \"bottom\"\n", "body \"a\" has no group \"bottom\"");
    expect("[[link]]\nbody = \"a\"\nto = \"nobody\"\nwithin = 0.01\n", "no body is named \"nobody\"");
    expect("[[link]]\nbody = \"rod\"\nto = \"a\"\nwithin = 0.01\n", "body \"rod\" must be deformable");
    expect("[[link]]\nbody = \"a\"\nto = \"a\"\nwithin = 0.01\n", "cannot be linked to itself");
    expect("[[link]]\nbody = \"a\"\nto = \"b\"\nwithin = 0.01\nframe = \"to\"\n", "only a rigid body has a frame");
    expect("[[link]]\nbody = \"a\"\nto = \"b\"\nwithin = 0.01\nfrom = 2.0\nuntil = 1.0\n", "until must be later");
    expect("[[link]]\nbody = \"a\"\nto = \"rod\"\nwithin = 0.01\ngrip = true\n", "no [[tool]] holds \"rod\"");
    expect("[[link]]\nbody = \"a\"\nto = \"b\"\nwithin = 0.01\nbreak_strian = 0.1\n", "did you mean \"break_strain\"?");
    expect("[[link]]\nbody = \"a\"\nto = \"b\"\nbox = [0, 0, 0, -1, 1, 1]\n", "its first corner must be the lowest");
    expect("[[link]]\nbody = \"a\"\nto = \"b\"\nsphere = [0, 0, 0]\n", "must be a list of 4 numbers");
    expect("[[link]]\nbody = \"a\"\nto = \"b\"\nsphere = [0, 0, 0, 1]\ngroup = \"top\"\n", "a group or a region, not both");
    expect("[[staple]]\nbody = \"a\"\n", "a [[staple]] needs a body and");
    EXPECT_NE(with("").error({{"link.x.from", "1"}}).find("the scene has no link named \"x\""), std::string::npos);
    EXPECT_NE(with("").error({{"a.integrator", "xpbd"}, {"a.break_strain", "0.2"}}).find("springs stepped by xpbd do not break"), std::string::npos);
    EXPECT_EQ(with("").error(), "");
}

// A group of one ball held by the other, a staple at its time, a third ball far away: the scripted times hold, and what is
// linked here does not touch a bit there.
TEST(LinksInScenes, GroupsAndStaplesAtTheirTimes) {
    const WrittenScene plain("links_none", kTwoBalls);
    const WrittenScene linked("links_some", std::string(kTwoBalls) + R"(
[[link]]
name = "hold"
body = "a"
to = "b"
group = "top"
until = 0.5
[[link]]
name = "pull"
body = "b"
to = "rod"
sphere = [0.0, 0.0, 0.0, 0.03]
from = 0.1
[[staple]]
name = "staple"
body = "a"
to = "b"
place = [0.03, 0.0, 0.051]
reach = 0.03
stiffness = 500.0
time = 0.3
)");
    std::vector<float> far_away;
    run(std::move(plain.build().world), 60, [&](const Frame& f, int) {
        const Range c = f.world().bodies.particles[2];
        far_away.assign(&f.world().particles.offset[c.first].x, &f.world().particles.offset[c.first].x + 4 * c.count);
    });
    run(std::move(linked.build().world), 60, [&](const Frame& f, int pass) {
        const World& w = f.world();
        const double begun = pass / 60.0;
        const auto count = [&](int g) { return w.links.group[g].rows.count; };
        if (begun < 0.49) {
            EXPECT_GT(count(0), 5u) << pass;
        } else if (begun > 0.51) {
            EXPECT_EQ(count(0), 0u) << pass;
        }
        EXPECT_EQ(count(1) > 0, pass >= 6) << pass;
        EXPECT_EQ(count(2), begun >= 0.3 ? 1u : 0u) << pass;
        EXPECT_EQ(w.islands.bodies.size(), 2u) << pass << ": a and b are one island, c another";
        if (pass < 59) return;
        EXPECT_GT(w.particles.velocity_z[w.bodies.particles[0].first], 0) << "a hangs on b, and b on the rod";
        EXPECT_EQ(w.links.group[1].name, "pull");
        EXPECT_GT(w.links.group[1].largest_force, 0.01);
        EXPECT_EQ(w.report.links, w.links.node.size());
        EXPECT_EQ(find_fault(w), "");
        const Range c = w.bodies.particles[2];
        EXPECT_EQ(0, std::memcmp(far_away.data(), &w.particles.offset[c.first].x, far_away.size() * sizeof(float)));
    });
}

// The scene of the issue, coarse: the jaws hold, the tissue comes along, nothing grows, and it goes back when released.
TEST(LinksInScenes, JawsGraspPullAndRelease) {
    std::vector<Override> coarse{{"gallbladder.triangles", "1500"}, {"upper_jaw.triangles", "600"}, {"lower_jaw.triangles", "600"}};
    BuiltScene scene = build_scene(read_scene_file(source_folder() / "content/scenes/jaw_grasp.toml", coarse));
    double residual_early = 0, residual_late = 0, work = 0, worst = 0, lifted = 0, back = 0, peak_links = 0;
    const Range rows = scene.world.bodies.particles[0];
    const uint32_t vertices = scene.world.meshes.info[0].vertices.count;
    const std::vector<Float4> start(scene.world.particles.offset.begin() + rows.first, scene.world.particles.offset.begin() + rows.end());
    run(std::move(scene.world), 300, [&](const Frame& f, int pass) {
        const World& w = f.world();
        const double t = pass / 60.0;
        double moved = 0;
        for (uint32_t v = 0; v < vertices; ++v)
            moved = std::max(moved, static_cast<double>(w.particles.offset[rows.first + v].z) - static_cast<double>(start[v].z));
        if (t > 1.4 && t < 1.7) residual_early = std::max(residual_early, w.report.deepest_residual);
        if (t > 3.0 && t < 3.4) residual_late = std::max(residual_late, w.report.deepest_residual), lifted = std::max(lifted, moved);
        if (pass == 299) back = moved;
        work = std::max(work, w.energy.work_hand);
        worst = std::max(worst, std::abs(w.energy.balance));
        peak_links = std::max(peak_links, w.energy.links);
        if (t > 1.45 && t < 3.35) {
            EXPECT_GT(w.report.links, 4u) << pass;
        } else if (t > 3.45) {
            EXPECT_EQ(w.report.links, 0u) << pass;
        }
    });
    std::printf("jaws: work %.4g J, books off by %.2f %%, residual %.3f then %.3f mm, lifted %.1f mm, back to %.2f mm\n", work,
                100 * worst / work, residual_early * 1e3, residual_late * 1e3, lifted * 1e3, back * 1e3);
    EXPECT_LT(worst, 1e-2 * work);
    EXPECT_LE(residual_late, std::max(1.1 * residual_early, 1e-4));
    EXPECT_GT(lifted, 0.01);
    EXPECT_LT(back, 0.002);
    EXPECT_GT(peak_links, 0);
}

}  // namespace
