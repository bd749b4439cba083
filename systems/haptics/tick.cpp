#include "systems/haptics/tick.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "systems/haptics/contact/device_motion.hpp"
#include "systems/haptics/contact/push_out.hpp"
#include "systems/haptics/contact/surface_crossing.hpp"
#include "systems/haptics/contact/surface_feel.hpp"
namespace trocar {
namespace {

constexpr double kSlipSpeed = 1;     // m/s, of the proxy beyond twice that of the device: a longer displacement continues in the next tick
constexpr double kNearby = 2e-4;     // m, a surface farther than this from contact with the tip does not carry it
constexpr double kSeen = 5e-3;       // m, beyond contact: surfaces that tell on which side a free tip is
constexpr double kLongestGap = 0.1;  // s, longer intervals between ticks are treated as this

// ---- surface ----

double segment_distance(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const Vec3d along = b - a;
    const double length2 = along.squaredNorm();
    const double t = length2 > 0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0;
    return (a + t * along - p).norm();
}

struct TickSpan {
    double elapsed = 0;  // s, since the last tick
    SurfaceTime before;  // of the surface at the last tick
    SurfaceTime now;
    double travel = 0;          // m, the proxy may go
    double surface_travel = 0;  // m, displacement of the fastest surface near the proxy
    double moved() const { return now.age - before.age; }
    double travel_at(double speed) const { return speed * std::abs(moved()) + (now.follow - before.follow).norm(); }
};

// Displacement (m) of the surface that yields: as compliance predicts, with the simulated tip resting on it.
Vec3d compliant_offset(const HapticParams& params, const SurfaceCompliance& c, const Vec3d& device, double time) {
    return surface_follow(params, c, device, time) + c.gap * c.normal;
}

// A surface is not extrapolated beyond the time it was published for: then it stands still.
double shown_age(const HapticParams& params, double age) { return std::clamp(age, -params.greatest_age, params.greatest_age); }

TickSpan span_of(const HapticParams& params, const LocalContactModel& model, double time, const ToolState& state) {
    TickSpan span;
    span.elapsed = state.ticks > 0 ? std::clamp(time - state.time, 0.0, kLongestGap) : params.dt;
    span.now.age = shown_age(params, time - model.time);
    span.before.age = shown_age(params, time - model.time - span.elapsed);
    return span;
}

// Where the surface that the proxy touched has carried it since the last tick.
Vec3d carried_position(const LocalContactModel& model, const TickSpan& span, const ToolState& state) {
    const ContactAnchor& anchor = state.anchor;
    if (state.contacts == 0 || anchor.triangle == kNone) return state.proxy;
    const TrianglePlaced triangle = place_anchor(model, span.now, anchor);
    if (!triangle.found) return state.proxy;
    const Vec3d point = triangle.at(anchor.weight);
    Vec3d arm = state.proxy - anchor.position;
    // a surface that turned between two models leaves the proxy on its side
    const Vec3d normal = triangle_normal(triangle.corner[0], triangle.corner[1], triangle.corner[2]).normalized();
    if (anchor.side * arm.dot(normal) < 0) arm = anchor.side * arm.norm() * normal;
    const bool drawn = state.surface != model.sequence && anchor.body == model.compliance.body;
    const Vec3d carried = point + arm + (drawn ? model.compliance.slip : Vec3d(Vec3d::Zero()));
    // a surface that recedes takes the proxy no farther than the device: contact never pulls
    const Vec3d up = arm.normalized();
    const double receded = up.dot(state.proxy - carried);
    return carried + std::clamp(up.dot(state.device.position - carried), 0.0, std::max(0.0, receded)) * up;
}

// Moves the proxy with the surface that moved since the last tick. False: the exit from a crowd of features is left to
// the search for the goal.
bool carry_proxy(const LocalContactModel& model, const TickSpan& span, const Vec3d& carried, const Room& room, HapticScratch& scratch,
                 ToolState& state) {
    const bool renewed = state.surface != model.sequence;
    if (carried == state.proxy && span.surface_travel == 0 && state.contacts == 0 && !renewed) return true;
    // between two models the surface does not move as either of them says: there the anchor keeps the side
    SurfaceCrossing crossing;
    if (!renewed || state.contacts == 0) crossing = first_crossing(span.before, state.proxy, carried, span.surface_travel, scratch.near);
    state.proxy = crossing.index == kNone ? carried : above_crossing(crossing, scratch.near);
    state.outside = state.outside || state.contacts > 0 || crossing.index != kNone;
    if (renewed && state.contacts == 0 && crossing.index == kNone) {
        const Exit exit = nearest_exit(state.proxy, kSeen, scratch);
        if (exit.inside && state.outside) state.proxy = exit.point;
        state.outside = state.outside || (exit.found && !exit.inside);
    }
    const ProxySearch s = find_proxy(state.proxy, state.proxy, room, 0, state.outside, scratch, true);
    state.proxy = s.proxy;
    state.outside = state.outside || s.active > 0;
    state.proxy_valid = !s.inside;
    if (s.inside) state.contacts = 0;
    return !s.left;
}

// Whether a tip there is clear of all nearby surface.
bool is_clear(const Vec3d& centre, HapticScratch& scratch) {
    find_touched(centre, scratch);
    return std::all_of(scratch.touched.begin(), scratch.touched.end(),
                       [&](const TouchedFeature& f) { return f.distance >= offset_of(scratch.near, f.near); });
}

// Moves the proxy to its solution for the device's present position.
void update_proxy(const LocalContactModel& model, const TickSpan& span, const HandTool& tool, const Vec3d& carried_to,
                  HapticScratch& scratch, ToolState& state) {
    constexpr double kSlow = 1e-3;  // m/s
    const Vec3d goal = state.device.position;
    if (!state.proxy_valid) {
        if (push_out(model, state)) return;
        state.proxy = proxy_start(model, state).tip;
        state.contacts = 0;
        state.proxy_valid = is_clear(state.proxy, scratch);
        state.outside = !nearest_exit(state.proxy, model.reach, scratch).inside;
        return;
    }
    const Vec3d from = state.proxy;
    const bool was_free = state.contacts == 0;
    const Room room{carried_to, span.travel};
    const bool came_out = carry_proxy(model, span, carried_to, room, scratch, state);
    if (!state.proxy_valid) return;
    const Vec3d carried = state.proxy;
    const double friction = feel_of(tool, model, state.touched, state.sliding).friction;
    const ProxySearch s = find_proxy(state.proxy, goal, room, friction, state.outside, scratch);
    if (!model.surface.empty()) {
        if (came_out) state.sliding = state.contacts > 0 && (s.proxy - carried).norm() > kSlow * span.elapsed;
        state.carried += carried - from;
    }
    state.proxy = s.proxy;
    state.proxy_valid = !s.inside;
    // what was free and did not get to its goal in this tick touches nothing yet
    state.contacts = s.inside || (was_free && s.unfinished && s.hovers) ? 0 : s.active;
    // hovering around an edge it still counts as touching that body, although no feature is in contact
    if (state.contacts > 0 && !scratch.touched.empty()) state.touched = scratch.near.triangle[scratch.touched.front().near].body;
}

// ---- force ----

Vec3d limited(const Vec3d& v, double most) {
    const double length = v.norm();
    return length > most ? Vec3d(v * (most / length)) : v;
}

// Force of the coupling on the hand, N.
Vec3d coupling_force(const SurfaceFeel& feel, const ToolState& state, const Vec3d& surface_velocity) {
    if (state.contacts == 0) return Vec3d::Zero();
    const Vec3d spring = feel.stiffness * (state.proxy - state.device.position);
    const double pull = spring.norm();
    if (pull == 0) return Vec3d::Zero();
    const Vec3d direction = spring / pull;
    const double speed = (state.device.velocity - surface_velocity).dot(direction);
    // damping starts from zero with the spring, so that first contact and release are continuous
    const double damping = std::clamp(-feel.damping * speed, -pull, pull);
    return (pull + damping) * direction;
}

// Force on the hand (N) between the last command and `wanted`: as far as the motions since then justify plus
// a small amount each tick, so that a new set of contacts ramps in.
Vec3d slewed_force(const HapticParams& params, const HandTool& tool, const SurfaceFeel& feel, const TickSpan& span, const Vec3d& wanted,
                   const Vec3d& drift, const DeviceState& last, double last_gain, const ToolState& state) {
    const double displacement = (state.device.position - last.position).norm() + drift.norm() * span.moved();
    const double explained = feel.stiffness * displacement + feel.damping * (state.device.velocity - last.velocity).norm() +
                             tool.max_force * std::abs(state.gain - last_gain);
    return state.command.force + limited(wanted - state.command.force, explained + params.force_slew * span.elapsed);
}

}  // namespace

void haptic_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool, const DeviceState& sample,
                 HapticScratch& scratch, ToolState& state) {
    TROCAR_ASSERT(tool.tip_radius > 0);
    const DeviceState last = state.device_valid ? state.device : sample;
    const double last_gain = state.gain;
    TickSpan span = span_of(params, model, time, state);
    state.time = time;
    state.model_age = time - model.time;
    ++state.ticks;
    const bool accepted = take_sample(params, sample, state);
    if (!state.device_valid) return;
    state.gain = next_gain(params, tool.limits, accepted, time - state.device.time, state.model_age, span.elapsed, state.gain);

    const double device_way = (state.device.position - last.position).norm();
    span.before.follow = compliant_offset(params, model.compliance, last.position, time - span.elapsed);
    span.now.follow = compliant_offset(params, model.compliance, state.device.position, time);
    const Vec3d centre = state.proxy_valid ? carried_position(model, span, state) : proxy_start(model, state).tip;
    // what is free keeps up with its device, as far as the model knows the surfaces on the way
    const bool is_free = state.proxy_valid && state.contacts == 0;
    const double known = model.reach - tool.tip_radius - segment_distance(centre, model.from, model.to);
    const double to_device = (state.device.position - centre).norm() + 10 * kSkin;
    const double own_travel =
        is_free ? std::min(to_device, std::max(known, 0.0)) : std::min(to_device, kSlipSpeed * span.elapsed + 2 * device_way + 10 * kSkin);
    const double most_travel = span.travel_at(model.fastest);
    span.surface_travel = span.travel_at(fastest_near(model, span.now, tool, centre, own_travel + 3 * most_travel + kNearby));
    span.travel = own_travel + 2 * span.surface_travel;
    // nothing is known beyond the region of the model, which has every surface that a tool there may meet
    const bool covered = own_travel <= known;
    if (covered) {
        const double look_around = !state.proxy_valid ? model.reach : state.surface != model.sequence && state.contacts == 0 ? kSeen : 0;
        const double carried_by = state.proxy_valid ? (centre - state.proxy).norm() : 0;
        gather_surface(model, span.now, tool, centre, span.travel + span.surface_travel + carried_by + kNearby + look_around, scratch);
        update_proxy(model, span, tool, centre, scratch, state);
    } else if (state.proxy_valid && state.contacts > 0 && centre != state.proxy) {
        state.anchor.position += centre - state.proxy;  // far out it rides on its surface
        state.proxy = centre;
    } else if (!is_free) {
        state.proxy_valid = false;
        state.contacts = 0;
    }  // else it waits where it is for a model that covers it
    state.surface = model.sequence;
    if (state.contacts == 0) state.touched = kNone, state.sliding = false, state.carried.setZero(), state.anchor = {};
    Vec3d drift = Vec3d::Zero();
    if (state.contacts > 0 && covered) {
        const SurfaceMotion motion = surface_motion(state.proxy, kNearby, scratch.near);
        state.anchor = motion.anchor;
        if (span.surface_travel > 0) drift = motion.velocity;
        if (span.surface_travel > 0 && motion.body != kNone && motion.body == model.compliance.body && span.elapsed > 0)
            drift += (span.now.follow - span.before.follow) / span.elapsed;
    }
    const SurfaceFeel feel = feel_of(tool, model, state.touched, state.sliding);
    const Vec3d coupling = coupling_force(feel, state, drift);
    state.largest_wanted = std::max(state.largest_wanted, state.gain * coupling.norm());
    // slightly below the maximum, so that rounding never exceeds it
    state.pull = state.gain * limited(coupling, tool.max_force * (1 - 1e-12));
    state.command.force =
        accepted ? slewed_force(params, tool, feel, span, state.pull, drift, last, last_gain, state) : Vec3d(Vec3d::Zero());
}

HapticParams haptic_params(uint32_t contact_rate) {
    HapticParams params;
    params.greatest_age = 2.1 / contact_rate;
    return params;
}

void sum_tool_counters(Haptics& haptics) {
    haptics.ticks = 0;
    haptics.rejected_samples = 0;
    for (const ToolState& state : haptics.state) {
        haptics.ticks += state.ticks;
        haptics.rejected_samples += state.rejected_samples;
        haptics.max_force = std::max(haptics.max_force, state.largest_force);
        haptics.max_force_wanted = std::max(haptics.max_force_wanted, state.largest_wanted);
    }
}

}  // namespace trocar
