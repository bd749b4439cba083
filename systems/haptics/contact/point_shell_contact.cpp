#include "systems/haptics/contact/point_shell_contact.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "engine/base/check.hpp"
#include "engine/geometry/four_points.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/haptics/point_shell.hpp"
#include "systems/haptics/contact/device_motion.hpp"
#include "systems/haptics/contact/push_out.hpp"
#include "systems/haptics/contact/surface_feel.hpp"
namespace trocar {
namespace {

constexpr double kBand = 5e-5;            // m, points this close to a surface are always evaluated
constexpr double kListed = 5e-4;          // m, points this close are evaluated first
constexpr double kStride = 5e-4;          // m, that a point may move in an iteration beyond its initial distance from the surface
constexpr double kNearlyTouching = 2e-5;  // m, from a plane: points nearly in contact with it
constexpr double kThickest = 5e-3;        // m, half of the thickest sheet beside which points may be skipped
constexpr double kAgainst = -0.5;         // cosine between a separation direction and the normal into the instrument
constexpr double kSearchBeyond = 5e-4;    // m, beyond the band: if no surface is nearer, a point that was outside is skipped
constexpr double kLongestGap = 0.1;       // s, longer intervals between ticks are treated as this
constexpr double kSearchAround = 1e-3;    // m, beyond a point's nearest triangle: triangles remembered and evaluated first next time
constexpr uint32_t kMostIterations = 2;   // per tick, from the previous pose of the instrument
constexpr double kSlow = 1e-3;            // m/s, slower than this along a surface counts as sticking
constexpr double kConverged = 1e-6;       // m, a displacement of points below which another iteration changes nothing

struct Pose {
    Vec3d tip = Vec3d::Zero();
    Quat turn;
    // of a tool with jaws
    double grip = 0;                                            // rad
    double reach = 0;                                           // m/rad, lever arm of the jaws
    std::span<const ShellPoint> point = {}, point_before = {};  // at this grip and at that of the last tick
};

double angle_between(const Quat& a, const Quat& b) { return rotation_vector(a, b).norm(); }

// The surface now and at the last tick.
struct Span {
    double elapsed = 0;  // s
    SurfaceMoment before, now;
    Vec3d follow_speed = Vec3d::Zero();  // m/s, of the body that yields, in addition to its vertices' own
    bool again = false;                  // another iteration at the same time
};

Span span_of(const HapticParams& params, const LocalContactModel& model, double time, double last_time, bool first,
             const Vec3d& last_device, const Vec3d& device) {
    const auto moment = [&](double age, const Vec3d& at) {
        const double shown = std::clamp(age, -params.greatest_age, params.greatest_age);
        return SurfaceMoment{shown, model.compliance.body, surface_follow(params, model.compliance, at, model.time + age)};
    };
    Span span;
    span.elapsed = first ? params.dt : std::clamp(time - last_time, 0.0, kLongestGap);
    span.now = moment(time - model.time, device);
    span.before = moment(time - model.time - span.elapsed, last_device);
    if (span.elapsed > 0) span.follow_speed = (span.now.follow - span.before.follow) / span.elapsed;
    return span;
}

// Updates positions and the bounds on displacements since clearance was last measured.
void note_motion(const LocalContactModel& model, const HandTool& tool, const SurfaceMoment& moment, const Pose& pose,
                 PointShellScratch& s) {
    const size_t points = tool.point_shell.size(), entries = model.point_shell.clear.size();
    const bool anew =
        s.position.size() != points || s.sequence != model.sequence || s.model_time != model.time || s.clear.size() != entries;
    if (anew) {
        if (s.position.capacity() < points) {
            s.plane.reserve(2 * points), s.position.reserve(2 * points), s.clear.reserve(4 * points), s.nearest.reserve(4 * points);
            s.asked_at.reserve(4 * points), s.bound.reserve(4 * points), s.radius.reserve(2 * points), s.near.reserve(4 * points);
            s.listed.reserve(4 * points), s.around.reserve(4 * points);
        }
        s.sequence = model.sequence;
        ++s.models;
        s.around.resize(std::max(s.around.size(), entries));
        s.model_time = model.time;
        s.clear = model.point_shell.clear;
        s.nearest = model.point_shell.nearest;
        s.asked_at.clear();
        for (size_t tree = 0; tree < model.point_shell.tree.size(); ++tree)
            s.asked_at.insert(s.asked_at.end(), model.point_shell.position.begin(), model.point_shell.position.end());
        s.position.resize(points);
        s.moment = {0, model.compliance.body, Vec3d::Zero()};
        s.aged = s.followed = s.shifted = s.turned = 0;
        s.tip = model.point_shell.tip, s.turn = model.point_shell.turn, s.grip = model.point_shell.grip;
        s.bound = s.clear;
        s.radius.resize(points);
        for (size_t k = 0; k < points; ++k)
            s.radius[k] = tool.point_shell[k].jaw == kNone ? tool.point_shell[k].arm.norm() : tool.shell_radius;
    }
    s.aged += std::abs(moment.age - s.moment.age);
    s.followed += (moment.follow - s.moment.follow).norm();
    s.moment = moment;
    s.shifted += (pose.tip - s.tip).norm() + pose.reach * std::abs(pose.grip - s.grip);
    s.turned += angle_between(s.turn, pose.turn);
    s.tip = pose.tip, s.turn = pose.turn, s.grip = pose.grip;
}

// Records the distance (m) measured for a point at its present position, at s.moment.
void note_distance(const LocalContactModel& model, uint32_t point, uint32_t index, const Vec3d& position, double distance,
                   PointShellScratch& s) {
    s.asked_at[index] = position;
    s.clear[index] = distance + model.point_shell.speed[index] * s.aged + s.followed;
    s.bound[index] = s.clear[index] + s.shifted + s.turned * s.radius[point];
    ++s.looked_at;
}

// Nearest triangle of a tree to a point at s.moment. Points and surfaces move little between two ticks, so
// the triangles around it at the last search usually contain the answer.
NearestTriangle nearest_to(const LocalContactModel& model, uint32_t tree, uint32_t point, uint32_t index, const Vec3d& position,
                           double reach, PointShellScratch& s) {
    if (s.all_points) return find_nearest(model, model.point_shell.tree[tree], position, s.nearest[index], reach, s.surface);
    ShellAround& around = s.around[index];
    const double surface = model.point_shell.speed[index] * s.aged + s.followed;
    const Vec3d& then = model.point_shell.position[point];
    NearestTriangle nearest;
    const bool asked = around.models == s.models;
    if (std::abs(s.moment.age) <= model.point_shell.ahead && (asked || !model.point_shell.found.empty())) {
        const double gone = (position - (asked ? around.position : then)).norm() + surface,
                     far = model.point_shell.around - (position - then).norm() - s.followed;
        const TrianglesAround& found = asked ? around.found : model.point_shell.found[index];
        if (nearest_of(model, found, position, gone, far, reach, s.surface, nearest)) return nearest;
    }
    nearest = find_nearest_around(model, model.point_shell.tree[tree], position, s.nearest[index], reach + kSearchAround, kSearchAround,
                                  s.surface, around.found);
    for (double& others : around.found.others) others += surface;
    ++s.searched;
    around.position = position;
    around.models = s.models;
    return nearest.at.squared_distance <= reach * reach ? nearest : NearestTriangle{};
}

// Whether the model contains every surface that a point may reach: it has all that may come within its reach.
bool covers(const LocalContactModel& model, const HandTool& tool, const Pose& pose, const SurfaceMoment& moment, double band) {
    const double displacement = (pose.tip - model.point_shell.tip).norm() +
                                angle_between(model.point_shell.turn, pose.turn) * tool.shell_radius +
                                pose.reach * std::abs(pose.grip - model.point_shell.grip);
    return displacement + moment.follow.norm() + band <= model.reach;
}

// Contact of a point with a body at the last tick; queries must ascend in body and point.
struct Before {
    const std::vector<ShellContact>& contact;
    size_t index = 0;
    const ShellContact* find(uint32_t body, uint32_t point) {
        while (index < contact.size() && (contact[index].body < body || (contact[index].body == body && contact[index].point < point)))
            ++index;
        const bool found = index < contact.size() && contact[index].body == body && contact[index].point == point;
        return found ? &contact[index] : nullptr;
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
    if (body == model.compliance.body) plane.carried += span.now.follow - span.before.follow, plane.velocity += span.follow_speed;
    if (before) {
        // the friction spring keeps its stretch
        plane.slip = before->slip;
        plane.held = before->force.dot(plane.normal);
        plane.sliding = before->sliding;
    }
    return plane;
}

// Search distance (m) per point: the length of its step, within limits.
struct Need {
    ShellStep step;  // axes of the tool
    double least = 0, most = 0;
    double of(const Vec3d& arm) const { return std::clamp((step.shift + step.turn.cross(arm)).norm(), least, most); }
};

// Bits of the points k, ..., k + 3 (elements from index `index` on) that may be nearer than `within` to a surface
// according to the drift bounds alone.
uint32_t four_near(const LocalContactModel& model, uint32_t index, uint32_t k, double within, const PointShellScratch& s) {
    const auto four = [](const double* x) { return (Vec4d)_mm256_loadu_pd(x); };
    const Vec4d surface = four(&model.point_shell.speed[index]) * all_lanes(s.aged), own = all_lanes(s.turned) * four(&s.radius[k]);
    return mask_bits(four(&s.bound[index]) - surface - own > all_lanes(within + s.followed + s.shifted)) ^ 15;
}

// Lists in scratch.near the points, over all trees, that may be nearer than `within` to a surface.
void list_near(const LocalContactModel& model, const HandTool& tool, const Pose& pose, double within, PointShellScratch& s) {
    const double apart_by = (pose.tip - model.point_shell.tip).norm() +
                            angle_between(model.point_shell.turn, pose.turn) * tool.shell_radius +
                            pose.reach * std::abs(pose.grip - model.point_shell.grip);
    // surfaces faster than model.point_shell.speed stay this far from the points
    const bool told = std::abs(s.moment.age) <= model.point_shell.ahead;
    const double far = told ? model.point_shell.around - apart_by - s.followed : -std::numeric_limits<double>::infinity();
    const bool passes = far > within && !s.all_points;
    s.near.clear();
    s.within = within;
    const auto points = static_cast<uint32_t>(s.position.size());
    const auto list = [&](uint32_t tree, uint32_t k) {
        const uint32_t index = tree * points + k;
        const double surface = model.point_shell.speed[index] * s.aged + s.followed, own = s.shifted + s.turned * s.radius[k];
        // distances change no faster than positions
        s.position[k] = pose.tip + rotate(pose.turn, pose.point[k].arm);
        const double left = s.clear[index] - surface - (s.position[k] - s.asked_at[index]).norm(), known = std::min(left, far);
        s.bound[index] = left + surface + own;
        if (known <= within || s.all_points) s.near.push_back({tree, k, index, known});
    };
    for (uint32_t tree = 0; tree < model.point_shell.tree.size(); ++tree) {
        for (uint32_t k = 0; k < points; k += 4) {
            const uint32_t count = std::min(4u, points - k);
            uint32_t near = passes && count == 4 ? four_near(model, tree * points + k, k, within, s) : (1u << count) - 1;
            for (; near != 0; near &= near - 1) list(tree, k + static_cast<uint32_t>(std::countr_zero(near)));
        }
    }
}

// Adds to scratch.plane the points of scratch.near that are within `need` of a surface and not among the
// planes yet, ascending in body and point. A separation direction against the instrument's own outward normal
// is rejected: the far side of a thin wall is nearer there and must not pull the instrument through. Sets
// `inside` if any point was inside.
void add_planes(const LocalContactModel& model, const HandTool& tool, const Span& span, const Pose& pose, const Need& need,
                const std::vector<ShellContact>& contact, PointShellScratch& s, bool& inside) {
    Before before{contact};
    const double most = need.most + std::max(0.0, model.compliance.gap);
    for (ShellNear& entry : s.near) {
        if (entry.taken || (!s.all_points && entry.known > most)) continue;
        const uint32_t k = entry.point, body = model.point_shell.tree[entry.tree].body;
        const double gap = body == model.compliance.body ? model.compliance.gap : 0;
        const double room = need.of(pose.point[k].arm), near = room + std::max(0.0, gap);
        if (!s.all_points && entry.known > near) continue;
        const uint32_t hint = s.nearest[entry.index];
        const bool was_outside = !s.all_points && entry.known > 0 && hint != kNone;
        const double half = was_outside ? model.half_thickness[hint] : kThickest;
        const double reach = was_outside ? std::min(model.reach, near + kSearchBeyond + half) : model.reach;
        const NearestTriangle nearest = nearest_to(model, entry.tree, k, entry.index, s.position[k], reach, s);
        entry.known = reach - half;
        const ShellContact* held = before.find(body, k);
        SurfaceSide side;
        if (nearest.triangle != kNone) {
            s.nearest[entry.index] = nearest.triangle;
            entry.known = std::sqrt(nearest.at.squared_distance) - half;
            if (!was_outside || entry.known < near) {  // or it came through
                side = side_of(model, nearest, held ? held->side : 0, s.surface);
                entry.known = side.distance;
            }
        }
        note_distance(model, k, entry.index, s.position[k], entry.known, s);
        inside = inside || entry.known < 0;
        if (nearest.triangle == kNone || entry.known >= near || side.distance - gap >= room) continue;
        side.distance -= gap;
        entry.taken = true;
        if (side.distance < 0 && side.normal.dot(rotate(pose.turn, pose.point[k].inward)) < kAgainst) continue;
        ShellPlane plane = plane_of(model, span, k, body, s.position[k] - pose.tip, side, held);
        plane.gap = gap, plane.tree = entry.tree, plane.index = entry.index;
        plane.friction = feel_of(tool, model, body, held && held->sliding).friction;
        if (pose.point[k].jaw != kNone && !span.again) {
            // relative to a jaw that moves by itself, the surface moves in the opposite direction
            const Vec3d moved = rotate(pose.turn, pose.point[k].arm - pose.point_before[k].arm);
            plane.carried -= moved;
            if (span.elapsed > 0) plane.velocity -= moved / span.elapsed;
        }
        s.plane.push_back(plane);
    }
}

// The same for more points, skipping those that are planes already.
void list_more(const LocalContactModel& model, const HandTool& tool, const Pose& pose, double within, PointShellScratch& s) {
    std::swap(s.near, s.listed);
    list_near(model, tool, pose, within, s);
    auto known = s.listed.begin();
    for (ShellNear& entry : s.near) {
        while (known != s.listed.end() && known->index < entry.index) ++known;
        if (known != s.listed.end() && known->index == entry.index) entry = *known;
    }
}

double displacement_of(const ShellPlane& plane, const ShellStep& step) { return (step.shift + step.turn.cross(plane.arm)).norm(); }

// The step that balances coupling and planes, including the planes of all points that it brings to a surface:
// points are added as far as the step reaches, until none is missing.
ShellStep balance(const LocalContactModel& model, const HandTool& tool, const ShellSprings& springs, const Span& span, const Pose& pose,
                  ShellStep step, const std::vector<ShellContact>& contact, PointShellScratch& s) {
    double searched_to = kBand;
    bool inside = false;
    for (bool broken = true;;) {
        if (broken) step = solve_shell(springs, s.plane, step);
        const double displacement = step.shift.norm() + step.turn.norm() * tool.shell_radius;
        if (!broken && displacement <= searched_to) return step;
        searched_to = std::min(2 * searched_to, std::max(displacement, searched_to));
        const size_t had = s.plane.size();
        if (searched_to + std::max(0.0, model.compliance.gap) > s.within)
            list_more(model, tool, pose, 2 * searched_to + std::max(0.0, model.compliance.gap), s);
        const Need need{{rotate_back(pose.turn, step.shift), rotate_back(pose.turn, step.turn)}, kBand, searched_to};
        add_planes(model, tool, span, pose, need, contact, s, inside);
        broken = std::any_of(s.plane.begin() + static_cast<ptrdiff_t>(had), s.plane.end(),
                             [&](const ShellPlane& plane) { return plane.held > 0 || separation_after(plane, step) < 0; });
    }
}

// Whether the planes still match the surface after a step, to a hundredth of the force on them: at points in
// contact or nearly so, and at points that moved farther than their clearance.
bool planes_hold(const LocalContactModel& model, const Pose& pose, const ShellStep& step, PointShellScratch& s) {
    constexpr double kWrong = 0.01;  // of the depths
    double wrong = 0, depth = 0;
    for (const ShellPlane& plane : s.plane) {
        const double gap = separation_after(plane, step);
        if (gap > kNearlyTouching && displacement_of(plane, step) < plane.distance) continue;
        const Vec3d point = pose.tip + rotate(pose.turn, pose.point[plane.point].arm);
        const double half = model.half_thickness[s.nearest[plane.index]];
        const double reach = std::abs(gap + plane.gap) + half + kSearchBeyond;
        const NearestTriangle nearest = nearest_to(model, plane.tree, plane.point, plane.index, point, reach, s);
        const double distance = nearest.triangle == kNone ? reach - half : side_of(model, nearest, plane.side, s.surface).distance;
        note_distance(model, plane.point, plane.index, point, distance, s);
        if (nearest.triangle != kNone) s.nearest[plane.index] = nearest.triangle;
        const double is = distance - plane.gap;
        wrong += std::abs(std::min(0.0, is) - std::min(0.0, gap));
        depth -= std::min(0.0, gap);
    }
    return wrong <= kWrong * depth;
}

// Result of an iteration: the tool is at its solution, the planes are wrong there, or the step was cut.
enum class Iteration { kDone, kWrong, kCut };

// Moves the tool to the balance of the planes and stores its contacts in state.contact.
Iteration move_shell(const LocalContactModel& model, const HandTool& tool, const ShellSprings& springs, const Span& span, const Pose& pose,
                     PointShellScratch& s, ToolState& state) {
    ShellStep step = balance(model, tool, springs, span, pose, {}, state.contact, s);
    // the friction limit uses the normal forces of the last tick first, then the resulting ones
    const bool rough = std::any_of(s.plane.begin(), s.plane.end(), [](const ShellPlane& plane) { return plane.friction > 0; });
    if (rough) {
        for (ShellPlane& plane : s.plane) plane.held = shell_force(springs, plane, step).normal;
        step = balance(model, tool, springs, span, pose, step, state.contact, s);
    }
    // surfaces beyond a plane may obstruct the step; a surface that moved in pushes as far as it moved. After
    // a cut the tool continues in the next iteration or tick. Meanwhile it bears the forces of the planes at
    // their balance, so no force drops out
    double share = 1;
    for (const ShellPlane& plane : s.plane) {
        const double displacement = displacement_of(plane, step),
                     most = std::max(plane.distance, kStride + (plane.distance < 0 ? plane.carried.norm() : 0));
        if (displacement > most) share = std::min(share, most / displacement);
    }
    const double displacement = step.shift.norm() + step.turn.norm() * tool.shell_radius;
    const ShellStep whole = step;
    step.shift *= share, step.turn *= share;
    const Quat turned = from_rotation_vector(step.turn);
    state.proxy = pose.tip + step.shift;
    state.proxy_turn = normalized(multiply(turned, pose.turn));
    std::sort(s.plane.begin(), s.plane.end(), [](const ShellPlane& a, const ShellPlane& b) { return a.index < b.index; });
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
    if (share < 1) return Iteration::kCut;
    return displacement <= kConverged || planes_hold(model, moved, step, s) ? Iteration::kDone : Iteration::kWrong;
}

// The coupling in series with the stiffness of the touched surfaces, weighted by the force on each body.
double coupling_in_series(const HandTool& tool, const LocalContactModel& model, const std::vector<ShellContact>& contacts,
                          const std::vector<ShellPlane>& planes) {
    if (model.surface.empty()) return tool.coupling_stiffness;
    double press = 0, yield = 0;  // N, m
    const auto add = [&](uint32_t body, double force) {
        press += force;
        const HapticSurface* surface = surface_of(model, body);
        if (surface && surface->stiffness > 0) yield += force / surface->stiffness;
    };
    for (const ShellContact& c : contacts) add(c.body, c.force.norm());
    if (contacts.empty())  // at the first touch, of the surfaces near it
        for (const ShellPlane& plane : planes) add(plane.body, 1);
    return press > 0 ? tool.coupling_stiffness * press / (press + tool.coupling_stiffness * yield) : tool.coupling_stiffness;
}

// Scales the contact forces of each body with damping b by a common factor that adds the damping force, -b
// times their power over their sum; the change is at most the force itself. Planes and contacts have their
// points in the same order. Returns the largest b (N s/m).
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

// Body with the largest contact force.
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

// Records the touched body, whether it slides, and how far its surface carried the instrument.
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

// Changes since the last tick that justify a change of the command.
struct TickChange {
    double elapsed = 0;         // s
    double device_travel = 0;   // m
    double device_turn = 0;     // rad
    double surface_travel = 0;  // m, displacement of surfaces against the tool and of its jaws against them
    double damping = 0;         // N, of the damping forces
    double gain = 0;            // of ToolState::gain
};

// Moves the last command towards the wanted one, as far as the changes since then justify plus a small amount
// each tick. Force and torque move by the same fraction, so that they remain those of the same contacts.
void slew_command(const HapticParams& params, const HandTool& tool, const TickChange& change, const Wrench& wanted, ToolState& state) {
    double lever = 1e-3;  // m
    for (const ShellContact& c : state.contact) lever = std::max(lever, c.arm.norm());
    // a released force keeps its lever arm
    if (const double last = state.command.force.norm(); last > 0)
        lever = std::max(lever, std::min(tool.shell_radius, state.command.torque.norm() / last));
    const double ramp = params.force_slew * change.elapsed + tool.max_force * change.gain + change.damping;
    const double force_room = tool.coupling_stiffness * (change.device_travel + change.device_turn * lever + change.surface_travel) + ramp;
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

// Moves the tool as far as one iteration allows, or waits until all of it is outside.
Iteration search_and_move(const LocalContactModel& model, const HandTool& tool, const Span& span, const Pose& pose, PointShellScratch& s,
                          ToolState& state) {
    if (!covers(model, tool, pose, span.now, kBand + std::max(0.0, model.compliance.gap))) {
        // what is free waits for a model that covers it
        if (!state.contact.empty()) state.proxy_valid = false;
        state.contact.clear();
        s.plane.clear();
        return Iteration::kDone;
    }
    note_motion(model, tool, span.now, pose, s);
    s.plane.clear();
    list_near(model, tool, pose, kListed + std::max(0.0, model.compliance.gap), s);
    bool inside = false;
    add_planes(model, tool, span, pose, {{}, kBand, kBand}, state.contact, s, inside);
    if (!state.proxy_valid) {
        state.proxy = pose.tip;
        state.proxy_turn = pose.turn;
        state.contact.clear();
        state.proxy_valid = !inside;
        return Iteration::kDone;
    }
    ShellSprings springs{coupling_in_series(tool, model, state.contact, s.plane), tool.turn_stiffness, tool.surface_stiffness, {}};
    springs.to_device = {state.device.position - pose.tip, rotation_vector(pose.turn, state.device.orientation)};
    return move_shell(model, tool, springs, span, pose, s, state);
}

// Planes match the surface only near the points where they were found. On rough surfaces another iteration
// from the new position finds others, and a surface that moved in deep may push farther than one iteration
// allows. Iterations take no simulated time.
void update_shell(const LocalContactModel& model, const HandTool& tool, Span span, Pose pose, PointShellScratch& s, ToolState& state) {
    const bool was_valid = state.proxy_valid;
    begin_moment(model, span.now, s.surface);
    for (uint32_t iteration = 0; iteration < kMostIterations; ++iteration) {
        const Iteration came = search_and_move(model, tool, span, pose, s, state);
        if (came == Iteration::kDone || !was_valid || (came == Iteration::kWrong && state.contact.empty())) return;
        pose.tip = state.proxy, pose.turn = state.proxy_turn;
        span.before = span.now;
        span.again = true;
    }
}

}  // namespace

void point_shell_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
                      const DeviceState& sample, PointShellScratch& scratch, ToolState& state) {
    TROCAR_ASSERT(!tool.point_shell.empty() && tool.surface_stiffness > 0 && tool.turn_stiffness > 0);
    if (state.contact.capacity() < tool.point_shell.size()) state.contact.reserve(tool.point_shell.size());
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

    const double device_travel = (state.device.position - last.position).norm();
    const Vec3d device_turn = rotation_vector(normalized(last.orientation), state.device.orientation);
    state.device_spin = span.elapsed > 0 ? Vec3d(device_turn / span.elapsed) : Vec3d(Vec3d::Zero());
    const double surface_travel = model.fastest * std::abs(span.now.age - span.before.age) + (span.now.follow - span.before.follow).norm();
    const ProxyStart start = proxy_start(model, state);
    Pose pose = state.proxy_valid ? Pose{state.proxy, state.proxy_turn} : Pose{start.tip, start.turn};
    pose.grip = state.device.grip;
    pose.reach = tool.shell_jaw.empty() ? 0 : jaw_reach(tool);
    pose.point = points_at_grip(tool, pose.grip, scratch.open);
    pose.point_before = points_at_grip(tool, last.grip, scratch.opened);
    const double jaw_travel = pose.reach * std::abs(pose.grip - last.grip);
    const bool inside = !state.proxy_valid && push_out(model, state);
    if (inside)
        scratch.plane.clear();
    else
        update_shell(model, tool, span, pose, scratch, state);
    const double damping = damp_contacts(model, state.device, state.device_spin, scratch.plane, state.contact);
    note_touch(span.elapsed, scratch.plane, state);

    Wrench wanted = sum_contacts(state.contact);
    if (inside)
        wanted.force = limited_to(tool.coupling_stiffness * state.pushed, tool.max_force);
    else
        state.contacts = static_cast<uint32_t>(state.contact.size());
    wanted.force *= state.gain;
    wanted.torque *= state.gain;
    state.pull = wanted.force;
    state.pull_torque = wanted.torque;
    if (accepted) {
        const TickChange change{.elapsed = span.elapsed,
                                .device_travel = device_travel,
                                .device_turn = device_turn.norm(),
                                .surface_travel = surface_travel + jaw_travel,
                                .damping = damping * (state.device.velocity - last.velocity).norm(),
                                .gain = std::abs(state.gain - last_gain)};
        slew_command(params, tool, change, wanted, state);
    } else {
        state.command = {};
    }
}

}  // namespace trocar
