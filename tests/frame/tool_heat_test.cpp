// Cautery: heat in tissue against closed forms, coagulation, whole scenes.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <numbers>
#include <numeric>

#include "engine/tissue/heat.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "engine/tissue/links.hpp"
#include "frame/written_scene.hpp"
#include "reference/paths.hpp"
namespace trocar {
namespace {

// A cube of 60 mm that a pen may heat.
std::string heated_cube(const std::string& heat, const std::string& kind) {
    return R"(
gravity = [0.0, 0.0, 0.0]
[[body]]
name = "block"
shape = "box"
size = 0.06
triangles = 4000
motion = "deformable"
)" + kind + R"(
[body.tissue]
youngs_modulus = 1e4
density = 1000.0
damping = 40.0
[body.heat]
)" + heat + R"(
[[body]]
name = "pen"
shape = "sphere"
size = 0.002
triangles = 100
motion = "hand"
position = [0.0, 0.0, 0.031]
apart = "block"
[[tool]]
body = "pen"
tip_radius = 0.001
[[tool.path]]
time = 0.0
position = [0.0, 0.0, 0.031]
[[tool.action]]
kind = "cauterise"
bodies = "block"
point = [0.0, 0.0, -0.001]
power = 40.0
spot = 2e-3
at = [0.1, 1.6]
)";
}

World solid_world(const std::string& heat) {
    return std::move(WrittenScene("heat", heated_cube(heat, "model = \"solid\"\ncells = 16")).build().world);
}

double distance_to(const World& w, uint32_t node, const Vec3d& centre) {
    return (rest_of_node(w.meshes, w.solids, w.bodies.mesh[0], node) - centre).norm();
}

// The node nearest to the middle.
uint32_t middle_node(const World& w) {
    uint32_t best = 0;
    for (uint32_t v = 0; v < w.actions.heat_body[0].nodes.count; ++v)
        if (distance_to(w, v, Vec3d::Zero()) < distance_to(w, best, Vec3d::Zero())) best = v;
    return best;
}

// Mean and largest relative difference of the temperatures from `exact` at 3 to 4 cells from a point source, after some steps.
template <typename Exact>
std::array<double, 2> compare(World& w, double seconds, int steps, const Exact& exact) {
    const HeatBody& body = w.actions.heat_body[0];
    const uint32_t source = middle_node(w);
    const Vec3d centre = rest_of_node(w.meshes, w.solids, w.bodies.mesh[0], source);
    std::vector<double> power(body.nodes.count, 0.0), flow;
    power[source] = 0.01;
    for (int i = 0; i < steps; ++i) step_heat(w.actions, body, seconds / steps, power, w.action_state.heat, flow);
    double sum = 0, most = 0, count = 0;
    for (uint32_t v = 0; v < body.nodes.count; ++v) {
        const double r = distance_to(w, v, centre), cell = 0.06 / 16;
        if (r < 2.9 * cell || r > 4.1 * cell) continue;
        const double error = w.action_state.heat.rise[v] / exact(r) - 1;
        sum += error, most = std::max(most, std::abs(error)), ++count;
    }
    EXPECT_GT(count, 100);
    return {sum / count, most};
}

// A point source that begins at 0: P / (4 pi k r) erfc(r / sqrt(4 a t)); and with blood, at rest: P / (4 pi k r)
// exp(-r sqrt(w / k)). Breaks when conductances, capacities or the perfusion are off by a few hundredths.
TEST(ToolHeat, APointSourceHasItsClosedForm) {
    constexpr double k = 0.5, c = 3.6e6, power = 0.01, t = 600;
    World w = solid_world("conductivity = 0.5\nspecific_heat = 3600.0\nperfusion = 0.0");
    const auto grows =
        compare(w, t, 300, [&](double r) { return power / (4 * std::numbers::pi * k * r) * std::erfc(r / std::sqrt(4 * k / c * t)); });
    World blood = solid_world("conductivity = 0.5\nspecific_heat = 3600.0\nperfusion = 1e-3");
    const auto rests = compare(
        blood, 3000, 1500, [&](double r) { return power / (4 * std::numbers::pi * k * r) * std::exp(-r * std::sqrt(1e-3 * 4.18e6 / k)); });
    std::printf("erfc: mean %.4f, at most %.4f; with blood: mean %.4f, at most %.4f; explicit limit %.2f s\n", grows[0], grows[1], rests[0],
                rests[1], w.actions.heat_body[0].stable_dt);
    EXPECT_LT(std::abs(grows[0]), 0.02);
    EXPECT_LT(grows[1], 0.05);
    EXPECT_LT(std::abs(rests[0]), 0.02);
    EXPECT_LT(rests[1], 0.05);
}

// What goes in is in the tissue, on a shell too; at 100 degrees it goes into steam.
TEST(ToolHeat, NoHeatIsLost) {
    for (const char* kind : {"model = \"solid\"\ncells = 8", "anchor = \"world\""}) {
        World w = std::move(WrittenScene("sum", heated_cube("perfusion = 0.0", kind)).build().world);
        const HeatBody& body = w.actions.heat_body[0];
        HeatState& state = w.action_state.heat;
        std::vector<double> power(body.nodes.count, 0.0), flow;
        power[middle_node(w)] = 40;
        for (int i = 0; i < 600; ++i) step_heat(w.actions, body, 1.0 / 60, power, state, flow);
        double sum = 0, steam = 0, volume = 0;
        for (uint32_t v = 0; v < body.nodes.count; ++v) {
            sum += w.actions.heat_volume[v] * body.per_volume * state.rise[v], steam += state.steam[v], volume += w.actions.heat_volume[v];
            EXPECT_LE(state.rise[v], 63.0);
        }
        std::printf("%.6f J in tissue, %.6f J in steam, of %.0f mm^3\n", sum, steam, 1e9 * volume);
        EXPECT_GT(steam, 0);
        EXPECT_NEAR(sum + steam, 400, 1e-8);
    }
}

// Constant temperatures: the integral is rate times time, by Eyring with the values of the source, and grows with temperature.
TEST(ToolHeat, DamageFollowsArrhenius) {
    World w = solid_world("perfusion = 0.0");
    const HeatBody& body = w.actions.heat_body[0];
    const std::vector<double> none(body.nodes.count, 0.0);
    for (const double celsius : {50.0, 60.0, 70.0}) {
        HeatState state = w.action_state.heat;
        std::fill(state.rise.begin(), state.rise.end(), celsius - 37);
        std::vector<double> flow;
        step_heat(w.actions, body, 3, none, state, flow);
        const double kelvin = celsius + 273.15, eyring = 1.380649e-23 * kelvin / 6.62607015e-34 * std::exp(553.5 / 8.314462618) *
                                                         std::exp(-2.768e5 / (8.314462618 * kelvin));
        EXPECT_NEAR(state.damage[0], 3 * eyring, 0.05 * 3 * eyring) << celsius;
        EXPECT_EQ(state.damage.front(), state.damage.back());
    }
}

// A whole scene: what the tip gives, what coagulates, what is listed in the pass and drawn. Away from the tissue nothing happens.
TEST(ToolHeat, ATipCoagulatesWhatItTouches) {
    for (const char* kind : {"anchor = \"world\"", "model = \"solid\"\ncells = 10", "model = \"solid\"\nskin = true\ncells = 8"}) {
        const WrittenScene scene("burns", heated_cube("stiffening = 1.0", kind));
        double listed = 0;
        run(scene.build().world, 130, [&](Frame& frame, int pass) {
            const World& w = frame.world();
            const ActionProgress& p = w.action_state.progress[0];
            for (const BurntNode& b : w.action_state.burnt) listed += w.actions.heat_area[b.node];
            if (pass < 129) return;
            EXPECT_EQ(p.done, 1u);
            EXPECT_NEAR(p.heat, 40 * 1.5, 40 * 0.04);
            EXPECT_GT(p.burnt, 0);
            EXPECT_DOUBLE_EQ(p.burnt, listed);
            EXPECT_LT(p.burnt, 6e-4) << "of a face of 3.6e-3 m^2";
            const double area = std::accumulate(w.actions.heat_area.begin(), w.actions.heat_area.end(), 0.0);
            const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[0]);
            double whole = 0;
            for (const Triangle& t : mesh.triangle)
                whole += 0.5 * (mesh.position[t[1]] - mesh.position[t[0]]).cross(mesh.position[t[2]] - mesh.position[t[0]]).norm();
            EXPECT_NEAR(area, whole, 1e-12);
            const PictureSnapshot picture = frame.snapshot_now();
            ASSERT_GT(picture.body[0].burnt.count, 0u);
            EXPECT_GT(*std::max_element(picture.burnt.begin(), picture.burnt.end()), 0.6f);
            EXPECT_EQ(*std::min_element(picture.burnt.begin(), picture.burnt.end()), 0.0f) << "far away";
            EXPECT_EQ(find_fault(w), "");
        });
        std::string away = heated_cube("", kind);
        away.replace(away.find("point = [0.0, 0.0, -0.001]"), 26, "point = [0.0, 0.0, 0.0011]");
        run(WrittenScene("away", away + "reach = 1e-3\n").build().world, 20, [&](Frame& frame, int) {
            const World& w = frame.world();
            EXPECT_EQ(w.action_state.progress[0].heat, 0.0);
            EXPECT_EQ(*std::max_element(w.action_state.heat.rise.begin(), w.action_state.heat.rise.end()), 0.0);
        });
    }
}

