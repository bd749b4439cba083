// Links, staples, breaking and cuts in whole scenes: read from files, scripted, stepped by the frame.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstring>
#include <fstream>

#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "systems/advance/tissue/fine_steps.hpp"
#include "systems/frame/frame.hpp"
#include "systems/prepare/tear_bodies.hpp"
#include "tests/frame/scenes_under_test.hpp"
#include "tests/frame/written_scene.hpp"
namespace {
using namespace trocar;
namespace fs = std::filesystem;

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

// Every mistake in a table gives a one-line error with its position.
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
    EXPECT_EQ(with("").error(), "");
}

// A group of one ball held by another, a staple at its time, a third ball far away: the scripted times are
// exact, and the links do not change a bit of the third ball.
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
        const auto count = [&](int g) { return w.links.group[g].links.count; };
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

// The grasping scene with coarse meshes: the jaws hold, the tissue follows, the energy does not grow, and the
// tissue returns when released.
TEST(LinksInScenes, JawsGraspPullAndRelease) {
    std::vector<Override> coarse{{"gallbladder.triangles", "3000"}, {"upper_jaw.triangles", "600"}, {"lower_jaw.triangles", "600"}};
    BuiltScene scene = build_scene(read_scene_file(source_folder() / "content/scenes/jaw_grasp.toml", coarse), Looks::kPlain);
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
    EXPECT_LT(worst, 5e-3 * work);
    EXPECT_LE(residual_late, std::max(1.1 * residual_early, 1e-4));
    EXPECT_GT(lifted, 0.01);
    EXPECT_LT(back, 0.002);
    EXPECT_GT(peak_links, 0);
}

// Links pull tissue onto the jaws while contact impulses and position correction separate them, in every
// substep: their work against the links is in the energy accounting for every integrator.
TEST(LinksInScenes, BooksOfJawsWhoeverSteps) {
    for (const char* integrator : {"leapfrog", "implicit"}) {
        const std::vector<Override> set{{"gallbladder.triangles", "1500"},
                                        {"upper_jaw.triangles", "600"},
                                        {"lower_jaw.triangles", "600"},
                                        {"gallbladder.integrator", integrator}};
        double work = 0, worst = 0;
        run(std::move(build_scene(read_scene_file(source_folder() / "content/scenes/jaw_grasp.toml", set), Looks::kPlain).world), 150,
            [&](const Frame& f, int) {
                work = std::max(work, f.world().energy.work_hand);
                worst = std::max(worst, std::abs(f.world().energy.balance));
            });
        std::printf("jaws, %s: work %.4g J, books off by %.3f %%\n", integrator, work, 100 * worst / work);
        EXPECT_GT(work, 5e-3);
        EXPECT_LT(worst, 5e-3 * work);
    }
}

