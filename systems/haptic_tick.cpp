#include "systems/haptic_tick.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "engine/check.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/quaternion.hpp"
#include "systems/haptic_planes.hpp"
namespace trocar {
namespace {

constexpr double kSkin = 1e-9;        // m, the sweep stops this much deeper than the planes hold, so that sliding along
                                      // a plane is never taken for hitting it
constexpr double kConverged = 1e-10;  // m, a smaller step ends the search
constexpr uint32_t kSteps = 32;       // of one search
constexpr uint32_t kSweeps = 40;      // Newton steps to the first touch of one triangle
constexpr double kProxySpeed = 4;     // m/s, above what hand and tissue do: a longer way round goes on in the next tick
constexpr double kLongestGap = 0.1;   // s, ticks farther apart than this count as this far

// ---- device ----

bool is_finite(const Quat& q) {
    return std::isfinite(q.w) && std::isfinite(q.x) && std::isfinite(q.y) && std::isfinite(q.z);
}

// Whether a hand can have made this sample after the last good one.
bool is_plausible(const HapticParams& params, const DeviceState& sample, const ToolState& state) {
    const Quat& q = sample.orientation;
    if (!std::isfinite(sample.time) || !sample.position.allFinite() || !sample.velocity.allFinite() || !is_finite(q))
        return false;
    if (q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z < 1e-6) return false;
    if (!state.device_valid) return true;
    const double elapsed = sample.time - state.device.time;
    const double way = (sample.position - state.device.position).norm();
    return elapsed >= 0 && way <= params.device_speed * elapsed + params.device_slack;
}

// Share of the force let through after `elapsed` more seconds.
double next_gain(const HapticParams& params, bool accepted, double sample_age, double model_age, double elapsed,
                 double gain) {
    if (!accepted) return 0;
    const bool stale = model_age > params.model_timeout || sample_age > params.device_timeout;
    gain += stale ? -elapsed / params.fall_time : elapsed / params.rise_time;
    return std::clamp(gain, 0.0, 1.0);
}

// ---- surface near the proxy ----

double segment_distance(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
    const Vec3d along = b - a;
    const double length2 = along.squaredNorm();
    const double t = length2 > 0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0;
    return (a + t * along - p).norm();
}

// Corners of a near triangle at `age` and what follows from them.
void place(const LocalContactModel& model, double age, NearTriangle& near) {
    for (int k = 0; k < 3; ++k) {
        const uint32_t v = model.triangle[near.row][k];
        near.corner[k] = model.position[v] + age * model.velocity[v];
    }
    const auto& [a, b, c] = near.corner;
    near.centre = (a + b + c) / 3;
    near.radius = std::sqrt(
        std::max({(a - near.centre).squaredNorm(), (b - near.centre).squaredNorm(), (c - near.centre).squaredNorm()}));
    const Vec3d n = triangle_normal(a, b, c);
    const double length = n.norm();
    near.normal = length > 0 ? Vec3d(n / length) : Vec3d::Zero();
}

// Fills scratch.near with the triangles that come nearer than `reach` to `centre` (told by boxes), as they lie at
// `age`.
void gather_near(const LocalContactModel& model, double age, const HandTool& tool, const Vec3d& centre, double reach,
                 HapticScratch& scratch) {
    const size_t vertices = model.position.size();
    scratch.beyond.resize(vertices);
    const Vec3d low = centre.array() - reach, high = centre.array() + reach;
    for (size_t v = 0; v < vertices; ++v) {
        const Vec3d p = model.position[v] + age * model.velocity[v];
        uint32_t sides = 0;
        for (int k = 0; k < 3; ++k) sides |= (p[k] < low[k] ? 1u << k : 0u) | (p[k] > high[k] ? 8u << k : 0u);
        scratch.beyond[v] = static_cast<uint8_t>(sides);
    }
    scratch.near.clear();
    for (uint32_t t = 0; t < model.triangle.size(); ++t) {
        const Triangle& v = model.triangle[t];
        if (scratch.beyond[v[0]] & scratch.beyond[v[1]] & scratch.beyond[v[2]]) continue;
        NearTriangle near;
        near.row = t;
        near.offset = tool.tip_radius + model.half_thickness[t];
        near.sheet = model.half_thickness[t] > 0;
        place(model, age, near);
        if ((near.centre - centre).squaredNorm() > (reach + near.radius) * (reach + near.radius)) continue;
        scratch.near.push_back(near);
    }
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

double corner_angle(const Triangle& t, const NearTriangle& near, uint32_t vertex) {
    const int k = t[0] == vertex ? 0 : t[1] == vertex ? 1 : 2;
    const Vec3d u = near.corner[(k + 1) % 3] - near.corner[k], v = near.corner[(k + 2) % 3] - near.corner[k];
    return std::atan2(u.cross(v).norm(), u.dot(v));
}

// Whether the point that lies at -offset from a feature is behind it: angle-weighted pseudonormal (Baerentzen & Aanaes,
// TVCG 11(3), 2005). Nothing is behind a sheet.
bool is_behind(const LocalContactModel& model, const std::vector<NearTriangle>& near, uint32_t row, Feature feature,
               const Vec3d& offset) {
    if (near[row].sheet) return false;
    const FeatureVertices f = feature_vertices(model.triangle[near[row].row], feature);
    if (f.a == kNone) return near[row].normal.dot(offset) > 0;
    Vec3d pseudonormal = Vec3d::Zero();
    for (const NearTriangle& other : near) {
        const Triangle& t = model.triangle[other.row];
        if (holds(t, f)) pseudonormal += (f.b == kNone ? corner_angle(t, other, f.a) : 1.0) * other.normal;
    }
    return pseudonormal.dot(offset) > 0;
}

// Fills scratch.touched with the features nearer to `centre` than their offset, and only those that are nearest points
// of the surface around them: the rest belong to a neighbour that is touched nearer.
void find_touched(const LocalContactModel& model, const Vec3d& centre, HapticScratch& scratch) {
    std::vector<TouchedFeature>& touched = scratch.touched;
    touched.clear();
    for (uint32_t row = 0; row < scratch.near.size(); ++row) {
        const NearTriangle& near = scratch.near[row];
        const double most = near.offset + kSkin;
        if ((near.centre - centre).squaredNorm() > (most + near.radius) * (most + near.radius)) continue;
        if (std::abs(near.normal.dot(centre - near.corner[0])) > most) continue;
        const TrianglePoint q = closest_point_on_triangle(centre, near.corner[0], near.corner[1], near.corner[2]);
        if (q.squared_distance > most * most) continue;
        touched.push_back({row, q.feature, q.offset, std::sqrt(q.squared_distance)});
    }
    const auto triangle = [&](const TouchedFeature& f) -> const Triangle& {
        return model.triangle[scratch.near[f.near].row];
    };
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
Planes gather_planes(const LocalContactModel& model, const Vec3d& centre, HapticScratch& scratch) {
    find_touched(model, centre, scratch);
    Planes planes;
    for (NearTriangle& near : scratch.near) near.held = false;
    const TouchedFeature* nearest = nullptr;
    for (const TouchedFeature& f : scratch.touched)
        if (!nearest || f.distance < nearest->distance) nearest = &f;
    if (!nearest) return planes;
    planes.inside = is_behind(model, scratch.near, nearest->near, nearest->feature, nearest->offset);
    for (const TouchedFeature& f : scratch.touched) {
        NearTriangle& near = scratch.near[f.near];
        const bool way_out = planes.inside && &f == nearest;
        const bool behind = way_out || is_behind(model, scratch.near, f.near, f.feature, f.offset);
        if (behind && !way_out) continue;
        if (f.distance < 1e-12) {
            near.held = planes.half_spaces.add({near.normal, near.offset});
        } else {
            const double side = behind ? 1 : -1;
            near.held = planes.half_spaces.add({side / f.distance * f.offset, near.offset + side * f.distance});
        }
    }
    return planes;
}

// Share of the way from `from` by `step` until the tip first touches a triangle: Newton's method on the distance, which
// is convex along a line, so it comes from the free side and never passes. 1 if it does not touch.
double sweep_to_triangle(const LocalContactModel& model, const std::vector<NearTriangle>& near, uint32_t row,
                         const Vec3d& from, const Vec3d& step, double least) {
    const NearTriangle& n = near[row];
    const double target = n.offset - kSkin;
    double t = 0;
    for (uint32_t k = 0; k < kSweeps; ++k) {
        const Vec3d p = from + t * step;
        const TrianglePoint q = closest_point_on_triangle(p, n.corner[0], n.corner[1], n.corner[2]);
        const double distance = std::sqrt(q.squared_distance);
        const double gap = distance - target;
        // touched already: it is held by its plane, or shadowed by a feature that is
        if (k == 0 && gap <= 0.5 * kSkin) return 1;
        const double approach = distance > 0 ? q.offset.dot(step) / distance : 0;
        if (!(approach > 0)) return 1;
        if (gap <= 0.5 * kSkin) return is_behind(model, near, row, q.feature, q.offset) ? 1 : t;
        t += gap / approach;
        if (t >= least) return 1;
    }
    return t;
}

// Share of `step` that is free.
double sweep(const LocalContactModel& model, const std::vector<NearTriangle>& near, const Vec3d& from,
             const Vec3d& step) {
    const double length = step.norm();
    double least = 1;
    for (uint32_t row = 0; row < near.size(); ++row) {
        const NearTriangle& n = near[row];
        if (n.held) continue;
        const double reach = n.offset + n.radius;
        if ((n.centre - from).squaredNorm() > (reach + length) * (reach + length)) continue;
        const double h0 = n.normal.dot(from - n.corner[0]), h1 = h0 + n.normal.dot(step);
        const double limit = n.offset - kSkin;
        if (std::min(h0, h1) > limit || std::max(h0, h1) < -limit) continue;
        least = std::min(least, sweep_to_triangle(model, near, row, from, step, least));
    }
    return least;
}

// ---- proxy ----

struct Search {
    Vec3d proxy = Vec3d::Zero();
    Vec3d first_touch = Vec3d::Zero();  // where a surface first held it
    bool touched = false;
    uint32_t active = 0;  // planes that hold it
    bool inside = false;  // inside tissue, and nothing says that it was outside before
};

// Moves the tip from `start` to the point nearest to `goal` that it can slide to, not farther than `travel` from
// `origin`.
Search find_proxy(const LocalContactModel& model, const Vec3d& start, const Vec3d& goal, const Vec3d& origin,
                  double travel, bool was_outside, HapticScratch& scratch) {
    Search s;
    s.proxy = start;
    for (uint32_t k = 0; k < kSteps; ++k) {
        const Planes planes = gather_planes(model, s.proxy, scratch);
        if (planes.inside && !was_outside) {
            s.inside = true;
            return s;
        }
        const Projection nearest = project_on_half_spaces(goal - s.proxy, planes.half_spaces);
        // squeezed from both sides: stay
        if (!nearest.feasible) {
            s.active = planes.half_spaces.count;
            break;
        }
        s.active = nearest.count;
        if (nearest.count > 0 && !s.touched) s.touched = true, s.first_touch = s.proxy;
        Vec3d step = nearest.point;
        const double length = step.norm();
        if (length <= kConverged) break;
        const double free = sweep(model, scratch.near, s.proxy, step);
        step *= free;
        s.proxy += step;
        const Vec3d way = s.proxy - origin;
        if (way.squaredNorm() > travel * travel) {
            // back to the edge of what was looked at; the next tick goes on
            s.proxy -= std::min(way.norm() - travel, step.norm()) / std::max(step.norm(), 1e-300) * step;
            break;
        }
    }
    return s;
}

// Velocity (m/s) of the surface where it is nearest to a point.
Vec3d surface_velocity(const LocalContactModel& model, const std::vector<NearTriangle>& near, const Vec3d& point) {
    double best = std::numeric_limits<double>::infinity();
    Vec3d velocity = Vec3d::Zero();
    for (const NearTriangle& n : near) {
        const double reach = (n.centre - point).norm() - n.radius;
        if (reach > 0 && reach * reach >= best) continue;
        const TrianglePoint q = closest_point_on_triangle(point, n.corner[0], n.corner[1], n.corner[2]);
        if (q.squared_distance >= best) continue;
        best = q.squared_distance;
        const Vec3d u = n.corner[1] - n.corner[0], v = n.corner[2] - n.corner[0];
        const Vec3d w = point + q.offset - n.corner[0];
        const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), area = uu * vv - uv * uv;
        const double b = area > 0 ? std::clamp((vv * u.dot(w) - uv * v.dot(w)) / area, 0.0, 1.0) : 0;
        const double c = area > 0 ? std::clamp((uu * v.dot(w) - uv * u.dot(w)) / area, 0.0, 1.0 - b) : 0;
        const Triangle& t = model.triangle[n.row];
        velocity = (1 - b - c) * model.velocity[t[0]] + b * model.velocity[t[1]] + c * model.velocity[t[2]];
    }
    return velocity;
}

struct TickSpan {
    double age = 0;      // s, of the model now
    double elapsed = 0;  // s, since the last tick
    double travel = 0;   // m, the proxy may go
};

// Takes the proxy along with the surface that moved since the last tick, in steps shorter than half the tip's radius so
// that the surface cannot pass over its centre.
void carry_proxy(const LocalContactModel& model, const TickSpan& span, double radius, const Vec3d& origin,
                 HapticScratch& scratch, ToolState& state) {
    const double way = model.fastest * span.elapsed;
    if (way == 0 && state.contacts == 0) return;
    const int steps = static_cast<int>(std::clamp(std::ceil(way / (0.5 * radius)), 1.0, 16.0));
    bool was_outside = state.contacts > 0;
    for (int k = 1; k <= steps; ++k) {
        const double age = span.age - span.elapsed * (steps - k) / steps;
        if (was_outside && way > 0)
            state.proxy += span.elapsed / steps * surface_velocity(model, scratch.near, state.proxy);
        for (NearTriangle& near : scratch.near) place(model, age, near);
        const Search s = find_proxy(model, state.proxy, state.proxy, origin, span.travel, was_outside, scratch);
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
bool is_clear(const LocalContactModel& model, const Vec3d& centre, HapticScratch& scratch) {
    find_touched(model, centre, scratch);
    return std::all_of(scratch.touched.begin(), scratch.touched.end(),
                       [&](const TouchedFeature& f) { return f.distance >= scratch.near[f.near].offset; });
}

// Moves the proxy to where it belongs for the device's present position.
void update_proxy(const LocalContactModel& model, const TickSpan& span, const HandTool& tool, HapticScratch& scratch,
                  ToolState& state) {
    const Vec3d goal = state.device.position;
    if (!state.proxy_valid) {
        state.proxy = goal;
        state.contacts = 0;
        state.proxy_valid = is_clear(model, goal, scratch);
        return;
    }
    const Vec3d origin = state.proxy;
    carry_proxy(model, span, tool.tip_radius, origin, scratch, state);
    if (!state.proxy_valid) return;
    Search s = find_proxy(model, state.proxy, goal, origin, span.travel, state.contacts > 0, scratch);
    if (s.touched && s.active > 0 && tool.friction > 0) {
        // the tip stays where it touched as far as friction carries: the tangential pull of the coupling is at most
        // friction times its normal pull
        const double depth = (s.proxy - goal).norm(), slip = (s.first_touch - s.proxy).norm();
        const double kept = slip > 0 ? std::min(1.0, tool.friction * depth / slip) : 1.0;
        if (slip > kConverged) {
            const Vec3d held = s.proxy + kept * (s.first_touch - s.proxy);
            const uint32_t active = s.active;
            s = find_proxy(model, s.first_touch, held, origin, span.travel, true, scratch);
            s.active = std::max(s.active, active);
        }
    }
    state.proxy = s.proxy;
    state.proxy_valid = !s.inside;
    state.contacts = s.inside ? 0 : s.active;
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
    return limited((pull + damping) * direction, tool.max_force);
}

}  // namespace

void haptic_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
                 const DeviceState& sample, HapticScratch& scratch, ToolState& state) {
    TROCAR_ASSERT(tool.tip_radius > 0);
    const DeviceState last = state.device;
    const double last_gain = state.gain;
    TickSpan span;
    span.age = time - model.time;
    span.elapsed = state.ticks > 0 ? std::clamp(time - state.time, 0.0, kLongestGap) : params.dt;
    state.time = time;
    ++state.ticks;
    state.model_age = span.age;
    const bool first = !state.device_valid;
    const bool accepted = is_plausible(params, sample, state);
    if (accepted) {
        state.device = sample;
        state.device.orientation = normalized(sample.orientation);
        state.device_valid = true;
    } else {
        ++state.rejected_samples;
    }
    if (!state.device_valid) {
        state.command.force.setZero();
        return;
    }
    state.gain = next_gain(params, accepted, time - state.device.time, span.age, span.elapsed, state.gain);

    const Vec3d centre = state.proxy_valid ? state.proxy : state.device.position;
    span.travel = std::min((state.device.position - centre).norm(), kProxySpeed * span.elapsed) +
                  model.fastest * span.elapsed + 10 * kSkin;
    const double around = tool.tip_radius + span.travel + kSkin;
    // beyond what the model shows there may be anything
    const bool seen = segment_distance(centre, model.from, model.to) + around <= model.reach;
    if (seen) {
        double thickest = 0;
        for (const double h : model.half_thickness) thickest = std::max(thickest, h);
        gather_near(model, span.age - (state.proxy_valid ? span.elapsed : 0), tool, centre,
                    around + thickest + model.fastest * span.elapsed, scratch);
        if (!state.proxy_valid)
            for (NearTriangle& near : scratch.near) place(model, span.age, near);
        update_proxy(model, span, tool, scratch, state);
    } else {
        state.proxy_valid = false;
        state.contacts = 0;
    }
    const Vec3d drift = seen && state.contacts > 0 && model.fastest > 0
                            ? surface_velocity(model, scratch.near, state.proxy)
                            : Vec3d(Vec3d::Zero());
    const Vec3d wanted = state.gain * coupling_force(tool, state, drift);
    if (!accepted || first) {
        state.command.force = accepted ? wanted : Vec3d(Vec3d::Zero());
    } else {
        // what the motions explain, and a little more each tick: a new set of contacts ramps in
        const double explained =
            tool.coupling_stiffness * ((state.device.position - last.position).norm() + drift.norm() * span.elapsed) +
            tool.coupling_damping * (state.device.velocity - last.velocity).norm() +
            tool.max_force * std::abs(state.gain - last_gain);
        const Vec3d change = limited(wanted - state.command.force, explained + params.force_slew * span.elapsed);
        state.command.force += change;
    }
    state.largest_force = std::max(state.largest_force, state.command.force.norm());
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
