// Blood, water and smoke in whole scenes: the ledger, what seals a wound, cuts that bleed, suction, bits.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <numeric>

#include "engine/files/capture_file.hpp"
#include "engine/fluid/film_setup.hpp"
#include "frame/written_scene.hpp"
#include "reference/paths.hpp"
#include "systems/fluid/amounts.hpp"
#include "systems/fluid/smoke.hpp"
namespace trocar {
namespace {

// A block that bleeds above a dish.
std::string bleeding_block(const std::string& wound = "rate = 300.0") {
    return R"(
gravity = [0.0, 0.0, 0.0]
[fluid]
gravity = [0.0, 0.0, -9.81]
bodies = ["block", "dish"]
[[body]]
name = "block"
shape = "box"
size = 0.06
triangles = 1200
motion = "deformable"
anchor = "world"
[body.tissue]
youngs_modulus = 1e4
density = 1000.0
damping = 40.0
[body.heat]
[[body]]
name = "dish"
shape = "dish"
triangles = 600
motion = "static"
position = [0.0, 0.0, -0.08]
apart = "block"
[[wound]]
name = "vessel"
body = "block"
place = [0.0, 0.0, 0.03]
radius = 7e-3
)" + wound +
           "\n";
}

// An instrument that stands still.
std::string instrument(const std::string& name, const std::string& place, const std::string& action) {
    return "[[body]]\nname = \"" + name + "\"\nshape = \"sphere\"\nsize = 0.002\ntriangles = 100\nmotion = \"hand\"\nposition = " + place +
           "\napart = [\"block\"]\n[[tool]]\nbody = \"" + name + "\"\ntip_radius = 0.001\n[[tool.path]]\ntime = 0.0\nposition = " + place +
           "\n[[tool.action]]\n" + action + "\n";
}

std::string theatre() {
    return bleeding_block() +
           instrument("pen", "[0.0, 0.0, 0.031]",
                      "kind = \"cauterise\"\nbodies = \"block\"\npoint = [0.0, 0.0, -0.001]\npower = 120.0\nspot = 6e-3\nat = [0.5, 2.0]") +
           instrument("hose", "[0.012, 0.0, 0.06]", "kind = \"irrigate\"\nrate = 900.0\npoint = [0.0, 0.0, -0.002]\nat = [0.1, 1.4]") +
           instrument("sucker", "[0.02, 0.0, 0.034]",
                      "kind = \"suck\"\nrate = 6000.0\nreach = 0.012\npoint = [0.0, 0.0, -0.002]\nat = [0.3, 3.0]");
}

FluidAmounts amounts_of(const World& w) {
    FluidShapeScratch scratch;
    return measure_fluids(surfaces_of(w), w.fluids, w.fluid_state, scratch);
}

double smoke_error(const World& w) {
    const SmokeLedger& l = w.fluid_state.smoke;
    const double there = std::accumulate(w.fluid_state.puffs.mass.begin(), w.fluid_state.puffs.mass.end(), 0.0);
    return l.emitted > 0 ? std::abs(l.emitted - l.sucked - l.cleared - there) / l.emitted : 0;
}

// Bled and irrigated liquid is on surfaces, in the air, sucked or lost, in every pass of a run in which all of that happens; smoke
// likewise. Breaks when a drop that lands, a cell that is sucked or a film that flows makes or loses liquid.
TEST(Fluids, TheLedgerCloses) {
    double worst = 0, drops = 0, pools = 0, most_smoke = 0;
    run(WrittenScene("ledger", theatre()).build().world, 180, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const FluidAmounts a = amounts_of(w);
        worst = std::max({worst, std::abs(a.error), smoke_error(w)});
        drops = std::max(drops, a.drops), pools = std::max(pools, a.pools);
        most_smoke = std::max(most_smoke, std::accumulate(w.fluid_state.puffs.mass.begin(), w.fluid_state.puffs.mass.end(), 0.0));
        const FluidLedger& l = w.fluid_state.ledger;
        EXPECT_LE(a.blood, (l.bled - l.sucked_blood - l.lost_blood) * (1 + 1e-12) + 1e-18);
        if (pass < 179) return;
        EXPECT_EQ(find_fault(w), "");
        EXPECT_NEAR(a.blood, l.bled - l.sucked_blood - l.lost_blood, 1e-12 * l.bled);
        EXPECT_NEAR(l.irrigated, 900e-6 / 60 * 1.3, 900e-6 / 60 / 50);
        EXPECT_GT(l.sucked, 0.2 * (l.bled + l.irrigated));
        EXPECT_GT(l.sucked_blood, 0);
        EXPECT_LT(l.sucked_blood, l.sucked) << "water too";
        EXPECT_GT(w.fluid_state.smoke.sucked, 0);
        std::printf(
            "bled %.3f ml, irrigated %.3f, sucked %.3f (%.3f of blood), film %.3f, pools %.3f, drops %.3f; smoke %.3g of %.3g kg "
            "sucked; errors up to %.2g\n",
            1e6 * l.bled, 1e6 * l.irrigated, 1e6 * l.sucked, 1e6 * l.sucked_blood, 1e6 * a.film, 1e6 * a.pools, 1e6 * a.drops,
            w.fluid_state.smoke.sucked, w.fluid_state.smoke.emitted, worst);
    });
    EXPECT_GT(drops, 0);
    EXPECT_GT(pools, 0);
    EXPECT_GT(most_smoke, 0);
    EXPECT_LT(worst, 1e-12);
}