// A tool above tissue holds a patch of it by links, pulls and stands still: the force commanded to the hand
// equals the reaction of the tissue's anchors and fixed nodes, computed from positions alone. After release
// the force is zero.
TEST(LinksInScenes, TheDeviceFeelsTheLinkItPulls) {
    const WrittenScene scene("links_felt", R"(
gravity = [0.0, 0.0, 0.0]
sleep_speed = 0.0
[[body]]
name = "a"
shape = "sphere"
size = 0.1
triangles = 300
motion = "deformable"
[body.tissue]
damping = 60.0
[[body]]
name = "probe"
shape = "sphere"
size = 0.008
triangles = 100
motion = "hand"
position = [0.0, 0.0, 0.06]
[[tool]]
body = "probe"
tip_radius = 0.004
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.06]
[[tool.path]]
time = 0.3
position = [0.0, 0.0, 0.06]
[[tool.path]]
time = 0.7
position = [0.002, 0.0, 0.064]
[[link]]
body = "a"
to = "probe"
sphere = [0.0, 0.0, -0.01, 0.015]
from = 0.2
until = 1.6
)");
    double largest_step = 0;
    Vec3d last = Vec3d::Zero();
    run(std::move(scene.build().world), 132, [&](const Frame& f, int pass) {
        const World& w = f.world();
        const ToolState& tool = w.haptics.state[0];
        const double t = (pass + 1) / 60.0;
        largest_step = std::max(largest_step, (tool.output.force - last).norm());
        last = tool.output.force;
        EXPECT_EQ(tool.contacts, 0u) << "only the links act";
        EXPECT_TRUE(t >= 0.2 || tool.output.force.norm() == 0) << t;
        if (t > 1.4 && t < 1.6) {
            Vec3d tissue = Vec3d::Zero();  // of the anchors, on the tissue
            for (uint32_t p = w.bodies.particles[0].first; p < w.bodies.particles[0].end(); ++p) {
                const Float4& o = w.particles.offset[p];
                tissue += w.anchors.stiffness[p] * Vec3d(w.anchors.rest_x[p] - o.x, w.anchors.rest_y[p] - o.y, w.anchors.rest_z[p] - o.z);
            }
            EXPECT_GT(tissue.norm(), 0.05);
            EXPECT_LT((tool.output.force - tissue).norm(), 0.01 * tissue.norm()) << t;
            EXPECT_LT(tool.output.force.z(), -0.05) << "the hand is pulled back to the tissue";
        }
        EXPECT_TRUE(t < 1.75 || tool.output.force.norm() == 0) << t;
    });
    EXPECT_LT(largest_step, 0.4) << "no jerk where it holds and lets go";
}

// Surgical mesh on a coarser shell comes to rest on a table with thousands of contacts at once. Breaks when
// contact constraints between an embedded surface and static planes become wide constraints, which support
// only particles (segmentation fault).
TEST(CagedShellsInScenes, ASheetLiesDownOnATable) {
    const WrittenScene scene("caged_sheet", R"(
[[body]]
name = "table"
shape = "table"
size = 0.3
triangles = 800
position = [0.0, 0.0, -0.005]
[[body]]
name = "mesh"
shape = "surgical_mesh"
triangles = 4000
motion = "deformable"
anchor = "shape"
position = [0.0, 0.0, 0.0007]
skin = true
[body.tissue]
preset = "polypropylene_mesh"
youngs_modulus = 1e5
bending = 0.0
)");
    size_t most = 0;
    run(scene.build().world, 6, [&](const Frame& f, int) {
        most = std::max(most, f.world().contacts.distance.size());
        EXPECT_EQ(f.world().report.nonfinite_particles + f.world().report.runaway_bodies, 0u);
        EXPECT_LT(f.world().report.deepest_residual, 1e-4);
    });
    EXPECT_GT(most, 2048u) << "so many go into blocks beside a static body";
}

// A shell with an embedded surface in a scene: its notes are printed, a rod presses the fine surface, and
// unsupported options are rejected.
TEST(CagedShellsInScenes, PressedAndRefused) {
    const std::string scene = R"(
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "a"
shape = "sphere"
size = 0.1
triangles = 3000
motion = "deformable"
skin = true
cells = 8
[body.tissue]
damping = 20.0
[[body]]
name = "rod"
shape = "sphere"
size = 0.03
triangles = 200
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.07]
[[body.path]]
time = 0.5
position = [0.0, 0.0, 0.06]
)";
    for (const char* keeps : {"0", "1e5"}) {
        BuiltScene built = WrittenScene("caged", scene).build({{"a.tissue.pressure_modulus", keeps}, {"a.tissue.bending", keeps}});
        EXPECT_NE(built.notes[0].find("times that of the skin itself"), std::string::npos) << built.notes[0];
        EXPECT_EQ(find_fault(built.world), "");
        run(std::move(built.world), 60, [&](const Frame& f, int pass) {
            const World& w = f.world();
            EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u);
            if (pass < 59) return;
            EXPECT_GT(w.report.contact_events, 5u);
            EXPECT_LT(w.report.deepest_residual, 2e-4);
            float top = 0;  // the embedded surface under the rod, 5 mm deep
            for (uint32_t v = 0; v < w.meshes.info[0].vertices.count; ++v) {
                if (w.meshes.position[v].head<2>().norm() < 2e-3) top = std::max(top, w.particles.offset[v].z);
            }
            EXPECT_NEAR(top, 0.045, 1e-3);
            EXPECT_LT(std::abs(w.energy.balance), 0.02 * w.energy.work_hand);
            EXPECT_EQ(find_fault(w), "");
        });
    }
    const auto error = [&](const std::string& table, const std::vector<Override>& o = {}) {
        return WrittenScene("caged_bad", scene + table).error(o);
    };
    EXPECT_NE(error("", {{"a.tissue.pressure_modulus", "1e4"}, {"a.model", "solid"}}).find("are for shells, not for solids"),
              std::string::npos);
    EXPECT_NE(error("[[cut]]\nbody = \"a\"\nsphere = [0, 0, 0.05, 0.01]\n").find("is not cut and does not break"), std::string::npos);
    EXPECT_NE(error("", {{"a.cells", "200"}}).find("take wider cells"), std::string::npos);
    EXPECT_EQ(error("", {{"a.integrator", "implicit"}}), "");
}

