#include "systems/haptics/contact/near_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "engine/geometry/eight_points.hpp"
namespace trocar {
namespace {

constexpr double kFirstReach = 3e-5;    // m, beyond contact, first search distance for the surface that moves the tip
constexpr uint32_t kUsualGroups = 512;  // initial capacity
constexpr double kNever = std::numeric_limits<double>::infinity();

bool within_distance(const Vec3d& a, const Vec3d& b, double distance) { return (a - b).squaredNorm() <= distance * distance; }

Vec3d beyond(const LocalContactModel& model, const SurfaceTime& at, uint32_t body) {
    return body == model.compliance.body ? at.follow : Vec3d(Vec3d::Zero());
}

// Distances at which a tip is in contact.
struct TipReach {
    const SurfaceTime& at;
    const Vec3d& centre;
    double tip_radius;  // m
    double travel;      // m, beyond touching
};

bool may_meet(const LocalContactModel& model, const TriangleGroup& group, const TipReach& tip) {
    const double age = tip.at.age, reach = tip.tip_radius + group.half_thickness + tip.travel;
    return within_distance(group.centre + age * group.velocity + beyond(model, tip.at, group.body), tip.centre,
                           group.radius + group.spread * std::abs(age) + reach);
}

template <typename Lanes>
Vec8f travel_along(const std::array<Lanes, 3>& centre, const std::array<Lanes, 3>& velocity, float age, const Vec3& point, size_t axis,
                   size_t first = 0) {
    return lanes_of(point[static_cast<long>(axis)]) - load_lanes(centre[axis], first) - lanes_of(age) * load_lanes(velocity[axis], first);
}

// A query point relative to the centre of a group or block at another time, with the lanes' rounding error.
struct PointFrom {
    Vec3 point;
    float age = 0;        // s
    double rounding = 0;  // m
};
PointFrom point_from(const TriangleGroup& group, double age, const Vec3d& point, double offset) {
    const Vec3d from = point - group.centre - age * group.velocity;
    return {from.cast<float>(), static_cast<float>(age),
            kLaneRounding * (from.norm() + offset + group.radius + std::abs(age) * group.spread)};
}

// Lower bound on the distance (m) from contact with a tip for the parts of a run.
BlockLanes gaps_of(const TriangleGroup& run, const GroupBalls& ball, const SurfaceTime& at, const Vec3d& beyond, const Vec3d& centre,
                   double offset) {
    const PointFrom from = point_from(run, at.age, centre - beyond, offset);
    BlockLanes gap;
    for (size_t first = 0; first < kBlockGroups; first += 8) {
        const auto along = [&](size_t axis) { return travel_along(ball.centre, ball.velocity, from.age, from.point, axis, first); };
        const Vec8f x = along(0), y = along(1), z = along(2);
        const Vec8f reach = load_lanes(ball.radius, first) + lanes_of(std::abs(from.age)) * load_lanes(ball.spread, first);
        put_lanes(square_roots(x * x + y * y + z * z) - reach - lanes_of(static_cast<float>(offset + kHair + from.rounding)), gap, first);
    }
    return gap;
}

// Calls visit(part of a run, lower bound on the distance from contact, m) within reach of the tip.
template <typename Visit>
void for_parts_near(const LocalContactModel& model, const TriangleGroup& run, const GroupBalls& ball, const TipReach& tip,
                    const Visit& visit) {
    if (!may_meet(model, run, tip)) return;
    const BlockLanes gap = gaps_of(run, ball, tip.at, beyond(model, tip.at, run.body), tip.centre, tip.tip_radius + run.half_thickness);
    for (uint32_t k = 0; k < run.triangles.count; ++k)
        if (static_cast<double>(gap[k]) <= tip.travel) visit(k, gap[k]);
}

// Calls visit(block index) for blocks within reach with a speed bound of at least `least_speed` (m/s).
template <typename Visit>
void for_blocks_near(const LocalContactModel& model, const TipReach& tip, const Visit& visit, const double* least_speed = nullptr) {
    for (uint32_t c = 0; c < model.cluster.size(); ++c) {
        const TriangleGroup& cluster = model.cluster[c];
        const auto is_slow = [&](double speed) { return least_speed && speed <= *least_speed; };
        if (is_slow(cluster.velocity.norm() + cluster.spread)) continue;
        for_parts_near(model, cluster, model.cluster_ball[c], tip, [&](uint32_t k, float) {
            if (!is_slow(static_cast<double>(model.cluster_ball[c].speed[k]))) visit(cluster.triangles.first + k);
        });
    }
}

// Marks everything to be evaluated anew, with the tip there.
void start_path(const Vec3d& centre, NearSurface& near) {
    near.triangle.clear();
    near.at = centre;
    ++near.triangle_count;
    near.path = 0;
}

EightPoints load_eight(const std::array<GroupLanes, 3>& lanes) {
    return {load_lanes(lanes[0]), load_lanes(lanes[1]), load_lanes(lanes[2])};
}
EightPoints eight_of(const Vec3d& p) {
    return {lanes_of(static_cast<float>(p.x())), lanes_of(static_cast<float>(p.y())), lanes_of(static_cast<float>(p.z()))};
}

// Nearest to the origin on r + t e, 0 <= t <= 1.
EightPoints nearest_on_sides(const EightPoints& r, const EightPoints& e, Vec8f length2) {
    const Vec8f along = (Vec8f{} - dot(r, e)) / greatest(length2, lanes_of(1e-30f));
    return r + least(greatest(along, Vec8f{}), lanes_of(1)) * e;
}

// Evaluates the triangles of a group. Corners are rounded by less than `doubt`, sides by `side_doubt`. The
// error of a distance to a triangle's plane is below the distance times the doubt of its sides over its
// height. Where a triangle is too narrow for this bound, its sides are as near as its face, to half the
// height.
void look_at(NearSurface& near, uint32_t index) {
    const LocalContactModel& model = *near.model;
    NearGroup& group = near.group[index];
    GroupSight& sight = near.sight[index];
    const TriangleGroup& of = model.group[group.group];
    const double age = near.time.age, extent = of.radius + of.spread * std::abs(age);
    const Vec3d from = near.at - beyond(model, near.time, group.body) - of.centre - age * of.velocity;
    const double far = from.norm() + group.offset + extent;
    const Vec8f doubt = lanes_of(static_cast<float>(kLaneRounding * far)),
                narrow = lanes_of(static_cast<float>(kLaneRounding * far * extent));
    const TriangleLanes& lanes = model.lanes[group.group];
    const auto corner = [&](size_t k) {
        return load_eight(lanes.corner[k]) + lanes_of(static_cast<float>(age)) * load_eight(lanes.velocity[k]);
    };
    EightPoints a = corner(0), b = corner(1), c = corner(2);
    const EightPoints ab = b - a, bc = c - b, ca = a - c, p = eight_of(from);
    a = a - p, b = b - p, c = c - p;
    const Vec8f ab2 = norm2(ab), ca2 = norm2(ca);
    EightPoints q = nearest_on_sides(a, ab, ab2);
    Vec8f q2 = norm2(q);
    for (const EightPoints& side : {nearest_on_sides(b, bc, norm2(bc)), nearest_on_sides(c, ca, ca2)}) {
        const Vec8f side2 = norm2(side);
        q = either(side2 < q2, side, q), q2 = least(side2, q2);
    }
    const EightPoints n = cross(ca, ab);
    const Vec8f n2 = norm2(n), height2 = n2 / greatest(ab2 + ca2, lanes_of(1e-30f)), height = square_roots(height2);
    const Mask8 wide = height2 > narrow;
    const Mask8 on_face = wide & (dot(cross(n, ab), a) < Vec8f{}) & (dot(cross(n, bc), b) < Vec8f{}) & (dot(cross(n, ca), c) < Vec8f{});
    q = either(on_face, dot(n, a) / greatest(n2, lanes_of(1e-37f)) * n, q);
    const Vec8f distance = square_roots(norm2(q)), off = doubt + (wide ? narrow / height : height);
    put_lanes(distance, sight.distance), put_lanes(off, sight.doubt);
    put_lanes(q.x, sight.offset[0]), put_lanes(q.y, sight.offset[1]), put_lanes(q.z, sight.offset[2]);
    sight.at = near.at;
    group.seen = near.triangle_count;
    group.wake = near.path + static_cast<double>(least_lane(distance - off)) - group.offset - kHair;
}

// Lower bound on the distance (m) from contact of a tip with the triangles of a group along a step from its
// position, from the last evaluation.
struct GapsAlong {
    Vec8f gap;       // m, at the start of the step
    Vec8f approach;  // m, decrease by the end of the step
};
GapsAlong gaps_along(const NearSurface& near, uint32_t index, const Vec3d& step, double length) {
    const GroupSight& sight = near.sight[index];
    const EightPoints offset = load_eight(sight.offset);
    const Vec3d gone = near.at - sight.at;
    const Vec8f distance = load_lanes(sight.distance), doubt = load_lanes(sight.doubt);
    const Vec8f nearer = dot(eight_of(gone), offset) + lanes_of(static_cast<float>(gone.norm())) * doubt;  // m2, for the distance
    const Vec8f inverse = lanes_of(1) / greatest(distance, lanes_of(1e-30f));
    const Vec8f touching = lanes_of(static_cast<float>(near.group[index].offset + kHair));
    return {distance - doubt - touching - nearer * inverse,
            (dot(eight_of(step), offset) + lanes_of(static_cast<float>(length)) * doubt) * inverse};
}

uint32_t lanes_within(const GapsAlong& g, double beyond) {
    const Vec8f lowest = g.gap - positive(g.approach);
    return mask_bits(!(lowest > lanes_of(static_cast<float>(beyond))));
}

// Whether the last evaluation proves that no part of a group comes within `beyond` (m) along a step.
bool stays_away(const NearSurface& near, uint32_t index, const Vec3d& step, double length, double beyond) {
    const NearGroup& group = near.group[index];
    if (group.wake > near.path + length + beyond) return true;
    if (group.seen == kNone || group.seen == near.triangle_count) return false;
    return lanes_within(gaps_along(near, index, step, length), beyond) == 0;
}

// Lanes certainly in contact with the tip at its position.
uint32_t lanes_touched(const GroupSight& sight, double offset) {
    return mask_bits(load_lanes(sight.distance) + load_lanes(sight.doubt) < lanes_of(static_cast<float>(offset - 2 * kSkin)));
}

// Fills near.ahead with the triangles that may come within `beyond` (m) of contact along a step; `free_ones`
// excludes those already in contact.
void find_along(const Vec3d& step, double beyond, bool free_ones, NearSurface& near) {
    const double length = step.norm();
    near.ahead.clear();
    for (uint32_t index = 0; index < near.group.size(); ++index) {
        if (stays_away(near, index, step, length, beyond)) continue;
        const NearGroup& group = near.group[index];
        if (group.seen != near.triangle_count) look_at(near, index);
        const Range triangles = near.model->group[group.group].triangles;
        const GroupSight& sight = near.sight[index];
        const GapsAlong g = gaps_along(near, index, step, length);
        uint32_t lanes = lanes_within(g, beyond);
        if (free_ones) lanes &= ~lanes_touched(sight, group.offset);
        for (; lanes != 0; lanes &= lanes - 1) {
            const auto lane = static_cast<uint32_t>(std::countr_zero(lanes));
            const float gap = g.gap[lane];
            near.ahead.push_back({triangles.first + lane, static_cast<double>(sight.distance[lane] - sight.doubt[lane]),
                                  gap > 0 ? static_cast<double>(gap / g.approach[lane]) : 0});
        }
    }
    near.found = static_cast<uint32_t>(near.ahead.size());
    if (!near.ask_all) return;
    near.ahead.clear();
    for (uint32_t t = 0; t < near.model->triangle.size(); ++t) near.ahead.push_back({t, -1, 0});
}

// Among the triangles within `reach` (m) of contact at a point, the nearest one closer than `most` to
// contact; ties go to the first in the model.
NearestIndex nearest_index(const Vec3d& point, double reach, double most, NearSurface& near) {
    go_to(point, near);
    find_within(reach, near);
    NearestIndex nearest;
    if (near.ahead.empty()) return nearest;
    std::swap(near.ahead[0], *std::min_element(near.ahead.begin(), near.ahead.end(),
                                               [](const TriangleAhead& a, const TriangleAhead& b) { return a.least < b.least; }));
    for (const TriangleAhead& one : near.ahead) {
        const double best = nearest.at.squared_distance;
        if (one.least > 0 && one.least * one.least > best) continue;
        const uint32_t index = ask_for(near, one.triangle);
        const double limit = offset_of(near, index) + most;
        const TrianglePoint q = closest_on_triangle(near, index, point);
        if (q.squared_distance >= limit * limit || q.squared_distance > best) continue;
        if (q.squared_distance == best && one.triangle > near.triangle[nearest.index].triangle) continue;
        nearest = {index, q};
    }
    return nearest;
}

}  // namespace

Vec3d weights_at(const std::array<Vec3d, 3>& corner, const Vec3d& point) {
    const Vec3d u = corner[1] - corner[0], v = corner[2] - corner[0], w = point - corner[0];
    const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), area = uu * vv - uv * uv;
    const double b = area > 0 ? std::clamp((vv * u.dot(w) - uv * v.dot(w)) / area, 0.0, 1.0) : 0;
    const double c = area > 0 ? std::clamp((uu * v.dot(w) - uv * u.dot(w)) / area, 0.0, 1.0 - b) : 0;
    return {1 - b - c, b, c};
}