std::string swapped(std::string text, const std::string& from, const std::string& to) {
    text.replace(text.find(from), from.size(), to);
    return text;
}

// Offsets of all nodes after coming to rest under their weight.
std::vector<Vec3d> hang(World w, double damage) {
    std::fill(w.action_state.heat.damage.begin(), w.action_state.heat.damage.end(), damage);
    w.actions.action[0].power = 0;
    w.settings.gravity = Vec3d(0, 0, -9.81);
    std::vector<Vec3d> place;
    const Range range = w.bodies.particles[0];
    run(std::move(w), 120, [&](Frame& frame, int pass) {
        if (pass < 119) return;
        for (uint32_t v = range.first; v < range.end(); ++v) {
            const Float4& o = frame.world().particles.offset[v];
            place.emplace_back(o.x, o.y, o.z);
        }
    });
    return place;
}

// A coagulated body sags as one made of tissue that is stiffer by 1 + 6 (1 - exp(-damage)). Breaks when a spring, a tetrahedron or the
// law is left out, or when it stiffens twice.
TEST(ToolHeat, CoagulatedTissueIsAsStiffAsTissueMadeSo) {
    constexpr double kDamage = 1.2;
    const double k = 1 + 6 * (1 - std::exp(-kDamage));
    for (const char* kind : {"fixed_below = -0.02", "model = \"solid\"\ncells = 6\nfixed_below = -0.02"}) {
        const auto made = [&](double by, const std::string& stiffening) {
            const std::string tissue = "youngs_modulus = " + std::to_string(1e4 * by) + "\ndepth = " + std::to_string(0.05 * by) + "\n";
            std::string text = swapped(heated_cube("stiffening = " + stiffening, kind), "youngs_modulus = 1e4\n", tissue);
            return std::move(WrittenScene("stiff", swapped(text, "triangles = 4000", "triangles = 600")).build().world);
        };
        const World rest = made(1, "7.0");
        const std::vector<Vec3d> soft = hang(made(1, "7.0"), 0), burnt = hang(made(1, "7.0"), kDamage), stiff = hang(made(k, "1.0"), 0);
        double sag = 0, moved = 0, error = 0;
        for (size_t v = 0; v < soft.size(); ++v) {
            const Float4& o = rest.particles.offset[rest.bodies.particles[0].first + v];
            sag = std::max(sag, (soft[v] - Vec3d(o.x, o.y, o.z)).norm()), moved = std::max(moved, (soft[v] - burnt[v]).norm());
            error = std::max(error, (burnt[v] - stiff[v]).norm());
        }
        std::printf("sags by %.4g mm, less by %.4g mm when coagulated, off by %.2g mm\n", 1e3 * sag, 1e3 * moved, 1e3 * error);
        EXPECT_GT(moved, 0.05 * sag) << kind;
        EXPECT_LT(error, 2e-3 * moved) << kind;
    }
}