// The energy accounting closes to 1 % of the work done while shells break, for every integrator. A ball fixed
// at its lower end is pulled up by a rod until its springs tear, its links break at different lengths, or a
// cut goes through stretched tissue while a staple holds. The energy of broken elements must be removed; the
// links' own test has a closed form.
TEST(Breaking, BooksOfPulledShells) {
    const std::string ball = R"(
gravity = [0.0, 0.0, 0.0]
sleep_speed = 0.0
[[body]]
name = "ball"
shape = "sphere"
size = 0.1
triangles = 1500
motion = "deformable"
fixed_below = -0.03
[body.tissue]
youngs_modulus = 5e3
damping = 10.0
depth = 4.0
[[body]]
name = "rod"
shape = "sphere"
size = 0.02
triangles = 100
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.12]
[[body.path]]
time = 1.0
position = [0.0, 0.0, 0.16]
)";
    const std::string hold = "[[link]]\nbody = \"ball\"\nto = \"rod\"\nsphere = [0.0, 0.0, 0.05, 0.03]\nframe = \"rest\"\n";
    const struct {
        const char* name;
        std::string more;
        std::vector<Override> set;
    } cases[] = {{"tears", hold, {{"ball.break_strain", "0.2"}}},
                 {"links break", hold + "break_strain = 0.05\nstiffness = 200.0\n", {}},
                 {"cut and stapled",
                  hold + R"(
[[cut]]
body = "ball"
box = [-0.1, -0.1, 0.01, 0.0, 0.1, 0.04]
time = 0.5
[[staple]]
body = "ball"
to = "rod"
place = [0.0, 0.0, 0.1]
reach = 0.1
stiffness = 50.0
time = 0.4
)",
                  {}}};
    for (const auto& c : cases) {
        for (const char* integrator : {"leapfrog", "implicit"}) {
            SCOPED_TRACE(std::string(c.name) + ", " + integrator);
            std::vector<Override> set = c.set;
            set.push_back({"ball.integrator", integrator});
            double peak = 0, worst = 0;
            uint64_t gone = 0;
            run(std::move(WrittenScene("pulled_shell", ball + c.more).build(set).world), 75, [&](const Frame& f, int) {
                const World& w = f.world();
                peak = std::max(peak, std::abs(w.energy.work_hand));
                worst = std::max(worst, std::abs(w.energy.balance));
                gone = w.report.broken_springs + w.report.broken_links;
                EXPECT_EQ(w.report.nonfinite_particles + w.report.runaway_bodies, 0u);
            });
            std::printf("shell, %s, %s: %llu springs and links gone, work %.4g J, books off by %.3f %%\n", c.name, integrator,
                        static_cast<unsigned long long>(gone), peak, 100 * worst / peak);
            EXPECT_GT(gone, 10u);
            EXPECT_LT(worst, 1e-2 * peak);
        }
    }
}

