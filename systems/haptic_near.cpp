#include "systems/haptic_near.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/geometry/four_points.hpp"
namespace trocar {
namespace {

constexpr double kAhead = 3e-5;  // m, triangles are woken for this much more than is asked
constexpr double kNever = std::numeric_limits<double>::infinity();

bool within_distance(const Vec3d& a, const Vec3d& b, double distance) { return (a - b).squaredNorm() <= distance * distance; }

Vec3d beyond(const LocalContactModel& model, const SurfaceTime& at, uint32_t body) {
    return body == model.give.body ? at.follow : Vec3d(Vec3d::Zero());
}

bool may_meet(const TriangleGroup& group, const SurfaceTime& at, const Vec3d& beyond, const Vec3d& centre, double reach) {
    return within_distance(group.centre + at.age * group.velocity + beyond, centre, group.radius + group.spread * std::abs(at.age) + reach);
}

typedef float Vec8f __attribute__((vector_size(32)));
template <typename Lanes>
Vec8f load_lanes(const Lanes& a, size_t first = 0) { return (Vec8f)_mm256_loadu_ps(a.data() + first); }
template <typename Lanes>
void put_lanes(Vec8f a, Lanes& lanes, size_t first = 0) { _mm256_storeu_ps(lanes.data() + first, (__m256)a); }
Vec8f lanes_of(float x) { return Vec8f{x, x, x, x, x, x, x, x}; }
Vec8f square_roots(Vec8f a) { return (Vec8f)_mm256_sqrt_ps((__m256)a); }
Vec8f positive(Vec8f a) { return (Vec8f)_mm256_max_ps((__m256)a, _mm256_setzero_ps()); }

template <typename Lanes>
Vec8f way_along(const std::array<Lanes, 3>& centre, const std::array<Lanes, 3>& velocity, float age, const Vec3& point, size_t axis, size_t first = 0) {
    return lanes_of(point[static_cast<long>(axis)]) - load_lanes(centre[axis], first) - lanes_of(age) * load_lanes(velocity[axis], first);
}

// A point as a group or a block sees it that goes on to another time: from its centre, and what lanes may round.
struct PointFrom {
    Vec3 point;
    float age = 0;       // s
    double rounding = 0; // m
};
PointFrom point_from(const TriangleGroup& group, double age, const Vec3d& point, double offset) {
    const Vec3d from = point - group.centre - age * group.velocity;
    return {from.cast<float>(), static_cast<float>(age), kDiscRounding * (from.norm() + offset + group.radius + std::abs(age) * group.spread)};
}

// How far (m) from touching a tip there the groups of a block are at least.
BlockLanes group_gaps(const LocalContactModel& model, uint32_t block, const SurfaceTime& at, const Vec3d& beyond, const Vec3d& centre, double offset) {
    const PointFrom from = point_from(model.block[block], at.age, centre - beyond, offset);
    const GroupBalls& ball = model.ball[block];
    BlockLanes gap;
    for (size_t first = 0; first < kBlockGroups; first += 8) {
        const auto along = [&](size_t axis) { return way_along(ball.centre, ball.velocity, from.age, from.point, axis, first); };
        const Vec8f x = along(0), y = along(1), z = along(2);
        const Vec8f reach = load_lanes(ball.radius, first) + lanes_of(std::abs(from.age)) * load_lanes(ball.spread, first);
        put_lanes(square_roots(x * x + y * y + z * z) - reach - lanes_of(static_cast<float>(offset + kHair + from.rounding)), gap, first);
    }
    return gap;
}

// Everything asleep, the tip there.
void start_path(const Vec3d& centre, NearSurface& near) {
    near.triangle.clear();
    near.four.clear();
    near.at = centre;
    ++near.places;
    near.path = 0;
    near.horizon = -1;
}

// How far (m) from touching a tip there the discs around the triangles of a group are at least.
GroupLanes disc_gaps(const LocalContactModel& model, uint32_t group, double age, const Vec3d& centre, double offset) {
    const PointFrom from = point_from(model.group[group], age, centre, offset);
    const TriangleDiscs& disc = model.disc[group];
    const auto along = [&](size_t axis) { return way_along(disc.centre, disc.velocity, from.age, from.point, axis); };
    const Vec8f x = along(0), y = along(1), z = along(2);
    const Vec8f height = load_lanes(disc.normal[0]) * x + load_lanes(disc.normal[1]) * y + load_lanes(disc.normal[2]) * z;
    const Vec8f height2 = height * height, across = square_roots(positive(x * x + y * y + z * z - height2));
    const Vec8f out = positive(across - load_lanes(disc.radius));
    const Vec8f slack = load_lanes(disc.thickness) + lanes_of(std::abs(from.age)) * load_lanes(disc.spread);
    GroupLanes gap;
    put_lanes(square_roots(height2 + out * out) - slack - lanes_of(static_cast<float>(offset + kHair + from.rounding)), gap);
    return gap;
}

// Looks at the triangles of a group, each by the disc around it.
void open_group(const NearSurface& near, NearGroup& group) {
    constexpr float kAway = std::numeric_limits<float>::infinity();
    group.open = true;
    group.opened = near.path;
    group.gap = disc_gaps(*near.model, group.group, near.time.age, near.at - beyond(*near.model, near.time, group.body), group.offset);
    const Range triangles = near.model->group[group.group].triangles;
    for (uint32_t k = 0; near.ask_all && k < triangles.count; ++k) group.gap[k] = -kAway;
}

void put_four(Vec4d a, double (&to)[4]) { _mm256_store_pd(to, (__m256d)a); }

// Wakes a triangle.
void place_triangle(NearSurface& near, const NearGroup& group, uint32_t triangle) {
    const LocalContactModel& model = *near.model;
    const size_t row = near.triangle.size(), lane = row % 4;
    NearTriangle one;
    one.triangle = triangle, one.body = group.body, one.sheet = group.sheet;
    near.triangle.push_back(one);
    near.place[triangle] = static_cast<uint32_t>(row);
    if (lane == 0) {
        NearFour& empty = near.four.emplace_back();
        for (auto& corner : empty.corner)
            for (auto& axis : corner) put_four(all_lanes(0), axis);
        put_four(all_lanes(-kNever), empty.offset);
        put_four(all_lanes(kNever), empty.wake);
    }
    NearFour& four = near.four.back();
    const Vec3d more = beyond(model, near.time, group.body);
    for (size_t k = 0; k < 3; ++k) {
        const uint32_t v = model.triangle[triangle][k];
        const Vec3d p = model.position[v] + near.time.age * model.velocity[v] + more;
        for (size_t axis = 0; axis < 3; ++axis) four.corner[k][axis][lane] = p[static_cast<long>(axis)];
    }
    four.offset[lane] = group.offset;
    four.wake[lane] = -1;
    four.seen = near.places - 1;
}

// Wakes the triangles of a group that the horizon has reached.
void wake_group(NearSurface& near, NearGroup& group) {
    if (!group.open) open_group(near, group);
    constexpr float kAway = std::numeric_limits<float>::infinity();
    const uint32_t first = near.model->group[group.group].triangles.first;
    const float ahead = static_cast<float>(near.horizon - group.opened);
    float next = kAway;
    for (uint32_t k = 0; k < kGroupTriangles; ++k) {
        if (group.gap[k] <= ahead) {
            place_triangle(near, group, first + k);
            group.gap[k] = kAway;
        }
        next = std::min(next, group.gap[k]);
    }
    group.wake = group.opened + static_cast<double>(next);
}

FourPoints load_four(const double (&axis)[3][4]) {
    return {(Vec4d)_mm256_load_pd(axis[0]), (Vec4d)_mm256_load_pd(axis[1]), (Vec4d)_mm256_load_pd(axis[2])};
}

// Nearest to the origin on r + t e, 0 <= t <= 1.
FourPoints nearest_on_sides(const FourPoints& r, const FourPoints& e, Vec4d length2) {
    const Vec4d along = (Vec4d{} - dot(r, e)) / greatest(length2, all_lanes(1e-300));
    return r + least(greatest(along, Vec4d{}), all_lanes(1)) * e;
}

FourPoints either(Mask4 mask, const FourPoints& a, const FourPoints& b) {
    return {mask ? a.x : b.x, mask ? a.y : b.y, mask ? a.z : b.z};
}

FourWays nearest_of(const NearFour& four, const Vec3d& point) {
    const FourPoints p{all_lanes(point.x()), all_lanes(point.y()), all_lanes(point.z())};
    const FourPoints a = load_four(four.corner[0]) - p, b = load_four(four.corner[1]) - p, c = load_four(four.corner[2]) - p;
    const FourPoints ab = b - a, bc = c - b, ca = a - c;
    const Vec4d ab2 = norm2(ab), bc2 = norm2(bc), ca2 = norm2(ca);
    FourPoints q = nearest_on_sides(a, ab, ab2);
    Vec4d q2 = norm2(q);
    const FourPoints on_bc = nearest_on_sides(b, bc, bc2), on_ca = nearest_on_sides(c, ca, ca2);
    const Vec4d bc_2 = norm2(on_bc), ca_2 = norm2(on_ca);
    q = either(bc_2 < q2, on_bc, q);
    q2 = least(bc_2, q2);
    q = either(ca_2 < q2, on_ca, q);
    q2 = least(ca_2, q2);
    // narrower than a part in 1e8 its sides are as near as its face, whose normal is lost in rounding
    const FourPoints n = cross(ca, ab);
    const Vec4d n2 = norm2(n);
    const Mask4 on_face = (n2 > all_lanes(1e-16) * ab2 * ca2) & (dot(cross(n, ab), a) < Vec4d{}) & (dot(cross(n, bc), b) < Vec4d{}) &
                          (dot(cross(n, ca), c) < Vec4d{});
    const Vec4d height = dot(n, a) / greatest(n2, all_lanes(1e-300));
    q = either(on_face, height * n, q);
    const Vec4d distance = square_root(norm2(q));
    FourWays ways;
    put_four(distance, ways.distance);
    put_four(q.x, ways.offset[0]);
    put_four(q.y, ways.offset[1]);
    put_four(q.z, ways.offset[2]);
    return ways;
}

// Of the triangles that come within `reach` (m) of touching at a point, the nearest to it that is nearer than `most` beyond touching;
// of equals the first of the model.
struct NearestRow {
    uint32_t row = kNone;
    TrianglePoint at;
};
NearestRow nearest_row(const Vec3d& point, double reach, double most, NearSurface& near) {
    near.candidate.clear();
    go_to(point, reach, near);
    for (uint32_t k = 0; k < near.four.size(); ++k) {
        NearFour& four = near.four[k];
        if (asleep(four, near.path + reach)) continue;
        const FourWays& ways = ways_to(near, four);
        for (uint32_t lane = 0; lane < 4; ++lane)
            if (ways.distance[lane] - kHair <= four.offset[lane] + reach) near.candidate.push_back({ways.distance[lane], 4 * k + lane});
    }
    NearestRow nearest;
    if (near.candidate.empty()) return nearest;
    std::swap(near.candidate[0], *std::min_element(near.candidate.begin(), near.candidate.end(),
                                                   [](const NearCandidate& a, const NearCandidate& b) { return a.least < b.least; }));
    for (const NearCandidate& c : near.candidate) {
        const double bound = c.least - kHair, limit = offset_of(near, c.row) + most, best = nearest.at.squared_distance;
        if (bound > 0 && bound * bound > best) continue;
        const TrianglePoint q = closest_on_row(near, c.row, point);
        if (q.squared_distance >= limit * limit || q.squared_distance > best) continue;
        if (q.squared_distance == best && near.triangle[c.row].triangle > near.triangle[nearest.row].triangle) continue;
        nearest = {c.row, q};
    }
    return nearest;
}

}  // namespace

const FourWays& ways_to(const NearSurface& near, NearFour& four) {
    if (four.seen == near.places) return four.ways;
    four.ways = nearest_of(four, near.at);
    four.seen = near.places;
    const double path = near.path - kSkin - kHair;
    for (int lane = 0; lane < 4 && !near.ask_all; ++lane)
        if (four.wake[lane] < kNever) four.wake[lane] = path + (four.ways.distance[lane] - four.offset[lane]);
    return four.ways;
}

const Vec3d& normal_of(NearSurface& near, uint32_t row) {
    NearTriangle& triangle = near.triangle[row];
    if (triangle.has_normal) return triangle.normal;
    triangle.has_normal = true;
    const Vec3d n = triangle_normal(corner_of(near, row, 0), corner_of(near, row, 1), corner_of(near, row, 2));
    const double length = n.norm();
    if (length > 0) triangle.normal = n / length;
    return triangle.normal;
}

TrianglePoint closest_on_row(const NearSurface& near, uint32_t row, const Vec3d& point) {
    return closest_point_on_triangle(point, corner_of(near, row, 0), corner_of(near, row, 1), corner_of(near, row, 2));
}

uint32_t row_of(const NearSurface& near, uint32_t triangle) {
    const uint32_t row = near.place[triangle];
    return row < near.triangle.size() && near.triangle[row].triangle == triangle ? row : kNone;
}

double fastest_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel) {
    double fastest = 0;
    for (uint32_t b = 0; b < model.block.size(); ++b) {
        const TriangleGroup& block = model.block[b];
        if (block.velocity.norm() + block.spread <= fastest) continue;
        const uint32_t first = model.group[block.triangles.first].triangles.first, body = model.body[first];
        const double reach = tool.tip_radius + model.half_thickness[first] + (body == model.give.body ? model.give.gap : 0) + travel;
        const Vec3d more = beyond(model, at, body);
        if (!may_meet(block, at, more, centre, reach)) continue;
        const BlockLanes gap = group_gaps(model, b, at, more, centre, reach);
        for (uint32_t k = 0; k < block.triangles.count; ++k) {
            if (gap[k] > 0 || static_cast<double>(model.ball[b].speed[k]) <= fastest) continue;
            const TriangleGroup& group = model.group[block.triangles.first + k];
            const double speed = group.velocity.norm() + group.spread;
            if (speed > fastest && may_meet(group, at, more, centre, reach)) fastest = speed;
        }
    }
    return std::min(fastest, model.fastest);
}

