#include <cstdio>
#include <memory>

#include "bench/haptics/haptics.hpp"
#include "content/scene/build_scene.hpp"
#include "content/scene/find_scene.hpp"
#include "content/scene/scene_file.hpp"
#include "engine/devices/device.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/real_time.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/report/figures.hpp"
#include "systems/frame/frame.hpp"
#include "systems/haptics/contact/device_motion.hpp"
#include "systems/haptics/live_haptics.hpp"
#include "systems/haptics/tool.hpp"
// Two instruments with whole-body contact on one deforming liver: tick times and force errors. They take over
// new surfaces as live ones do.
namespace trocar::bench {
namespace {

// The scene's probe and a second one next to it.
World two_probes(const char* triangles) {
    const std::vector<Override> overrides = {{"liver.triangles", triangles}};
    SceneFile scene = read_scene_file(find_scene("shaft_on_liver"), overrides);
    BodySpec body = scene.bodies[1];
    ToolSpec tool = scene.tools[0];
    body.name = tool.body = "second";
    const Vec3d aside(0.0, -0.035, 0.0);
    body.position += aside;
    for (Keyframe& key : tool.path) key.position += aside;
    scene.bodies.push_back(body);
    scene.tools.push_back(tool);
    return build_scene(scene).world;
}

struct Wrench {
    Vec3d force = Vec3d::Zero(), torque = Vec3d::Zero();
    bool settled = false;
};

// Balance of coupling and contacts at a device pose, from every triangle and every point: alternates
// brute-force distances and planes with the balance until nothing moves. The touched body starts at its
// simulated contacts, offset from its triangles by the model's gap. Without friction. If the planes alternate
// for ever there is no balance to compare with: not settled.
Wrench balanced(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool, const ToolState& start,
                const DeviceState& device) {
    PlacedSurface placed;
    const double age = std::clamp(time - model.time, -params.greatest_age, params.greatest_age);
    begin_moment(model, {age, model.compliance.body, surface_follow(params, model.compliance, device.position, time)}, placed);
    std::vector<std::array<Vec3d, 3>> corner(model.triangle.size());
    for (size_t t = 0; t < corner.size(); ++t)
        for (int k = 0; k < 3; ++k) {
            const uint32_t v = model.triangle[t][k];
            corner[t][k] = model.position[v] + age * model.velocity[v];
            if (model.body[t] == model.compliance.body) corner[t][k] += placed.moment.follow;
        }
    Vec3d tip = start.proxy;
    Quat turn = start.proxy_turn;
    Wrench sum;
    for (int round = 0; round < 60; ++round) {
        std::vector<ShellPlane> planes;
        for (uint32_t k = 0; k < tool.point_shell.size(); ++k) {
            const Vec3d arm = rotate(turn, tool.point_shell[k].arm), point = tip + arm;
            NearestTriangle nearest;
            nearest.at.squared_distance = 2.5e-5;
            for (uint32_t t = 0; t < corner.size(); ++t) {
                const auto& [a, b, c] = corner[t];
                if ((a - point).squaredNorm() > 4e-4) continue;  // no edge is longer
                const TrianglePoint at = closest_point_on_triangle(point, a, b, c);
                if (at.squared_distance < nearest.at.squared_distance) nearest = {t, at, point + at.offset};
            }
            if (nearest.triangle == kNone) continue;
            const SurfaceSide side = side_of(model, nearest, 0, placed);
            ShellPlane plane;
            plane.distance = side.distance - (model.body[nearest.triangle] == model.compliance.body ? model.compliance.gap : 0),
            plane.normal = side.normal, plane.arm = arm;
            planes.push_back(plane);
        }
        ShellSprings springs{tool.coupling_stiffness, tool.turn_stiffness, tool.surface_stiffness, {}};
        springs.to_device = {device.position - tip, rotation_vector(turn, device.orientation)};
        const ShellStep step = solve_shell(springs, planes);
        sum = {};
        for (const ShellPlane& plane : planes) {
            const ShellForce f = shell_force(springs, plane, step);
            sum.force += f.force, sum.torque += plane.arm.cross(f.force);
        }
        tip += step.shift;
        turn = normalized(multiply(from_rotation_vector(step.turn), turn));
        sum.settled = step.shift.norm() + tool.shell_radius * step.turn.norm() < 1e-10;
        if (sum.settled) break;
    }
    return sum;
}

// One tool: timed ticks, and frictionless ticks that are compared.
struct ShellProbe {
    HandTool tool, smooth;
    Device device;
    LocalContactModel model;  // the one in use
    bool waits = false;       // a newer one is available
    HapticScratch scratch;
    PointShellScratch smooth_scratch;
    ToolState state, smooth_state;
};

struct ShellTimer {
    HapticParams params;
    std::vector<std::unique_ptr<ShellProbe>> probe;
    std::vector<TickCost>* cost = nullptr;  // of all tools together
    bool judges = false;
    uint64_t tick = 0, judged = 0, unsettled = 0, looked_at = 0, worst = 0;
    size_t triangles = 0, points = 0, contacts = 0;
    uint32_t every = 47;  // not a multiple of a pass, so that surfaces of every age are compared
    double force2 = 0, torque2 = 0, largest = 0, peak = 0, torque_peak = 0;