// Tissue that tears out of closed jaws springs back over them, is caught between their teeth and folds: position correction does less
// than a fifth of the jaws' work. Breaks without find_tangled_nodes (1.8 J, where the jaws do 0.17 J), and without halved steps in passes
// in which the shell folds: the accounting is off by 17 %.
TEST(Breaking, BooksOfWhatJawsLoseLong) {
    const std::vector<Override> set{{"link.upper.break_strain", "0.2"}, {"link.lower.break_strain", "0.2"}};
    double peak = 0, worst = 0, push = 0, hand = 0;
    run(std::move(build_scene(read_scene_file(source_folder() / "content/scenes/jaw_grasp.toml", set), Looks::kPlain).world), 300,
        [&](const Frame& f, int) {
            const Energy& e = f.world().energy;
            peak = std::max(peak, e.elastic), worst = std::max(worst, std::abs(e.balance));
            hand = std::max(hand, e.work_hand), push = std::max(push, e.work_push - 0.2 * hand);
        });
    std::printf("lost by jaws: held %.4g J, books off by %.3f %%, corrections at most %.3g J above a fifth of the work of the jaws\n", peak,
                100 * worst / peak, push);
    EXPECT_LT(worst, 1e-2 * peak);
    EXPECT_LE(push, 0);
}

// Two masses pass each other at just below and just above a twentieth of their spring's rest length per step.
TEST(Breaking, MoreStepsWhereShellsFold) {
    World w = build_scene(read_scene_file(source_folder() / "content/scenes/jaw_grasp.toml", {}), Looks::kPlain).world;
    const uint32_t body = 0;
    const AdvanceInputs in{w.meshes, w.springs, w.bodies, w.anchors, w.paths, w.haptics.tool, {}, 2, {}};
    const Range rows = w.bodies.particles[body];
    const double dt = 2e-4;
    AdvanceScratch scratch;
    const auto steps = [&] { return finer_steps(in, w.particles, std::span(&body, 1), dt, 1.0 / 60, scratch); };
    EXPECT_EQ(steps(), 1u);
    std::fill_n(w.particles.velocity_x.begin() + rows.first, rows.count, 10.0f);  // uniform
    EXPECT_EQ(steps(), 1u);
    const size_t first = size_t{w.springs.slice_column[w.springs.info[0].slices.first]} * 16;  // the first springs of vertex 0
    double shortest = 1e9;
    for (size_t c = first; c < size_t{w.springs.slice_column[w.springs.info[0].slices.first + 1]} * 16; c += 16) {
        if (w.springs.neighbour[c] != 0) shortest = std::min<double>(shortest, static_cast<double>(w.springs.rest_length[c]));
    }
    const double limit = 0.05 * shortest / dt;
    w.particles.velocity_x[rows.first] = static_cast<float>(10 + 0.99 * limit);
    EXPECT_EQ(steps(), 1u);
    w.particles.velocity_x[rows.first] = static_cast<float>(10 + 1.01 * limit);
    EXPECT_EQ(steps(), 2u);
}

constexpr const char* kCutScene = R"(
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "a"
shape = "sphere"
size = 0.1
triangles = 600
motion = "deformable"
[[body]]
name = "b"
shape = "sphere"
size = 0.1
triangles = 600
motion = "deformable"
position = [0.3, 0.0, 0.0]
[[body]]
name = "rod"
shape = "sphere"
size = 0.03
triangles = 200
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.08]
[[body.path]]
time = 1.0
position = [0.0, 0.0, 0.03]
[[body]]
name = "press"
shape = "sphere"
size = 0.03
triangles = 200
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.3, 0.0, 0.08]
[[body.path]]
time = 1.0
position = [0.3, 0.0, 0.055]
)";
constexpr const char* kCutTables = R"(
[[cut]]
name = "hole"
body = "a"
sphere = [0.0, 0.0, 0.05, 0.03]
time = 0.2
)";

