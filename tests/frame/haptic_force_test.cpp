#include <gtest/gtest.h>

#include <cmath>

#include "engine/base/error.hpp"
#include "engine/devices/device.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "frame/scenes_under_test.hpp"
#include "systems/frame/frame.hpp"
#include "systems/haptics/tick.hpp"
#include "systems/haptics/tool.hpp"
#include "tests/reference/haptic_rig.hpp"
#include "tests/reference/local_patches.hpp"
#include "tests/reference/poked_tissue.hpp"

// The force on the hand compared with the tissue's force on the simulated tool, in whole frames.
namespace trocar {
namespace {

// The forces of one tool's ticks, and the mean force of the tissue on the tool's body in every pass.
struct FeltForces {
    HandTool tool;
    Device device;  // reads from the world while it is stepped
    HapticScratch scratch;
    ToolState state;
    std::vector<double> time;    // s, times of the ticks
    std::vector<Vec3d> hand;     // m, device positions
    std::vector<Vec3d> felt;     // N
    std::vector<double> middle;  // s, middle of each pass
    std::vector<Vec3d> pushed;   // N
    double lowest_energy = 0;    // J, of the passivity observer
    double oldest = 0;           // s, largest age of a surface used for a force

    // ticks like the frame, on the model that it just published
    void on_pass(const World& w) {
        for (uint64_t k = 0; k < w.clock.period; ++k) {
            const double t = static_cast<double>(w.clock.tick + k) * 1e-3;
            const DeviceState at = read_device(device, t);
            tick_tool(haptic_params(w.clock.contact_rate), w.local_contact[0], t, tool, {}, at, scratch, state);
            oldest = std::max(oldest, state.model_age);
            time.push_back(t);
            hand.push_back(at.position);
            felt.push_back(state.output.force);
        }
    }
};

FeltForces feel(World world, uint64_t until) {
    FeltForces f;
    ThreadPool pool(0);
    pool.run([&] {
        Frame frame(std::move(world), {});
        World& w = frame.world();
        f.tool = w.haptics.tool[0];
        f.device = device_of(w.haptics, w.paths, f.tool);
        frame.set_contact_hook({[](void* user, World& at) { static_cast<FeltForces*>(user)->on_pass(at); }, &f});
        while (w.clock.tick < until) {
            const double start = static_cast<double>(w.clock.tick) * 1e-3;
            frame.step();
            const double period = static_cast<double>(w.clock.period) * 1e-3;  // of the previous pass
            ASSERT_EQ((w.haptics.state[0].output.force - f.state.output.force).norm(), 0) << "the frame ticks otherwise";
            f.middle.push_back(start + 0.5 * period);
            f.pushed.push_back(w.haptics.state[0].contact_impulse / period);
        }
        f.lowest_energy = w.haptics.state[0].safety.lowest_energy;
    });
    return f;
}

// Device force compared with the tissue's force over some time (s).
struct Felt {
    double felt = 0, pushed = 0;  // N, means of the magnitudes
    double error = 0;             // N, root mean square of the difference
    double noise = 0;             // N, root mean square of the difference minus its mean
    double step = 0;              // N, root mean square of the change from tick to tick
};
Felt compare(const FeltForces& f, double from, double to) {
    Felt sum;
    Vec3d bias = Vec3d::Zero();
    size_t n = 0, pass = 0;
    for (size_t k = 1; k < f.time.size(); ++k) {
        if (f.time[k] < from || f.time[k] >= to) continue;
        while (f.middle[pass + 1] < f.time[k]) ++pass;
        const double share = (f.time[k] - f.middle[pass]) / (f.middle[pass + 1] - f.middle[pass]);
        const Vec3d pushed = (1 - share) * f.pushed[pass] + share * f.pushed[pass + 1], off = f.felt[k] - pushed;
        sum.felt += f.felt[k].norm(), sum.pushed += pushed.norm();
        sum.error += off.squaredNorm(), sum.step += (f.felt[k] - f.felt[k - 1]).squaredNorm();
        bias += off;
        ++n;
    }
    const double count = static_cast<double>(n);
    sum.felt /= count, sum.pushed /= count;
    sum.noise = std::sqrt(std::max(0.0, sum.error / count - (bias / count).squaredNorm()));
    sum.error = std::sqrt(sum.error / count), sum.step = std::sqrt(sum.step / count);
    return sum;
}

// Pressed, held and dragged over a liver: the hand feels the tissue's force on the tool. Breaks when every
// surface vertex is extrapolated with its own velocity: 14 % too much force while dragged, 0.41 N of it
// noise, and 3.4 mJ given to the hand.
TEST(HapticForce, TheHandFeelsWhatTheTissueDoes) {
    const FeltForces f = feel(small_scene("probe_on_liver", "10000").world, 2700);
    struct Part {
        const char* name;
        double from, to, ratio, error, step;
    };
    for (const Part& part : {Part{"press", 0.9, 1.5, 0.02, 0.03, 0.005}, Part{"hold", 1.52, 1.6, 0.015, 0.03, 0.005},
                             Part{"drag", 1.75, 2.55, 0.03, 0.13, 0.04}}) {
        const Felt felt = compare(f, part.from, part.to);
        std::printf("%-5s felt %.3f N of %.3f N, error %.3f N rms, noise %.3f N rms, from tick to tick %.4f N rms\n", part.name, felt.felt,
                    felt.pushed, felt.error, felt.noise, felt.step);
        EXPECT_GT(felt.pushed, 0.5);
        EXPECT_NEAR(felt.felt / felt.pushed, 1, part.ratio) << part.name;
        EXPECT_LT(felt.error, part.error) << part.name;
        EXPECT_LT(felt.step, part.step) << part.name;
    }
    EXPECT_GT(f.lowest_energy, -1e-3);
}

// A jab faster than any surface, and back out. The observer's energy stays above -1 mJ, and from the first
// contact on the hand never receives more energy than it supplied, computed from the commanded forces, each
// held until the next tick. Breaks when the ramped force is counted as the tissue's (-5.7 mJ).
TEST(HapticForce, AJabGivesNoEnergy) {
    const FeltForces f = feel(small_scene("probe_on_liver", "10000").world, 5300);
    EXPECT_GT(f.lowest_energy, -1e-3);
    double given = 0, least = 0, largest = 0;
    for (size_t k = 1; k < f.time.size(); ++k) {
        if (f.time[k] < 3.4) continue;
        const Vec3d displacement = f.hand[k] - f.hand[k - 1];
        given -= f.felt[k - 1].dot(displacement);
        largest = std::max(largest, f.felt[k].norm());
        least = std::min(least, given);
    }
    std::printf("hand gave %.1f mJ in all, least %.3f mJ; observer's least %.3f mJ; largest force %.2f N\n", 1e3 * given, 1e3 * least,
                1e3 * f.lowest_energy, largest);
    // what the tissue bears, without a click at the first touch
    double bears = 0;
    for (size_t pass = 0; pass < f.pushed.size(); ++pass)
        if (f.middle[pass] >= 3.4) bears = std::max(bears, f.pushed[pass].norm());
    EXPECT_GT(largest, 0.7 * bears);
    EXPECT_LT(largest, 1.5 * bears);
    EXPECT_GT(given, 2e-3);
    EXPECT_GT(least, -1e-3);
}

// An arm pokes a liver at several positions, at 1 to 2 Hz and up to 20 mm deep. Computed from the commanded
// forces, each held until the next tick, no poke returns more energy than it took. Breaks when the coupling's
// damping drives the hand instead of damping it.
TEST(HapticForce, PokingTissueGivesNoEnergy) {
    World world = small_scene("probe_on_liver", "5000").world;
    reference::poke_at(world, 0, 20, 1);
    const reference::PokeEnergy e = reference::poke_energy(std::move(world), 20);
    std::printf("%u pokes, largest force %.2f N, hand gave %.1f mJ; least %.4f mJ, of one poke %.4f mJ; observer's least %.4f mJ\n",
                e.pokes, e.largest, 1e3 * e.given, 1e3 * e.least, 1e3 * e.least_poke, 1e3 * e.observer);
    EXPECT_EQ(e.unlike, 0) << "the frame ticks otherwise";
    EXPECT_GT(e.pokes, 15);
    EXPECT_GT(e.largest, 1);
    EXPECT_GT(e.given, 0.01);
    EXPECT_GT(e.least, -1e-4);
    EXPECT_GT(e.least_poke, -1e-3);
    EXPECT_GT(e.observer, -1e-3);
}

// A dial driven through its detents touches the tool repeatedly. The force on the hand stays within the
// dial's resistance (friction, detent and damping over the lever) plus the impact of the tool's 50 g on the
// dial's inertia. Breaks when the force is computed from a surface that lags the touch by a pass or two (1.1
// N).
TEST(HapticForce, ADrivenDialIsMetWithoutASpike) {
    const FeltForces f = feel(small_scene("dial_and_button", "600").world, 5400);
    double largest = 0;
    for (size_t k = 1; k < f.time.size(); ++k)
        if (f.time[k] > 3.3) largest = std::max(largest, f.felt[k].norm());
    const Felt felt = compare(f, 3.5, 5.2);
    std::printf("largest %.3f N; felt %.3f N of %.3f N, error %.3f N rms\n", largest, felt.felt, felt.pushed, felt.error);
    EXPECT_GT(largest, 0.3);
    EXPECT_LT(largest, 0.85);
    EXPECT_GT(f.lowest_energy, -1e-4);
}

// contact.rate sets how often contacts are detected: no surface used for a force is older than one period,
// and the hand feels the same tissue.
TEST(HapticForce, ContactsAreFoundAtTheRateOfTheScene) {
    const std::string scene = (source_folder() / "content/scenes/probe_on_liver.toml").string();
    for (const uint32_t rate : {30u, 60u, 120u, 240u}) {
        const FeltForces f = feel(
            build_scene(read_scene_file(scene, {{"liver.triangles", "4000"}, {"contact.rate", std::to_string(rate)}}), Looks::kPlain).world,
            1500);
        EXPECT_EQ(f.middle.size(), size_t{rate} * 3 / 2);
        EXPECT_LT(f.oldest, 1.0 / rate);
        EXPECT_GT(f.oldest, 1.0 / rate - 2.1e-3);
        const Felt felt = compare(f, 0.9, 1.4);
        std::printf("%u Hz: oldest %.1f ms, felt %.3f N of %.3f N, error %.3f N rms\n", rate, 1e3 * f.oldest, felt.felt, felt.pushed,
                    felt.error);
        EXPECT_NEAR(felt.felt / felt.pushed, 1, 0.03);
        EXPECT_LT(felt.error, 0.05);
    }
    for (const char* wrong : {"0", "50", "480", "60.5", "fast"})
        EXPECT_THROW(read_scene_file(scene, {{"contact.rate", wrong}}), InputError) << wrong;
}

// ---- two tools ----

struct TwoTools {
    std::vector<std::array<Vec3d, 2>> force, impulse;  // N, on the hands; N s per pass, on the tools
    std::vector<Vec3d> momentum;                       // N s, of the tissue after a pass
};
Vec3d momentum_of(const World& w, uint32_t body) {
    Vec3d sum = Vec3d::Zero();
    for (uint32_t p = w.bodies.particles[body].first; p < w.bodies.particles[body].end(); ++p)
        if (w.particles.offset[p].w > 0)
            sum += Vec3d(w.particles.velocity_x[p], w.particles.velocity_y[p], w.particles.velocity_z[p]) / double(w.particles.offset[p].w);
    return sum;
}
// Two hands on a free-floating liver; the tools are stored in the scene's order or swapped.
TwoTools press_with_two(bool swapped) {
    const std::string file = (source_folder() / "content/scenes/two_tools.toml").string();
    SceneFile scene = read_scene_file(
        file, {{"liver.triangles", "2000"}, {"liver.anchor", "shape"}, {"liver.fixed_below", "-1"}, {"liver.tissue.damping", "0"}});
    scene.tools[1].path[1].time = 0.5, scene.tools[1].path[2].time = 1.0;  // both at once: a floating liver
                                                                           // drifts
    if (swapped) std::swap(scene.tools[0], scene.tools[1]);
    TwoTools seen;
    ThreadPool pool(0);
    pool.run([&] {
        Frame frame(build_scene(scene, Looks::kPlain).world, {});
        World& w = frame.world();
        const size_t a = swapped ? 1 : 0, b = 1 - a;
        while (w.clock.tick < 1200) {
            frame.step();
            const std::vector<ToolState>& s = w.haptics.state;
            seen.force.push_back({s[a].output.force, s[b].output.force});
            seen.impulse.push_back({s[a].contact_impulse, s[b].contact_impulse});
            seen.momentum.push_back(momentum_of(w, 0));
        }
    });
    return seen;
}

// T17. Two tools on one tissue: the tissue gains the momentum that the tools lose, pass by pass, and neither
// hand's force depends on the order of the tools.
TEST(HapticForce, T17_TwoToolsOnOneTissueBalanceAndAreAlike) {
    const TwoTools one = press_with_two(false), other = press_with_two(true);
    ASSERT_EQ(one.force.size(), other.force.size());
    double largest = 0, both = 0;
    for (size_t k = 0; k < one.force.size(); ++k) {
        for (size_t tool = 0; tool < 2; ++tool) {
            EXPECT_EQ((one.force[k][tool] - other.force[k][tool]).norm(), 0) << k;
            largest = std::max(largest, one.impulse[k][tool].norm());
        }
        both = std::max(both, std::min(one.impulse[k][0].norm(), one.impulse[k][1].norm()));
    }
    EXPECT_GT(both, 1e-3) << "both press at once";
    double worst = 0;
    for (size_t k = 1; k < one.force.size(); ++k) {
        const Vec3d gained = one.momentum[k] - one.momentum[k - 1];
        worst = std::max(worst, (gained + one.impulse[k][0] + one.impulse[k][1]).norm());
    }
    std::printf("largest impulse of a pass %.4f N s, worst balance %.2e N s\n", largest, worst);
    EXPECT_LT(worst, 1e-4 * largest);
}

// ---- texture ----

// A long strip with a height that is a sine of x.
Mesh waved_strip(double length, double wave, double height) {
    Mesh mesh;
    const uint32_t n = static_cast<uint32_t>(length / (wave / 32));
    for (uint32_t i = 0; i <= n; ++i) {
        const double x = length * i / n;
        for (int k = 0; k <= 4; ++k) mesh.position.push_back({x, 2e-3 * (k - 2), height * std::sin(2 * M_PI * x / wave)});
    }
    for (uint32_t i = 0; i < n; ++i)
        for (uint32_t k = 0; k < 4; ++k) {
            const uint32_t a = 5 * i + k, b = a + 5;
            mesh.triangle.push_back({a, b, b + 1});
            mesh.triangle.push_back({a, b + 1, a + 1});
        }
    return mesh;
}

// T19. A stiff texture drawn under a hand at 1 kHz: the force oscillates like a mass on a spring, K a m w^2 /
// (m w^2 - K) (w above resonance), without any added vibration.
TEST(HapticForce, T19_AStiffTextureIsFeltWithoutBuzz) {
    constexpr double kWave = 4e-3, kHeight = 3e-5, kPush = -1.0, kLength = 0.14, kStart = 0.01;
    for (const double frequency : {30.0, 60.0, 100.0}) {
        reference::HapticRig rig = reference::still_rig(reference::make_patch(waved_strip(kLength, kWave, kHeight)));
        rig.params.force_slew = 1e9;
        const double stiffness = rig.tool.coupling_stiffness, rate = 2 * M_PI * frequency, speed = frequency * kWave;
        reference::FreeDevice device;
        const double inertia = device.mass * rate * rate, wave = kHeight * stiffness * inertia / (inertia - stiffness);
        // on its path from the start: below the resting height by the contact force, oscillating in antiphase
        // to the texture
        const double swing = -kHeight * stiffness / (inertia - stiffness), phase = 2 * M_PI * kStart / kWave;
        rig.at({kStart, 0, 0.01});
        rig.go({kStart, 0, reference::kRigRadius + kPush / stiffness + swing * std::sin(phase)}, 0.1);
        device.x = rig.state.device.position.z(), device.v = swing * rate * std::cos(phase);
        double mean = 0, square = 0, most = 0;
        const int ticks = static_cast<int>((kLength - 2 * kStart) / speed / reference::kRigTick);
        for (int k = 0; k < ticks; ++k) {
            const double force = rig.at({kStart + speed * k * reference::kRigTick, 0, device.x}, {speed, 0, device.v}).z();
            mean += force, square += force * force, most = std::max(most, std::abs(force + kPush));
            device.step(force + kPush);
        }
        mean /= ticks;
        const double felt = std::sqrt(2 * (square / ticks - mean * mean));
        std::printf("%.0f Hz: felt %.4f N of %.4f N, farthest from the push %.4f N\n", frequency, felt, wave, most);
        EXPECT_NEAR(mean, -kPush, 0.1 * wave);
        EXPECT_NEAR(felt / wave, 1, 0.1);
        EXPECT_LT(most, 1.5 * wave);
    }
}

}  // namespace
}  // namespace trocar
