// Sheets that instruments cut, in whole scenes.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <random>
#include <set>

#include "engine/mesh/crossing_faces.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/tissue/cut_setup.hpp"
#include "frame/written_scene.hpp"
#include "reference/paths.hpp"
namespace trocar {
namespace {

World cut_world(const std::vector<Override>& more = {}) {
    std::vector<Override> overrides{{"mesh.triangles", "400"}, {"mesh.cut_capacity", "800"}};
    overrides.insert(overrides.end(), more.begin(), more.end());
    return std::move(build_scene(read_scene_file(source_folder() / "content/scenes/cut_sheet.toml", overrides), Looks::kPlain).world);
}

struct Sums {
    double mass = 0, area = 0;
    size_t pieces = 0;
};

Sums sums_of(const World& w) {
    Sums sums;
    const uint32_t body = 0, prototype = w.bodies.mesh[body];
    const MeshView mesh = mesh_view(w.meshes, prototype);
    for (uint32_t v = 0; v < mesh.position.size(); ++v) sums.mass += 1 / double{w.particles.offset[w.bodies.particles[body].first + v].w};
    for (const Triangle& t : mesh.triangle)
        sums.area += 0.5 * (mesh.position[t[1]] - mesh.position[t[0]]).cross(mesh.position[t[2]] - mesh.position[t[0]]).norm();
    sums.pieces = w.meshes.info[prototype].components;
    return sums;
}

// A blade goes across: two pieces, all the mass and area of the whole, one stroke, the work of the new surface, and an
// accounting that closes. Breaks when mass is lost or made at new vertices, or when a remade spring's energy is not
// accounted.
TEST(ToolCuts, ABladeMakesTwoOfASheet) {
    double drift = 0, entered = 0, felt = 0;
    Sums before, after;
    size_t faults = 0;
    run(cut_world(), 150, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        if (pass == 0) before = sums_of(w);
        if (pass == 149) after = sums_of(w);
        if (pass % 30 == 29) faults += find_fault(w) != "";
        entered = std::max(entered, w.energy.work_hand);
        drift = std::max(drift, std::abs(w.energy.balance));
        felt = std::max(felt, w.haptics.state[0].output.force.norm());
        if (pass < 149) return;
        const ActionProgress& p = w.action_state.progress[0];
        const CutBody& cut = w.actions.cut_body[0];
        EXPECT_EQ(p.done, 1u);
        EXPECT_EQ(p.refused, 0u);
        EXPECT_DOUBLE_EQ(p.work, 1000 * p.area);
        EXPECT_EQ(cut.thickness, 1e-3);
        EXPECT_NEAR(-w.energy.work_cuts, p.work - p.owed, 1e-12) << "what the hand has given";
        EXPECT_LT(p.owed, 0.1 * p.work);
        std::printf("cut %.2f mm, %.3g J, felt at most %.2f N, drift %.3g of %.3g J, %u vertices, %u triangles\n", 1e3 * p.area / 1e-3,
                    p.work, felt, drift, entered, w.action_state.cut.count[0][0], w.action_state.cut.count[0][1]);
    });
    EXPECT_EQ(faults, 0u);
    EXPECT_EQ(before.pieces, 1u);
    EXPECT_EQ(after.pieces, 2u);
    EXPECT_NEAR(after.area, before.area, 1e-12 * before.area);
    EXPECT_NEAR(after.mass, before.mass, 1e-6 * before.mass) << "floats";
    EXPECT_GT(felt, 0.1);
    EXPECT_LT(drift, 1e-3 * entered) << "of the hands' work";
}

// What a stroke ended without giving is given by the next one. Breaks when it is dropped.
TEST(ToolCuts, ADebtIsNotForgotten) {
    std::ifstream file(source_folder() / "content/scenes/cut_sheet.toml");
    std::string text(std::istreambuf_iterator<char>(file), {});
    text.replace(text.find("at = [0.7]"), 10, "at = [0.7, 1.1, 1.3]");
    double carried = 0;
    run(WrittenScene("debt", text).build().world, 110, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const ActionProgress& p = w.action_state.progress[0];
        EXPECT_NEAR(-w.energy.work_cuts, p.work - p.owed, 1e-12) << pass;
        if (pass == 75) {
            carried = p.owed;
            EXPECT_FALSE(p.on);
        }
    });
    std::printf("carried %.3g J\n", carried);
    EXPECT_GT(carried, 0);
}

