#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <random>
#include <sstream>

#include "content/shapes/shape_library.hpp"
#include "frame/scenes_under_test.hpp"
#include "frame/written_scene.hpp"
#include "systems/frame/frame.hpp"
#include "tests/reference/local_patches.hpp"

// What a hand feels in scenes at random: tips of all sizes, tissue and rates, bodies that pass a still tool. In all of them the force of
// the tissue on the simulated tool, or a closed form, says what is right.
namespace trocar {
namespace {

struct AnyNumber {
    std::mt19937 random;
    double between(double low, double high) { return low + (high - low) * (random() / 4294967296.0); }
    double log_between(double low, double high) { return std::exp(between(std::log(low), std::log(high))); }
    template <typename T, size_t n>
    T one_of(const std::array<T, n>& values) {
        return values[random() % n];
    }
};

template <typename... Part>
std::string text_of(const Part&... part) {
    std::ostringstream text;
    text.precision(12);
    (text << ... << part);
    return text.str();
}

// Forces of a tool at the end of a pass, N.
struct ToolForces {
    Vec3d felt = Vec3d::Zero(), tissue = Vec3d::Zero();
    Vec3d device = Vec3d::Zero();  // m
};

// Runs a scene; the forces of its tools after every pass.
std::vector<std::vector<ToolForces>> forces_in(const std::string& name, const std::string& text, double seconds) {
    std::vector<std::vector<ToolForces>> passes;
    BuiltScene scene = WrittenScene(name, text).build();
    ThreadPool pool(0);
    pool.run([&] {
        Frame frame(std::move(scene.world), {});
        const World& w = frame.world();
        while (static_cast<double>(w.clock.tick) * 1e-3 < seconds) {
            const uint64_t start = w.clock.tick;
            frame.step();
            const double period = 1e-3 * static_cast<double>(w.clock.tick - start);
            for (std::vector<ToolForces>& now = passes.emplace_back(); const ToolState& s : w.haptics.state)
                now.push_back({s.output.force, s.contact_impulse / period, s.device.position});
        }
    });
    return passes;
}

std::string tool_text(const std::string& body, double radius, int dof, const Vec3d& start, const std::string& path, int triangles = 320) {
    return text_of("[[body]]\nname = \"", body, "\"\nshape = \"sphere\"\nsize = ", 2 * radius, "\ntriangles = ", triangles,
                   "\nmotion = \"hand\"\nmass = 0.05\nposition = [", start.x(), ", ", start.y(), ", ", start.z(), "]\n[[tool]]\nbody = \"",
                   body, "\"\ndof = ", dof, "\ntip_radius = ", radius,
                   "\nstiffness = 500\ndamping = 5\nmax_force = 20\nfriction = 0.1\npath = [", path, "]\n");
}
std::string key(double time, const Vec3d& at) {
    return text_of("{time = ", time, ", position = [", at.x(), ", ", at.y(), ", ", at.z(), "]}");
}
std::string scene_text(double seconds, int rate) {
    return text_of("seconds = ", seconds, "\ngravity = [0, 0, 0]\n[contact]\nrate = ", rate, "\n");
}

// ---- presses ----

struct Press {
    std::string text;
    double seconds = 0;
    std::string about;
};

Press any_press(uint32_t seed, bool large, uint32_t tip_triangles) {
    AnyNumber any{std::mt19937(seed)};
    const bool solid = any.between(0, 1) < 0.4;
    const std::string shape = any.one_of(std::array{"liver", "stomach", "sphere", "kidney"});
    const uint32_t triangles = solid                              ? any.one_of(std::array{2500u, 6000u})
                               : large && any.between(0, 1) < 0.1 ? 100'000u
                                                                  : any.one_of(std::array{2500u, 10'000u, 40'000u});
    const double tip = any.log_between(5e-5, 1e-2), speed = any.log_between(0.02, 0.5), depth = any.between(4e-3, 12e-3),
                 modulus = any.log_between(2e3, 2e4), hold = 0.8;
    const int rate = any.one_of(std::array{60, 90, 120, 240});
    const Mesh mesh = make_shape(shape, triangles);
    double low = 1, high = -1;
    for (const Vec3d& p : mesh.position) low = std::min(low, p.z()), high = std::max(high, p.z());
    // the middle of a face that looks up, above the half that is held
    Vec3d place = Vec3d::Zero();
    for (bool found = false; !found;) {
        const Triangle& t = mesh.triangle[any.random() % mesh.triangle.size()];
        const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
        place = (a + b + c) / 3;
        found = (b - a).cross(c - a).normalized().z() > 0.8 && place.z() > 0.5 * (low + high);
    }
    const Vec3d above = place + Vec3d(0, 0, tip + 0.01), below = place + Vec3d(0, 0, tip - depth);
    const double arrival = (above - below).norm() / speed;
    Press press;
    press.seconds = arrival + hold;
    press.about = text_of("seed ", seed, ": tip ", 1e3 * tip, " mm, ", solid ? "solid " : "shell ", shape, " of ", triangles,
                          " triangles, ", rate, " Hz, ", speed, " m/s, ", modulus, " Pa");
    press.text =
        scene_text(press.seconds, rate) +
        text_of("[[body]]\nname = \"organ\"\nshape = \"", shape, "\"\ntriangles = ", triangles,
                "\nmotion = \"deformable\"\nfixed_below = ", low + 0.3 * (high - low), solid ? "\nmodel = \"solid\"" : "",
                "\n[body.tissue]\nyoungs_modulus = ", modulus, "\ndensity = 1060\ndamping = 60\n",
                solid ? "" : "wall = 8e-3\ndepth = 0.05\n") +
        tool_text("needle", tip, 3, above, key(0, above) + ", " + key(arrival, below) + ", " + key(press.seconds, below), tip_triangles);
    return press;
}

// Presses at random; the means over the last tenth of a second.
struct PressErrors {
    uint32_t presses = 0, lost = 0, off = 0;
    double worst = 0;
};
PressErrors press_at_random(uint32_t first, uint32_t count, bool large, uint32_t tip_triangles) {
    PressErrors errors;
    for (uint32_t seed = first; seed < first + count; ++seed) {
        const Press press = any_press(seed, large, tip_triangles);
        const auto passes = forces_in("press", press.text, press.seconds);
        double felt = 0, tissue = 0;
        const size_t last = std::max<size_t>(1, passes.size() / 10);
        for (size_t k = passes.size() - last; k < passes.size(); ++k) {
            felt += passes[k][0].felt.norm(), tissue += passes[k][0].tissue.norm();
        }
        const double error = std::abs(felt / tissue - 1);
        ++errors.presses;
        errors.lost += felt == 0, errors.off += error > 0.02;
        errors.worst = std::max(errors.worst, error);
        if (error > 0.02) std::printf("%s: felt %.4f N of %.4f N\n", press.about.c_str(), felt / double(last), tissue / double(last));
    }
    std::printf("%u presses, %u lost, %u more than 2 %% off, worst %.1f %%\n", errors.presses, errors.lost, errors.off, 100 * errors.worst);
    return errors;
}

// Whatever the tip is made of: the facets of a ball of 80 triangles lie up to 7 % of its radius inside what the hand feels, of 320 up
// to 1.5 %. Breaks without resting_gap: 10 % off in the first press, then 4 %.
TEST(RandomPresses, TheHandFeelsTheTissueWhateverTheTip) {
    const auto expect_felt = [](uint32_t first, uint32_t count, uint32_t tip_triangles) {
        const PressErrors e = press_at_random(first, count, false, tip_triangles);
        EXPECT_EQ(e.lost, 0u) << tip_triangles;
        EXPECT_EQ(e.off, 0u) << tip_triangles;
    };
    expect_felt(101, 1, 320);
    for (const uint32_t tip_triangles : {80u, 320u}) expect_felt(104, 6, tip_triangles);
    expect_felt(100, 8, 5120);
}
// One each is off: a ball of 8 mm and 80 triangles in a finely meshed shell, where more features are in contact than a tick solves for;
// needles of 0.06 and 0.26 mm that never come to rest in tissue that is coarse or turned inside out.
TEST(LongRandomPresses, TheHandFeelsTheTissueWhateverTheTip) {
    for (const uint32_t tip_triangles : {80u, 320u, 1280u, 5120u}) {
        const PressErrors e = press_at_random(100, 24, false, tip_triangles);
        EXPECT_EQ(e.lost, 0u) << tip_triangles;
        EXPECT_LE(e.off, 1u) << tip_triangles;
    }
}

// ---- bodies that pass a still tool ----

// A box that is moved over a still tip within a few ticks and stops with the tip's centre inside: stiffness times the
// way back to its front. Breaks when a body's motion within a pass is not foreseen, or its surface not swept.
TEST(RandomPresses, AScriptedBodyThatPassesAToolIsFelt) {
    for (const int dof : {3, 6}) {
        for (uint32_t seed = 0; seed < 10; ++seed) {
            AnyNumber any{std::mt19937(seed)};
            const double size = 0.05, depth = any.between(2e-3, 8e-3), radius = any.log_between(5e-5, 5e-3), way = any.between(5e-3, 0.08),
                         speed = any.log_between(0.5, 15), start = any.between(0.1, 0.12);
            const double x0 = -way - 0.5 * size - radius, x1 = depth - 0.5 * size;
            const std::string text =
                scene_text(0.6, any.one_of(std::array{60, 120, 240})) +
                text_of("[[body]]\nname = \"wall\"\nshape = \"box\"\nsize = ", size, "\ntriangles = 1200\nmotion = \"kinematic\"\npath = [",
                        key(0, {x0, 0, 0}), ", ", key(start, {x0, 0, 0}), ", ", key(start + way / speed, {x1, 0, 0}), "]\n") +
                tool_text("tip", radius, dof, {0, 0.001, 0.002}, key(0, {0, 0.001, 0.002}) + ", " + key(1, {0, 0.001, 0.002}));
            const auto passes = forces_in("pass", text, 0.6);
            const double wanted = 500 * (depth + radius), felt = passes.back()[0].felt.norm();
            EXPECT_NEAR(felt / wanted, 1, 0.02) << dof << " degrees of freedom, seed " << seed << ": tip " << 1e3 * radius << " mm, "
                                                << speed << " m/s, " << felt << " N of " << wanted << " N";
        }
    }
}

// ---- first touch ----

// From the first touch until two passes later the hand feels at most 1.5 times what the tissue bears when it is pressed
// slowly to the same depth. Breaks when tissue counts as rigid until its give was seen (1.13 N instead of 0.03 N).
TEST(RandomPresses, FirstTouchDoesNotClick) {
    for (const int dof : {3, 6}) {
        for (const int rate : {60, 120, 240}) {
            const auto text = [&](int hz, double end) {
                return scene_text(end, hz) +
                       "[[body]]\nname = \"liver\"\nshape = \"liver\"\ntriangles = 10000\nmotion = \"deformable\"\nfixed_below = -0.03\n"
                       "[body.tissue]\nyoungs_modulus = 5000\ndensity = 1060\nwall = 8e-3\ndepth = 0.05\ndamping = 60\nfriction = 0.1\n" +
                       tool_text("ball", 7e-3, dof, {0, 0, 0.1}, key(0, {0, 0, 0.1}) + ", " + key(1.2, {0, 0, 0.02}));
            };
            const auto right = forces_in("touch", text(240, 0.8), 0.8), felt = forces_in("touch", text(rate, 0.8), 0.8);
            size_t touched = 0;
            while (felt[touched][0].felt.norm() == 0 && touched + 3 < felt.size()) ++touched;
            for (size_t k = touched; k < touched + 3; ++k) {
                const double deep = felt[k][0].device.z();
                double bears = 0;
                for (const auto& pass : right)
                    if (pass[0].device.z() >= deep - 2e-4) bears = std::max(bears, pass[0].tissue.norm());
                EXPECT_LT(felt[k][0].felt.norm(), 1.5 * bears + 2e-3)
                    << dof << " degrees of freedom, " << rate << " Hz, pass " << k - touched;
            }
        }
    }
}

// ---- a still corner ----

// A corner of a box is pressed into tissue and held: the force of a still hand stays within 1 %. Breaks when a corner in a dent
// has the plane of the nearest triangle only, and goes through its neighbours in turn (147, 178 and 21 %).
TEST(RandomPresses, ACornerHeldStillIsStill) {
    struct Corner {
        uint32_t triangles;
        bool solid;
        double size, mass, x, y, depth;
        const char* rotation;
    };
    for (const Corner& c :
         {Corner{5000, false, 0.02, 0.2, 0.0198404722, -0.00882504479, 0.0499452614, "0.049088, -0.458263, -0.466839, 78.8437"},
          Corner{10000, false, 0.01, 0.05, -0.0171355874, -0.0174782539, 0.0450797036, "1.347682, -0.06635, -0.090979, 32.2397"},
          Corner{10000, true, 0.02, 0.05, 0.0126376804, -0.0061135608, 0.039475174, "-0.648341, -1.376811, -0.917924, 54.9713"}}) {
        const std::string rotation = text_of("rotation = [", c.rotation, "]");
        const auto at = [&](double time, double z) {
            return text_of("{time = ", time, ", position = [", c.x, ", ", c.y, ", ", z, "], ", rotation, "}");
        };
        const std::string text =
            scene_text(3, 60) +
            text_of("[[body]]\nname = \"liver\"\nshape = \"liver\"\ntriangles = ", c.triangles, "\nmotion = \"deformable\"\n",
                    c.solid ? "model = \"solid\"\n" : "",
                    "fixed_below = -0.03\nanchor = \"world\"\n[body.tissue]\nyoungs_modulus = 5000\ndensity = 1060\nwall = 8e-3\n"
                    "depth = 0.05\ndamping = 60\nfriction = 0.1\n[[body]]\nname = \"box\"\nshape = \"box\"\nsize = ",
                    c.size, "\ntriangles = 12\nmotion = \"hand\"\nmass = ", c.mass, "\nposition = [", c.x, ", ", c.y, ", 0.095]\n",
                    rotation, "\n[[tool]]\nbody = \"box\"\ndof = 6\nstiffness = 500\nmax_force = 3.3\nfriction = 0.1\npath = [",
                    at(0, 0.095), ", ", at(1, c.depth), ", ", at(3, c.depth), "]\n");
        const auto passes = forces_in("corner", text, 3);
        double least = 1e9, most = 0;
        for (size_t k = passes.size() - 60; k < passes.size(); ++k)
            least = std::min(least, passes[k][0].felt.norm()), most = std::max(most, passes[k][0].felt.norm());
        EXPECT_LT(most - least, 0.01 * most) << rotation << ": " << least << " to " << most << " N";
    }
}

// ---- two tools on one sheet ----

// Two tips press a thin sheet from both sides at one place: each hand feels the same, steadily, what the tissue bears, and that
// is the stiffness of its coupling times the distance its tip is short of the sheet. Breaks when light tissue between two tools is swept
// too little for their weight (tips in each other), or when a tip that touches the other one too is taken for free of the sheet.
void squeeze_at_random(uint32_t first, uint32_t count, uint32_t may_slip) {
    const Mesh sheet = reference::make_plane(24, 0.05);
    WrittenScene mesh("sheet_mesh", "");
    mesh.path.replace_extension(".obj");
    std::ofstream out(mesh.path);
    for (const Vec3d& p : sheet.position) out << "v " << p.x() << ' ' << p.y() << ' ' << p.z() << '\n';
    for (const Triangle& t : sheet.triangle) out << "f " << t[0] + 1 << ' ' << t[1] + 1 << ' ' << t[2] + 1 << '\n';
    out.close();
    uint32_t slips = 0;
    for (uint32_t seed = first; seed < first + count; ++seed) {
        AnyNumber any{std::mt19937(seed)};
        const double radius = any.one_of(std::array{2e-3, 4e-3, 7e-3}), thickness = any.one_of(std::array{2e-4, 5e-4, 1e-3}),
                     squeeze = any.between(1e-3, 4e-3), x = any.between(-0.01, 0.01), y = any.between(-0.01, 0.01);
        const int rate = any.one_of(std::array{60, 120, 240});
        const double modulus = any.log_between(5e4, 1e6);
        std::string text = scene_text(1.2, rate) +
                           text_of("[[body]]\nname = \"sheet\"\nfile = \"", mesh.path.string(), "\"\nthickness = ", thickness,
                                   "\nmotion = \"deformable\"\n[[body.region]]\nbox = [-1, -1, -1, -0.048, 1, 1]\nfixed = true\n"
                                   "[[body.region]]\nbox = [0.048, -1, -1, 1, 1, 1]\nfixed = true\n[body.tissue]\nyoungs_modulus = ",
                                   modulus, "\ndamping = 30\nfriction = 0.3\n");
        for (const double side : {1.0, -1.0}) {
            const Vec3d far(x, y, side * (radius + 8e-3)), near(x, y, side * (radius + 0.5 * thickness - squeeze));
            text += tool_text(side > 0 ? "up" : "down", radius, 3, far, key(0, far) + ", " + key(0.2, near) + ", " + key(1.5, near));
        }
        const auto passes = forces_in("sheet", text, 1.2);
        const ToolForces up = passes.back()[0], down = passes.back()[1];
        const double size = up.felt.norm();
        double ripple = 0;
        for (size_t k = passes.size() - 10; k < passes.size(); ++k) ripple = std::max(ripple, (passes[k][0].felt - up.felt).norm() / size);
        const std::string about = text_of("seed ", seed, ": tips of ", 1e3 * radius, " mm, ", 1e3 * thickness, " mm thick, ", rate, " Hz, ",
                                          modulus, " Pa, squeezed by ", 1e3 * squeeze, " mm: ", size, " N of ", 500 * squeeze, " N");
        // a tip may slip off the other one, slowly
        slips += ripple > 0.01 || (up.felt + down.felt).norm() > 0.02 * size;
        EXPECT_LT((up.felt + down.felt).norm(), 0.05 * size) << about;
        EXPECT_LT(ripple, 0.03) << about;
        EXPECT_NEAR(size / up.tissue.norm(), 1, 0.02) << about;
        EXPECT_NEAR(down.felt.norm() / down.tissue.norm(), 1, 0.02) << about;
        EXPECT_NEAR(size / (500 * squeeze), 1, 0.1) << about;
    }
    EXPECT_LE(slips, may_slip);
}

TEST(RandomPresses, TwoToolsOnOneSheetFeelTheSame) { squeeze_at_random(0, 7, 1); }
TEST(LongRandomPresses, TwoToolsOnOneSheetFeelTheSame) { squeeze_at_random(0, 20, 2); }

}  // namespace
}  // namespace trocar