void find_within(double beyond, NearSurface& near) { find_along(Vec3d::Zero(), beyond, false, near); }

void find_ahead(const Vec3d& step, NearSurface& near) { find_along(step, 0, true, near); }

uint32_t index_of(const NearSurface& near, uint32_t triangle) {
    const uint32_t index = near.triangle_index[triangle];
    return index < near.triangle.size() && near.triangle[index].triangle == triangle ? index : kNone;
}

uint32_t ask_for(NearSurface& near, uint32_t triangle) {
    if (const uint32_t index = index_of(near, triangle); index != kNone) return index;
    const LocalContactModel& model = *near.model;
    const auto index = static_cast<uint32_t>(near.triangle.size());
    NearTriangle& one = near.triangle.emplace_back();
    one.triangle = triangle, one.body = model.body[triangle];
    one.sheet = model.half_thickness[triangle] > 0;
    one.offset = near.tip_radius + model.half_thickness[triangle];
    const Vec3d more = beyond(model, near.time, one.body);
    for (size_t k = 0; k < 3; ++k) {
        const uint32_t v = model.triangle[triangle][k];
        one.corner[k] = model.position[v] + near.time.age * model.velocity[v] + more;
    }
    near.triangle_index[triangle] = index;
    return index;
}

const Vec3d& normal_of(NearSurface& near, uint32_t index) {
    NearTriangle& triangle = near.triangle[index];
    if (triangle.has_normal) return triangle.normal;
    triangle.has_normal = true;
    const Vec3d n = triangle_normal(triangle.corner[0], triangle.corner[1], triangle.corner[2]);
    const double length = n.norm();
    if (length > 0) triangle.normal = n / length;
    return triangle.normal;
}