    void judge(ShellProbe& p, const LocalContactModel& model, double time) {
        const Wrench wanted = balanced(params, model, time, p.smooth, p.smooth_state, p.smooth_state.device);
        if (!wanted.settled) return void(++unsettled);
        Wrench felt;
        for (const ShellContact& c : p.smooth_state.contact) felt.force += c.force, felt.torque += c.arm.cross(c.force);
        force2 += (felt.force - wanted.force).squaredNorm();
        torque2 += (felt.torque - wanted.torque).squaredNorm();
        if (const double off = (felt.force - wanted.force).norm(); off > largest) largest = off, worst = tick;
        peak = std::max(peak, wanted.force.norm());
        torque_peak = std::max(torque_peak, wanted.torque.norm());
        ++judged;
    }
    // As in the live thread: one per tick.
    void take_model(const World& world) {
        const auto count = static_cast<uint32_t>(probe.size());
        for (uint32_t n = 0; n < count; ++n) {
            const uint32_t k = (first_asked(tick, count) + n) % count;
            if (!probe[k]->waits) continue;
            probe[k]->model = world.local_contact[k];
            probe[k]->waits = false;
            return;
        }
    }
    void on_pass(World& world) {
        for (const auto& p : probe) p->waits = true;
        for (const uint64_t end = world.clock.tick + world.clock.period; tick < end; ++tick) {
            take_model(world);
            const double time = static_cast<double>(tick) * 1e-3;
            double seconds = 0;
            bool touches = true;
            for (size_t k = 0; k < probe.size(); ++k) {
                ShellProbe& p = *probe[k];
                const LocalContactModel& model = p.model;
                const DeviceState sample = read_device(p.device, time);
                const double start = thread_seconds();
                tick_tool(params, model, time, p.tool, {}, sample, p.scratch, p.state);
                seconds += thread_seconds() - start;
                touches = touches && p.state.contacts > 0;
                triangles = std::max(triangles, model.triangle.size());
                contacts = std::max(contacts, p.state.contact.size());
                if (!judges) continue;
                point_shell_tick(params, model, time, p.smooth, sample, p.smooth_scratch, p.smooth_state);
                if (tick % every == 7 && p.smooth_state.contacts > 0) judge(p, model, time);
            }
            note_tick(tick, seconds, touches, *cost);
        }
    }
};

Row limited(std::string name, double ours, std::string unit, double at_least, double aim) {
    Row row;
    row.name = std::move(name), row.ours = ours, row.unit = std::move(unit);
    row.goal = Goal::kLimit, row.at_least = at_least, row.aim = aim;
    return row;
}

}  // namespace

void shell_rows(Report& report) {
    report.heading("6-DOF: two instruments of 1,000 points on a deforming liver of 100,000 triangles (time of the thread)");
    ThreadPool pool(0);
    std::vector<TickCost> cost;
    ShellTimer timer;  // of the run whose forces are compared, the last one: comparing is work between the ticks
    const int runs = tick_runs(report);
    for (int run = 0; run < runs; ++run) {
        timer = {};
        timer.every = report.quick() ? 197 : 47;
        timer.judges = run + 1 == runs;
        timer.cost = &cost;
        pool.run([&] {
            Frame frame(two_probes("100000"), {});
            const World& w = frame.world();
            for (const HandTool& tool : w.haptics.tool) {
                auto probe = std::make_unique<ShellProbe>();
                probe->tool = probe->smooth = tool;
                probe->smooth.friction = 0;
                probe->device = device_of(w.haptics, w.paths, tool);
                timer.points += tool.point_shell.size();
                timer.probe.push_back(std::move(probe));
            }
            timer.params = haptic_params(w.clock.contact_rate);
            frame.set_contact_hook({[](void* user, World& world) { static_cast<ShellTimer*>(user)->on_pass(world); }, &timer});
            while (static_cast<double>(w.clock.tick) < (report.quick() ? 1500 : 3500)) frame.step();
        });
    }
    for (const auto& probe : timer.probe) timer.looked_at += probe->scratch.point_shell.looked_at;
    const std::vector<double> us = touching_us(cost);
    char note[280];
    std::snprintf(note, sizeof note,
                  "minimum of %d identical runs per tick; %zu points, %zu triangles in reach at most, up to %zu contacts a tool, median "
                  "%.0f us, largest %.0f us, %zu ticks with both in contact; %.0f points looked at a tick",
                  runs, timer.points, timer.triangles, timer.contacts, quantile(us, 0.5), quantile(us, 1), us.size(),
                  static_cast<double>(timer.looked_at) / static_cast<double>(timer.tick));
    Row row = limited("6-DOF tick, both tools in contact, p99.9", 1e-3 * quantile(us, 0.999), "ms", 0.6, 0.35);
    row.note = note;
    row.error = 100 * std::sqrt(timer.force2 / static_cast<double>(std::max<uint64_t>(1, timer.judged))) / timer.peak;
    report.add(row);
    std::snprintf(note, sizeof note,
                  "against all points and all triangles iterated to balance, %llu ticks (%llu more have none: planes come and go); peak "
                  "%.2f N, largest error %.3f %% in tick %llu",
                  static_cast<unsigned long long>(timer.judged), static_cast<unsigned long long>(timer.unsettled), timer.peak,
                  100 * timer.largest / timer.peak, static_cast<unsigned long long>(timer.worst));
    Row force = limited("6-DOF force error RMS", row.error, "%", 2, 1);
    force.note = note;
    report.add(force);
    std::snprintf(note, sizeof note, "about the tip; peak %.1f mN m", 1e3 * timer.torque_peak);
    Row torque =
        limited("6-DOF torque error RMS",
                100 * std::sqrt(timer.torque2 / static_cast<double>(std::max<uint64_t>(1, timer.judged))) / timer.torque_peak, "%", 2, 1);
    torque.note = note;
    report.add(torque);
}

}  // namespace trocar::bench
