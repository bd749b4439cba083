#include "systems/haptic_proxy.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "engine/geometry/point_triangle.hpp"
#include "systems/haptic_planes.hpp"
namespace trocar {
namespace {

constexpr double kConverged = 1e-10;  // m, a smaller step ends the search
constexpr uint32_t kSteps = 16;       // of one search; a longer one goes on in the next tick
constexpr uint32_t kMostTouched = 60; // features in a tick, summed over its steps, before another step is too much
constexpr uint32_t kSweeps = 40;      // Newton steps to the first touch of one triangle
constexpr double kAhead = 2e-4;       // m, triangles are woken for this much more than is asked
constexpr double kFirstLook = 3e-4;   // m, of a sweep is looked at first; four times as far each time that it is free
constexpr double kHair = 1e-9;        // m, they wake earlier than their distance says: more than it was rounded by

// ---- surface near the proxy ----

bool within(const Vec3d& a, const Vec3d& b, double distance) { return (a - b).squaredNorm() <= distance * distance; }

Vec3d beyond(const LocalContactModel& model, const SurfaceTime& at, uint32_t body) {
    return body == model.give.body ? at.follow : Vec3d(Vec3d::Zero());
}

bool may_meet(const TriangleGroup& group, const SurfaceTime& at, const Vec3d& beyond, const Vec3d& centre, double reach) {
    return within(group.centre + at.age * group.velocity + beyond, centre, group.radius + group.spread * std::abs(at.age) + reach);
}

// Distance (m) from a point that no point of a triangle is nearer than.
double disc_distance(const NearDisc& disc, const Vec3d& point) {
    const Vec3d way = point - disc.centre;
    const double height = disc.normal.dot(way);
    const double out = std::max(0.0, std::sqrt(std::max(0.0, way.squaredNorm() - height * height)) - disc.radius);
    return std::sqrt(height * height + out * out) - disc.slack;
}

// Takes the disc as it lies then; how far (m) from touching `centre` the triangle is at least.
double place_disc(const TriangleDisc& disc, const SurfaceTime& at, const Vec3d& beyond, const Vec3d& centre, NearDisc& near) {
    near.centre = disc.centre + at.age * disc.velocity + beyond;
    near.normal = disc.normal;
    near.radius = disc.radius;
    near.slack = disc.thickness + disc.spread * std::abs(at.age);
    return disc_distance(near, centre) - near.offset;
}

// Takes the corners of a row and its disc from them.
void take_corners(NearSurface& near, uint32_t row) {
    NearTriangle& triangle = near.triangle[row];
    if (triangle.placed) return;
    triangle.placed = true;
    const LocalContactModel& model = *near.model;
    const Vec3d more = beyond(model, near.time, triangle.body);
    for (int k = 0; k < 3; ++k)
        triangle.corner[k] = model.position[triangle.vertex[k]] + near.time.age * model.velocity[triangle.vertex[k]] + more;
    const auto& [p, q, r] = triangle.corner;
    NearDisc& disc = near.disc[row];
    disc.centre = (p + q + r) / 3;
    disc.radius = std::sqrt(
        std::max({(p - disc.centre).squaredNorm(), (q - disc.centre).squaredNorm(), (r - disc.centre).squaredNorm()}));
    const Vec3d n = triangle_normal(p, q, r);
    const double length = n.norm();
    disc.normal = length > 0 ? Vec3d(n / length) : Vec3d::Zero();
    disc.slack = 0;
}
const NearDisc& exact_disc(NearSurface& near, uint32_t row) {
    take_corners(near, row);
    return near.disc[row];
}

void start_path(const Vec3d& centre, NearSurface& near) {
    near.at = centre;
    near.path = 0;
    near.horizon = -1;
}

// Moves the tip there and wakes what it may touch within `ahead` (m) more.
void go_to(const Vec3d& centre, double ahead, NearSurface& near) {
    near.path += (centre - near.at).norm();
    near.at = centre;
    if (near.path + ahead <= near.horizon) return;
    near.horizon = near.path + ahead + kAhead;
    near.awake.clear();
    for (uint32_t row = 0; row < near.wake.size(); ++row)
        if (near.wake[row] <= near.horizon) near.awake.push_back(row);
}

// Lets a row sleep that the tip, where it is, is that far (m) from touching.
void sleep(uint32_t row, double gap, NearSurface& near) {
    if (!near.ask_all) near.wake[row] = near.path + gap - kHair;
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

TrianglePoint closest_on_row(NearSurface& near, uint32_t row, const Vec3d& point) {
    take_corners(near, row);
    const auto& [a, b, c] = near.triangle[row].corner;
    return closest_point_on_triangle(point, a, b, c);
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

// Rows of the triangles around a feature, ascending.
struct RowsAround {
    static constexpr uint32_t kCapacity = 32;
    std::array<uint32_t, kCapacity> row;
    uint32_t count = 0;
    bool complete = false;  // they close around it, and all of them are at hand
};

// By the neighbours of the model, starting from `row`.
RowsAround rows_around(const NearSurface& near, uint32_t row, Feature feature) {
    const LocalContactModel& model = *near.model;
    RowsAround around;
    const auto add = [&](uint32_t triangle) {
        if (triangle == kNone || around.count == RowsAround::kCapacity) return false;
        const auto found = std::lower_bound(near.row.begin(), near.row.end(), triangle);
        if (found == near.row.end() || *found != triangle) return false;
        around.row[around.count++] = static_cast<uint32_t>(found - near.row.begin());
        return true;
    };
    const uint32_t start = near.row[row];
    around.row[around.count++] = row;
    if (dimension(feature) == 1) {
        around.complete = add(model.neighbour[start][static_cast<int>(feature) - static_cast<int>(Feature::kEdge0)]);
    } else if (dimension(feature) == 0) {
        const uint32_t vertex = model.triangle[start][static_cast<int>(feature)];
        const auto next = [&](uint32_t t) {
            const Triangle& c = model.triangle[t];
            return model.neighbour[t][c[0] == vertex ? 2 : c[1] == vertex ? 0 : 1];
        };
        uint32_t t = next(start);
        while (t != start && add(t)) t = next(t);
        around.complete = t == start;
    }
    std::sort(around.row.begin(), around.row.begin() + around.count);
    return around;
}

// Whether the point that lies at -offset from a feature is behind it: angle-weighted pseudonormal (Baerentzen & Aanaes,
// TVCG 11(3), 2005). Nothing is behind a sheet. `gone` (m): length of the path to that point; all that hold the feature
// are touched there, so they wake by then.
bool is_behind(NearSurface& near, uint32_t row, Feature feature, const Vec3d& offset, double gone) {
    if (near.triangle[row].sheet) return false;
    const FeatureVertices f = feature_vertices(near.triangle[row].vertex, feature);
    if (f.a == kNone) return exact_disc(near, row).normal.dot(offset) > 0;
    Vec3d pseudonormal = Vec3d::Zero();
    const auto add = [&](uint32_t k) {
        const Vec3d& normal = exact_disc(near, k).normal;
        pseudonormal += (f.b == kNone ? corner_angle(near.triangle[k], f.a) : 1.0) * normal;
    };
    const RowsAround around = rows_around(near, row, feature);
    if (around.complete) {
        for (uint32_t k = 0; k < around.count; ++k) add(around.row[k]);
    } else {
        for (const uint32_t k : near.awake)
            if (near.wake[k] <= gone && holds(near.triangle[k].vertex, f)) add(k);
    }
    return pseudonormal.dot(offset) > 0;
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
    // of the planes before this
    for (const TouchedFeature& f : scratch.touched)
        if (f.near < scratch.near.triangle.size()) scratch.near.triangle[f.near].held = false;
    find_touched(centre, scratch);
    Planes planes;
    const TouchedFeature* nearest = nullptr;
    for (const TouchedFeature& f : scratch.touched)
        if (!nearest || f.distance < nearest->distance) nearest = &f;
    if (!nearest) return planes;
    planes.inside = is_behind(scratch.near, nearest->near, nearest->feature, nearest->offset, scratch.near.path);
    for (const TouchedFeature& f : scratch.touched) {
        if (planes.half_spaces.count == HalfSpaces::kCapacity) break;
        const NearDisc& disc = exact_disc(scratch.near, f.near);
        const bool way_out = planes.inside && &f == nearest;
        const bool behind = way_out || is_behind(scratch.near, f.near, f.feature, f.offset, scratch.near.path);
        if (behind && !way_out) continue;
        if (f.distance < 1e-12) {
            scratch.near.triangle[f.near].held = planes.half_spaces.add({disc.normal, disc.offset});
        } else {
            const double side = behind ? 1 : -1;
            scratch.near.triangle[f.near].held =
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
GapAlong gap_along(NearSurface& near, uint32_t row, const Vec3d& from, const Vec3d& step, double t,
                   bool ask_side) {
    const TrianglePoint q = closest_on_row(near, row, from + t * step);
    const double distance = std::sqrt(q.squared_distance);
    GapAlong g;
    g.gap = distance - (near.disc[row].offset - kSkin);
    g.approach = distance > 0 ? q.offset.dot(step) / distance : 0;
    g.behind = ask_side && g.gap <= 0.5 * kSkin && is_behind(near, row, q.feature, q.offset, near.path + t * step.norm() + kHair);
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
double sweep_to_triangle(NearSurface& near, uint32_t row, const Vec3d& from, const Vec3d& step,
                         double least) {
    double t = 0;
    for (uint32_t k = 0; k < kSweeps; ++k) {
        const GapAlong g = gap_along(near, row, from, step, t, k > 0);
        // touched already: it is held by its plane, or shadowed by a feature that is
        if (k == 0 && g.gap <= 0.5 * kSkin) return 1;
        if (!(g.approach > 0)) return 1;
        if (g.gap <= 0.5 * kSkin) return g.behind ? 1 : t;
        t += g.gap / g.approach;
        if (t >= least) return 1;
        // most near misses are told here; where they graze, Newton's method is slow
        if (k == 0 && stays_open(g, gap_along(near, row, from, step, least, false), least)) return 1;
    }
    return t;
}

// Fills scratch.ahead with the triangles that a tip may touch along a step, and the share of it before which their
// planes rule that out.
void gather_ahead(const Vec3d& from, const Vec3d& step, HapticScratch& scratch) {
    NearSurface& near = scratch.near;
    const double length = step.norm(), half = 0.5 * length;
    const Vec3d middle = from + 0.5 * step;
    scratch.ahead.clear();
    go_to(from, length, near);
    for (const uint32_t row : near.awake) {
        if (near.wake[row] > near.path + length || near.triangle[row].held || near.triangle[row].overlaps_at == near.path) continue;
        const NearDisc& disc = near.disc[row];
        const double gap = disc_distance(disc, from) - disc.offset;
        if (gap - kHair > length) {
            sleep(row, gap, near);
            continue;
        }
        const double h0 = disc.normal.dot(from - disc.centre), h1 = h0 + disc.normal.dot(step);
        const double height = h0 * h1 > 0 ? std::min(std::abs(h0), std::abs(h1)) : 0;
        const double most = disc.offset + disc.slack;
        if (!may_come_near(disc, middle, half, height, most)) continue;
        const double room = std::abs(h0) - most - kHair, closing = std::abs(h0) - (h0 > 0 ? h1 : -h1);
        scratch.ahead.push_back({std::max(room > 0 && closing > 0 ? room / closing : 0, (gap - kHair) / length), row});
    }
}

// Share of `step` that is free.
double sweep_at_once(const Vec3d& from, const Vec3d& step, HapticScratch& scratch) {
    gather_ahead(from, step, scratch);
    // the soonest first: what it leaves free, most of the others cannot shorten
    std::vector<SweptTriangle>& ahead = scratch.ahead;
    const auto later = [](const SweptTriangle& a, const SweptTriangle& b) { return std::tie(a.from, a.near) > std::tie(b.from, b.near); };
    std::make_heap(ahead.begin(), ahead.end(), later);
    double least = 1;
    while (!ahead.empty() && ahead.front().from < least) {
        least = std::min(least, sweep_to_triangle(scratch.near, ahead.front().near, from, step, least));
        std::pop_heap(ahead.begin(), ahead.end(), later);
        ahead.pop_back();
    }
    return least;
}

// The same, looking only a little ahead first: in narrow places most steps end there.
double sweep(const Vec3d& from, const Vec3d& step, HapticScratch& scratch) {
    const double length = step.norm();
    for (double look = kFirstLook; look < length; look *= 4) {
        const double share = look / length, free = sweep_at_once(from, share * step, scratch);
        if (free < 1) return share * free;
        if (scratch.near.touched > kMostTouched) return share;
    }
    return sweep_at_once(from, step, scratch);
}

// ---- proxy ----

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

}  // namespace

double fastest_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel) {
    double fastest = 0;
    for (const TriangleGroup& block : model.block) {
        if (block.velocity.norm() + block.spread <= fastest) continue;
        const uint32_t first = model.group[block.triangles.first].triangles.first, body = model.body[first];
        const double reach = tool.tip_radius + model.half_thickness[first] + (body == model.give.body ? model.give.gap : 0) + travel;
        const Vec3d more = beyond(model, at, body);
        if (!may_meet(block, at, more, centre, reach)) continue;
        for (uint32_t g = block.triangles.first; g < block.triangles.end(); ++g) {
            const TriangleGroup& group = model.group[g];
            const double speed = group.velocity.norm() + group.spread;
            if (speed > fastest && may_meet(group, at, more, centre, reach)) fastest = speed;
        }
    }
    return std::min(fastest, model.fastest);
}

void gather_near(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre,
                 double travel, NearSurface& near) {
    near.row.clear();
    near.triangle.clear();
    near.disc.clear();
    near.wake.clear();
    near.model = &model;
    near.time = at;
    near.touched = 0;
    start_path(centre, near);
    NearTriangle triangle;
    NearDisc disc;
    for (const TriangleGroup& block : model.block) {
        const uint32_t first = model.group[block.triangles.first].triangles.first;
        triangle.body = model.body[first];
        triangle.sheet = model.half_thickness[first] > 0;
        disc.offset = tool.tip_radius + model.half_thickness[first] + (triangle.body == model.give.body ? model.give.gap : 0);
        const double reach = disc.offset + travel;
        const Vec3d more = beyond(model, at, triangle.body);
        if (!near.ask_all && !may_meet(block, at, more, centre, reach)) continue;
        for (uint32_t g = block.triangles.first; g < block.triangles.end(); ++g) {
            const TriangleGroup& group = model.group[g];
            if (!near.ask_all && !may_meet(group, at, more, centre, reach)) continue;
            for (uint32_t t = group.triangles.first; t < group.triangles.end(); ++t) {
                const TriangleDisc& still = model.disc[t];
                const double ball = still.radius + still.thickness + still.spread * std::abs(at.age);
                if (!near.ask_all && !within(still.centre + at.age * still.velocity + more, centre, ball + reach)) continue;
                const double gap = place_disc(still, at, more, centre, disc);
                if (!near.ask_all && gap > travel) continue;
                near.row.push_back(t);
                triangle.vertex = model.triangle[t];
                near.triangle.push_back(triangle);
                near.disc.push_back(disc);
                near.wake.push_back(near.ask_all ? -1 : gap - kHair);
            }
        }
    }
}

void place_near(const SurfaceTime& at, const Vec3d& centre, NearSurface& near) {
    near.time = at;
    start_path(centre, near);
    for (uint32_t row = 0; row < near.triangle.size(); ++row) {
        NearTriangle& triangle = near.triangle[row];
        const double gap = place_disc(near.model->disc[near.row[row]], at, beyond(*near.model, at, triangle.body), centre, near.disc[row]);
        triangle.placed = false;
        triangle.overlaps_at = -1;
        near.wake[row] = near.ask_all ? -1 : gap - kHair;
    }
}

void find_touched(const Vec3d& centre, HapticScratch& scratch) {
    NearSurface& near = scratch.near;
    std::vector<TouchedFeature>& touched = scratch.touched;
    touched.clear();
    go_to(centre, 0, near);
    for (const uint32_t row : near.awake) {
        if (near.wake[row] > near.path) continue;
        const double most = near.disc[row].offset + kSkin;
        double distance = disc_distance(near.disc[row], centre);
        if (distance <= most + kHair) distance = disc_distance(exact_disc(near, row), centre);
        if (distance > most + kHair) {
            sleep(row, distance - most, near);
            continue;
        }
        const TrianglePoint q = closest_on_row(near, row, centre);
        distance = std::sqrt(q.squared_distance);
        if (q.squared_distance > most * most) {
            sleep(row, distance - most, near);
            continue;
        }
        near.triangle[row].touch = static_cast<uint32_t>(touched.size());
        touched.push_back({row, q.feature, near.triangle[row].vertex, q.offset, distance});
        if (distance - (near.disc[row].offset - kSkin) <= 0.5 * kSkin) near.triangle[row].overlaps_at = near.path;
    }
    near.touched += static_cast<uint32_t>(touched.size());
    // faces before edges before vertices, then the nearer: the first of this order always stays, however rounding names
    // the features around a point above a vertex
    const auto comes_before = [](const TouchedFeature& f, const TouchedFeature& g) {
        return std::make_tuple(-dimension(f.feature), f.distance, f.near) <
               std::make_tuple(-dimension(g.feature), g.distance, g.near);
    };
    // a triangle that holds the feature but whose own closest point is elsewhere comes nearer
    const auto is_shadowed = [&](const TouchedFeature& f) {
        const FeatureVertices mine = feature_vertices(f.vertex, f.feature);
        if (mine.a == kNone) return false;
        const auto shadows = [&](const TouchedFeature& other) {
            return holds(other.vertex, mine) && comes_before(other, f) &&
                   !same_feature(feature_vertices(other.vertex, other.feature), mine);
        };
        const RowsAround around = rows_around(near, f.near, f.feature);
        if (!around.complete) return std::any_of(touched.begin(), touched.end(), shadows);
        return std::any_of(around.row.begin(), around.row.begin() + around.count, [&](uint32_t row) {
            const uint32_t k = near.triangle[row].touch;
            return k < touched.size() && touched[k].near == row && shadows(touched[k]);
        });
    };
    // marked first: removing while looking would change what the later ones see
    for (TouchedFeature& f : touched) f.shadowed = is_shadowed(f);
    std::erase_if(touched, [](const TouchedFeature& f) { return f.shadowed; });
}

SurfaceMotion surface_motion(const Vec3d& point, double most, NearSurface& near) {
    const LocalContactModel& model = *near.model;
    go_to(point, 0, near);
    double best = std::numeric_limits<double>::infinity();  // squared, m^2
    uint32_t nearest = kNone;
    TrianglePoint closest;
    // those it touches first, then what may be nearer still; of equals the first of the model
    for (const bool touching : {true, false}) {
        for (uint32_t row = 0; row < near.triangle.size(); ++row) {
            if ((near.wake[row] <= near.path) != touching) continue;
            const double offset = near.disc[row].offset, bound = near.wake[row] - near.path + offset;
            if (bound > offset + most || (bound > 0 && bound * bound > best)) continue;
            const TrianglePoint q = closest_on_row(near, row, point);
            const double limit = offset + most;
            if (q.squared_distance >= limit * limit) continue;
            if (q.squared_distance > best || (q.squared_distance == best && row > nearest)) continue;
            best = q.squared_distance, nearest = row, closest = q;
        }
    }
    if (nearest == kNone) return {};
    const NearTriangle& n = near.triangle[nearest];
    const Vec3d u = n.corner[1] - n.corner[0], v = n.corner[2] - n.corner[0];
    const Vec3d w = point + closest.offset - n.corner[0];
    const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), area = uu * vv - uv * uv;
    const double b = area > 0 ? std::clamp((vv * u.dot(w) - uv * v.dot(w)) / area, 0.0, 1.0) : 0;
    const double c = area > 0 ? std::clamp((uu * v.dot(w) - uv * u.dot(w)) / area, 0.0, 1.0 - b) : 0;
    return {(1 - b - c) * model.velocity[n.vertex[0]] + b * model.velocity[n.vertex[1]] + c * model.velocity[n.vertex[2]],
            n.body};
}

ProxySearch find_proxy(const Vec3d& start, const Vec3d& goal, const Room& room, double friction, bool was_outside,
                       HapticScratch& scratch) {
    ProxySearch s;
    s.proxy = start;
    for (uint32_t k = 0; k < kSteps; ++k) {
        if (k >= 1 && scratch.near.touched > kMostTouched) break;
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

}  // namespace trocar
