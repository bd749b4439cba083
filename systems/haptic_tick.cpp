#include "systems/haptic_tick.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "engine/check.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "systems/haptic_device.hpp"
#include "systems/haptic_planes.hpp"
namespace trocar {
namespace {

constexpr double kSkin = 1e-9;        // m, the sweep stops this much deeper than the planes hold, so that sliding along
                                      // a plane is never taken for hitting it
constexpr double kConverged = 1e-10;  // m, a smaller step ends the search
constexpr uint32_t kSteps = 16;       // of one search; a longer one goes on in the next tick
constexpr uint32_t kSweeps = 40;      // Newton steps to the first touch of one triangle
constexpr double kSlipSpeed = 1;     // m/s, of the proxy beyond twice that of the device: a longer way round goes on in
                                     // the next tick
constexpr double kLongestGap = 0.1;  // s, ticks farther apart than this count as this far

// ---- surface near the proxy ----

double segment_distance(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const Vec3d along = b - a;
    const double length2 = along.squaredNorm();
    const double t = length2 > 0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0;
    return (a + t * along - p).norm();
}

bool within(const Vec3d& a, const Vec3d& b, double distance) { return (a - b).squaredNorm() <= distance * distance; }

// Where the surfaces of a model are at a time: positions + age * velocities, those of the body that gives way `follow`
// beyond that.
struct SurfaceTime {
    double age = 0;                 // s
    Vec3d follow = Vec3d::Zero();   // m
    Vec3d beyond(const LocalContactModel& model, uint32_t body) const {
        return body == model.give.body ? follow : Vec3d(Vec3d::Zero());
    }
};

// Takes the corners there; the ball around them. False when that lies farther than `travel` from touching `centre`.
bool place(const LocalContactModel& model, const SurfaceTime& at, const Vec3d& centre, double travel, NearTriangle& near,
           NearDisc& disc) {
    const Vec3d beyond = at.beyond(model, near.body);
    for (int k = 0; k < 3; ++k)
        near.corner[k] = model.position[near.vertex[k]] + at.age * model.velocity[near.vertex[k]] + beyond;
    const auto& [p, q, r] = near.corner;
    disc.centre = (p + q + r) / 3;
    disc.radius = std::sqrt(
        std::max({(p - disc.centre).squaredNorm(), (q - disc.centre).squaredNorm(), (r - disc.centre).squaredNorm()}));
    if (!within(disc.centre, centre, disc.radius + disc.offset + travel)) return false;
    const Vec3d n = triangle_normal(p, q, r);
    const double length = n.norm();
    disc.normal = length > 0 ? Vec3d(n / length) : Vec3d::Zero();
    return true;
}

// Fills scratch.near with the triangles that a tip touches somewhere nearer than `travel` to `centre` (told by balls),
// as they lie then.
void gather_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel,
                 HapticScratch& scratch) {
    scratch.near.clear();
    scratch.disc.clear();
    NearTriangle near;
    NearDisc disc;
    for (const TriangleGroup& group : model.group) {
        const double half_thickness = model.half_thickness[group.triangles.first];
        disc.offset = tool.tip_radius + half_thickness;
        near.sheet = half_thickness > 0;
        near.body = model.body[group.triangles.first];
        const double reach = group.radius + group.spread * std::abs(at.age) + disc.offset + travel;
        if (!within(group.centre + at.age * group.velocity + at.beyond(model, near.body), centre, reach)) continue;
        for (uint32_t t = group.triangles.first; t < group.triangles.end(); ++t) {
            near.vertex = model.triangle[t];
            if (!place(model, at, centre, travel, near, disc)) continue;
            scratch.near.push_back(near);
            scratch.disc.push_back(disc);
        }
    }
}

// Whether a point of the way from - half to + half around `middle` may come nearer than `most` to the triangle in a
// disc, where the way lies `height` or more off its plane: off the plane, and off the disc along the plane.
bool may_come_near(const NearDisc& disc, const Vec3d& middle, double half, double height, double most) {
    const double room2 = most * most - height * height;
    if (room2 < 0) return false;
    const Vec3d way = middle - disc.centre;
    const double across = disc.normal.dot(way);
    const double along = disc.radius + half + std::sqrt(room2);
    // rounding of the squares: a part in 1e12 of what they were made of
    return way.squaredNorm() - across * across <= along * along + 1e-12 * (way.squaredNorm() + along * along);
}
bool may_come_near(const NearDisc& disc, const Vec3d& point, double most) {
    return may_come_near(disc, point, 0, std::abs(disc.normal.dot(point - disc.centre)), most);
}

// ---- features ----

bool has_vertex(const Triangle& t, uint32_t v) { return t[0] == v || t[1] == v || t[2] == v; }

// Vertices of the model that a feature of a triangle has in common with its neighbours: one, two or none.
struct FeatureVertices {
    uint32_t a = kNone, b = kNone;
};
FeatureVertices feature_vertices(const Triangle& t, Feature feature) {
    switch (feature) {
        case Feature::kVertex0:
            return {t[0], kNone};
        case Feature::kVertex1:
            return {t[1], kNone};
        case Feature::kVertex2:
            return {t[2], kNone};
        case Feature::kEdge0:
            return {t[0], t[1]};
        case Feature::kEdge1:
            return {t[1], t[2]};
        case Feature::kEdge2:
            return {t[2], t[0]};
        case Feature::kFace:
            break;
    }
    return {};
}
int dimension(Feature feature) { return feature == Feature::kFace ? 2 : feature >= Feature::kEdge0 ? 1 : 0; }
bool holds(const Triangle& t, const FeatureVertices& f) {
    return has_vertex(t, f.a) && (f.b == kNone || has_vertex(t, f.b));
}
bool same_feature(const FeatureVertices& f, const FeatureVertices& g) {
    return (f.a == g.a && f.b == g.b) || (f.a == g.b && f.b == g.a);
}

double corner_angle(const NearTriangle& near, uint32_t vertex) {
    const int k = near.vertex[0] == vertex ? 0 : near.vertex[1] == vertex ? 1 : 2;
    const Vec3d u = near.corner[(k + 1) % 3] - near.corner[k], v = near.corner[(k + 2) % 3] - near.corner[k];
    return std::atan2(u.cross(v).norm(), u.dot(v));
}

// Whether the point that lies at -offset from a feature is behind it: angle-weighted pseudonormal (Baerentzen & Aanaes,
// TVCG 11(3), 2005). Nothing is behind a sheet.
bool is_behind(const HapticScratch& scratch, uint32_t row, Feature feature, const Vec3d& offset) {
    if (scratch.near[row].sheet) return false;
    const FeatureVertices f = feature_vertices(scratch.near[row].vertex, feature);
    if (f.a == kNone) return scratch.disc[row].normal.dot(offset) > 0;
    Vec3d pseudonormal = Vec3d::Zero();
    for (size_t k = 0; k < scratch.near.size(); ++k) {
        const NearTriangle& near = scratch.near[k];
        if (!holds(near.vertex, f)) continue;
        pseudonormal += (f.b == kNone ? corner_angle(near, f.a) : 1.0) * scratch.disc[k].normal;
    }
    return pseudonormal.dot(offset) > 0;
}

// Fills scratch.touched with the features nearer to `centre` than their offset, and only those that are nearest points
// of the surface around them: the rest belong to a neighbour that is touched nearer.
void find_touched(const Vec3d& centre, HapticScratch& scratch) {
    std::vector<TouchedFeature>& touched = scratch.touched;
    touched.clear();
    for (uint32_t row = 0; row < scratch.near.size(); ++row) {
        const double most = scratch.disc[row].offset + kSkin;
        if (!may_come_near(scratch.disc[row], centre, most)) continue;
        const auto& [a, b, c] = scratch.near[row].corner;
        const TrianglePoint q = closest_point_on_triangle(centre, a, b, c);
        if (q.squared_distance > most * most) continue;
        touched.push_back({row, q.feature, q.offset, std::sqrt(q.squared_distance)});
    }
    const auto triangle = [&](const TouchedFeature& f) -> const Triangle& { return scratch.near[f.near].vertex; };
    // faces before edges before vertices, then the nearer: the first of this order always stays, however rounding names
    // the features around a point above a vertex
    const auto comes_before = [](const TouchedFeature& f, const TouchedFeature& g) {
        return std::make_tuple(-dimension(f.feature), f.distance, f.near) <
               std::make_tuple(-dimension(g.feature), g.distance, g.near);
    };
    // a triangle that holds the feature but whose own closest point is elsewhere comes nearer
    const auto is_shadowed = [&](const TouchedFeature& f) {
        const FeatureVertices mine = feature_vertices(triangle(f), f.feature);
        if (mine.a == kNone) return false;
        return std::any_of(touched.begin(), touched.end(), [&](const TouchedFeature& other) {
            return holds(triangle(other), mine) && comes_before(other, f) &&
                   !same_feature(feature_vertices(triangle(other), other.feature), mine);
        });
    };
    // marked first: removing while looking would change what the later ones see
    for (TouchedFeature& f : touched) f.shadowed = is_shadowed(f);
    std::erase_if(touched, [](const TouchedFeature& f) { return f.shadowed; });
}

// ---- planes ----

struct Planes {
    HalfSpaces half_spaces;  // relative to the centre of the tip
    bool inside = false;     // the nearest feature is seen from behind
};

// Tangent planes of the touched features, relative to `centre`. Every one leaves its triangle wholly on the other side,
// so any step that keeps to them is safe. Features seen from behind hold nothing; but when the nearest one is, the
// surface has passed over the centre, and the way out is through it.
Planes gather_planes(const Vec3d& centre, HapticScratch& scratch) {
    find_touched(centre, scratch);
    Planes planes;
    for (NearTriangle& near : scratch.near) near.held = false;
    const TouchedFeature* nearest = nullptr;
    for (const TouchedFeature& f : scratch.touched)
        if (!nearest || f.distance < nearest->distance) nearest = &f;
    if (!nearest) return planes;
    planes.inside = is_behind(scratch, nearest->near, nearest->feature, nearest->offset);
    for (const TouchedFeature& f : scratch.touched) {
        const NearDisc& disc = scratch.disc[f.near];
        const bool way_out = planes.inside && &f == nearest;
        const bool behind = way_out || is_behind(scratch, f.near, f.feature, f.offset);
        if (behind && !way_out) continue;
        if (f.distance < 1e-12) {
            scratch.near[f.near].held = planes.half_spaces.add({disc.normal, disc.offset});
        } else {
            const double side = behind ? 1 : -1;
            scratch.near[f.near].held =
                planes.half_spaces.add({side / f.distance * f.offset, disc.offset + side * f.distance});
        }
    }
    return planes;
}

// Distance (m) of a tip's centre from a triangle less the distance at which they touch, along a step: where on the step,
// how it changes with the share of the step.
struct GapAlong {
    double gap = 0, approach = 0;  // m, m per step
    bool behind = false;
};
GapAlong gap_along(const HapticScratch& scratch, uint32_t row, const Vec3d& from, const Vec3d& step, double t,
                   bool ask_side) {
    const auto& [a, b, c] = scratch.near[row].corner;
    const TrianglePoint q = closest_point_on_triangle(from + t * step, a, b, c);
    const double distance = std::sqrt(q.squared_distance);
    GapAlong g;
    g.gap = distance - (scratch.disc[row].offset - kSkin);
    g.approach = distance > 0 ? q.offset.dot(step) / distance : 0;
    g.behind = ask_side && g.gap <= 0.5 * kSkin && is_behind(scratch, row, q.feature, q.offset);
    return g;
}

// Whether a gap that is convex along a step stays open from its start to share `end`: by the tangents at both.
bool stays_open(const GapAlong& start, const GapAlong& finish, double end) {
    if (finish.gap <= 0.5 * kSkin) return false;
    if (finish.approach >= 0) return true;
    const double lowest = (start.gap - finish.gap - finish.approach * end) / (start.approach - finish.approach);
    return start.gap - start.approach * lowest > 0.5 * kSkin;
}

// Share of the way from `from` by `step` until the tip first touches a triangle: Newton's method on the distance, which
// is convex along a line, so it comes from the free side and never passes. 1 if it does not touch before `least`.
double sweep_to_triangle(const HapticScratch& scratch, uint32_t row, const Vec3d& from, const Vec3d& step,
                         double least) {
    double t = 0;
    for (uint32_t k = 0; k < kSweeps; ++k) {
        const GapAlong g = gap_along(scratch, row, from, step, t, k > 0);
        // touched already: it is held by its plane, or shadowed by a feature that is
        if (k == 0 && g.gap <= 0.5 * kSkin) return 1;
        if (!(g.approach > 0)) return 1;
        if (g.gap <= 0.5 * kSkin) return g.behind ? 1 : t;
        t += g.gap / g.approach;
        if (t >= least) return 1;
        // most near misses are told here; where they graze, Newton's method is slow
        if (k == 0 && stays_open(g, gap_along(scratch, row, from, step, least, false), least)) return 1;
    }
    return t;
}

// Fills scratch.ahead with the triangles that a tip may touch along a step, and the share of it before which their
// planes rule that out.
void gather_ahead(const Vec3d& from, const Vec3d& step, HapticScratch& scratch) {
    const Vec3d middle = from + 0.5 * step;
    const double half = 0.5 * step.norm();
    scratch.ahead.clear();
    for (uint32_t row = 0; row < scratch.near.size(); ++row) {
        if (scratch.near[row].held) continue;
        const NearDisc& disc = scratch.disc[row];
        const double h0 = disc.normal.dot(from - disc.centre), h1 = h0 + disc.normal.dot(step);
        const double height = h0 * h1 > 0 ? std::min(std::abs(h0), std::abs(h1)) : 0;
        if (!may_come_near(disc, middle, half, height, disc.offset - kSkin)) continue;
        const double room = std::abs(h0) - (disc.offset - kSkin), closing = std::abs(h0) - (h0 > 0 ? h1 : -h1);
        scratch.ahead.push_back({room > 0 && closing > 0 ? room / closing : 0, row});
    }
}

// Share of `step` that is free.
double sweep(const Vec3d& from, const Vec3d& step, HapticScratch& scratch) {
    gather_ahead(from, step, scratch);
    // the soonest first: what it leaves free, most of the others cannot shorten
    const auto soonest = std::min_element(scratch.ahead.begin(), scratch.ahead.end(),
                                          [](const SweptTriangle& a, const SweptTriangle& b) { return a.from < b.from; });
    if (soonest == scratch.ahead.end()) return 1;
    std::iter_swap(scratch.ahead.begin(), soonest);
    double least = 1;
    for (const SweptTriangle& ahead : scratch.ahead)
        if (ahead.from < least) least = std::min(least, sweep_to_triangle(scratch, ahead.near, from, step, least));
    return least;
}

// ---- proxy ----

struct Search {
    Vec3d proxy = Vec3d::Zero();
    uint32_t active = 0;  // planes that hold it
    bool inside = false;  // inside tissue, and nothing says that it was outside before
};

// Where a proxy goes that friction holds: back from the point that it would slide to until the tangential pull of the
// coupling is at most friction times its normal pull. Relative to the proxy, like `planes`.
Vec3d held_by_friction(double friction, const HalfSpaces& planes, const Vec3d& slid, const Vec3d& goal) {
    // where it is, or straight out of a surface that came too near
    const Vec3d stuck = project_on_half_spaces(Vec3d::Zero(), planes).point;
    const double slip = (stuck - slid).norm(), grip = friction * (slid - goal).norm();
    return slip <= grip ? stuck : Vec3d(slid + grip / slip * (stuck - slid));
}

// Share of `step` from `from` that stays within `travel` of `origin`.
double share_within(const Vec3d& from, const Vec3d& step, const Vec3d& origin, double travel) {
    const Vec3d way = from - origin;
    const double a = step.squaredNorm(), b = way.dot(step), c = way.squaredNorm() - travel * travel;
    if (a + 2 * b + c <= 0) return 1;
    return std::clamp((std::sqrt(std::max(0.0, b * b - a * c)) - b) / a, 0.0, 1.0);
}

// Room that the triangles at hand show: the proxy may go there in this tick, the rest of a longer way in the next.
struct Room {
    Vec3d origin = Vec3d::Zero();
    double travel = 0;  // m
};

// Moves the tip from `start` to the point nearest to `goal` that it can slide to.
Search find_proxy(const Vec3d& start, const Vec3d& goal, const Room& room, double friction, bool was_outside,
                  HapticScratch& scratch) {
    Search s;
    s.proxy = start;
    for (uint32_t k = 0; k < kSteps; ++k) {
        const Planes planes = gather_planes(s.proxy, scratch);
        if (planes.inside && !was_outside) {
            s.inside = true;
            return s;
        }
        const Vec3d pull = goal - s.proxy;
        const Projection nearest = project_on_half_spaces(pull, planes.half_spaces);
        // squeezed from both sides: stay
        if (!nearest.feasible) {
            s.active = planes.half_spaces.count;
            break;
        }
        s.active = nearest.count;
        Vec3d step = nearest.point;
        if (friction > 0 && nearest.count > 0) step = held_by_friction(friction, planes.half_spaces, step, pull);
        if (step.squaredNorm() <= kConverged * kConverged) break;
        const double share = share_within(s.proxy, step, room.origin, room.travel);
        step *= share;
        s.proxy += sweep(s.proxy, step, scratch) * step;
        if (share < 1 && step.squaredNorm() <= kConverged * kConverged) break;
    }
    // cut short on its way round a convex edge, it may hover over the surface that keeps it from the goal
    if (s.active == 0 && (goal - s.proxy).squaredNorm() > kConverged * kConverged) s.active = 1;
    return s;
}

// Motion of the surface where it is nearest to a point; none if nothing is nearer than `most` beyond touching.
struct SurfaceMotion {
    Vec3d velocity = Vec3d::Zero();  // m/s, of the model
    uint32_t body = kNone;
};
SurfaceMotion surface_motion(const LocalContactModel& model, const HapticScratch& scratch, const Vec3d& point, double most) {
    double best = std::numeric_limits<double>::infinity();
    SurfaceMotion motion;
    for (size_t k = 0; k < scratch.near.size(); ++k) {
        const NearTriangle& n = scratch.near[k];
        const double nearer = std::min(best, scratch.disc[k].offset + most);
        if (!may_come_near(scratch.disc[k], point, nearer)) continue;
        const TrianglePoint q = closest_point_on_triangle(point, n.corner[0], n.corner[1], n.corner[2]);
        if (q.squared_distance >= nearer * nearer) continue;
        best = std::sqrt(q.squared_distance);
        const Vec3d u = n.corner[1] - n.corner[0], v = n.corner[2] - n.corner[0];
        const Vec3d w = point + q.offset - n.corner[0];
        const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), area = uu * vv - uv * uv;
        const double b = area > 0 ? std::clamp((vv * u.dot(w) - uv * v.dot(w)) / area, 0.0, 1.0) : 0;
        const double c = area > 0 ? std::clamp((uu * v.dot(w) - uv * u.dot(w)) / area, 0.0, 1.0 - b) : 0;
        motion.velocity = (1 - b - c) * model.velocity[n.vertex[0]] + b * model.velocity[n.vertex[1]] +
                          c * model.velocity[n.vertex[2]];
        motion.body = n.body;
    }
    return motion;
}