TEST(Fluids, SameBitsForThreadsAndWithoutScratch) {
    expect_same_bits(WrittenScene("wet_bits", theatre()), 75, [](const Frame& frame) {
        const FluidState& s = frame.world().fluid_state;
        EXPECT_GT(s.ledger.sucked, 0);
        EXPECT_GT(s.ledger.irrigated, 0);
        EXPECT_FALSE(s.puffs.mass.empty());
    });
}

// A saved state goes on as the run that it is of.
TEST(Fluids, ASavedStateGoesOn) {
    const WrittenScene scene("wet_replay", theatre());
    CaptureRecord record;
    uint64_t hash = 0;
    const auto states = [](const auto& visit) {
        for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
            if (resource_kind(static_cast<Resource>(r)) == ResourceKind::kState) visit(static_cast<Resource>(r));
    };
    run(scene.build().world, 90, [&](Frame& frame, int pass) {
        if (pass == 49) states([&](Resource r) { save_resource(frame.world(), r, record); });
        if (pass == 89) hash = state_hash(frame.world());
    });
    World again = scene.build().world;
    states([&](Resource r) { load_resource(record, r, again); });
    run(std::move(again), 40, [&](Frame& frame, int pass) {
        if (pass == 39) {
            EXPECT_EQ(state_hash(frame.world()), hash);
        }
    });
}

// Poiseuille: pi d^4 p / (128 mu l); bleeds by it until the tissue has coagulated, then no more.
TEST(Fluids, AVesselBleedsByPoiseuilleUntilItIsCoagulated) {
    const std::string vessel = "pressure = 12000.0\ndiameter = 5e-4\nlength = 0.02";
    const double rate = std::numbers::pi * std::pow(5e-4, 4) * 12000 / (128 * 3.5e-3 * 0.02);
    const std::string pen =
        instrument("pen", "[0.0, 0.0, 0.031]",
                   "kind = \"cauterise\"\nbodies = \"block\"\npoint = [0.0, 0.0, -0.001]\npower = 200.0\nspot = 8e-3\nat = [0.5, 2.5]");
    double before = 0, after = 0;
    run(WrittenScene("vessel", bleeding_block(vessel) + pen).build().world, 180, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        if (pass == 29) {
            EXPECT_NEAR(w.fluid_state.ledger.bled, 0.5 * rate, 1e-9 * rate + rate / 990);
            EXPECT_NEAR(w.fluid_state.bleeding[0], rate, 1e-12 * rate);
        }
        if (pass == 150) before = w.fluid_state.ledger.bled;
        if (pass == 179) after = w.fluid_state.ledger.bled;
        if (pass == 179) {
            EXPECT_EQ(w.fluid_state.bleeding[0], 0.0);
            EXPECT_GT(w.action_state.progress[0].burnt, 1e-4);
        }
    });
    EXPECT_GT(before, 0.5 * rate);
    EXPECT_EQ(after, before);
}

