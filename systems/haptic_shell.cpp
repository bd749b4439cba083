#include "systems/haptic_shell.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "engine/check.hpp"
#include "engine/geometry/four_points.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/point_shell.hpp"
#include "systems/haptic_device.hpp"
#include "systems/haptic_surface.hpp"
namespace trocar {
namespace {

constexpr double kBand = 5e-5;       // m, points as near to a surface are looked at whatever they do
constexpr double kListed = 5e-4;     // m, points as near are asked for first
constexpr double kStride = 5e-4;     // m, that a point may go in a look beyond its distance from the surface when the look began
constexpr double kBeside = 2e-5;     // m, from a plane: points that nearly touch it
constexpr double kThickest = 5e-3;   // m, half of the thickest sheet that points are passed over beside
constexpr double kAgainst = -0.5;    // cosine between a way out and the normal into the instrument
constexpr double kLook = 5e-4;       // m, beyond the band: where no surface is nearer, a point that was outside is left alone
constexpr double kLongestGap = 0.1;  // s, ticks farther apart than this count as this far
constexpr double kAround = 1e-3;     // m, beyond a point's nearest triangle: others are remembered, to be asked first the next time
constexpr uint32_t kMostLooks = 2;   // a tick, at the surface from where the instrument came to
constexpr double kSlow = 1e-3;       // m/s, slower than this along a surface nothing slides
constexpr double kSettled = 1e-6;    // m, a way of points after which another look changes nothing

struct Pose {
    Vec3d tip = Vec3d::Zero();
    Quat turn;
    // of a tool with jaws
    double grip = 0;                                            // rad
    double reach = 0;                                           // m a radian, of the jaws
    std::span<const ShellPoint> point = {}, point_before = {};  // at this grip and at that of the tick before
};

double angle_between(const Quat& a, const Quat& b) { return rotation_vector(a, b).norm(); }

// The surface now and at the tick before.
struct Span {
    double elapsed = 0;  // s
    SurfaceMoment before, now;
    Vec3d follow_speed = Vec3d::Zero();  // m/s, of the body that follows, beyond its vertices' own
    bool again = false;                  // another look at the same time
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
    if (span.elapsed > 0) span.follow_speed = (span.now.follow - span.before.follow) / span.elapsed;
    return span;
}

// Takes up where everything is, and how far it may have come since the scratch was told how near it is.
void note_ways(const LocalContactModel& model, const HandTool& tool, const SurfaceMoment& moment, const Pose& pose, ShellScratch& s) {
    const size_t points = tool.shell.size(), rows = model.shell.clear.size();
    const bool anew = s.place.size() != points || s.sequence != model.sequence || s.model_time != model.time || s.clear.size() != rows;
    if (anew) {
        if (s.place.capacity() < points) {
            s.plane.reserve(2 * points), s.place.reserve(2 * points), s.clear.reserve(4 * points), s.nearest.reserve(4 * points);
            s.asked_at.reserve(4 * points), s.bound.reserve(4 * points), s.radius.reserve(2 * points), s.near.reserve(4 * points);
            s.listed.reserve(4 * points), s.around.reserve(4 * points);
        }
        s.sequence = model.sequence;
        ++s.models;
        s.around.resize(std::max(s.around.size(), rows));
        s.model_time = model.time;
        s.clear = model.shell.clear;
        s.nearest = model.shell.nearest;
        s.asked_at.clear();
        for (size_t tree = 0; tree < model.shell.tree.size(); ++tree)
            s.asked_at.insert(s.asked_at.end(), model.shell.place.begin(), model.shell.place.end());
        s.place.resize(points);
        s.moment = {0, model.give.body, Vec3d::Zero()};
        s.aged = s.followed = s.shifted = s.turned = 0;
        s.tip = model.shell.tip, s.turn = model.shell.turn, s.grip = model.shell.grip;
        s.bound = s.clear;
        s.radius.resize(points);
        for (size_t k = 0; k < points; ++k) s.radius[k] = tool.shell[k].jaw == kNone ? tool.shell[k].arm.norm() : tool.shell_radius;
    }
    s.aged += std::abs(moment.age - s.moment.age);
    s.followed += (moment.follow - s.moment.follow).norm();
    s.moment = moment;
    s.shifted += (pose.tip - s.tip).norm() + pose.reach * std::abs(pose.grip - s.grip);
    s.turned += angle_between(s.turn, pose.turn);
    s.tip = pose.tip, s.turn = pose.turn, s.grip = pose.grip;
}

// A point was asked for its distance (m) where it is now, at s.moment.
void note_distance(const LocalContactModel& model, uint32_t point, uint32_t row, const Vec3d& place, double distance, ShellScratch& s) {
    s.asked_at[row] = place;
    s.clear[row] = distance + model.shell.speed[row] * s.aged + s.followed;
    s.bound[row] = s.clear[row] + s.shifted + s.turned * s.radius[point];
    ++s.looked_at;
}

// Nearest triangle of a tree to a point at s.moment. Neither it nor the surface goes far between two ticks: the triangles that were
// around it when the tree was last searched mostly tell.
NearestTriangle nearest_to(const LocalContactModel& model, uint32_t tree, uint32_t point, uint32_t row, const Vec3d& place, double reach,
                           ShellScratch& s) {
    if (s.all_points) return find_nearest(model, model.shell.tree[tree], place, s.nearest[row], reach, s.surface);
    ShellAround& around = s.around[row];
    const double surface = model.shell.speed[row] * s.aged + s.followed;
    const Vec3d& then = model.shell.place[point];
    NearestTriangle nearest;
    const bool asked = around.models == s.models;
    if (std::abs(s.moment.age) <= model.shell.ahead && (asked || !model.shell.found.empty())) {
        const double gone = (place - (asked ? around.place : then)).norm() + surface,
                     far = model.shell.around - (place - then).norm() - s.followed;
        const TrianglesAround& found = asked ? around.found : model.shell.found[row];
        if (nearest_of(model, found, place, gone, far, reach, s.surface, nearest)) return nearest;
    }
    nearest = find_nearest_around(model, model.shell.tree[tree], place, s.nearest[row], reach + kAround, kAround, s.surface, around.found);
    for (double& others : around.found.others) others += surface;
    ++s.searched;
    around.place = place;
    around.models = s.models;
    return nearest.at.squared_distance <= reach * reach ? nearest : NearestTriangle{};
}

// Whether the model shows every surface that a point may reach.
bool covers(const LocalContactModel& model, const HandTool& tool, const Pose& pose, const SurfaceMoment& moment, double band) {
    const double way = (pose.tip - model.shell.tip).norm() + angle_between(model.shell.turn, pose.turn) * tool.shell_radius +
                       pose.reach * std::abs(pose.grip - model.shell.grip);
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
    plane.velocity = side.velocity;
    if (body == model.give.body) plane.carried += span.now.follow - span.before.follow, plane.velocity += span.follow_speed;
    if (before) {
        // friction goes on from where it was stretched
        plane.slip = before->slip;
        plane.held = before->force.dot(plane.normal);
        plane.sliding = before->sliding;
    }
    return plane;
}

// How far (m) points are looked at: as far as a step takes each of them, within limits.
struct Need {
    ShellStep step;  // axes of the tool
    double least = 0, most = 0;
    double of(const Vec3d& arm) const { return std::clamp((step.shift + step.turn.cross(arm)).norm(), least, most); }
};

// One bit each of the points k, ..., k + 3, whose rows begin at `row`, that may be nearer than `within` to a surface by what ways alone
// tell.
uint32_t four_near(const LocalContactModel& model, uint32_t row, uint32_t k, double within, const ShellScratch& s) {
    const auto four = [](const double* x) { return (Vec4d)_mm256_loadu_pd(x); };
    const Vec4d surface = four(&model.shell.speed[row]) * all_lanes(s.aged), own = all_lanes(s.turned) * four(&s.radius[k]);
    return mask_bits(four(&s.bound[row]) - surface - own > all_lanes(within + s.followed + s.shifted)) ^ 15;
}

// Lists in scratch.near the points, of all trees, that may be nearer than `within` to a surface.
void list_near(const LocalContactModel& model, const HandTool& tool, const Pose& pose, double within, ShellScratch& s) {
    const double apart_by = (pose.tip - model.shell.tip).norm() + angle_between(model.shell.turn, pose.turn) * tool.shell_radius +
                            pose.reach * std::abs(pose.grip - model.shell.grip);
    // surfaces faster than model.shell.speed says stay this far from the points
    const bool told = std::abs(s.moment.age) <= model.shell.ahead;
    const double far = told ? model.shell.around - apart_by - s.followed : -std::numeric_limits<double>::infinity();
    const bool passes = far > within && !s.all_points;
    s.near.clear();
    s.within = within;
    const auto points = static_cast<uint32_t>(s.place.size());
    const auto list = [&](uint32_t tree, uint32_t k) {
        const uint32_t row = tree * points + k;
        const double surface = model.shell.speed[row] * s.aged + s.followed, own = s.shifted + s.turned * s.radius[k];
        // nothing comes nearer faster than places change
        s.place[k] = pose.tip + rotate(pose.turn, pose.point[k].arm);
        const double left = s.clear[row] - surface - (s.place[k] - s.asked_at[row]).norm(), known = std::min(left, far);
        s.bound[row] = left + surface + own;
        if (known <= within || s.all_points) s.near.push_back({tree, k, row, known});
    };
    for (uint32_t tree = 0; tree < model.shell.tree.size(); ++tree) {
        for (uint32_t k = 0; k < points; k += 4) {
            const uint32_t count = std::min(4u, points - k);
            uint32_t near = passes && count == 4 ? four_near(model, tree * points + k, k, within, s) : (1u << count) - 1;
            for (; near != 0; near &= near - 1) list(tree, k + static_cast<uint32_t>(std::countr_zero(near)));
        }
    }
}

// Adds to scratch.plane the points of scratch.near that are as near to a surface as `need` says and not among them yet, bodies
// and points ascending. A way out that leads against the instrument's own outside is none: there a thin wall's far side is
// nearer, and it must not pull the instrument through. Notes in `inside` if any point was.
void add_planes(const LocalContactModel& model, const HandTool& tool, const Span& span, const Pose& pose, const Need& need,
                const std::vector<ShellContact>& contact, ShellScratch& s, bool& inside) {
    Before before{contact};
    const double most = need.most + std::max(0.0, model.give.gap);
    for (ShellNear& row : s.near) {
        if (row.taken || (!s.all_points && row.known > most)) continue;
        const uint32_t k = row.point, body = model.shell.tree[row.tree].body;
        const double gap = body == model.give.body ? model.give.gap : 0;
        const double room = need.of(pose.point[k].arm), near = room + std::max(0.0, gap);
        if (!s.all_points && row.known > near) continue;
        const uint32_t hint = s.nearest[row.row];
        const bool was_outside = !s.all_points && row.known > 0 && hint != kNone;
        const double half = was_outside ? model.half_thickness[hint] : kThickest;
        const double reach = was_outside ? std::min(model.reach, near + kLook + half) : model.reach;
        const NearestTriangle nearest = nearest_to(model, row.tree, k, row.row, s.place[k], reach, s);
        row.known = reach - half;
        const ShellContact* held = before.find(body, k);
        SurfaceSide side;
        if (nearest.triangle != kNone) {
            s.nearest[row.row] = nearest.triangle;
            row.known = std::sqrt(nearest.at.squared_distance) - half;
            if (!was_outside || row.known < near) {  // or it came through
                side = side_of(model, nearest, held ? held->side : 0, s.surface);
                row.known = side.distance;
            }
        }
        note_distance(model, k, row.row, s.place[k], row.known, s);
        inside = inside || row.known < 0;
        if (nearest.triangle == kNone || row.known >= near || side.distance - gap >= room) continue;
        side.distance -= gap;
        row.taken = true;
        if (side.distance < 0 && side.normal.dot(rotate(pose.turn, pose.point[k].inward)) < kAgainst) continue;
        ShellPlane plane = plane_of(model, span, k, body, s.place[k] - pose.tip, side, held);
        plane.gap = gap, plane.tree = row.tree, plane.row = row.row;
        plane.friction = feel_of(tool, model, body, held && held->sliding).friction;
        if (pose.point[k].jaw != kNone && !span.again) {
            // against a jaw that moves by itself the surface goes the other way
            const Vec3d moved = rotate(pose.turn, pose.point[k].arm - pose.point_before[k].arm);
            plane.carried -= moved;
            if (span.elapsed > 0) plane.velocity -= moved / span.elapsed;
        }
        s.plane.push_back(plane);
    }
}

// The same for more, knowing what became planes.
void list_more(const LocalContactModel& model, const HandTool& tool, const Pose& pose, double within, ShellScratch& s) {
    std::swap(s.near, s.listed);
    list_near(model, tool, pose, within, s);
    auto known = s.listed.begin();
    for (ShellNear& row : s.near) {
        while (known != s.listed.end() && known->row < row.row) ++known;
        if (known != s.listed.end() && known->row == row.row) row = *known;
    }
}

double way_of(const ShellPlane& plane, const ShellStep& step) { return (step.shift + step.turn.cross(plane.arm)).norm(); }

// The step that balances coupling and planes, with the planes of all points that it brings to a surface: more and more of
// them are looked at, as far as the step goes.
ShellStep settle(const LocalContactModel& model, const HandTool& tool, const ShellSprings& springs, const Span& span, const Pose& pose,
                 ShellStep step, const std::vector<ShellContact>& contact, ShellScratch& s) {
    double looked = kBand;
    bool inside = false;
    for (bool broken = true;;) {
        if (broken) step = solve_shell(springs, s.plane, step);
        const double way = step.shift.norm() + step.turn.norm() * tool.shell_radius;
        if (!broken && way <= looked) return step;
        looked = std::min(2 * looked, std::max(way, looked));
        const size_t had = s.plane.size();
        if (looked + std::max(0.0, model.give.gap) > s.within) list_more(model, tool, pose, 2 * looked + std::max(0.0, model.give.gap), s);
        const Need need{{rotate_back(pose.turn, step.shift), rotate_back(pose.turn, step.turn)}, kBand, looked};
        add_planes(model, tool, span, pose, need, contact, s, inside);
        broken = std::any_of(s.plane.begin() + static_cast<ptrdiff_t>(had), s.plane.end(),
                             [&](const ShellPlane& plane) { return plane.held > 0 || gap_after(plane, step) < 0; });
    }
}

// Whether the planes are right about the points that they hold or nearly do, and about those that went farther than the surface
// was away, where a step took them: to a hundredth of what they bear.
bool planes_hold(const LocalContactModel& model, const Pose& pose, const ShellStep& step, ShellScratch& s) {
    constexpr double kWrong = 0.01;  // of the depths
    double wrong = 0, depth = 0;
    for (const ShellPlane& plane : s.plane) {
        const double gap = gap_after(plane, step);
        if (gap > kBeside && way_of(plane, step) < plane.distance) continue;
        const Vec3d point = pose.tip + rotate(pose.turn, pose.point[plane.point].arm);
        const double half = model.half_thickness[s.nearest[plane.row]];
        const double reach = std::abs(gap + plane.gap) + half + kLook;
        const NearestTriangle nearest = nearest_to(model, plane.tree, plane.point, plane.row, point, reach, s);
        const double distance = nearest.triangle == kNone ? reach - half : side_of(model, nearest, plane.side, s.surface).distance;
        note_distance(model, plane.point, plane.row, point, distance, s);
        if (nearest.triangle != kNone) s.nearest[plane.row] = nearest.triangle;
        const double is = distance - plane.gap;
        wrong += std::abs(std::min(0.0, is) - std::min(0.0, gap));
        depth -= std::min(0.0, gap);
    }
    return wrong <= kWrong * depth;
}

// What came of a look at the surface: the tool is where it belongs, the planes are wrong where it came to, or it wanted to go
// farther than it may in one.
enum class Look { kDone, kWrong, kCut };

// Moves the tool to where the planes balance and leaves what holds it in state.contact.
Look move_shell(const LocalContactModel& model, const HandTool& tool, const ShellSprings& springs, const Span& span, const Pose& pose,
                ShellScratch& s, ToolState& state) {
    ShellStep step = settle(model, tool, springs, span, pose, {}, state.contact, s);
    // friction counts on the normal forces of the tick before, then on those that come out
    const bool rough = std::any_of(s.plane.begin(), s.plane.end(), [](const ShellPlane& plane) { return plane.friction > 0; });
    if (rough) {
        for (ShellPlane& plane : s.plane) plane.held = shell_force(springs, plane, step).normal;
        step = settle(model, tool, springs, span, pose, step, state.contact, s);
    }
    // beyond a plane there may be others that stand in the way; a surface that came in pushes as far as it did. Cut short, the tool
    // goes on in the next look or tick and bears what the planes will where they balance: no force drops out on the way
    double share = 1;
    for (const ShellPlane& plane : s.plane) {
        const double way = way_of(plane, step), most = std::max(plane.distance, kStride + (plane.distance < 0 ? plane.carried.norm() : 0));
        if (way > most) share = std::min(share, most / way);
    }
    const double way = step.shift.norm() + step.turn.norm() * tool.shell_radius;
    const ShellStep whole = step;
    step.shift *= share, step.turn *= share;
    const Quat turned = from_rotation_vector(step.turn);
    state.proxy = pose.tip + step.shift;
    state.proxy_turn = normalized(multiply(turned, pose.turn));
    std::sort(s.plane.begin(), s.plane.end(), [](const ShellPlane& a, const ShellPlane& b) { return a.row < b.row; });
    state.contact.clear();
    for (const ShellPlane& plane : s.plane) {
        const ShellForce f = shell_force(springs, plane, whole);
        if (!(f.normal > 0)) continue;
        bool sliding = plane.sliding;
        if (!span.again) {
            const Vec3d went = step.shift + step.turn.cross(plane.arm) - plane.carried,
                        along = went - plane.normal.dot(went) * plane.normal;
            sliding = f.yields && along.norm() > kSlow * span.elapsed;
        }
        state.contact.push_back({plane.point, plane.body, rotate(turned, plane.arm), f.force, f.slip, f.normal / springs.surface_stiffness,
                                 plane.side, sliding});
    }
    Pose moved = pose;
    moved.tip = state.proxy, moved.turn = state.proxy_turn;
    if (share < 1) return Look::kCut;
    return way <= kSettled || planes_hold(model, moved, step, s) ? Look::kDone : Look::kWrong;
}

// The coupling in a row with the stiffness of what was touched, by what each body bore of the force.
double coupling_in_a_row(const HandTool& tool, const LocalContactModel& model, const std::vector<ShellContact>& contacts) {
    if (model.surface.empty()) return tool.coupling_stiffness;
    double press = 0, yield = 0;  // N, m
    for (const ShellContact& c : contacts) {
        const double force = c.force.norm();
        press += force;
        const HapticSurface* surface = surface_of(model, c.body);
        if (surface && surface->stiffness > 0) yield += force / surface->stiffness;
    }
    return press > 0 ? tool.coupling_stiffness * press / (press + tool.coupling_stiffness * yield) : tool.coupling_stiffness;
}

// Lets the contacts of a body with damping b grow together, so that at the speed v of the hand along their sum they bear b v
// more: -b times the power that they give over their sum, never more than they bore. Planes and contacts: points ascend alike.
// Returns the largest b (N s/m).
double damp_contacts(const LocalContactModel& model, const DeviceState& device, const Vec3d& spin, const std::vector<ShellPlane>& planes,
                     std::vector<ShellContact>& contacts) {
    double most = 0;
    if (model.surface.empty()) return most;
    for (size_t begin = 0, plane = 0; begin < contacts.size();) {
        const uint32_t body = contacts[begin].body;
        Vec3d force = Vec3d::Zero();
        double power = 0;
        size_t end = begin;
        for (; end < contacts.size() && contacts[end].body == body; ++end, ++plane) {
            const ShellContact& c = contacts[end];
            while (planes[plane].body != body || planes[plane].point != c.point) ++plane;
            force += c.force;
            power += c.force.dot(device.velocity + spin.cross(c.arm) - planes[plane].velocity);
        }
        const HapticSurface* surface = surface_of(model, body);
        if (surface && surface->damping > 0 && force.squaredNorm() > 0) {
            const double more = std::clamp(-surface->damping * power / force.squaredNorm(), -1.0, 1.0);
            for (size_t k = begin; k < end; ++k) contacts[k].force *= 1 + more;
            most = std::max(most, surface->damping);
        }
        begin = end;
    }
    return most;
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

// What is touched and whether it slides, and how far its surface took the instrument along.
void note_touch(double elapsed, const std::vector<ShellPlane>& planes, ToolState& state) {
    state.touched = strongest_body(state.contact);
    state.sliding = false;
    if (state.contact.empty()) state.carried.setZero();
    Vec3d velocity = Vec3d::Zero();
    double press = 0;
    size_t plane = 0;
    for (const ShellContact& c : state.contact) {
        while (planes[plane].body != c.body || planes[plane].point != c.point) ++plane;
        if (c.body != state.touched) continue;
        state.sliding = state.sliding || c.sliding;
        press += c.depth;
        velocity += c.depth * planes[plane].velocity;
    }
    if (press > 0) state.carried += elapsed / press * velocity;
}

// What has changed since the last tick: a change of the command may follow from it.
struct TickChange {
    double elapsed = 0;      // s
    double device_way = 0;   // m
    double device_turn = 0;  // rad
    double surface_way = 0;  // m, of surfaces against the tool and of its jaws against them
    double damping = 0;      // N, of the damping forces
    double gain = 0;         // of ToolState::gain
};

// From the last command towards what is wanted, as far as the changes since then explain and a little more each tick: the
// same share of force and torque, so that they stay those of the same contacts.
void slew_command(const HapticParams& params, const HandTool& tool, const TickChange& change, const Wrench& wanted, ToolState& state) {
    double lever = 1e-3;  // m
    for (const ShellContact& c : state.contact) lever = std::max(lever, c.arm.norm());
    // what is let go keeps the lever that it had
    if (const double last = state.command.force.norm(); last > 0)
        lever = std::max(lever, std::min(tool.shell_radius, state.command.torque.norm() / last));
    const double ramp = params.force_slew * change.elapsed + tool.max_force * change.gain + change.damping;
    const double force_room = tool.coupling_stiffness * (change.device_way + change.device_turn * lever + change.surface_way) + ramp;
    const double torque_room = tool.turn_stiffness * change.device_turn + lever * force_room;
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

// Moves the tool as far as one look at the surface around it allows, or waits until all of it is outside.
Look look_and_move(const LocalContactModel& model, const HandTool& tool, const Span& span, const Pose& pose, ShellScratch& s,
                   ToolState& state) {
    if (!covers(model, tool, pose, span.now, kBand + std::max(0.0, model.give.gap))) {
        state.proxy_valid = false;
        state.contact.clear();
        s.plane.clear();
        return Look::kDone;
    }
    note_ways(model, tool, span.now, pose, s);
    s.plane.clear();
    list_near(model, tool, pose, kListed + std::max(0.0, model.give.gap), s);
    bool inside = false;
    add_planes(model, tool, span, pose, {{}, kBand, kBand}, state.contact, s, inside);
    if (!state.proxy_valid) {
        state.proxy = pose.tip;
        state.proxy_turn = pose.turn;
        state.contact.clear();
        state.proxy_valid = !inside;
        return Look::kDone;
    }
    ShellSprings springs{coupling_in_a_row(tool, model, state.contact), tool.turn_stiffness, tool.surface_stiffness, {}};
    springs.way = {state.device.position - pose.tip, rotation_vector(pose.turn, state.device.orientation)};
    return move_shell(model, tool, springs, span, pose, s, state);
}

// Planes stand for surfaces near where they were found only: on rough ones another look from where the tool came to finds
// others, and a surface that came in deep may push farther than one look reaches. No time passes between looks.
void update_shell(const LocalContactModel& model, const HandTool& tool, Span span, Pose pose, ShellScratch& s, ToolState& state) {
    const bool was_valid = state.proxy_valid;
    begin_moment(model, span.now, s.surface);
    for (uint32_t look = 0; look < kMostLooks; ++look) {
        const Look came = look_and_move(model, tool, span, pose, s, state);
        if (came == Look::kDone || !was_valid || (came == Look::kWrong && state.contact.empty())) return;
        pose.tip = state.proxy, pose.turn = state.proxy_turn;
        span.before = span.now;
        span.again = true;
    }
}

}  // namespace

void shell_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool, const DeviceState& sample,
                ShellScratch& scratch, ToolState& state) {
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
    state.gain = next_gain(params, tool.limits, accepted, time - state.device.time, state.model_age, span.elapsed, state.gain);

    const double device_way = (state.device.position - last.position).norm();
    const Vec3d device_turn = rotation_vector(normalized(last.orientation), state.device.orientation);
    state.device_spin = span.elapsed > 0 ? Vec3d(device_turn / span.elapsed) : Vec3d(Vec3d::Zero());
    const double surface_way = model.fastest * std::abs(span.now.age - span.before.age) + (span.now.follow - span.before.follow).norm();
    Pose pose = state.proxy_valid ? Pose{state.proxy, state.proxy_turn} : Pose{state.device.position, state.device.orientation};
    pose.grip = state.device.grip;
    pose.reach = tool.shell_jaw.empty() ? 0 : jaw_reach(tool);
    pose.point = points_at_grip(tool, pose.grip, scratch.open);
    pose.point_before = points_at_grip(tool, last.grip, scratch.opened);
    const double jaw_way = pose.reach * std::abs(pose.grip - last.grip);
    update_shell(model, tool, span, pose, scratch, state);
    const double damping = damp_contacts(model, state.device, state.device_spin, scratch.plane, state.contact);
    note_touch(span.elapsed, scratch.plane, state);

    state.contacts = static_cast<uint32_t>(state.contact.size());
    Wrench wanted = sum_contacts(state.contact);
    wanted.force *= state.gain;
    wanted.torque *= state.gain;
    state.pull = wanted.force;
    state.pull_torque = wanted.torque;
    if (accepted) {
        const TickChange change{.elapsed = span.elapsed,
                                .device_way = device_way,
                                .device_turn = device_turn.norm(),
                                .surface_way = surface_way + jaw_way,
                                .damping = damping * (state.device.velocity - last.velocity).norm(),
                                .gain = std::abs(state.gain - last_gain)};
        slew_command(params, tool, change, wanted, state);
    } else {
        state.command = {};
    }
    state.largest_force = std::max(state.largest_force, state.command.force.norm());
}

}  // namespace trocar