struct TickSpan {
    double elapsed = 0;  // s, since the last tick
    SurfaceTime before;  // of the surface at the last tick
    SurfaceTime now;
    double travel = 0;   // m, the proxy may go
    double moved() const { return now.age - before.age; }
    // m, a surface that went fastest since the last tick
    double surface_way(const LocalContactModel& model) const {
        return model.fastest * std::abs(moved()) + (now.follow - before.follow).norm();
    }
};

// A surface is not advanced for longer than it was published for: a stalled one stands still.
TickSpan span_of(const HapticParams& params, const LocalContactModel& model, double time, const ToolState& state) {
    const auto shown = [&](double age) { return std::clamp(age, -params.greatest_age, params.greatest_age); };
    TickSpan span;
    span.elapsed = state.ticks > 0 ? std::clamp(time - state.time, 0.0, kLongestGap) : params.dt;
    span.now.age = shown(time - model.time);
    span.before.age = shown(time - model.time - span.elapsed);
    return span;
}

// Takes the proxy along with the surface that moved since the last tick, in steps shorter than half the tip's radius so
// that the surface cannot pass over its centre.
void carry_proxy(const LocalContactModel& model, const TickSpan& span, double radius, const Room& room,
                 HapticScratch& scratch, ToolState& state) {
    const double way = span.surface_way(model);
    if (way == 0 && state.contacts == 0) return;
    const int steps = static_cast<int>(std::clamp(std::ceil(way / (0.5 * radius)), 1.0, 16.0));
    bool was_outside = state.contacts > 0;
    for (int k = 1; k <= steps; ++k) {
        const double left = double(steps - k) / steps;
        const Vec3d followed = span.now.follow - span.before.follow;
        const SurfaceTime at{span.now.age - span.moved() * left, span.now.follow - left * followed};
        if (was_outside && way > 0) {
            const SurfaceMotion motion = surface_motion(model, scratch, state.proxy, radius);
            state.proxy += span.moved() / steps * motion.velocity;
            if (motion.body != kNone && motion.body == model.give.body) state.proxy += followed / steps;
        }
        if (steps > 1)
            for (size_t row = 0; row < scratch.near.size(); ++row)
                place(model, at, room.origin, std::numeric_limits<double>::infinity(), scratch.near[row],
                      scratch.disc[row]);
        const Search s = find_proxy(state.proxy, state.proxy, room, 0, was_outside, scratch);
        state.proxy = s.proxy;
        was_outside = was_outside || s.active > 0;
        if (s.inside) {
            state.proxy_valid = false;
            state.contacts = 0;
            return;
        }
    }
}