// A sphere is pressed onto the wound: it bleeds by what the pressure of the blood is above that of the contact, whose force is
// summed here over all contacts of the block, which are all at the wound; pressed harder it stops, and goes on when let go.
TEST(Fluids, PressureStopsABleeding) {
    const std::string press = R"(
[[body]]
name = "swab"
shape = "sphere"
size = 0.03
triangles = 600
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, 0.048]
[[body.path]]
time = 1.0
position = [0.0, 0.0, 0.040]
[[body.path]]
time = 1.2
position = [0.0, 0.0, 0.048]
)";
    const double rate = 300e-6 / 60;
    std::string text = bleeding_block("rate = 300.0") + press;
    text.replace(text.find("radius = 7e-3"), 13, "radius = 0.02");
    text.replace(text.find("[fluid]\n"), 8, "[fluid]\nblood_pressure = 150.0\n");
    bool partly = false, stopped = false;
    double most = 0;
    uint64_t before = 0;
    run(WrittenScene("pressed", text).build().world, 90, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const ContactConstraints& rows = w.contact_constraints;
        double impulse = 0;
        for (size_t i = 0; i < rows.body.size(); ++i)
            impulse += std::abs(rows.impulse[i].dot(rotate(w.poses.orientation[rows.other[i]], rows.normal[i])));
        const double seconds = static_cast<double>(w.clock.tick - before) * 1e-3;
        before = w.clock.tick;
        const double pressure = impulse / (seconds * w.fluids.wound[0].area), expected = rate * std::max(0.0, 1 - pressure / 150);
        EXPECT_NEAR(w.fluid_state.bleeding[0], expected, 1e-3 * rate) << pass;
        most = std::max(most, pressure);
        partly |= expected > 0.2 * rate && expected < 0.8 * rate;
        stopped |= w.fluid_state.bleeding[0] == 0;
        if (pass == 89) {
            EXPECT_NEAR(w.fluid_state.bleeding[0], rate, 1e-9 * rate);
        }
    });
    std::printf("pressed with up to %.0f Pa\n", most);
    EXPECT_TRUE(partly);
    EXPECT_TRUE(stopped);
}

// A staple through the vessel closes it; one beside it does not.
TEST(Fluids, AStapleClosesAVessel) {
    const auto scene = [](const std::string& place) {
        return R"(
gravity = [0.0, 0.0, 0.0]
staples = 20
[fluid]
gravity = [0.0, 0.0, -9.81]
bodies = "ball"
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
name = "plate"
shape = "sphere"
size = 0.04
triangles = 300
motion = "static"
position = [0.0, 0.0, -0.042]
[[wound]]
body = "ball"
place = )" + place +
               R"(
rate = 60.0
)" + instrument("pen", "[0.0, 0.0, -0.021]", "kind = \"staple\"\nat = [0.25]\nreach = 3e-3");
    };
    for (const bool beside : {false, true}) {
        std::string text = scene(beside ? "[0.012, 0.0, -0.016]" : "[0.0, 0.0, -0.02]");
        text.replace(text.find("apart = [\"block\"]"), 17, "apart = [\"ball\", \"plate\"]");
        run(WrittenScene("stapled", text).build().world, 30, [&](Frame& frame, int pass) {
            const World& w = frame.world();
            if (pass == 10) {
                EXPECT_NEAR(w.fluid_state.bleeding[0], 1e-6, 1e-18);
            }
            if (pass < 29) return;
            EXPECT_EQ(w.action_state.progress[0].done, 1u);
            EXPECT_NEAR(w.fluid_state.bleeding[0], beside ? 1e-6 : 0, 1e-18);
        });
    }
}