TrianglePoint closest_on_triangle(const NearSurface& near, uint32_t index, const Vec3d& point) {
    return closest_point_on_triangle(point, corner_of(near, index, 0), corner_of(near, index, 1), corner_of(near, index, 2));
}

double fastest_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel) {
    const TipReach tip{at, centre, tool.tip_radius, travel};
    double fastest = 0;
    for_blocks_near(
        model, tip,
        [&](uint32_t b) {
            for_parts_near(model, model.block[b], model.ball[b], tip, [&](uint32_t k, float) {
                if (static_cast<double>(model.ball[b].speed[k]) <= fastest) return;
                const TriangleGroup& group = model.group[model.block[b].triangles.first + k];
                const double speed = group.velocity.norm() + group.spread;
                if (speed > fastest && may_meet(model, group, tip)) fastest = speed;
            });
        },
        &fastest);
    return std::min(fastest, model.fastest);
}

void gather_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel,
                 NearSurface& near) {
    near.group.clear();
    near.model = &model;
    near.time = at;
    near.asked = 0;
    near.tip_radius = tool.tip_radius;
    near.triangle_count = 0;
    start_path(centre, near);
    // more than needed: page faults of new memory take longer than a tick's work
    if (near.triangle_index.size() < model.triangle.size()) near.triangle_index.resize(4 * model.triangle.size());
    if (near.sight.empty()) near.sight.resize(kUsualGroups), near.group.reserve(kUsualGroups);
    const TipReach tip{at, centre, tool.tip_radius, travel};
    for_blocks_near(model, tip, [&](uint32_t b) {
        const TriangleGroup& block = model.block[b];
        const double offset = tool.tip_radius + block.half_thickness;
        for_parts_near(model, block, model.ball[b], tip, [&](uint32_t k, float gap) {
            near.group.push_back({block.triangles.first + k, block.body, kNone, offset, static_cast<double>(gap)});
        });
    });
    if (near.sight.size() < near.group.size()) near.sight.resize(near.group.size());
}