// Whether a tip there is clear of all that is near.
bool is_clear(const Vec3d& centre, HapticScratch& scratch) {
    find_touched(centre, scratch);
    return std::all_of(scratch.touched.begin(), scratch.touched.end(),
                       [&](const TouchedFeature& f) { return f.distance >= scratch.disc[f.near].offset; });
}

// Moves the proxy to where it belongs for the device's present position.
void update_proxy(const LocalContactModel& model, const TickSpan& span, const HandTool& tool, HapticScratch& scratch,
                  ToolState& state) {
    const Vec3d goal = state.device.position;
    if (!state.proxy_valid) {
        state.proxy = goal;
        state.contacts = 0;
        state.proxy_valid = is_clear(goal, scratch);
        return;
    }
    const Room room{state.proxy, span.travel};
    carry_proxy(model, span, tool.tip_radius, room, scratch, state);
    if (!state.proxy_valid) return;
    const Search s = find_proxy(state.proxy, goal, room, tool.friction, state.contacts > 0, scratch);
    state.proxy = s.proxy;
    state.proxy_valid = !s.inside;
    state.contacts = s.inside ? 0 : s.active;
    // hovering on its way round an edge, it is still that body's: nothing is touched then
    if (state.contacts > 0 && !scratch.touched.empty()) state.touched = scratch.near[scratch.touched.front().near].body;
}