// A sheet that a blade cuts bleeds along its new rim; its films hang together as the surface does, and nothing is lost. Breaks when a
// film keeps edges of triangles that are gone.
TEST(Fluids, ACutBleedsAndItsFilmFollows) {
    std::vector<Override> overrides{
        {"mesh.triangles", "400"}, {"mesh.cut_capacity", "800"}, {"fluid.gravity", "[0.0, 0.0, -9.81]"}, {"fluid.bodies", "\"mesh\""}};
    World world =
        std::move(build_scene(read_scene_file(source_folder() / "content/scenes/cut_sheet.toml", overrides), Looks::kPlain).world);
    world.actions.action[0].bleeding = 2e-6;  // m^2/s
    double length = 0, expected = 0, worst = 0;
    uint64_t before = 0;
    run(std::move(world), 150, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const Vec3d* rest = w.meshes.position.data() + w.meshes.info[w.bodies.mesh[0]].vertices.first;
        for (const OpenedEdge& e : w.action_state.opened) length += (rest[e.a] - rest[e.b]).norm();
        expected += 2e-6 * length * static_cast<double>(w.clock.tick - before) * 1e-3;
        before = w.clock.tick;
        worst = std::max(worst, std::abs(amounts_of(w).error));
        if (pass < 149) return;
        EXPECT_EQ(find_fault(w), "");
        EXPECT_GT(length, 0.02);
        EXPECT_NEAR(w.fluid_state.ledger.bled, expected, 1e-9 * expected);
        // every film edge is one of the surface, and the conductances of a piece are those of a film made of it
        FluidState fresh = w.fluid_state;
        connect_film(w.meshes, w.bodies.mesh[0], w.fluids.body[0], fresh);
        EXPECT_EQ(fresh.from, w.fluid_state.from);
        EXPECT_EQ(fresh.conductance, w.fluid_state.conductance);
        const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[0]);
        size_t edges = 0;
        for (size_t e = 0; e < fresh.from.size(); ++e) edges += fresh.from[e] != fresh.to[e];
        EXPECT_EQ(edges, mesh.edge.size());
        std::printf("cut %.1f mm, bled %.3f ml, error %.2g\n", 1e3 * length, 1e6 * w.fluid_state.ledger.bled, worst);
    });
    EXPECT_LT(worst, 1e-12);
}

// Liquid moves with the surface that it is on: with gravity off it stays at its vertices while the block is pressed.
TEST(Fluids, AFilmMovesWithItsBody) {
    std::string text = bleeding_block("rate = 300.0\nuntil = 0.2") + R"(
[[body]]
name = "swab"
shape = "sphere"
size = 0.03
triangles = 600
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.01, 0.0, 0.047]
[[body.path]]
time = 0.8
position = [0.0, 0.0, 0.038]
)";
    text.replace(text.find("gravity = [0.0, 0.0, -9.81]"), 27, "gravity = [0.0, 0.0, 0.0]");
    std::vector<double> before;
    Float4 place{};
    run(WrittenScene("moved", text).build().world, 60, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const uint32_t spot = w.fluids.spot[0];
        if (pass == 14) before = w.fluid_state.volume, place = w.particles.offset[w.bodies.particles[0].first + spot];
        if (pass < 59) return;
        EXPECT_EQ(w.fluid_state.volume, before);
        EXPECT_GT(before[spot], 0);
        EXPECT_GT(std::abs(place.z - w.particles.offset[w.bodies.particles[0].first + spot].z), 1e-3f) << "it has moved";
    });
}

// Wet and dry in contact: the dry one gets wet where they touch, from what is there, and nothing is lost. Away from it nothing passes.
TEST(Fluids, BodiesThatTouchShareLiquid) {
    const auto scene = [](const char* height) {
        std::string text = bleeding_block("rate = 300.0\nuntil = 0.3") + R"(
[[body]]
name = "swab"
shape = "sphere"
size = 0.03
triangles = 600
motion = "kinematic"
[[body.path]]
time = 0.0
position = [0.0, 0.0, )" + height +
                           R"(]
)";
        text.replace(text.find("bodies = [\"block\", \"dish\"]"), 26, "bodies = [\"block\", \"swab\"]");
        return text;
    };
    for (const bool touches : {true, false}) {
        run(WrittenScene("shared", scene(touches ? "0.0445" : "0.055")).build().world, 60, [&](Frame& frame, int pass) {
            const World& w = frame.world();
            EXPECT_LT(std::abs(amounts_of(w).error), 1e-12);
            if (pass < 59) return;
            const Range cells = w.fluids.body[1].cells;
            const double on_swab =
                std::accumulate(w.fluid_state.volume.begin() + cells.first, w.fluid_state.volume.begin() + cells.end(), 0.0);
            std::printf("%.3f of %.3f ml on the swab\n", 1e6 * on_swab, 1e6 * w.fluid_state.ledger.bled);
            if (touches) {
                EXPECT_GT(on_swab, 0.02 * w.fluid_state.ledger.bled);
                EXPECT_LT(on_swab, 0.9 * w.fluid_state.ledger.bled);
            } else {
                EXPECT_EQ(on_swab, 0.0);
            }
            EXPECT_EQ(find_fault(w), "");
        });
    }
}