// The bytes in a body's range of an array.
std::string bytes_of(const World& w, uint32_t body) {
    const Range p = w.bodies.particles[body];
    std::string out(reinterpret_cast<const char*>(&w.particles.offset[p.first]), p.count * sizeof(Float4));
    out.append(reinterpret_cast<const char*>(&w.particles.velocity_z[p.first]), p.count * sizeof(float));
    const MeshInfo& info = w.meshes.info[w.bodies.mesh[body]];
    out.append(reinterpret_cast<const char*>(&w.meshes.triangle[info.triangles.first]), info.triangles.count * sizeof(Triangle));
    out.append(reinterpret_cast<const char*>(&w.meshes.neighbour[info.triangles.first]), info.triangles.count * sizeof(Triangle));
    return out;
}

// A hole is cut into a closed body while a rod presses it, without rebuilding the world. The body is judged
// anew with a note, its tables equal those of a mesh made without these triangles, contact continues, and
// another body pressed by another rod does not change by a bit. The same for any number of threads.
void expect_a_hole_in_one(const std::string& integrator) {
    const std::vector<Override> stepped{{"a.integrator", integrator}};
    const WrittenScene whole("cut_none", kCutScene), cut("cut_hole", std::string(kCutScene) + kCutTables);
    std::string other, torn[2];
    run(std::move(whole.build(stepped).world), 60, [&](const Frame& f, int pass) {
        if (pass == 59) other = bytes_of(f.world(), 1);
    });
    for (const uint32_t threads : {1u, 3u}) {
        uint32_t contacts = 0;
        run(
            std::move(cut.build(stepped).world), 60,
            [&](const Frame& f, int pass) {
                const World& w = f.world();
                const MeshInfo& info = w.meshes.info[w.bodies.mesh[0]];
                const double begun = pass / 60.0;
                EXPECT_EQ(info.admission, begun < 0.2 ? Admission::kSolid : Admission::kWinding) << pass;
                EXPECT_EQ(w.report.opened_bodies, begun < 0.2 ? 0u : 1u);
                if (pass < 59) return;
                EXPECT_EQ(find_fault(w), "");
                EXPECT_EQ(bytes_of(w, 1), other) << "the other body and its mesh";
                torn[threads == 3] = bytes_of(w, 0);
                const uint32_t removed = static_cast<uint32_t>(w.report.removed_triangles);
                EXPECT_GT(removed, 20u);
                EXPECT_LT(removed, 150u);
                EXPECT_EQ(info.triangles.count + removed, w.tears.body[0].order.count);
                EXPECT_GT(w.report.broken_springs, removed);
                EXPECT_EQ(w.report.nonfinite_particles, 0u);
                for (uint32_t t = info.triangles.first; t < info.triangles.end(); ++t) {
                    Vec3d middle = Vec3d::Zero();
                    for (const uint32_t v : w.meshes.triangle[t]) middle += w.meshes.position[info.vertices.first + v] / 3;
                    EXPECT_GT((middle - Vec3d(0, 0, 0.05)).norm(), 0.03);
                }
                // compare the tables with a mesh that never had the removed triangles
                Mesh mesh;
                mesh.position.assign(w.meshes.position.begin() + info.vertices.first, w.meshes.position.begin() + info.vertices.end());
                mesh.triangle.assign(w.meshes.triangle.begin() + info.triangles.first, w.meshes.triangle.begin() + info.triangles.end());
                Meshes made;
                add_prototype(made, mesh, Admission::kWinding);
                EXPECT_EQ(made.info[0].edges.count, info.edges.count);
                EXPECT_TRUE(std::equal(made.neighbour.begin(), made.neighbour.end(), w.meshes.neighbour.begin() + info.triangles.first));
                EXPECT_TRUE(std::equal(made.edge.begin(), made.edge.end(), w.meshes.edge.begin() + info.edges.first));
                // every remaining spring has a triangle
                uint32_t left = 0;
                for (size_t h = 0; h < w.torn_springs.neighbour.size(); ++h) left += w.torn_springs.rest_length[h] > 0;
                EXPECT_EQ(left, 2 * info.edges.count);
                // the picture lists the removed triangles
                EXPECT_EQ(w.picture.removed.size(), removed);
                contacts = static_cast<uint32_t>(w.report.contact_events);
            },
            threads);
        EXPECT_GT(contacts, 10u);
    }
    EXPECT_EQ(torn[0], torn[1]);
}
TEST(Cuts, AHoleInOneBodyLeavesAllOthersAlone) {
    for (const char* integrator : {"leapfrog", "implicit"}) expect_a_hole_in_one(integrator);
}