void gather_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre,
                 double travel, NearSurface& near) {
    near.group.clear();
    near.model = &model;
    near.time = at;
    near.asked = 0;
    start_path(centre, near);
    if (near.place.size() < model.triangle.size()) near.place.resize(model.triangle.size());
    NearGroup found;
    for (found.block = 0; found.block < model.block.size(); ++found.block) {
        const TriangleGroup& block = model.block[found.block];
        const uint32_t first = model.group[block.triangles.first].triangles.first;
        found.body = model.body[first];
        found.sheet = model.half_thickness[first] > 0;
        found.offset = tool.tip_radius + model.half_thickness[first] + (found.body == model.give.body ? model.give.gap : 0);
        const Vec3d more = beyond(model, at, found.body);
        if (!near.ask_all && !may_meet(block, at, more, centre, found.offset + travel)) continue;
        const BlockLanes gap = group_gaps(model, found.block, at, more, centre, found.offset);
        for (uint32_t k = 0; k < block.triangles.count; ++k) {
            found.wake = near.ask_all ? -1 : static_cast<double>(gap[k]);
            if (found.wake > travel) continue;
            found.group = block.triangles.first + k;
            near.group.push_back(found);
        }
    }
}

void place_near(const SurfaceTime& at, const Vec3d& centre, NearSurface& near) {
    near.time = at;
    start_path(centre, near);
    const LocalContactModel& model = *near.model;
    uint32_t block = kNone;
    BlockLanes gap{};
    for (NearGroup& group : near.group) {
        if (group.block != block) {
            block = group.block;
            gap = group_gaps(model, block, at, beyond(model, at, group.body), centre, group.offset);
        }
        group.open = false;
        group.wake = near.ask_all ? -1 : static_cast<double>(gap[group.group - model.block[block].triangles.first]);
    }
}