// Vertices with open edges, each of which must have two: a rim that is a curve.
uint32_t count_rim(const World& w, uint32_t& wrong, uint32_t& open_vessels) {
    const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[0]);
    std::vector<uint32_t> open(mesh.position.size(), 0);
    for (size_t e = 0; e < mesh.edge.size(); ++e)
        if (mesh.edge_triangle[e][1] == kNone) ++open[mesh.edge[e][0]], ++open[mesh.edge[e][1]];
    uint32_t rim = 0;
    for (uint32_t v = 0; v < open.size(); ++v) {
        rim += open[v] > 0, wrong += open[v] != 0 && open[v] != 2;
        open_vessels += open[v] > 0 && !is_sealed(w.actions.heat_body[0], w.action_state.heat, v);
    }
    return rim;
}

std::string boiling(const std::string& kind, const std::string& power) {
    return swapped(heated_cube("perfusion = 0.0\nwater = 0.05\nparts = true\nstiffening = 2.0", kind), "power = 40.0", "power = " + power);
}

// What boils away is removed: a hole whose rim is a closed curve of coagulated vertices, all heat being in tissue and steam.
TEST(ToolHeat, WhatBoilsAwayIsRemoved) {
    run(WrittenScene("boils", boiling("anchor = \"world\"", "200.0")).build().world, 110, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        uint32_t wrong = 0, open_vessels = 0;
        const uint32_t rim = count_rim(w, wrong, open_vessels);
        EXPECT_EQ(wrong, 0u) << pass;
        EXPECT_EQ(open_vessels, 0u) << pass;
        if (pass < 109) return;
        const HeatBody& body = w.actions.heat_body[0];
        double heat = 0;
        for (uint32_t v = 0; v < body.nodes.count; ++v)
            heat += w.actions.heat_volume[v] * body.per_volume * w.action_state.heat.rise[v] + w.action_state.heat.steam[v];
        std::printf("%llu triangles removed, rim of %u, %.1f J\n", static_cast<unsigned long long>(w.report.removed_triangles), rim, heat);
        EXPECT_GT(w.report.removed_triangles, 5u);
        EXPECT_GT(w.report.broken_springs, 0u);
        EXPECT_GT(rim, 4u);
        EXPECT_NEAR(heat, w.action_state.progress[0].heat, 1e-8);
        EXPECT_EQ(w.report.opened_bodies, 1u);
        EXPECT_EQ(find_fault(w), "");
    });
    run(WrittenScene("boils_solid", boiling("model = \"solid\"\ncells = 10", "1000.0")).build().world, 80, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        if (pass < 79) return;
        EXPECT_GT(w.report.removed_tetrahedra, 3u);
        EXPECT_EQ(w.meshes.info[w.bodies.mesh[0]].admission, Admission::kSolid) << "a crater leaves it closed";
        EXPECT_EQ(find_fault(w), "");
    });
    expect_same_bits(WrittenScene("boil_bits", boiling("anchor = \"world\"", "400.0")), 50,
                     [](const Frame& frame) { EXPECT_GT(frame.world().report.removed_triangles, 0u); });
}

