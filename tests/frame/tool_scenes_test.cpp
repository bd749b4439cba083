// Tool scenes, run as a user runs them.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/base/error.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "engine/motion/keyframe_path.hpp"
#include "frame/scenes_under_test.hpp"
#include "reference/leapfrog_double.hpp"
#include "systems/app/report/tool_record.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {
namespace {

World scene_world(const std::string& name, const std::vector<Override>& overrides) {
    return std::move(build_scene(read_scene_file(source_folder() / "content/scenes" / (name + ".toml"), overrides), Looks::kPlain).world);
}

// Steps to a time (s) and calls `look` after every pass.
template <typename Look>
void run_until(Frame& frame, double time, const Look& look) {
    while (static_cast<double>(frame.world().clock.tick) < 1e3 * time) {
        frame.step();
        look(frame.world());
    }
}

// Springs and anchors of a shell without bending and pressure, in double.
reference::DoubleBody double_copy(const World& w, uint32_t body) {
    reference::DoubleBody b;
    const MeshView view = mesh_view(w.meshes, w.bodies.mesh[body]);
    for (uint32_t v = 0; v < view.position.size(); ++v) {
        const uint32_t p = w.bodies.particles[body].first + v;
        b.position.push_back(vertex_position(surfaces_of(w), body, v) - w.poses.origin[body]);
        b.inv_mass.push_back(w.particles.offset[p].w);
        b.goal.push_back({w.anchors.rest_x[p], w.anchors.rest_y[p], w.anchors.rest_z[p]});
        b.anchor.push_back(w.anchors.stiffness[p]);
    }
    for (const auto& [i, j] : view.edge) {
        b.spring.push_back({i, j});
        b.rest_length.push_back((view.position[i] - view.position[j]).norm());
    }
    b.stiffness = w.bodies.spring_stiffness[body];
    return b;
}

// The load of two hands on a tissue equals the reaction of its springs and anchors, and each hand feels its
// own share, to 1 %. Breaks when damping carries part of a static load, when a reaction is lost, counted
// twice or applied to the other tool, or when the hand feels a different surface than the tissue's.
TEST(ToolScenes, TwoHandsFeelWhatTheTissueBears) {
    ThreadPool pool(0);
    pool.run([&] {
        Frame frame(scene_world("two_tools", {{"liver.tissue.bending", "0.0"}, {"liver.tissue.pressure_modulus", "0.0"}}), {});
        run_until(frame, 2.9, [](const World&) {});
        const World& w = frame.world();
        const double period = 1e-3 * w.clock.period;
        Vec3d pressed = Vec3d::Zero(), borne = Vec3d::Zero();
        ASSERT_EQ(w.haptics.state.size(), 2u);
        for (const ToolState& tool : w.haptics.state) {
            const Vec3d tissue = tool.contact_impulse / period;
            EXPECT_GT(tissue.norm(), 0.05);
            EXPECT_NEAR(tool.output.force.norm(), tissue.norm(), 0.01 * tissue.norm());
            EXPECT_LT((tool.output.force - tissue).norm(), 0.03 * tissue.norm()) << "friction of the one contact and of the many differs";
            pressed += tissue;
        }
        const reference::DoubleBody liver = double_copy(w, 0);
        const std::vector<Vec3d> f = reference::forces(liver);
        for (size_t i = 0; i < f.size(); ++i)
            if (liver.inv_mass[i] > 0) borne += f[i];
        EXPECT_LT((pressed - borne).norm(), 1e-3 * pressed.norm()) << pressed.transpose() << " and " << borne.transpose();
    });
}

// The same for an instrument with a point shell: pressed across the liver and held, its hand feels the force
// and torque of springs and anchors. Breaks when the points of the shell differ from the simulated contacts.
TEST(ToolScenes, AShellFeelsWhatTheTissueBears) {
    ThreadPool pool(0);
    pool.run([&] {
        const auto path = source_folder() / "content/scenes/shaft_on_liver.toml";
        for (const double height : {0.048, 0.044}) {
            SceneFile scene = read_scene_file(
                path, {{"liver.tissue.bending", "0.0"}, {"liver.tissue.pressure_modulus", "0.0"}, {"liver.triangles", "4000"}});
            scene.tools[0].path.resize(3);
            scene.tools[0].path[2].position.z() = height;
            Frame frame(std::move(build_scene(scene, Looks::kPlain).world), {});
            run_until(frame, 2.5, [](const World&) {});
            const World& w = frame.world();
            const ToolState& tool = w.haptics.state[0];
            const reference::DoubleBody liver = double_copy(w, 0);
            const std::vector<Vec3d> f = reference::forces(liver);
            Vec3d borne = Vec3d::Zero();
            for (size_t i = 0; i < f.size(); ++i)
                if (liver.inv_mass[i] > 0) borne += f[i];
            const Vec3d moment = tool.contact_moment / (1e-3 * w.clock.period);
            std::printf("felt %.4f N of %.4f N (%.2f %%), torque %.5f of %.5f N m\n", tool.output.force.norm(), borne.norm(),
                        100 * (tool.output.force.norm() / borne.norm() - 1), tool.output.torque.norm(), moment.norm());
            EXPECT_GT(borne.norm(), 0.3);
            EXPECT_NEAR(tool.output.force.norm(), borne.norm(), 0.01 * borne.norm()) << height;
            EXPECT_NEAR(tool.output.torque.norm(), moment.norm(), 0.02 * moment.norm()) << height;
        }
    });
}

// Below the force limit of the wall the needle stays outside; beyond it the needle penetrates and the wall no
// longer acts on it, shaft included; after withdrawal it may be stopped again. Breaks when the proxy or the
// simulated needle slips through a thin wall, or when the wall pushes out a needle that has penetrated it.
TEST(ToolScenes, NeedleGoesThroughTheWallWhenPressedHarderThanItBears) {
    ThreadPool pool(0);
    pool.run([&] {
        Frame frame(scene_world("needle_wall", {{"wall.triangles", "4000"}}), {});
        const auto passed = [&] { return frame.world().haptics.state[0].events.count[static_cast<size_t>(HapticEventKind::kPassThrough)]; };
        run_until(frame, 2.1, [](const World&) {});
        const ToolState& tool = frame.world().haptics.state[0];
        EXPECT_EQ(passed(), 0u);
        EXPECT_GT(tool.output.force.z(), 0.3);
        EXPECT_LT(tool.output.force.norm(), 1.5);
        EXPECT_EQ(tool.pierce.body, kNone);
        double largest = 0;
        run_until(frame, 3.5, [&](const World& w) {
            const ToolState& at = w.haptics.state[0];
            largest = std::max(largest, at.output.force.norm());
        });
        EXPECT_EQ(passed(), 1u);
        EXPECT_LT(largest, 1.6);
        EXPECT_EQ(tool.pierce.body, 0u);
        // the pass of the breakthrough still has a force; later passes have none
        Vec3d after = Vec3d::Zero();
        run_until(frame, 3.6, [&](const World& w) { after += w.haptics.state[0].contact_impulse; });
        EXPECT_EQ(after, Vec3d::Zero());
        EXPECT_LT((tool.proxy - tool.device.position).norm(), 1e-9);
        EXPECT_LT(tool.proxy.z(), -0.02);
        run_until(frame, 4.9, [](const World&) {});
        EXPECT_EQ(tool.pierce.body, kNone);
        EXPECT_EQ(tool.output.force, Vec3d::Zero());
        EXPECT_LT(frame.world().energy.kinetic, 1e-6);
    });
}

// Surgical mesh falls onto a wall, drapes over its dome, is stapled and comes to rest: no part of it is
// inside the wall, and the energy of its fall is fully accounted. Breaks when an open sheet sinks into
// tissue, when stiff knots of it excite each other, or when a staple set without tension exerts a force.
TEST(ToolScenes, MeshOnAWallLiesStill) {
    ThreadPool pool(0);
    pool.run([&] {
        Frame frame(scene_world("mesh_on_wall", {{"mesh.triangles", "400"}, {"wall.triangles", "2000"}}), {});
        double peak = 0, worst = 0;
        run_until(frame, 0.7, [&](const World& w) {
            peak = std::max(peak, w.energy.kinetic + w.energy.elastic + w.energy.bending + w.energy.links);
            worst = std::max(worst, std::abs(w.energy.balance));
        });
        const World& w = frame.world();
        EXPECT_GT(peak, 1e-4);
        EXPECT_LT(worst, 0.02 * peak);
        EXPECT_EQ(w.links.node.size(), 4u);
        EXPECT_LT(w.report.deepest_residual, 1e-3);
        EXPECT_LT(w.energy.kinetic, 1e-2 * peak);
        double lowest = 1, highest = -1;  // m: it bends with the wall, whose surface is 20 mm lower at the
                                          // ends of the mesh than at its middle
        for (uint32_t v = 0; v < w.meshes.info[w.bodies.mesh[1]].vertices.count; ++v) {
            const double z = vertex_position(surfaces_of(w), 1, v).z();
            lowest = std::min(lowest, z), highest = std::max(highest, z);
        }
        EXPECT_NEAR(highest, 0.0095, 1e-3) << "on top of the wall, half of the two thicknesses";
        EXPECT_NEAR(highest - lowest, 0.018, 4e-3);
    });
}

// The force map of a sliding probe has its maximum over the lump, and none where there is no lump.
TEST(ToolScenes, LongPalpationFindsTheLump) {
    const auto map_of = [](const std::string& lump) {
        std::vector<ToolSample> samples;
        ThreadPool pool(0);
        pool.run([&] {
            Frame frame(scene_world("palpate", {{"lump", lump}, {"liver.cells", "20"}, {"liver.triangles", "5000"}}), {});
            run_until(frame, 29.5, [&](const World&) { record_tools(frame, samples); });
        });
        return *force_map(samples, 0);
    };
    // maximum over median, and its position
    const auto peak = [](const ForceMap& map, Vec3d& at) {
        std::vector<double> felt;
        double highest = 0;
        for (uint32_t k = 0; k < map.force.size(); ++k) {
            if (std::isnan(map.force[k])) continue;
            felt.push_back(map.force[k]);
            if (map.force[k] <= highest) continue;
            highest = map.force[k];
            at = (map.right_from + (k % map.columns + 0.5) * map.cell) * map.right +
                 (map.up_from + (k / map.columns + 0.5) * map.cell) * map.up;
        }
        std::nth_element(felt.begin(), felt.begin() + static_cast<ptrdiff_t>(felt.size() / 2), felt.end());
        return highest / felt[felt.size() / 2];
    };
    Vec3d position = Vec3d::Zero();
    const ForceMap map = map_of("10.0");
    const double with = peak(map, position);
    const Vec3d lump = Vec3d(0.01, -0.005, 0.033), off = position - (lump - lump.dot(map.normal) * map.normal);
    EXPECT_LT(off.norm(), 0.012) << "its radius";
    EXPECT_GT(with, 1.5);
    const double without = peak(map_of("1.0"), position);
    EXPECT_LT(without, 0.8 * with);
}

// A probe that is dragged and withdrawn at 30 passes a second moves 3 mm per pass, and tissue folds around
// its neck; it still comes free. Breaks when points that are through a fold are pushed further through it:
// the organ then stays caught on the probe.
TEST(ToolScenes, AToolComesOutOfAFold) {
    ThreadPool pool(0);
    for (const char* triangles : {"8000", "14000"}) {
        pool.run([&] {
            Frame frame(scene_world("probe_on_liver", {{"contact.rate", "30"}, {"liver.triangles", triangles}}), {});
            double deepest = 0;
            run_until(frame, 3.2, [&](const World& w) {
                for (const double depth : w.penetrations.depth) deepest = std::max(deepest, depth);
            });
            EXPECT_GT(deepest, 2e-4) << triangles;  // there was a fold
            run_until(frame, 3.5, [&](const World& w) {
                for (const double depth : w.penetrations.depth) EXPECT_EQ(depth, 0) << triangles << ' ' << w.clock.tick;
            });
        });
    }
}

// The complete operating scene through one press of each hand, with a coarser liver: energy accounting closes
// to 1 % of the largest elastic energy, no particle is lost, the remaining overlap is below 0.1 mm, both
// hands feel organs, and no instrument collides with the wall around its port.
TEST(ToolScenes, FieldStaysWholeUnderBothHands) {
    ThreadPool pool(0);
    pool.run([&] {
        Frame frame(
            scene_world("field",
                        {{"liver.cells", "10"}, {"liver.triangles", "3000"}, {"stomach.triangles", "2000"}, {"wall.triangles", "2000"}}),
            {});
        const World& w = frame.world();
        const uint32_t wall = 2;
        ASSERT_EQ(w.bodies.name[wall], "wall");
        std::array<double, 2> felt{};
        double elastic = 0, balance = 0, residual = 0;
        bool met_wall = false;
        run_until(frame, 1.5, [&](const World&) {
            for (size_t t = 0; t < 2; ++t) felt[t] = std::max(felt[t], w.haptics.state[t].output.force.norm());
            elastic = std::max(elastic, w.energy.elastic), balance = std::max(balance, std::abs(w.energy.balance));
            residual = std::max(residual, w.report.deepest_residual);
            for (size_t p = 0; p < w.pairs.a.size(); ++p)
                met_wall |= w.pairs.a[p] == wall && w.bodies.motion[w.pairs.b[p]] == Motion::kHand;
        });
        EXPECT_FALSE(met_wall);
        EXPECT_GT(felt[0], 0.2);
        EXPECT_GT(felt[1], 0.2);
        EXPECT_LT(balance, 0.01 * elastic);
        EXPECT_LT(residual, 1e-4);
        EXPECT_GT(w.report.min_volume_ratio, 0.0);
        EXPECT_EQ(w.report.runaway_bodies + w.report.nonfinite_particles, 0u);
    });
}

// `repeat` repeats a path: one period later the hand is at the same position, and each repetition starts with
// the last key of the previous one.
TEST(ToolScenes, RepeatedPathsComeBack) {
    const World w =
        scene_world("field", {{"liver.cells", "6"}, {"liver.triangles", "1000"}, {"tool.left.repeat", "3"}, {"tool.right.repeat", "1"}});
    const auto keys = [&](size_t tool) {
        const Range range = w.paths.keys[w.haptics.tool[tool].path];
        return std::span(w.paths.key).subspan(range.first, range.count);
    };
    ASSERT_EQ(keys(0).size(), 9u + 8u + 8u);
    ASSERT_EQ(keys(1).size(), 6u);
    EXPECT_EQ(keys(0).back().time, 15.0);
    for (double time = 0; time < 5; time += 0.013)
        for (const double later : {5.0, 10.0})
            EXPECT_LT((sample_path(keys(0), time + later).position - sample_path(keys(0), time).position).norm(), 1e-12) << time;
    EXPECT_EQ(sample_path(keys(0), 17.0).position, keys(0)[0].position);
}

TEST(ToolScenes, WhatIsKeptApartIsNamedAndAnother) {
    const auto refused = [](const std::string& key, const std::string& value) -> std::string {
        try {
            scene_world("field", {{"liver.cells", "6"}, {"liver.triangles", "1000"}, {key, value}});
        } catch (const InputError& error) {
            return error.what();
        }
        return "";
    };
    EXPECT_NE(refused("left.apart", "door").find("no body is named \"door\""), std::string::npos);
    EXPECT_NE(refused("left.apart", "left").find("names itself"), std::string::npos);
    EXPECT_NE(refused("left.apart", "3").find("string"), std::string::npos);
    EXPECT_NE(refused("tool.left.repeat", "0").find("repeat"), std::string::npos);
    EXPECT_NE(refused("tool.left.repeat", "1000000").find("4 million"), std::string::npos);
}

}  // namespace
}  // namespace trocar