void go_to(const Vec3d& centre, NearSurface& near) {
    if (centre == near.at) return;
    near.path += (centre - near.at).norm();
    near.at = centre;
    ++near.triangle_count;
}

SurfaceMotion surface_motion(const Vec3d& point, double most, NearSurface& near) {
    const LocalContactModel& model = *near.model;
    double least_offset = kNever;  // m
    for (const NearGroup& group : near.group) least_offset = std::min(least_offset, group.offset);
    // in contact nothing farther matters; otherwise the search distance grows until all beyond it is farther
    NearestIndex found;
    for (double reach = 0;; reach = std::min(most, std::max(kFirstReach, 3 * reach))) {
        found = nearest_index(point, reach, most, near);
        if (reach == most || (found.index != kNone && (reach == 0 || found.at.squared_distance <= std::pow(least_offset + reach, 2))))
            break;
    }
    if (found.index == kNone) return {};
    const NearTriangle& one = near.triangle[found.index];
    const Vec3d at = point + found.at.offset, w = weights_at(one.corner, at);
    const Triangle& t = vertices_of(near, found.index);
    const double up = -normal_of(near, found.index).dot(found.at.offset);
    const bool above = std::abs(up) > 0.5 * std::sqrt(found.at.squared_distance);
    return {w[0] * model.velocity[t[0]] + w[1] * model.velocity[t[1]] + w[2] * model.velocity[t[2]],
            one.body,
            {one.body, model.source[one.triangle], w, at, above ? std::copysign(1.0, up) : 0}};
}

TrianglePlaced place_anchor(const LocalContactModel& model, const SurfaceTime& at, const ContactAnchor& anchor) {
    TrianglePlaced placed;
    // bodies ascend, and triangles within a body
    uint32_t first = 0;
    for (uint32_t count = static_cast<uint32_t>(model.triangle.size()); count > 0;) {
        const uint32_t half = count / 2, t = first + half;
        const bool before = std::pair(model.body[t], model.source[t]) < std::pair(anchor.body, anchor.triangle);
        first = before ? t + 1 : first, count = before ? count - half - 1 : half;
    }
    if (first == model.triangle.size() || model.body[first] != anchor.body || model.source[first] != anchor.triangle) return placed;
    placed.found = true;
    for (size_t k = 0; k < 3; ++k) {
        const uint32_t v = model.triangle[first][k];
        placed.corner[k] = model.position[v] + at.age * model.velocity[v] + beyond(model, at, anchor.body);
    }
    return placed;
}

NearestIndex nearest_within(const Vec3d& point, double most, NearSurface& near) { return nearest_index(point, most, most, near); }

}  // namespace trocar