// The removed triangles are part of the state: a world restored to before the cut has its triangles again and
// repeats bit for bit.
TEST(Cuts, AStateSetBackHasItsTrianglesAgain) {
    const WrittenScene cut("cut_back", std::string(kCutScene) + kCutTables);
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(cut.build().world), {});
        World& w = frame.world();
        const Clock clock = w.clock;
        const Poses poses = w.poses;
        const Particles particles = w.particles;
        const Torn torn = w.torn;
        const Sleep sleep = w.sleep;
        const auto mesh = bytes_of(w, 0);
        for (int i = 0; i < 30; ++i) frame.step();
        const uint64_t first = state_hash(w);
        EXPECT_GT(w.report.removed_triangles, 0u);
        w.clock = clock, w.poses = poses, w.particles = particles, w.torn = torn, w.sleep = sleep;
        frame.step();
        EXPECT_EQ(w.meshes.info[w.bodies.mesh[0]].triangles.count, w.tears.body[0].order.count);
        EXPECT_EQ(w.meshes.info[w.bodies.mesh[0]].admission, Admission::kSolid);
        EXPECT_EQ(w.report.removed_triangles, 0u);
        for (int i = 1; i < 30; ++i) frame.step();
        EXPECT_EQ(state_hash(w), first);
    });
}

// Removal by index while the scene runs: triangles one by one, repeated ones and invalid ones; the last
// triangle cannot be removed.
TEST(Cuts, TrianglesByNumberUntilTheLast) {
    BuiltScene scene = WrittenScene("cut_all", std::string(kCutScene) + "[[cut]]\nbody = \"a\"\nsphere = [9, 9, 9, 0.1]\n").build();
    ThreadPool pool(1);
    pool.run([&] {
        Frame frame(std::move(scene.world), {});
        World& w = frame.world();
        const uint32_t all = w.tears.body[0].order.count;
        for (uint32_t first = 0; first < all + 100; first += 97) {
            std::vector<uint32_t> some;
            for (uint32_t t = first; t < first + 97; ++t) some.insert(some.end(), {t, t, t + 100000});
            remove_triangles(w.tears, 0, some, w.torn);
            for (int i = 0; i < 3; ++i) frame.step();
            EXPECT_EQ(find_fault(w), "") << first;
            EXPECT_EQ(w.report.nonfinite_particles, 0u);
        }
        EXPECT_EQ(w.meshes.info[w.bodies.mesh[0]].triangles.count, 1u);
        EXPECT_EQ(w.report.removed_triangles, all - 1);
        for (int i = 0; i < 30; ++i) frame.step();
    });
}

TEST(Cuts, MistakesAreNamed) {
    const auto error = [](const std::string& table, const std::vector<Override>& overrides = {}) {
        return WrittenScene("cut_bad", kCutScene + table).error(overrides);
    };
    EXPECT_NE(error("[[cut]]\nsphere = [0, 0, 0, 1]\n").find("a [[cut]] needs a body"), std::string::npos);
    EXPECT_NE(error("[[cut]]\nbody = \"a\"\n").find("give one of sphere, box, capsule and group"), std::string::npos);
    EXPECT_NE(error("[[cut]]\nbody = \"rod\"\nsphere = [0, 0, 0, 1]\n").find("only deformable bodies can be cut"), std::string::npos);
    EXPECT_NE(error("[[cut]]\nbody = \"c\"\nsphere = [0, 0, 0, 1]\n").find("no body is named \"c\""), std::string::npos);
    EXPECT_EQ(error("[[cut]]\nbody = \"a\"\nsphere = [0, 0, 0.05, 0.01]\n", {{"a.model", "solid"}}), "");
    EXPECT_NE(error("[[cut]]\nbody = \"a\"\nsphere = [0, 0, 0, 1]\n", {{"a.tissue.bending", "1e4"}}).find("cannot keep its volume or bend"),
              std::string::npos);
}