// cut_sheet.toml with a hot blade: clamps stretch the sheet, which the blade cuts and heats.
std::string hot_blade(const std::string& cut_from) {
    std::ifstream file(source_folder() / "content/scenes/cut_sheet.toml");
    std::string text(std::istreambuf_iterator<char>(file), {});
    text = swapped(text, "[[body]]\nname = \"left\"", "[body.heat]\nperfusion = 0.0\nstiffening = 3.0\n[[body]]\nname = \"left\"");
    text = swapped(text, "at = [0.7]", "at = [" + cut_from + "]");
    text = swapped(text, "time = 0.7\nposition", "time = 0.1\nposition"), text = swapped(text, "time = 2.2\nposition", "time = 0.7\nposition");
    text = swapped(text, "time = 2.6\nposition", "time = 0.9\nposition");
    return text + R"([[tool.action]]
kind = "cauterise"
bodies = "mesh"
point = [0.0009, 0.0, 0.012]
power = 20.0
spot = 4e-3
reach = 5e-3
when = "always"
)";
}

// A sheet that is cut while it is hot: its heat and its volume stay.
TEST(ToolHeat, CutsKeepTheHeat) {
    const WrittenScene scene("hot_cut", hot_blade("0.1"));
    run(scene.build().world, 40, [&](Frame& frame, int) {
        const World& w = frame.world();
        const HeatBody& body = w.actions.heat_body[0];
        const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[0]);
        double heat = 0, volume = 0, area = 0;
        for (uint32_t v = 0; v < body.nodes.count; ++v) {
            volume += w.actions.heat_volume[v];
            heat += w.actions.heat_volume[v] * body.per_volume * w.action_state.heat.rise[v] + w.action_state.heat.steam[v];
        }
        for (const Triangle& t : mesh.triangle)
            area += 0.5 * (mesh.position[t[1]] - mesh.position[t[0]]).cross(mesh.position[t[2]] - mesh.position[t[0]]).norm();
        EXPECT_NEAR(volume, area * 1e-3, 1e-12 * volume);
        EXPECT_NEAR(heat, w.action_state.progress[1].heat, 1e-9 * std::max(1.0, heat));
        EXPECT_EQ(find_fault(w), "");
    });
    expect_same_bits(scene, 30, [](const Frame& frame) {
        EXPECT_GT(frame.world().action_state.progress[0].area, 0.0);
        EXPECT_GT(frame.world().action_state.progress[1].heat, 1.0);
    });
}

