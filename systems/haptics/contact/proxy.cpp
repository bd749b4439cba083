#include "systems/haptics/contact/proxy.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "engine/geometry/point_triangle.hpp"
#include "systems/haptics/contact/half_spaces.hpp"
namespace trocar {
namespace {

constexpr double kConverged = 1e-10;                       // m, a smaller step ends the search
constexpr uint32_t kSteps = 16;                            // of one search; a longer one continues in the next tick
constexpr uint32_t kMostFeatures = HalfSpaces::kCapacity;  // of a step; more would exceed the time of a tick
constexpr uint32_t kMostAsked = 60;                        // NearSurface::asked beyond which another step would exceed the time of a tick
constexpr uint32_t kLook = 8;                              // cost of a sweep, in features
constexpr uint32_t kFound = 8;                             // triangles found by a sweep that cost as much as one feature
constexpr uint32_t kSweeps = 40;                           // Newton steps to the first touch of one triangle
constexpr double kFirstLook = 3e-4;                        // m, first part of a sweep; four times longer each time it is free

// ---- features ----

bool has_vertex(const Triangle& t, uint32_t v) { return t[0] == v || t[1] == v || t[2] == v; }

// Vertices that a feature of a triangle shares with its neighbours in the model: one, two or none.
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
bool holds(const Triangle& t, const FeatureVertices& f) { return has_vertex(t, f.a) && (f.b == kNone || has_vertex(t, f.b)); }
bool same_feature(const FeatureVertices& f, const FeatureVertices& g) { return (f.a == g.a && f.b == g.b) || (f.a == g.b && f.b == g.a); }

// Sine and cosine of a triangle's angle at a vertex, times the lengths of its sides there.
struct Corner {
    double sine = 0, cosine = 0;
    double angle() const { return std::atan2(sine, cosine); }
    // to within kRoughAngle: a polynomial of the smaller over the larger
    double rough_angle() const {
        const double along = std::abs(cosine), large = std::max(sine, along), x = large > 0 ? std::min(sine, along) / large : 0;
        const double a = x * (0.9724 - 0.1919 * x * x), b = sine > along ? M_PI / 2 - a : a;
        return cosine < 0 ? M_PI - b : b;
    }
};
constexpr double kRoughAngle = 0.006;  // rad
Corner corner_at(const NearSurface& near, uint32_t index, uint32_t vertex) {
    const Triangle& t = vertices_of(near, index);
    const uint32_t k = t[0] == vertex ? 0 : t[1] == vertex ? 1 : 2;
    const Vec3d corner = corner_of(near, index, k), u = corner_of(near, index, (k + 1) % 3) - corner,
                v = corner_of(near, index, (k + 2) % 3) - corner;
    return {u.cross(v).norm(), u.dot(v)};
}

double rough_angle(NearSurface& near, uint32_t index, uint32_t vertex) {
    const Triangle& t = vertices_of(near, index);
    float& angle = near.triangle[index].angle[t[0] == vertex ? 0 : t[1] == vertex ? 1 : 2];
    if (angle < 0) angle = static_cast<float>(corner_at(near, index, vertex).rough_angle());
    return angle;
}

// Triangles around a feature.
struct TrianglesAt {
    static constexpr uint32_t kCapacity = 32;
    std::array<uint32_t, kCapacity> triangle;
    uint32_t count = 0;
    bool complete = false;  // they close around it
};

// From the adjacency of the model, starting at `start`.
TrianglesAt triangles_at(const LocalContactModel& model, uint32_t start, Feature feature) {
    TrianglesAt around;
    const auto add = [&](uint32_t triangle) {
        if (triangle == kNone || around.count == TrianglesAt::kCapacity) return false;
        around.triangle[around.count++] = triangle;
        return true;
    };
    around.triangle[around.count++] = start;
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
    return around;
}

// Whether the point at -offset from a feature is behind it: angle-weighted pseudonormal (Baerentzen & Aanaes,
// TVCG 11(3), 2005). No point is behind a sheet.
bool is_behind(NearSurface& near, uint32_t index, Feature feature, const Vec3d& offset) {
    if (near.triangle[index].sheet) return false;
    const FeatureVertices f = feature_vertices(vertices_of(near, index), feature);
    if (f.a == kNone) return normal_of(near, index).dot(offset) > 0;
    const auto side = [&](uint32_t k) { return normal_of(near, k).dot(offset); };
    const auto weight = [&](uint32_t k) { return f.b == kNone ? corner_at(near, k, f.a).angle() : 1.0; };
    TrianglesAt around = triangles_at(*near.model, near.triangle[index].triangle, feature);
    double sum = 0;
    if (!around.complete) {
        for (const NearGroup& group : near.group) {
            const Range triangles = near.model->group[group.group].triangles;
            for (uint32_t t = triangles.first; t < triangles.end(); ++t)
                if (holds(near.model->triangle[t], f)) sum += weight(ask_for(near, t)) * side(ask_for(near, t));
        }
        return sum > 0;
    }
    // if all triangles agree, the angle weights do not matter
    uint32_t behind = 0;
    for (uint32_t k = 0; k < around.count; ++k) behind += side(ask_for(near, around.triangle[k])) > 0;
    if (behind == 0 || behind == around.count) return behind > 0;
    double rough = 0, doubt = 0;
    for (uint32_t k = 0; k < around.count && f.b == kNone; ++k) {
        const uint32_t other = index_of(near, around.triangle[k]);
        rough += rough_angle(near, other, f.a) * side(other);
        doubt += kRoughAngle * std::abs(side(other));
    }
    if (std::abs(rough) > doubt) return rough > 0;
    std::sort(around.triangle.begin(), around.triangle.begin() + around.count);
    for (uint32_t k = 0; k < around.count; ++k) {
        const uint32_t other = index_of(near, around.triangle[k]);
        sum += weight(other) * side(other);
    }
    return sum > 0;
}

// Appends the triangle's feature to the touched ones if the tip is in contact with it at its position.
void add_touched(uint32_t triangle, const Vec3d& centre, HapticScratch& scratch) {
    NearSurface& near = scratch.near;
    const uint32_t index = ask_for(near, triangle);
    const double most = offset_of(near, index) + kSkin;
    const TrianglePoint q = closest_on_triangle(near, index, centre);
    if (q.squared_distance > most * most) return;
    scratch.touched.push_back({index, triangle, q.feature, vertices_of(near, index), q.offset, std::sqrt(q.squared_distance)});
}

// Where moving surfaces bring more features over the tip than there are half-spaces, only the nearest are
// kept. The others are found again after the tip has moved as far as the nearest allow.
void add_nearest(const Vec3d& centre, HapticScratch& scratch) {
    constexpr double kAll = std::numeric_limits<double>::infinity();
    std::vector<TriangleAhead>& crowd = scratch.near.ahead;
    std::vector<TouchedFeature>& touched = scratch.touched;
    const auto keep_nearest = [&] {
        const auto nearer = [](const TouchedFeature& f, const TouchedFeature& g) {
            return std::tie(f.distance, f.triangle) < std::tie(g.distance, g.triangle);
        };
        std::nth_element(touched.begin(), touched.begin() + (kMostFeatures - 1), touched.end(), nearer);
        touched.resize(kMostFeatures);
        return touched.back().distance;
    };
    std::nth_element(crowd.begin(), crowd.begin() + kMostFeatures, crowd.end(),
                     [](const TriangleAhead& a, const TriangleAhead& b) { return a.least < b.least; });
    double farthest = kAll;  // m, among the nearest kMostFeatures so far
    for (const TriangleAhead& one : crowd) {
        if (one.least > farthest) continue;
        add_touched(one.triangle, centre, scratch);
        if (touched.size() == 2 * kMostFeatures || (farthest == kAll && touched.size() >= kMostFeatures)) farthest = keep_nearest();
    }
    if (touched.size() > kMostFeatures) keep_nearest();
}

// ---- planes ----

// Tangent planes of the features in contact, relative to `centre`. Each has its triangle entirely on the
// other side, so every step that satisfies them is safe. A feature seen from behind constrains nothing; but
// if the nearest one is, the surface has passed over the centre, and the exit is through it.
const Planes& gather_planes(const Vec3d& centre, HapticScratch& scratch) {
    if (scratch.near.at == centre && scratch.planes_place == scratch.near.triangle_count) return scratch.planes;
    // of the earlier planes
    for (const TouchedFeature& f : scratch.touched)
        if (f.near < scratch.near.triangle.size()) scratch.near.triangle[f.near].held = false;
    find_touched(centre, scratch);
    Planes& planes = scratch.planes;
    planes.half_spaces.count = 0;
    planes.inside = false;
    scratch.planes_place = scratch.near.triangle_count;
    const TouchedFeature* nearest = nullptr;
    for (const TouchedFeature& f : scratch.touched)
        if (!nearest || f.distance < nearest->distance) nearest = &f;
    if (!nearest) return planes;
    planes.inside = is_behind(scratch.near, nearest->near, nearest->feature, nearest->offset);
    for (const TouchedFeature& f : scratch.touched) {
        if (planes.half_spaces.count == HalfSpaces::kCapacity) break;
        const double reach = offset_of(scratch.near, f.near);
        const bool separation_direction = planes.inside && &f == nearest;
        const bool behind = separation_direction || is_behind(scratch.near, f.near, f.feature, f.offset);
        if (behind && !separation_direction) continue;
        if (f.distance < 1e-12) {
            scratch.near.triangle[f.near].held = planes.half_spaces.add({normal_of(scratch.near, f.near), reach});
        } else {
            const double side = behind ? 1 : -1;
            scratch.near.triangle[f.near].held = planes.half_spaces.add({side / f.distance * f.offset, reach + side * f.distance});
        }
    }
    return planes;
}

// Distance (m) of a tip's centre from a triangle minus their contact distance, along a step, and its
// derivative with respect to the fraction of the step.
struct GapAlong {
    double gap = 0, approach = 0;  // m, m per step
    bool behind = false;
};
GapAlong gap_along(NearSurface& near, uint32_t index, const Vec3d& from, const Vec3d& step, double t, bool ask_side) {
    const TrianglePoint q = closest_on_triangle(near, index, from + t * step);
    const double distance = std::sqrt(q.squared_distance);
    GapAlong g;
    g.gap = distance - (offset_of(near, index) - kSkin);
    g.approach = distance > 0 ? q.offset.dot(step) / distance : 0;
    g.behind = ask_side && g.gap <= 0.5 * kSkin && is_behind(near, index, q.feature, q.offset);
    return g;
}

// Whether a separation that is convex along a step stays positive from its start to fraction `end`: by the
// tangents at both.
bool stays_open(const GapAlong& start, const GapAlong& finish, double end) {
    if (finish.gap <= 0.5 * kSkin) return false;
    if (finish.approach >= 0) return true;
    const double lowest = (start.gap - finish.gap - finish.approach * end) / (start.approach - finish.approach);
    return start.gap - start.approach * lowest > 0.5 * kSkin;
}

// Fraction of `step` at which the tip first touches a triangle: Newton's method on the distance, which is
// convex along a line, so it never overshoots. 1 if it does not touch before `least`.
double sweep_to_triangle(NearSurface& near, uint32_t index, const Vec3d& from, const Vec3d& step, double least) {
    double t = 0;
    for (uint32_t k = 0; k < kSweeps; ++k) {
        const GapAlong g = gap_along(near, index, from, step, t, k > 0);
        // in contact already: constrained by its plane, or shadowed by a feature that is
        if (k == 0 && g.gap <= 0.5 * kSkin) return 1;
        if (!(g.approach > 0)) return 1;
        if (g.gap <= 0.5 * kSkin) return g.behind ? 1 : t;
        t += g.gap / g.approach;
        if (t >= least) return 1;
        // decides most near misses; where they graze, Newton's method is slow
        if (k == 0 && stays_open(g, gap_along(near, index, from, step, least, false), least)) return 1;
    }
    return t;
}

// Fraction of `step` that is free.
double sweep_at_once(const Vec3d& from, const Vec3d& step, HapticScratch& scratch) {
    NearSurface& near = scratch.near;
    go_to(from, near);
    find_ahead(step, near);
    near.asked += kLook + near.found / kFound;
    // earliest first: few of the others can shorten the fraction it leaves
    std::vector<TriangleAhead>& ahead = near.ahead;
    double least = 1;
    while (!ahead.empty()) {
        const auto soonest =
            std::min_element(ahead.begin(), ahead.end(), [](const TriangleAhead& a, const TriangleAhead& b) { return a.from < b.from; });
        const uint32_t index = ask_for(near, soonest->triangle);
        if (!near.triangle[index].held) least = std::min(least, sweep_to_triangle(near, index, from, step, least));
        *soonest = ahead.back();
        ahead.pop_back();
        std::erase_if(ahead, [&](const TriangleAhead& a) { return a.from >= least; });
    }
    return least;
}

// The same, in growing parts: in narrow regions most steps end in the first one.
double sweep(const Vec3d& from, const Vec3d& step, HapticScratch& scratch) {
    const double length = step.norm();
    for (double look = kFirstLook; look < length; look *= 4) {
        const double share = look / length, free = sweep_at_once(from, share * step, scratch);
        if (free < 1) return share * free;
        if (scratch.near.asked > kMostAsked) return share;
    }
    return sweep_at_once(from, step, scratch);
}

// ---- proxy ----

// End of a step with friction: back from the sliding solution until the tangential coupling force is at most
// friction times its normal force. Relative to the proxy, like `planes`.
Vec3d held_by_friction(double friction, const HalfSpaces& planes, const Vec3d& slid, const Vec3d& goal) {
    // the shortest step that satisfies the planes: none, unless a surface came too near
    const Vec3d stuck = project_on_half_spaces(Vec3d::Zero(), planes).point;
    const double slip = (stuck - slid).norm(), grip = friction * (slid - goal).norm();
    return slip <= grip ? stuck : Vec3d(slid + grip / slip * (stuck - slid));
}

// Fraction of `step` from `from` that stays within `travel` of `origin`.
double share_within(const Vec3d& from, const Vec3d& step, const Vec3d& origin, double travel) {
    const Vec3d between = from - origin;
    const double a = step.squaredNorm(), b = between.dot(step), c = between.squaredNorm() - travel * travel;
    if (a + 2 * b + c <= 0) return 1;
    return std::clamp((std::sqrt(std::max(0.0, b * b - a * c)) - b) / a, 0.0, 1.0);
}

}  // namespace

void find_touched(const Vec3d& centre, HapticScratch& scratch) {
    NearSurface& near = scratch.near;
    std::vector<TouchedFeature>& touched = scratch.touched;
    touched.clear();
    scratch.planes_place = kNone;
    go_to(centre, near);
    find_within(kSkin, near);
    if (near.ahead.size() > kMostFeatures) {
        add_nearest(centre, scratch);
    } else {
        for (const TriangleAhead& one : near.ahead) add_touched(one.triangle, centre, scratch);
    }
    std::sort(touched.begin(), touched.end(), [](const TouchedFeature& f, const TouchedFeature& g) { return f.triangle < g.triangle; });
    for (uint32_t k = 0; k < touched.size(); ++k) near.triangle[touched[k].near].touch = k;
    scratch.touched_crowd = touched.size() == kMostFeatures;
    near.asked += touched.size() < kMostFeatures ? static_cast<uint32_t>(touched.size()) : kMostAsked + 1;
    // faces before edges before vertices, then the nearer: the first in this order always stays, whichever
    // features rounding gives around a point above a vertex
    const auto comes_before = [](const TouchedFeature& f, const TouchedFeature& g) {
        return std::make_tuple(-dimension(f.feature), f.distance, f.triangle) <
               std::make_tuple(-dimension(g.feature), g.distance, g.triangle);
    };
    // a triangle that contains the feature but has its own closest point elsewhere comes nearer
    const auto is_shadowed = [&](const TouchedFeature& f) {
        const FeatureVertices mine = feature_vertices(f.vertex, f.feature);
        if (mine.a == kNone) return false;
        const auto shadows = [&](const TouchedFeature& other) {
            return holds(other.vertex, mine) && comes_before(other, f) &&
                   !same_feature(feature_vertices(other.vertex, other.feature), mine);
        };
        const TrianglesAt around = triangles_at(*near.model, f.triangle, f.feature);
        if (!around.complete) return std::any_of(touched.begin(), touched.end(), shadows);
        return std::any_of(around.triangle.begin(), around.triangle.begin() + around.count, [&](uint32_t triangle) {
            const uint32_t index = index_of(near, triangle), k = index == kNone ? kNone : near.triangle[index].touch;
            return k < touched.size() && touched[k].near == index && shadows(touched[k]);
        });
    };
    // marked first: removal during the search would change later results
    for (TouchedFeature& f : touched) f.shadowed = is_shadowed(f);
    std::erase_if(touched, [](const TouchedFeature& f) { return f.shadowed; });
}

Exit nearest_exit(const Vec3d& centre, double most, HapticScratch& scratch) {
    constexpr double kAbove = 1e-8;  // m
    const NearestIndex nearest = nearest_within(centre, most, scratch.near);
    scratch.planes_place = kNone;
    if (nearest.index == kNone) return {};
    const Vec3d& offset = nearest.at.offset;
    const bool inside = is_behind(scratch.near, nearest.index, nearest.at.feature, offset);
    return {true, inside, centre + offset + kAbove * offset.normalized()};
}

void gather_surface(const LocalContactModel& model, const SurfaceTime& at, const HandTool& tool, const Vec3d& centre, double travel,
                    HapticScratch& scratch) {
    scratch.planes_place = kNone;
    gather_near(model, at, tool, centre, travel, scratch.near);
}

ProxySearch find_proxy(const Vec3d& start, const Vec3d& goal, const Room& room, double friction, bool was_outside, HapticScratch& scratch,
                       bool leave_crowd) {
    ProxySearch s;
    s.proxy = start;
    for (uint32_t k = 0; k < kSteps; ++k) {
        if (k >= 1 && scratch.near.asked > kMostAsked) {
            s.unfinished = true;
            break;
        }
        const Planes& planes = gather_planes(s.proxy, scratch);
        if (planes.inside && !was_outside) {
            s.inside = true;
            return s;
        }
        if (k == 0 && leave_crowd && scratch.touched_crowd) {
            s.left = true;
            s.active = planes.half_spaces.count;
            return s;
        }
        const Vec3d pull = goal - s.proxy;
        const Projection nearest = project_on_half_spaces(pull, planes.half_spaces);
        // constrained from both sides: stay
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
        s.unfinished = share < 1;
        s.proxy += sweep(s.proxy, step, scratch) * step;
        if (share < 1 && step.squaredNorm() <= kConverged * kConverged) break;
    }
    // after a step cut at a convex edge, it may hover over the surface between it and the goal
    s.hovers = s.active == 0 && (goal - s.proxy).squaredNorm() > kConverged * kConverged;
    if (s.hovers) s.active = 1;
    return s;
}

}  // namespace trocar
