#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <functional>

#include "bench/haptics/haptics.hpp"
#include "bench/suites.hpp"
#include "content/shapes/shape_library.hpp"
#include "tests/reference/brute_force_proxy.hpp"
#include "tests/reference/haptic_rig.hpp"
#include "tests/reference/local_patches.hpp"
#include "tests/reference/sample_meshes.hpp"
// Haptic forces against their ideal: closed forms, a slow proxy, energy and force steps.
namespace trocar::bench {
namespace {

using reference::FreeDevice;
using reference::HapticRig;
using reference::kRigRadius;
using reference::kRigTick;
using reference::still_rig;

constexpr double kWhole = 2 * M_PI;

// ---- replayed paths ----

// A surface, the device's path through it at 1 kHz, and the rest position of the tip's centre on the true
// shape for a device position. The slow proxy also needs its previous position.
struct ReplayedPath {
    const char* name;
    Mesh mesh;
    uint32_t ticks;
    uint32_t every;  // ticks between two compared ones
    std::function<Vec3d(double)> device;
    std::function<Vec3d(const Vec3d& device, const Vec3d& before)> proxy;
};

Vec3d out_of_plane(const Vec3d& p, const Vec3d& normal, double height) { return p + std::max(0.0, height - normal.dot(p)) * normal; }

ReplayedPath plane_path() {
    return {
        "plane",
        reference::make_plane(40),
        4000,
        1,
        [](double t) { return Vec3d(0.03 * std::sin(kWhole * 0.5 * t), 0.02 * std::sin(kWhole * 0.8 * t), 4e-3 * std::cos(kWhole * t)); },
        [](const Vec3d& p, const Vec3d&) { return out_of_plane(p, Vec3d::UnitZ(), kRigRadius); }};
}

ReplayedPath sphere_path() {
    constexpr double kBig = 0.03;
    return {"sphere",
            reference::make_sphere(Vec3d::Zero(), kBig, 6),
            4000,
            1,
            [](double t) -> Vec3d {
                const double a = kWhole * 0.25 * t, b = 0.6 * std::sin(kWhole * 0.4 * t);
                const double r = kBig + kRigRadius - 1e-3 + 4e-3 * std::cos(kWhole * t);
                return r * Vec3d(std::cos(a) * std::cos(b), std::sin(a) * std::cos(b), std::sin(b));
            },
            [](const Vec3d& p, const Vec3d&) -> Vec3d { return p * std::max(1.0, (kBig + kRigRadius) / p.norm()); }};
}

// Two walls that meet at the y axis at 90 degrees: the closest point in a corner of half-spaces.
ReplayedPath groove_path() {
    const Vec3d left = Vec3d(1, 0, 1).normalized(), right = Vec3d(-1, 0, 1).normalized();
    const Mesh mesh = reference::make_ground(40, 0.05, [](const Vec3d& p) { return Vec3d(p.x(), p.y(), std::abs(p.x())); });
    return {"groove",
            mesh,
            4000,
            1,
            [](double t) {
                return Vec3d(8e-3 * std::sin(kWhole * 0.7 * t), 0.02 * std::sin(kWhole * 0.3 * t), 6e-3 + 7e-3 * std::cos(kWhole * t));
            },
            [=](const Vec3d& p, const Vec3d&) -> Vec3d {
                const Vec3d one = out_of_plane(p, left, kRigRadius), other = out_of_plane(p, right, kRigRadius);
                if (right.dot(one) >= kRigRadius) return one;
                if (left.dot(other) >= kRigRadius) return other;
                return {0, p.y(), kRigRadius * std::sqrt(2.0)};
            }};
}

Mesh torus(double ring, double tube, uint32_t around, uint32_t across) {
    Mesh mesh;
    for (uint32_t i = 0; i < around; ++i) {
        for (uint32_t k = 0; k < across; ++k) {
            const double u = kWhole * i / around, v = kWhole * k / across, r = ring + tube * std::cos(v);
            mesh.position.push_back({r * std::cos(u), r * std::sin(u), tube * std::sin(v)});
            const uint32_t a = i * across + k, b = i * across + (k + 1) % across;
            const uint32_t c = (i + 1) % around * across + k, d = (i + 1) % around * across + (k + 1) % across;
            mesh.triangle.push_back({a, c, b});
            mesh.triangle.push_back({b, c, d});
        }
    }
    return mesh;
}

ReplayedPath torus_path() {
    static constexpr double kRing = 0.03, kTube = 0.012;
    return {"torus",
            torus(kRing, kTube, 320, 128),
            4000,
            1,
            [](double t) {
                const double u = kWhole * 0.2 * t, v = kWhole * 0.5 * t;
                const double r = kTube + kRigRadius - 1e-3 + 3e-3 * std::cos(kWhole * t);
                return Vec3d((kRing + r * std::cos(v)) * std::cos(u), (kRing + r * std::cos(v)) * std::sin(u), r * std::sin(v));
            },
            [](const Vec3d& p, const Vec3d&) -> Vec3d {
                const Vec3d middle = kRing * Vec3d(p.x(), p.y(), 0).normalized(), out = p - middle;
                return middle + out * std::max(1.0, (kTube + kRigRadius) / out.norm());
            }};
}

// Part of a liver around the top of its belly side, rubbed by the device; reference: the slow proxy.
ReplayedPath organ_path(bool quick) {
    const Mesh liver = make_shape("liver", 20'000);
    Vec3d top = liver.position[0];
    for (const Vec3d& p : liver.position)
        if (p.z() > top.z()) top = p;
    Mesh patch;
    patch.position = liver.position;
    for (const Triangle& t : liver.triangle)
        if ((liver.position[t[0]] - top).norm() < 0.022) patch.triangle.push_back(t);
    std::vector<uint32_t> row(liver.position.size(), kNone);
    Mesh small;
    for (Triangle t : patch.triangle) {
        for (uint32_t& v : t) {
            if (row[v] == kNone) row[v] = static_cast<uint32_t>(small.position.size()), small.position.push_back(liver.position[v]);
            v = row[v];
        }
        small.triangle.push_back(t);
    }
    const Mesh slow = small;
    return {"organ (liver of 20,000 triangles)",
            small,
            1000,
            quick ? 50u : 10u,
            [top](double t) -> Vec3d {
                return top + Vec3d(8e-3 * std::sin(kWhole * 1.0 * t), 6e-3 * std::sin(kWhole * 1.6 * t), 4e-3 * std::cos(kWhole * 2 * t));
            },
            [slow](const Vec3d& p, const Vec3d& before) {
                return reference::brute_force_proxy(slow.position, slow.triangle, before, p, kRigRadius, 2e-5);
            }};
}

struct PathErrors {
    double rms = 0, largest = 0, peak = 0;  // N
    double step = 0;                        // largest change of force beyond the ramp, over stiffness * device displacement
    double bare_step = 0;                   // the same without the ramp
    double us = 0;                          // per tick
};

PathErrors replay(const ReplayedPath& path) {
    HapticRig rig = still_rig(reference::make_patch(path.mesh));
    PathErrors errors;
    Vec3d last = path.device(0), before = path.device(0), last_force = Vec3d::Zero();
    double seconds = 0;
    uint32_t judged = 0;
    for (uint32_t k = 0; k < path.ticks; ++k) {
        const Vec3d device = path.device(rig.time());
        const double start = thread_seconds();
        const Vec3d force = rig.at(device);
        seconds += thread_seconds() - start;
        const double spring_change = rig.tool.coupling_stiffness * (device - last).norm();
        const double change = (force - last_force).norm(), ramp = rig.params.force_slew * kRigTick;
        if (spring_change > 1e-6) {
            errors.step = std::max(errors.step, (change - ramp) / spring_change);
            errors.bare_step = std::max(errors.bare_step, change / spring_change);
        }
        last = device, last_force = force;
        if (k % path.every != 0) continue;
        before = path.proxy(device, before);
        const Vec3d wanted = rig.tool.coupling_stiffness * (before - device);
        errors.rms += (force - wanted).squaredNorm();
        errors.largest = std::max(errors.largest, (force - wanted).norm());
        errors.peak = std::max(errors.peak, wanted.norm());
        ++judged;
    }
    errors.rms = std::sqrt(errors.rms / judged);
    errors.us = 1e6 * seconds / path.ticks;
    return errors;
}

Row limit_row(std::string name, double ours, std::string unit, double at_least, double aim) {
    Row row;
    row.name = std::move(name), row.ours = ours, row.unit = std::move(unit);
    row.goal = Goal::kLimit, row.at_least = at_least, row.aim = aim;
    return row;
}

void path_rows(Report& report) {
    report.heading("Force on replayed paths against the true shape (organ: against a slow proxy on the same mesh), % of the peak force");
    double step = 0, bare_step = 0;
    for (const ReplayedPath& path : {plane_path(), sphere_path(), groove_path(), torus_path(), organ_path(report.quick())}) {
        const PathErrors e = replay(path);
        char note[96];
        std::snprintf(note, sizeof note, "peak %.2f N, %.1f us a tick", e.peak, e.us);
        Row rms = limit_row(std::string("force error RMS: ") + path.name, 100 * e.rms / e.peak, "%", 2, 1);
        rms.note = note;
        report.add(rms);
        report.add(limit_row(std::string("force error, largest: ") + path.name, 100 * e.largest / e.peak, "%", 7, 3));
        step = std::max(step, e.step), bare_step = std::max(bare_step, e.bare_step);
    }
    Row row = limit_row("force step beyond the ramp over stiffness x way, all paths", step, "", 1.05, 1.0);
    char note[96];
    std::snprintf(note, sizeof note, "ramp of %.1f N a tick; without it %.1f (facets of convex shapes)",
                  HapticParams{}.force_slew * kRigTick, bare_step);
    row.note = note;
    report.add(row);
}

// ---- slow simulation under a fast hand ----

// Massless tissue under a coupling: F(u) = 300 u + 2e6 u^3 (N, m) = K (device displacement - u).
double yield_of(double device, double stiffness) {
    double u = 0;
    for (int k = 0; k < 60; ++k) u -= (300 * u + 2e6 * u * u * u - stiffness * (device - u)) / (300 + 6e6 * u * u + stiffness);
    return u;
}

// RMS error (% of the peak force) of three ways to render at 1 kHz a simulation of `rate` Hz that is one
// frame old: its force, its force extrapolated, and a tick on its surface.
struct RateErrors {
    double hold = 0, drawn_on = 0, ours = 0;
};
RateErrors slow_simulation(double rate, double hand_rate) {
    constexpr double kStroke = 8e-3;  // m
    HapticRig rig(reference::make_patch(reference::make_plane(20)));
    rig.params = haptic_params(static_cast<uint32_t>(rate));
    const double stiffness = rig.tool.coupling_stiffness;
    const auto device = [&](double t) { return 0.5 * kStroke * (1 - std::cos(kWhole * hand_rate * t)); };  // downwards
    const auto speed_at = [&](double t) { return 0.5 * kStroke * kWhole * hand_rate * std::sin(kWhole * hand_rate * t); };
    const auto force_at = [&](double t) { return stiffness * (device(t) - yield_of(device(t), stiffness)); };
    const LocalContactModel flat = rig.model;
    RateErrors sum;
    double peak = 0;
    int64_t published = -1;
    constexpr int kTicks = 4000;
    for (int k = 0; k < kTicks; ++k) {
        const double t = k * kRigTick;
        const auto pass = static_cast<int64_t>(t * rate + 1e-9) - 1;  // the last finished pass
        if (pass >= 0 && pass != published) {
            const double when = static_cast<double>(pass) / rate, near = 1e-6;
            const double u = yield_of(device(when), stiffness);
            const double rise = (yield_of(device(when + near), stiffness) - yield_of(device(when - near), stiffness)) / (2 * near);
            rig.model.time = when;
            for (size_t v = 0; v < flat.position.size(); ++v) {
                rig.model.position[v] = flat.position[v] - Vec3d(0, 0, u);
                rig.model.velocity[v] = Vec3d(0, 0, -rise);
            }
            // results of the simulation's last two passes
            const Vec3d down(0, 0, -1);
            const double before = when - 1 / rate;
            const double share =
                pass == 0 ? 0 : give_share(-down, down * (u - yield_of(device(before), stiffness)), down * (device(when) - device(before)));
            rig.model.compliance = {0, share, -down, down * device(when) + Vec3d(0, 0, kRigRadius), down * speed_at(when), when, 0};
            if (share == 0) rig.model.compliance.body = kNone;
            group_triangles(rig.model);
            published = pass;
        }
        // starts slightly above the surface, so that the tip counts as outside
        const double force = rig.at({0, 0, kRigRadius + (k < 3 ? 1e-6 : 0) - device(t)}, {0, 0, -speed_at(t)}).z();
        if (published < 1) continue;
        const double newest = force_at(static_cast<double>(pass) / rate), older = force_at(static_cast<double>(pass - 1) / rate);
        const double drawn_on = newest + (newest - older) * (t * rate - static_cast<double>(pass));
        const double wanted = force_at(t);
        sum.hold += std::pow(newest - wanted, 2), sum.drawn_on += std::pow(drawn_on - wanted, 2);
        sum.ours += std::pow(force - wanted, 2);
        peak = std::max(peak, wanted);
    }
    const auto share = [&](double s) { return 100 * std::sqrt(s / kTicks) / peak; };
    return {share(sum.hold), share(sum.drawn_on), share(sum.ours)};
}

void rate_rows(Report& report) {
    report.heading("A hand on tissue that a slower simulation moves, one frame late: RMS force error, % of the peak");
    for (const auto& [rate, hand] : {std::pair{30.0, 1.0}, {60.0, 1.0}, {30.0, 2.0}, {120.0, 5.0}}) {
        const RateErrors e = slow_simulation(rate, hand);
        char name[96], note[96];
        std::snprintf(name, sizeof name, "%.0f Hz simulation, %.0f Hz hand", rate, hand);
        std::snprintf(note, sizeof note, "held force %.2f %%, force drawn on in time %.2f %%", e.hold, e.drawn_on);
        Row row = limit_row(name, e.ours, "%", 1.5, 0.8);
        if (rate != 30 || hand != 1) row.goal = Goal::kNone;
        row.note = note;
        report.add(row);
    }
}

// ---- stability ----

// Whether the oscillation of a device pushed with 1 N against a wall decays, with samples `late` ticks old.
bool wall_is_quiet(double stiffness, int late) {
    HapticRig rig = still_rig(reference::make_patch(reference::make_plane()));
    rig.tool.coupling_stiffness = stiffness;
    rig.params.force_slew = 1e9;
    constexpr double kPush = -1.0;
    rig.at({0, 0, 0.01});
    FreeDevice device;
    device.x = kRigRadius + kPush / stiffness;
    rig.go({0, 0, device.x}, 0.1);
    device.v = 0.005;
    std::deque<double> seen(static_cast<size_t>(late) + 1, device.x);
    std::array<double, 4> swing{};
    for (double& s : swing) {
        double low = 1, high = -1;
        for (int k = 0; k < 1000; ++k) {
            seen.push_back(device.x), seen.pop_front();
            device.step(rig.at({0, 0, seen.front()}).z() + kPush);
            low = std::min(low, device.x), high = std::max(high, device.x);
        }
        s = high - low;
    }
    return swing[3] < swing[1];
}

// Energy that the wall and the device's damping returned beyond the energy stored in the wall's spring, J,
// over minutes of poking: the passivity observer of Hannaford & Ryu (2002) including the device's damping.
double leaked_energy(double minutes) {
    HapticRig rig = still_rig(reference::make_patch(reference::make_plane()));
    rig.tool = HandTool{};
    rig.tool.tip_radius = kRigRadius;
    const double stiffness = rig.tool.coupling_stiffness, yields_at = rig.tool.max_force / stiffness;
    FreeDevice device;
    device.x = kRigRadius + 5e-3;
    double given = 0, most = 0, leaked = 0;
    const auto ticks = static_cast<int64_t>(minutes * 60'000);
    for (int64_t k = 0; k < ticks; ++k) {
        const double t = rig.time(), push = std::sin(kWhole * 1.7 * t) + 0.4 * std::sin(kWhole * 0.31 * t) - 0.5;
        const double force = rig.at({0, 0, device.x}, {0, 0, device.v}).z();
        given += force * device.step(force + push);
        const double depth = std::max(0.0, kRigRadius - device.x), bent = std::min(depth, yields_at);
        const double stored = stiffness * bent * (0.5 * bent + (depth - bent));
        const double taken = device.lost - given - stored;
        most = std::max(most, taken);
        leaked = std::max(leaked, most - taken);
    }
    return leaked;
}

void stability_rows(Report& report) {
    report.heading("Stability, device of 0.1 kg and 0.5 N s/m");
    for (const int late : {0, 1}) {
        const FreeDevice device;
        const double theory = device.damping / (0.5 * kRigTick + late * kRigTick);
        double low = 0.5 * theory, high = 1.5 * theory;
        for (int k = 0; k < 12; ++k) {
            const double middle = 0.5 * (low + high);
            (wall_is_quiet(middle, late) ? low : high) = middle;
        }
        char name[96], note[96];
        std::snprintf(name, sizeof name, "Z-width: shortfall from b / (T/2 + t_d), samples %d ticks late", late);
        std::snprintf(note, sizeof note, "stable to %.0f N/m, theory %.0f N/m", low, theory);
        Row row = limit_row(name, 100 * std::max(0.0, 1 - low / theory), "%", 10, 5);
        row.note = note;
        report.add(row);
    }
    const double minutes = report.quick() ? 1 : 10;
    char name[96];
    std::snprintf(name, sizeof name, "energy given by a wall in %.0f min of poking", minutes);
    report.add(limit_row(name, 1e3 * leaked_energy(minutes), "mJ", 1, 0.1));
}

// ---- faults ----

// ms from the first bad tick until the force of a pressed tip is zero.
double safe_after(const std::function<void(HapticRig&, DeviceState&)>& break_it) {
    HapticRig rig(reference::make_patch(reference::make_plane()));
    rig.params.model_timeout = 1e9;
    rig.tool.max_force = 3.3;
    rig.at({0, 0, 0.01});
    rig.go({0, 0, 0}, 0.05);
    const double start = rig.time();
    DeviceState sample = rig.state.device;
    for (int k = 0; k < 1000; ++k) {
        sample.time = rig.time();
        break_it(rig, sample);
        if (rig.with(sample).norm() == 0) return 1e3 * (rig.time() - start);
    }
    return kNoValue;
}

void fault_rows(Report& report) {
    report.heading("Time to no force after a fault, ms");
    const double last = [] {
        HapticRig rig(reference::make_patch(reference::make_plane()));
        rig.at({0, 0, 0.01});
        rig.go({0, 0, 0}, 0.05);
        return rig.state.device.time;
    }();
    report.add(limit_row("position not a number", safe_after([](HapticRig&, DeviceState& s) { s.position.x() = NAN; }), "ms", 20, 5));
    report.add(limit_row("a glitch of 100 mm", safe_after([](HapticRig&, DeviceState& s) { s.position.x() = 0.1; }), "ms", 20, 5));
    report.add(limit_row("unplugged: samples stop", safe_after([&](HapticRig&, DeviceState& s) { s.time = last; }), "ms", 20, 5));
    const auto stalled = [](double surface_age) {
        HapticRig rig(reference::make_patch(reference::make_plane()));
        rig.tool.max_force = 3.3;
        rig.tool.limits.surface_age = surface_age;
        const auto renew = [&] { rig.model.time = rig.time(); };
        for (int k = 0; k <= 50; ++k) renew(), rig.at({0, 0, 0.01 - 0.0002 * k});
        const double start = rig.time();
        for (int k = 0; k < 1000; ++k)
            if (rig.at({0, 0, 0}).norm() == 0) return 1e3 * (rig.time() - start);
        return kNoValue;
    };
    report.add(limit_row("simulation stalls: no new surface, surface_age = 14 ms (for 120 Hz)", stalled(0.014), "ms", 20, 5));
    Row stall = limit_row("the same where the scene does not say surface_age (0.1 s)", stalled(0), "ms", kNoValue, kNoValue);
    stall.goal = Goal::kNone;
    stall.note = "a surface of up to that age is still felt: those of 30 Hz passes are 35 ms old, a busy machine delays them";
    report.add(stall);
}

}  // namespace
}  // namespace trocar::bench

int haptics_suite(int argc, char** argv) {
    using namespace trocar::bench;
    Report report("haptics", argc, argv);
    report.check_parts(argc, argv, {"paths", "rates", "stability", "faults", "poke", "tick", "shell", "live"});
    const std::string only = argc > 1 ? argv[1] : "";
    const auto wanted = [&](const char* part) { return only.empty() || only == part; };
    if (wanted("paths")) path_rows(report);
    if (wanted("rates")) rate_rows(report);
    if (wanted("stability")) stability_rows(report);
    if (wanted("faults")) fault_rows(report);
    if (wanted("poke")) poke_rows(report);
    if (wanted("tick")) tick_rows(report);
    if (wanted("shell")) shell_rows(report);
    if (wanted("live")) live_rows(report);
    return report.finish();
}