// Energy that stiffening gives to a stretched sheet is in the accounting. Breaks when it is not booked.
TEST(ToolHeat, StiffeningIsAccountedFor) {
    double gained = 0, drift = 0;
    run(WrittenScene("books", swapped(hot_blade("9.0"), "power = 20.0", "power = 600.0")).build().world, 60, [&](Frame& frame, int) {
        const Energy& e = frame.world().energy;
        gained = std::max(gained, e.work_links), drift = std::max(drift, std::abs(e.balance));
    });
    std::printf("stiffening gave %.3g J, drift %.3g J\n", gained, drift);
    EXPECT_GT(gained, 1e-5);
    EXPECT_LT(drift, 0.02 * gained);
}

TEST(ToolHeat, SameBitsForThreadsAndWithoutScratch) {
    const WrittenScene scene("heat_bits", heated_cube("", "anchor = \"world\""));
    expect_same_bits(scene, 60, [](const Frame& frame) { EXPECT_GT(frame.world().action_state.progress[0].heat, 1.0); });
}

TEST(ToolHeat, WhatCannotBeHeatedIsRefused) {
    const auto error = [](const std::string& from, const std::string& to) {
        std::string text = heated_cube("", "anchor = \"world\"");
        text.replace(text.find(from), from.size(), to);
        return WrittenScene("refused_heat", text).error();
    };
    EXPECT_EQ(error("power = 40.0", "power = 41.0"), "");
    EXPECT_NE(error("power = 40.0\n", "").find("power"), std::string::npos);
    EXPECT_NE(error("bodies = \"block\"", "bodies = \"pen\"").find("must be deformable"), std::string::npos);
    EXPECT_NE(error("bodies = \"block\"", "bodies = \"blok\"").find("no body is named"), std::string::npos);
    EXPECT_NE(error("bodies = \"block\"\n", "").find("bodies"), std::string::npos);
    EXPECT_NE(error("[body.heat]\n", "[body.heat]\nconductivity = -1.0\n").find("conductivity"), std::string::npos);
}

}  // namespace
}  // namespace trocar