// ---- force ----

Vec3d limited(const Vec3d& v, double most) {
    const double length = v.norm();
    return length > most ? Vec3d(v * (most / length)) : v;
}

// Force of the coupling on the hand. N
Vec3d coupling_force(const HandTool& tool, const ToolState& state, const Vec3d& surface_velocity) {
    if (!state.proxy_valid || state.contacts == 0) return Vec3d::Zero();
    const Vec3d spring = tool.coupling_stiffness * (state.proxy - state.device.position);
    const double pull = spring.norm();
    if (pull == 0) return Vec3d::Zero();
    const Vec3d direction = spring / pull;
    const double speed = (state.device.velocity - surface_velocity).dot(direction);
    // damping starts with the spring from zero, so that first touch and release are without a step
    const double damping = std::clamp(-tool.coupling_damping * speed, -pull, pull);
    // a hair below the maximum, so that rounding never exceeds it
    return limited((pull + damping) * direction, tool.max_force * (1 - 1e-12));
}

// Force on the hand (N) on the way from the last command to `wanted`: as far as the motions since then explain, and a
// little more each tick, so that a new set of contacts ramps in.
Vec3d slewed_force(const HapticParams& params, const HandTool& tool, const TickSpan& span, const Vec3d& wanted,
                   const Vec3d& drift, const DeviceState& last, double last_gain, const ToolState& state) {
    const double way = (state.device.position - last.position).norm() + drift.norm() * span.moved();
    const double explained = tool.coupling_stiffness * way +
                             tool.coupling_damping * (state.device.velocity - last.velocity).norm() +
                             tool.max_force * std::abs(state.gain - last_gain);
    return state.command.force + limited(wanted - state.command.force, explained + params.force_slew * span.elapsed);
}

}  // namespace