// The bits do not depend on threads or scratch, and the surface of a state follows from it alone: set back into a world
// as at load it is the same, with springs and anchors.
TEST(ToolCuts, TheStateHoldsTheSurface) {
    const auto run_with = [&](uint32_t threads, bool clear, const auto& look) {
        ThreadPool pool(threads);
        pool.run([&] {
            FrameOptions options;
            options.clear_scratch = clear;
            Frame frame(cut_world(), options);
            for (int i = 0; i < 80; ++i) frame.step();
            look(frame.world());
        });
    };
    uint64_t hash = 0;
    run_with(1, false, [&](const World& w) {
        hash = state_hash(w);
        EXPECT_GT(w.action_state.progress[0].area, 0);
        World again = cut_world();
        again.action_state = w.action_state, again.particles = w.particles, again.poses = w.poses;
        restore_cut_surfaces(again.actions, again.action_state.cut, again.bodies, again.particles, again.meshes, again.springs,
                             again.anchors, again.trees);
        for (const Resource r : {Resource::kMeshes, Resource::kSprings, Resource::kAnchors})
            EXPECT_EQ(resource_hash(again, r), resource_hash(w, r)) << resource_name(r);
    });
    run_with(3, false, [&](const World& w) { EXPECT_EQ(state_hash(w), hash); });
    run_with(1, true, [&](const World& w) { EXPECT_EQ(state_hash(w), hash); });
}

// A fine mesh, whose strands spring across the blade between two passes, is cut all the same. Breaks when the sweep does not follow
// the surface: of these two one piece was left.
TEST(ToolCuts, NoStrandEscapesBetweenTwoPasses) {
    for (const char* triangles : {"1000", "2000"}) {
        run(cut_world({{"mesh.triangles", triangles}, {"mesh.cut_capacity", "4000"}}), 136, [&](Frame& frame, int pass) {
            if (pass < 135) return;
            EXPECT_EQ(sums_of(frame.world()).pieces, 2u) << triangles;
            EXPECT_TRUE(frame.world().action_state.cut.slit.empty());
        });
    }
}

// A cut beyond the room is not made, and counted.
TEST(ToolCuts, BeyondItsRoomNothingIsCut) {
    run(cut_world({{"mesh.cut_capacity", "10"}}), 90, [&](Frame& frame, int pass) {
        if (pass < 89) return;
        const ActionProgress& p = frame.world().action_state.progress[0];
        EXPECT_GT(p.refused, 0u);
        EXPECT_EQ(sums_of(frame.world()).pieces, 1u);
        EXPECT_EQ(find_fault(frame.world()), "");
    });
}

TEST(ToolCuts, WhatCannotBeCutIsRefused) {
    const auto error = [](const Override& o) -> std::string {
        try {
            cut_world({o});
        } catch (const InputError& e) {
            return e.what();
        }
        return "";
    };
    for (const auto& [key, value] :
         {std::pair{"mesh.break_strain", "0.5"}, {"mesh.tissue.bending", "1.0"}, {"mesh.integrator", "implicit"}, {"mesh.skin", "true"}})
        EXPECT_NE(error({key, value}).find("instruments cannot cut it"), std::string::npos) << key << ": " << error({key, value});
}