void go_to(const Vec3d& centre, double ahead, NearSurface& near) {
    if (centre != near.at) {
        near.path += (centre - near.at).norm();
        near.at = centre;
        ++near.places;
    }
    if (near.path + ahead <= near.horizon) return;
    near.horizon = near.path + ahead + kAhead;
    for (NearGroup& group : near.group)
        if (group.wake <= near.horizon) wake_group(near, group);
}

SurfaceMotion surface_motion(const Vec3d& point, double most, NearSurface& near) {
    const LocalContactModel& model = *near.model;
    double least_offset = kNever;  // m
    for (const NearGroup& group : near.group) least_offset = std::min(least_offset, group.offset);
    // where something is touched nothing farther can be nearer; else what is looked at grows until what is beyond cannot be
    NearestRow found;
    for (double reach = 0;; reach = std::min(most, std::max(kAhead, 3 * reach))) {
        found = nearest_row(point, reach, most, near);
        if (reach == most || (found.row != kNone && (reach == 0 || found.at.squared_distance <= std::pow(least_offset + reach, 2)))) break;
    }
    const uint32_t nearest = found.row;
    const TrianglePoint& closest = found.at;
    if (nearest == kNone) return {};
    const Vec3d p = corner_of(near, nearest, 0), q = corner_of(near, nearest, 1), r = corner_of(near, nearest, 2);
    const Vec3d u = q - p, v = r - p, w = point + closest.offset - p;
    const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), area = uu * vv - uv * uv;
    const double b = area > 0 ? std::clamp((vv * u.dot(w) - uv * v.dot(w)) / area, 0.0, 1.0) : 0;
    const double c = area > 0 ? std::clamp((uu * v.dot(w) - uv * u.dot(w)) / area, 0.0, 1.0 - b) : 0;
    const Triangle& t = vertices_of(near, nearest);
    return {(1 - b - c) * model.velocity[t[0]] + b * model.velocity[t[1]] + c * model.velocity[t[2]], near.triangle[nearest].body};
}

}  // namespace trocar