void haptic_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
                 const DeviceState& sample, HapticScratch& scratch, ToolState& state) {
    TROCAR_ASSERT(tool.tip_radius > 0);
    const DeviceState last = state.device_valid ? state.device : sample;
    const double last_gain = state.gain;
    TickSpan span = span_of(params, model, time, state);
    state.time = time;
    state.model_age = time - model.time;
    ++state.ticks;
    const bool accepted = take_sample(params, sample, state);
    if (!state.device_valid) return;
    state.gain = next_gain(params, accepted, time - state.device.time, state.model_age, span.elapsed, state.gain);

    const Vec3d centre = state.proxy_valid ? state.proxy : state.device.position;
    const double device_way = (state.device.position - last.position).norm();
    span.before.follow = surface_follow(params, model.give, last.position, span.before.age);
    span.now.follow = surface_follow(params, model.give, state.device.position, span.now.age);
    const double surface_way = span.surface_way(model);
    span.travel = std::min((state.device.position - centre).norm(), kSlipSpeed * span.elapsed + 2 * device_way) +
                  2 * surface_way + 10 * kSkin;
    // beyond what the model shows there may be anything
    if (segment_distance(centre, model.from, model.to) + tool.tip_radius + span.travel + span.now.follow.norm() <= model.reach) {
        gather_near(model, span.now, tool, centre, span.travel + surface_way, scratch);
        update_proxy(model, span, tool, scratch, state);
    } else {
        state.proxy_valid = false;
        state.contacts = 0;
    }
    if (state.contacts == 0) state.touched = kNone;
    Vec3d drift = Vec3d::Zero();
    if (state.contacts > 0 && surface_way > 0) {
        const SurfaceMotion motion = surface_motion(model, scratch, state.proxy, tool.tip_radius);
        drift = motion.velocity;
        if (motion.body != kNone && motion.body == model.give.body && span.elapsed > 0)
            drift += (span.now.follow - span.before.follow) / span.elapsed;
    }
    const Vec3d wanted = state.gain * coupling_force(tool, state, drift);
    state.command.force =
        accepted ? slewed_force(params, tool, span, wanted, drift, last, last_gain, state) : Vec3d(Vec3d::Zero());
    state.largest_force = std::max(state.largest_force, state.command.force.norm());
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
    }
}

}  // namespace trocar