// A puff spreads by variance 2 D t on each axis, rises by v c (1 - exp(-t / c)), thins out by exp(-k t); a nozzle takes the gas that
// flows to it. By closed forms; the passes are exact but for suction.
TEST(Fluids, SmokeSpreadsRisesAndIsSucked) {
    const std::string sucker = instrument("sucker", "[0.0, 0.0, 0.2]", "kind = \"suck\"\nrate = 12000.0\nreach = 0.001\nat = [1.0, 2.0]") +
                               instrument("pen", "[0.0, 0.1, 0.2]", "kind = \"cauterise\"\nbodies = \"block\"\npower = 10.0\nat = [90.0]");
    World world = std::move(WrittenScene("smoke", bleeding_block() + sucker).build().world);
    Puffs& puffs = world.fluid_state.puffs;
    const Vec3d from(0, 0, 0.15);
    puffs.position.push_back(from), puffs.variance.push_back(1e-4), puffs.mass.push_back(1e-7), puffs.age.push_back(0);
    world.fluid_state.smoke.emitted = 1e-7;
    const FluidParams p = world.fluids.params;
    double mass = 0, expected = 0;
    run(std::move(world), 120, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const Puffs& now = w.fluid_state.puffs;
        const double t = static_cast<double>(w.clock.tick) * 1e-3;
        EXPECT_LT(smoke_error(w), 1e-12);
        if (pass == 59) {
            EXPECT_NEAR(now.variance[0], 1e-4 + 2 * p.smoke_diffusion * t, 1e-15);
            EXPECT_NEAR(now.position[0].z() - from.z(), p.smoke_rise * p.smoke_cooling * (1 - std::exp(-t / p.smoke_cooling)), 1e-12);
            EXPECT_NEAR(now.mass[0], 1e-7 * std::exp(-p.smoke_clearing * t), 1e-19);
            mass = expected = now.mass[0];
        }
        if (pass >= 60 && !now.mass.empty()) {
            // the density at the nozzle is that of the Gaussian, times the flow of 0.2 l/s
            const double density = std::exp(-(now.position[0] - Vec3d(0, 0, 0.2)).squaredNorm() / (2 * now.variance[0])) /
                                   std::pow(2 * std::numbers::pi * now.variance[0], 1.5);
            expected *= std::exp(-2e-4 * density / 60 - p.smoke_clearing / 60);
            EXPECT_NEAR(now.mass[0], expected, 0.05 * mass) << pass;
        }
        if (pass == 119) {
            EXPECT_LT(now.mass[0], 0.6 * mass);
            std::printf("%.3g of %.3g kg left\n", now.mass[0], mass);
        }
    });
}

TEST(Fluids, WhatCannotBeIsRefused) {
    const auto error = [](const std::string& from, const std::string& to) {
        std::string text = theatre();
        text.replace(text.find(from), from.size(), to);
        return WrittenScene("refused_wet", text).error();
    };
    EXPECT_EQ(error("rate = 300.0", "rate = 301.0"), "");
    EXPECT_NE(error("rate = 300.0", "rate = 300.0\nlength = 0.1").find("needs either rate"), std::string::npos);
    EXPECT_NE(error("body = \"block\"", "body = \"blok\"").find("no body is named"), std::string::npos);
    EXPECT_NE(error("bodies = [\"block\", \"dish\"]", "bodies = \"dish\"").find("not among [fluid] bodies"), std::string::npos);
    EXPECT_NE(error("bodies = [\"block\", \"dish\"]", "bodies = [\"block\", \"pen\"]").find("held by a hand"), std::string::npos);
    EXPECT_NE(error("rate = 900.0\n", "").find("rate"), std::string::npos);
    EXPECT_NE(error("[fluid]\n", "[fluid]\nsmoke_cooling = 0.0\n").find("smoke_cooling"), std::string::npos);
    EXPECT_NE(error("place = [0.0, 0.0, 0.03]\n", "").find("place"), std::string::npos);
}

}  // namespace
}  // namespace trocar
