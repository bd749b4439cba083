#include "systems/haptic_shell.hpp"

#include <algorithm>
#include <cmath>

#include "engine/check.hpp"
#include "engine/geometry/quaternion.hpp"
#include "systems/haptic_device.hpp"
namespace trocar {
namespace {

constexpr double kSlipSpeed = 0.25;  // m/s, of points beyond twice that of the device
constexpr double kThickest = 5e-3;   // m, half of the thickest sheet that points are passed over beside
constexpr double kAgainst = -0.5;    // cosine between a way out and the normal into the instrument
constexpr double kLook = 5e-4;       // m, beyond the band: where no surface is nearer, a point that was outside is left alone
constexpr double kLongestGap = 0.1;  // s, ticks farther apart than this count as this far

struct Pose {
    Vec3d tip = Vec3d::Zero();
    Quat turn;
};

double angle_between(const Quat& a, const Quat& b) { return rotation_vector(a, b).norm(); }

// The surface now and at the tick before.
struct Span {
    double elapsed = 0;  // s
    SurfaceMoment before, now;
};

Span span_of(const HapticParams& params, const LocalContactModel& model, double time, double last_time, bool first,
             const Vec3d& last_device, const Vec3d& device) {
    const auto moment = [&](double age, const Vec3d& at) {
        const double shown = std::clamp(age, -params.greatest_age, params.greatest_age);
        return SurfaceMoment{shown, model.give.body, surface_follow(params, model.give, at, model.time + age)};
    };
    Span span;
    span.elapsed = first ? params.dt : std::clamp(time - last_time, 0.0, kLongestGap);
    span.now = moment(time - model.time, device);
    span.before = moment(time - model.time - span.elapsed, last_device);
    return span;
}

// Takes up how far everything may have come since the scratch was told how near it is.
void note_ways(const LocalContactModel& model, const HandTool& tool, const SurfaceMoment& moment, const Pose& pose,
               ShellScratch& s) {
    const size_t points = tool.shell.size();
    if (s.radius.size() != points || s.sequence != model.sequence || s.model_time != model.time ||
        s.clear.size() != model.shell.clear.size()) {
        s.radius.resize(points);
        for (size_t k = 0; k < points; ++k) s.radius[k] = tool.shell[k].arm.norm();
        if (s.plane.capacity() < points) s.plane.reserve(2 * points), s.clear.reserve(4 * points), s.nearest.reserve(4 * points);
        s.clear = model.shell.clear;
        s.nearest = model.shell.nearest;
        s.sequence = model.sequence;
        s.model_time = model.time;
        s.tip = model.shell.tip;
        s.turn = model.shell.turn;
        s.moment = {0, model.give.body, Vec3d::Zero()};
        s.shifted = s.turned = s.surface_way = 0;
    }
    s.shifted += (pose.tip - s.tip).norm();
    s.turned += angle_between(s.turn, pose.turn);
    s.surface_way += model.fastest * std::abs(moment.age - s.moment.age) + (moment.follow - s.moment.follow).norm();
    s.tip = pose.tip;
    s.turn = pose.turn;
    s.moment = moment;
}

// Whether the model shows every surface that a point may reach.
bool covers(const LocalContactModel& model, const HandTool& tool, const Pose& pose, const SurfaceMoment& moment, double band) {
    const double way = (pose.tip - model.shell.tip).norm() + angle_between(model.shell.turn, pose.turn) * tool.shell_radius;
    return way + model.fastest * std::abs(moment.age) + moment.follow.norm() + band <= model.reach;
}

// What held a point of a body at the tick before; asked for bodies and points that ascend.
struct Before {
    const std::vector<ShellContact>& contact;
    size_t row = 0;
    const ShellContact* find(uint32_t body, uint32_t point) {
        while (row < contact.size() && (contact[row].body < body || (contact[row].body == body && contact[row].point < point))) ++row;
        const bool found = row < contact.size() && contact[row].body == body && contact[row].point == point;
        return found ? &contact[row] : nullptr;
    }
};

ShellPlane plane_of(const LocalContactModel& model, const Span& span, uint32_t point, uint32_t body, const Vec3d& arm,
                    const SurfaceSide& side, const ShellContact* before) {
    ShellPlane plane;
    plane.point = point;
    plane.body = body;
    plane.distance = side.distance;
    plane.normal = side.normal;
    plane.arm = arm;
    plane.side = side.side;
    plane.carried = (span.now.age - span.before.age) * side.velocity;
    if (body == model.give.body) plane.carried += span.now.follow - span.before.follow;
    if (before) {
        // friction goes on from where it was stretched
        plane.slip = before->slip;
        plane.held = before->force.dot(plane.normal);
    }
    return plane;
}

// Fills scratch.plane with the points nearer than `band` to a surface, bodies and points ascending. A way out that leads
// against the instrument's own outside is none: there a thin wall's far side is nearer, and it must not pull the
// instrument through. True if any point was inside.
bool find_planes(const LocalContactModel& model, const HandTool& tool, const Span& span, const Pose& pose, double band,
                 const std::vector<ShellContact>& contact, ShellScratch& s) {
    s.plane.clear();
    begin_moment(model, span.now, s.surface);
    const uint32_t points = static_cast<uint32_t>(tool.shell.size());
    Before before{contact};
    bool inside = false;
    size_t row = 0;
    for (uint32_t root = 0; root < model.shell.node.size(); root = next_tree(model, root)) {
        const uint32_t body = model.shell.node[root].body;
        const double gap = body == model.give.body ? model.give.gap : 0;
        for (uint32_t k = 0; k < points; ++k, ++row) {
            const double ways = s.shifted + s.turned * s.radius[k] + s.surface_way;
            const double known = s.clear[row] - ways, near = band + std::max(0.0, gap);
            if (!s.all_points && known > near) continue;
            const Vec3d arm = rotate(pose.turn, tool.shell[k].arm);
            const uint32_t hint = s.nearest[row];
            const bool was_outside = !s.all_points && known > 0 && hint != kNone;
            const double half = was_outside ? model.half_thickness[hint] : kThickest;
            const double reach = was_outside ? std::min(model.reach, near + kLook + half) : model.reach;
            const NearestTriangle nearest = find_nearest(model, root, pose.tip + arm, hint, reach, s.surface);
            ++s.looked_at;
            s.clear[row] = reach - half + ways;
            if (nearest.triangle == kNone) continue;
            const double apart = std::sqrt(nearest.at.squared_distance) - half;
            if (was_outside && apart >= near) {  // and did not come through
                s.nearest[row] = nearest.triangle;
                s.clear[row] = apart + ways;
                continue;
            }
            const ShellContact* held = before.find(body, k);
            SurfaceSide side = side_of(model, nearest, held ? held->side : 0, s.surface);
            s.nearest[row] = nearest.triangle;
            s.clear[row] = side.distance + ways;
            inside = inside || side.distance < 0;
            side.distance -= gap;
            if (side.distance >= band) continue;
            if (side.distance < 0 && side.normal.dot(rotate(pose.turn, tool.shell[k].inward)) < kAgainst) continue;
            s.plane.push_back(plane_of(model, span, k, body, arm, side, held));
        }
    }
    return inside;
}

// Moves the tool for one tick and leaves what holds it in state.contact.
void move_shell(const ShellSprings& springs, double band, double radius, const Pose& pose, ShellScratch& s, ToolState& state) {
    ShellStep step;
    double most = band;  // and as far as a surface that came in pushes it
    for (const ShellPlane& plane : s.plane)
        if (plane.distance < 0) most = std::max(most, band + plane.carried.norm());
    // friction counts on the normal forces of the tick before, then on those that come out
    for (uint32_t round = 0; round < (springs.friction > 0 ? 2u : 1u); ++round) {
        step = solve_shell(springs, s.plane, step);
        if (springs.friction <= 0 || round > 0) break;
        for (ShellPlane& plane : s.plane) plane.held = shell_force(springs, plane, step).normal;
    }
    const double way = step.shift.norm() + step.turn.norm() * radius;
    if (way > most) step.shift *= most / way, step.turn *= most / way;
    const Quat turned = from_rotation_vector(step.turn);
    state.proxy = pose.tip + step.shift;
    state.proxy_turn = normalized(multiply(turned, pose.turn));
    state.contact.clear();
    for (const ShellPlane& plane : s.plane) {
        const ShellForce f = shell_force(springs, plane, step);
        if (f.normal > 0)
            state.contact.push_back({plane.point, plane.body, rotate(turned, plane.arm), f.force, f.slip, f.normal / springs.surface_stiffness, plane.side});
    }
}

struct Wrench {
    Vec3d force = Vec3d::Zero();
    Vec3d torque = Vec3d::Zero();
};

Wrench sum_contacts(const std::vector<ShellContact>& contacts) {
    Wrench sum;
    for (const ShellContact& c : contacts) {
        sum.force += c.force;
        sum.torque += c.arm.cross(c.force);
    }
    return sum;
}

// Body whose surface presses most.
uint32_t strongest_body(const std::vector<ShellContact>& contacts) {
    uint32_t best = kNone;
    double most = 0;
    for (size_t begin = 0; begin < contacts.size();) {
        Vec3d force = Vec3d::Zero();
        size_t end = begin;
        for (; end < contacts.size() && contacts[end].body == contacts[begin].body; ++end) force += contacts[end].force;
        if (best == kNone || force.norm() > most) best = contacts[begin].body, most = force.norm();
        begin = end;
    }
    return best;
}

// From the last command towards what is wanted, as far as the motions since then explain and a little more each tick: the
// same share of force and torque, so that they stay those of the same contacts.
void slew_command(const HapticParams& params, const HandTool& tool, const Wrench& wanted, double elapsed, double device_way,
                  double device_turn, double surface_way, double gain_change, ToolState& state) {
    double lever = 1e-3;  // m
    for (const ShellContact& c : state.contact) lever = std::max(lever, c.arm.norm());
    const double ramp = params.force_slew * elapsed + tool.max_force * gain_change;
    const double force_room = tool.coupling_stiffness * (device_way + device_turn * lever + surface_way) + ramp;
    const double torque_room = tool.turn_stiffness * device_turn + lever * force_room;
    const double force_change = (wanted.force - state.command.force).norm(), torque_change = (wanted.torque - state.command.torque).norm();
    double share = 1;
    if (force_change > force_room) share = std::min(share, force_room / force_change);
    if (torque_change > torque_room) share = std::min(share, torque_room / torque_change);
    if (share == 1) {
        state.command.force = wanted.force;
        state.command.torque = wanted.torque;
    } else {
        state.command.force += share * (wanted.force - state.command.force);
        state.command.torque += share * (wanted.torque - state.command.torque);
    }
}

// Moves the tool, or waits until all of it is outside.
void update_shell(const LocalContactModel& model, const HandTool& tool, const Span& span,
                  double band, const Pose& pose, ShellScratch& s, ToolState& state) {
    if (!covers(model, tool, pose, span.now, band + std::max(0.0, model.give.gap))) {
        state.proxy_valid = false;
        state.contact.clear();
        return;
    }
    note_ways(model, tool, span.now, pose, s);
    const bool inside = find_planes(model, tool, span, pose, band, state.contact, s);
    if (!state.proxy_valid) {
        state.proxy = pose.tip;
        state.proxy_turn = pose.turn;
        state.contact.clear();
        state.proxy_valid = !inside;
        return;
    }
    ShellSprings springs{tool.coupling_stiffness, tool.turn_stiffness, tool.surface_stiffness, tool.friction, {}};
    springs.way = {state.device.position - pose.tip, rotation_vector(pose.turn, state.device.orientation)};
    move_shell(springs, band, tool.shell_radius, pose, s, state);
}

}  // namespace

void shell_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
                const DeviceState& sample, ShellScratch& scratch, ToolState& state) {
    TROCAR_ASSERT(!tool.shell.empty() && tool.surface_stiffness > 0 && tool.turn_stiffness > 0);
    if (state.contact.capacity() < tool.shell.size()) state.contact.reserve(tool.shell.size());
    const DeviceState last = state.device_valid ? state.device : sample;
    const double last_gain = state.gain, last_time = state.time;
    const bool first = state.ticks == 0;
    state.time = time;
    state.model_age = time - model.time;
    ++state.ticks;
    const bool accepted = take_sample(params, sample, state);
    if (!state.device_valid) return;
    const Span span = span_of(params, model, time, last_time, first, last.position, state.device.position);
    state.gain = next_gain(params, accepted, time - state.device.time, state.model_age, span.elapsed, state.gain);

    const double device_way = (state.device.position - last.position).norm();
    const Vec3d device_turn = rotation_vector(normalized(last.orientation), state.device.orientation);
    state.device_spin = span.elapsed > 0 ? Vec3d(device_turn / span.elapsed) : Vec3d(Vec3d::Zero());
    const double surface_way = model.fastest * std::abs(span.now.age - span.before.age) + (span.now.follow - span.before.follow).norm();
    const double band = kSlipSpeed * span.elapsed + 2 * (device_way + device_turn.norm() * tool.shell_radius);
    const Pose pose = state.proxy_valid ? Pose{state.proxy, state.proxy_turn} : Pose{state.device.position, state.device.orientation};
    update_shell(model, tool, span, band, pose, scratch, state);

    state.contacts = static_cast<uint32_t>(state.contact.size());
    state.touched = strongest_body(state.contact);
    Wrench wanted = sum_contacts(state.contact);
    wanted.force *= state.gain;
    wanted.torque *= state.gain;
    state.pull = wanted.force;
    state.pull_torque = wanted.torque;
    if (accepted) {
        slew_command(params, tool, wanted, span.elapsed, device_way, device_turn.norm(), surface_way, std::abs(state.gain - last_gain), state);
    } else {
        state.command = {};
    }
    state.largest_force = std::max(state.largest_force, state.command.force.norm());
}

}  // namespace trocar
