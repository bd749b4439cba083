#include <gtest/gtest.h>

#include <cmath>

#include "engine/device.hpp"
#include "engine/error.hpp"
#include "engine/thread_pool.hpp"
#include "frame/scenes_under_test.hpp"
#include "systems/frame.hpp"
#include "systems/haptic_tick.hpp"
#include "systems/haptic_tool.hpp"

// What the hand feels beside what the tissue does to the simulated tool, in whole frames.
namespace trocar {
namespace {

// The forces of one tool's ticks and the mean force of the tissue on the tool's body in every pass.
struct FeltForces {
    HandTool tool;
    Device device;
    HapticScratch scratch;
    ToolState state;
    std::vector<double> time;          // s, of the ticks
    std::vector<Vec3d> felt;           // N
    std::vector<double> middle;        // s, of the passes
    std::vector<Vec3d> pushed;         // N
    double lowest_energy = 0;          // J, of the observer
    double oldest = 0;                 // s, of the surfaces under the forces

    // ticks as the frame will, on the model that it just published
    void on_pass(const World& w) {
        for (uint64_t k = 0; k < w.clock.period; ++k) {
            const double t = static_cast<double>(w.clock.tick + k) * 1e-3;
            tick_tool(haptic_params(w.clock.contact_rate), w.local_contact[0], t, tool, {}, read_device(device, t), scratch, state);
            oldest = std::max(oldest, state.model_age);
            time.push_back(t);
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
            const double period = static_cast<double>(w.clock.period) * 1e-3;  // of the pass that was
            ASSERT_EQ((w.haptics.state[0].output.force - f.state.output.force).norm(), 0) << "the frame ticks otherwise";
            f.middle.push_back(start + 0.5 * period);
            f.pushed.push_back(w.haptics.state[0].contact_impulse / period);
        }
        f.lowest_energy = w.haptics.state[0].safety.lowest_energy;
    });
    return f;
}

// Device force against the tissue's over some time (s).
struct Felt {
    double felt = 0, pushed = 0;  // N, means of the sizes
    double error = 0;             // N, root mean square of the difference
    double noise = 0;             // N, the same of the difference less its mean
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

// Pressed, held and dragged over a liver: the hand feels what the tissue does to the tool. A surface whose vertices were
// moved on each by its own velocity gave 14 % too much while dragged, 0.41 N of it noise, and 3.4 mJ to the hand.
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

// contact.rate: contacts are found so often, no surface under a force is older than the time from one pass to the next, and
// the hand feels the same tissue.
TEST(HapticForce, ContactsAreFoundAtTheRateOfTheScene) {
    const std::string scene = (source_folder() / "content/scenes/probe_on_liver.toml").string();
    for (const uint32_t rate : {30u, 60u, 120u}) {
        const FeltForces f = feel(build_scene(read_scene_file(scene, {{"liver.triangles", "4000"}, {"contact.rate", std::to_string(rate)}})).world, 1500);
        EXPECT_EQ(f.middle.size(), size_t{rate} * 3 / 2);
        EXPECT_LT(f.oldest, 1.0 / rate);
        EXPECT_GT(f.oldest, 1.0 / rate - 2.1e-3);
        const Felt felt = compare(f, 0.9, 1.4);
        std::printf("%u Hz: oldest %.1f ms, felt %.3f N of %.3f N, error %.3f N rms\n", rate, 1e3 * f.oldest, felt.felt, felt.pushed, felt.error);
        EXPECT_NEAR(felt.felt / felt.pushed, 1, 0.03);
        EXPECT_LT(felt.error, 0.05);
    }
    for (const char* wrong : {"0", "50", "240", "60.5", "fast"})
        EXPECT_THROW(read_scene_file(scene, {{"contact.rate", wrong}}), InputError) << wrong;
}

}  // namespace
}  // namespace trocar