// Regions in a scene: a sphere, a group and a painted field that describe the same part give the same values;
// mistakes are named.
TEST(RegionsInScenes, SphereGroupAndPaintedFieldAgree) {
    const std::string head = "[[body]]\nname = \"a\"\nshape = \"sphere\"\nsize = 0.1\ntriangles = 400\nmotion = \"deformable\"\n";
    const BuiltScene sphere =
        WrittenScene("regions_1", head + "[[body.region]]\nsphere = [0, 0, 0.05, 0.04]\nstiffness = 5\ndensity = 2\n").build();
    const BuiltScene group = WrittenScene("regions_2", head +
                                                           "[[body.group]]\nname = \"cap\"\nsphere = [0, 0, 0.05, "
                                                           "0.04]\n[[body.region]]\ngroup = \"cap\"\nstiffness = 5\ndensity = 2\n")
                                 .build();
    EXPECT_EQ(sphere.world.springs.factor, group.world.springs.factor);
    EXPECT_EQ(sphere.world.bodies.stable_dt, group.world.bodies.stable_dt);
    ASSERT_EQ(sphere.world.springs.factor.size(), sphere.world.springs.neighbour.size());
    EXPECT_EQ(*std::max_element(sphere.world.springs.factor.begin(), sphere.world.springs.factor.end()), 5.0f);
    EXPECT_EQ(*std::min_element(sphere.world.springs.factor.begin(), sphere.world.springs.factor.end()), 1.0f);
    EXPECT_EQ(find_fault(sphere.world), "");
    const MeshInfo& info = sphere.world.meshes.info[0];
    const fs::path ply = fs::temp_directory_path() / "trocar_region.ply";
    {
        std::ofstream out(ply);
        out.precision(17);
        out << "ply\nformat ascii 1.0\nelement vertex " << info.vertices.count
            << "\nproperty double x\nproperty double y\nproperty double z\nproperty float stiffness\nelement face 1\nproperty list uchar "
               "int "
               "vertex_indices\nend_header\n";
        for (uint32_t v = 0; v < info.vertices.count; ++v) {
            const Vec3d& p = sphere.world.meshes.position[v];
            out << p.x() << ' ' << p.y() << ' ' << p.z() << ' ' << ((p - Vec3d(0, 0, 0.05)).norm() <= 0.04 ? 5 : 1) << '\n';
        }
        out << "3 0 1 2\n";
    }
    const BuiltScene painted = WrittenScene("regions_3", head + "[[body.region]]\nfield = \"" + ply.string() + "\"\n").build();
    EXPECT_EQ(sphere.world.springs.factor, painted.world.springs.factor);
    fs::remove(ply);
    const auto error = [&](const std::string& table, const std::vector<Override>& o = {}) {
        return WrittenScene("regions_bad", head + table).error(o);
    };
    EXPECT_NE(error("[[body.region]]\nstiffness = 2\n").find("needs one of sphere, box, capsule, group and field"), std::string::npos);
    EXPECT_NE(error("[[body.region]]\nsphere = [1, 1, 1, 0.1]\n").find("holds no node of the body"), std::string::npos);
    EXPECT_NE(error("[[body.region]]\ngroup = \"x\"\n").find("body \"a\" has no group \"x\""), std::string::npos);
    EXPECT_NE(error("[[body.region]]\nfield = \"/no/such.ply\"\n").find("/no/such.ply"), std::string::npos);
    EXPECT_EQ(error("[[body.region]]\nsphere = [0, 0, 0, 1]\n", {{"a.integrator", "implicit"}}), "");
}

}  // namespace