// The scene, its mesh with self-contact; when it is cut, a hand takes the lip of the left half at a height y, folds it over its clamp
// and lets it go.
std::string folded_flap(double y, const Vec3d& over, const Vec3d& down) {
    std::ifstream file(source_folder() / "content/scenes/cut_sheet.toml");
    std::string text(std::istreambuf_iterator<char>(file), {});
    const auto replace = [&](const std::string& from, const std::string& to) { text.replace(text.find(from), from.size(), to); };
    replace("thickness = 1e-3 ", "self_contact = true\nthickness = 1e-3 ");
    replace("apart = \"mesh\"        # sharp", "apart = [\"mesh\", \"hand\"] # sharp");
    const auto at = [&](double time, const Vec3d& p) {
        return "[[tool.path]]\ntime = " + std::to_string(time) + "\nposition = [" + std::to_string(p.x()) + ", " + std::to_string(p.y()) +
               ", " + std::to_string(p.z()) + "]\n";
    };
    const Vec3d lip(-0.008, y, 0.003), above(-0.008, y, 0.05);
    text += "\n[[body]]\nname = \"hand\"\nshape = \"sphere\"\nsize = 0.002\ntriangles = 100\nmotion = \"hand\"\nposition = [-0.008, " +
            std::to_string(y) +
            ", 0.05]\napart = [\"mesh\", \"left\", \"right\", \"blade\"]\n[[tool]]\nbody = \"hand\"\ntip_radius = 0.0009\n" +
            "stiffness = 600.0\ndamping = 12.0\n" + at(0, above) + at(2.2, above) + at(2.35, lip) + at(2.45, lip) + at(2.9, over) +
            at(3.3, down) + at(4, down) + "[[tool.action]]\nkind = \"grasp\"\nat = [2.4, 3.3]\nreach = 0.01\nfriction = 0.5\npress = 5.0\n";
    return text;
}

// No pass leaves faces that cross, what holds them back adds no energy, and the accounting closes. Breaks when parts of the flap are put
// back rigidly: the work of contact is then a thousand times the hands'.
void expect_quiet_flap(const std::string& name, const std::string& text) {
    double entered = 0, drift = 0, gained = 0, contact = 0;
    uint64_t crossings = 0, held = 0;
    bool grasped = false;
    run(WrittenScene(name, text).build().world, 228, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        CrossingFacesScratch scratch;
        crossings += count_crossing_faces(mesh_view(w.meshes, w.bodies.mesh[0]).triangle,
                                          w.particles.offset.data() + w.bodies.particles[0].first, scratch);
        grasped |= !w.action_state.grasp.empty();
        held += w.report.held_vertices;
        entered = std::max(entered, w.energy.work_hand), drift = std::max(drift, std::abs(w.energy.balance));
        gained = std::max(gained, w.energy.work_numeric), contact = std::min(contact, w.energy.work_contact);
        if (pass < 227) return;
        EXPECT_EQ(find_fault(w), "") << name;
    });
    std::printf("%s: entered %.3g J, drift %.3g, gained %.3g, contact %.3g, held %zu\n", name.c_str(), entered, drift, gained, contact,
                size_t(held));
    EXPECT_TRUE(grasped) << name;
    EXPECT_EQ(crossings, 0u) << name;
    EXPECT_GT(held, 0u) << name << ": nothing had to be held";
    EXPECT_LT(drift, 1e-3 * entered) << name << ": of the hands' work";
    EXPECT_LT(gained, 1e-3 * entered) << name;
    EXPECT_GT(contact, -0.2 * entered) << name;
}

std::string random_flap(uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> any(-1, 1);
    const double y = 0.04 * any(random);
    const Vec3d over(-0.04 + 0.02 * any(random), 0.02 * any(random), 0.045 + 0.015 * any(random)),
        down(-0.07 + 0.03 * any(random), 0.04 * any(random), 0.012 * any(random));
    return folded_flap(y, over, down);
}

TEST(ToolCuts, AFlapThatAHandFoldsAndLetsGoGainsNothing) {
    expect_quiet_flap("flap", folded_flap(0, {-0.045, 0.01, 0.045}, {-0.07, 0.02, 0.006}));
    for (const uint64_t seed : {0, 1}) expect_quiet_flap("flap" + std::to_string(seed), random_flap(seed));
}

TEST(LongToolCuts, FlapsThatHandsFoldAtRandomGainNothing) {
    for (uint64_t seed = 2; seed < 40; ++seed) expect_quiet_flap("flap" + std::to_string(seed), random_flap(seed));
}

}  // namespace
}  // namespace trocar
