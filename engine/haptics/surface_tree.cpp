#include "engine/haptics/surface_tree.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
namespace trocar {
namespace {

constexpr uint32_t kRun = 16;
constexpr double kRounding = 1e-12;  // relative, of squares
constexpr size_t kDeepest = 64;      // most pending nodes in a traversal: three per level, and each level quarters the runs

void add_runs(const LocalContactModel& model, uint32_t begin, uint32_t end, SurfaceTreeScratch& scratch) {
    scratch.run.clear();
    scratch.order.clear();
    for (uint32_t first = begin; first < end; first += kRun) {
        TriangleRun run;
        run.triangles = {first, std::min(kRun, end - first)};
        double fastest2 = 0;
        for (uint32_t t = first; t < run.triangles.end(); ++t) {
            for (const uint32_t v : model.triangle[t]) {
                grow(run.box, model.position[v]);
                grow(run.velocity, model.velocity[v]);
                fastest2 = std::max(fastest2, model.velocity[v].squaredNorm());
            }
        }
        run.speed = std::sqrt(fastest2);
        scratch.order.push_back(static_cast<uint32_t>(scratch.run.size()));
        scratch.run.push_back(run);
    }
}

// Orders the runs order[begin..end) by the median of the longest axis of their centres; returns its index.
uint32_t halve(SurfaceTreeScratch& scratch, uint32_t begin, uint32_t end) {
    Box centres;
    for (uint32_t k = begin; k < end; ++k) {
        const Box& box = scratch.run[scratch.order[k]].box;
        const Vec3d centre = box.min + box.max;
        grow(centres, centre);
    }
    int axis;
    (centres.max - centres.min).maxCoeff(&axis);
    const auto comes_before = [&](uint32_t a, uint32_t b) {
        const Box &p = scratch.run[a].box, &q = scratch.run[b].box;
        const double x = p.min[axis] + p.max[axis], y = q.min[axis] + q.max[axis];
        return x != y ? x < y : a < b;
    };
    const uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(scratch.order.begin() + begin, scratch.order.begin() + middle, scratch.order.begin() + end, comes_before);
    return middle;
}

float rounded_down(double x) {
    const auto f = static_cast<float>(x);
    return f <= x ? f : std::nextafter(f, -std::numeric_limits<float>::infinity());
}
float rounded_up(double x) { return -rounded_down(-x); }

// Puts the runs order[begin..end) in a lane; `node` holds them if there are several.
void set_part(const SurfaceTreeScratch& scratch, uint32_t begin, uint32_t end, uint32_t index, SurfaceNode& node) {
    TriangleRun all = scratch.run[scratch.order[begin]];
    for (uint32_t k = begin + 1; k < end; ++k) {
        const TriangleRun& run = scratch.run[scratch.order[k]];
        grow(all.box, run.box);
        grow(all.velocity, run.velocity);
        all.speed = std::max(all.speed, run.speed);
    }
    const uint32_t lane = node.lanes++;
    for (int axis = 0; axis < 3; ++axis) {
        const auto a = static_cast<size_t>(axis);
        node.low[a][lane] = rounded_down(all.box.min[axis]), node.high[a][lane] = rounded_up(all.box.max[axis]);
        node.velocity_low[a][lane] = rounded_down(all.velocity.min[axis]), node.velocity_high[a][lane] = rounded_up(all.velocity.max[axis]);
    }
    node.speed[lane] = rounded_up(all.speed);
    node.part[lane] = end - begin == 1 ? all.triangles : Range{index, 0};
}

// Adds the node of the runs order[begin..end) and everything below it.
void add_node(SurfaceTreeScratch& scratch, uint32_t begin, uint32_t end, std::vector<SurfaceNode>& nodes) {
    const auto index = static_cast<uint32_t>(nodes.size());
    nodes.emplace_back();
    const auto add_part = [&](uint32_t first, uint32_t last) {
        if (first == last) return;
        set_part(scratch, first, last, static_cast<uint32_t>(nodes.size()), nodes[index]);
        if (last - first > 1) add_node(scratch, first, last, nodes);
    };
    const auto add_half = [&](uint32_t first, uint32_t last) {
        const uint32_t middle = last - first > 1 ? halve(scratch, first, last) : first;
        add_part(first, middle);
        add_part(middle, last);
    };
    const uint32_t middle = end - begin > 1 ? halve(scratch, begin, end) : begin;
    add_half(begin, middle);
    add_half(middle, end);
}

Vec3d corner_of(const LocalContactModel& model, const SurfaceMoment& at, uint32_t body, uint32_t vertex) {
    const Vec3d p = model.position[vertex] + at.age * model.velocity[vertex];
    return body == at.follower ? Vec3d(p + at.follow) : p;
}

std::array<Vec3d, 3> corners_of(const LocalContactModel& model, const SurfaceMoment& at, uint32_t t) {
    const Triangle& v = model.triangle[t];
    return {corner_of(model, at, model.body[t], v[0]), corner_of(model, at, model.body[t], v[1]),
            corner_of(model, at, model.body[t], v[2])};
}

// Corners of four triangles of one body at the present time.
void corners_of_four(const LocalContactModel& model, const std::array<uint32_t, 4>& triangle, const SurfaceMoment& at,
                     FourTriangles& corner) {
    const bool follows = model.body[triangle[0]] == at.follower;
    const Vec4d follow = to_vec4(at.follow), age = all_lanes(at.age);
    const auto corner_of_lane = [&](size_t lane, size_t k) {
        const uint32_t v = model.triangle[triangle[lane]][k];
        const Vec4d p = to_vec4(model.position[v]) + age * to_vec4(model.velocity[v]);
        return follows ? p + follow : p;
    };
    const auto four = [&](size_t k) {
        return side_by_side(corner_of_lane(0, k), corner_of_lane(1, k), corner_of_lane(2, k), corner_of_lane(3, k));
    };
    corner.a = four(0), corner.b = four(1), corner.c = four(2);
}

// Triangles first, ..., `last` of a run, up to four of them.
void place_four(const LocalContactModel& model, uint32_t first, uint32_t last, const SurfaceMoment& at, FourPlaced& four) {
    corners_of_four(model, {first, std::min(first + 1, last), std::min(first + 2, last), std::min(first + 3, last)}, at, four.corner);
    const auto& [a, b, c] = four.corner;
    four.box.low = {least(least(a.x, b.x), c.x), least(least(a.y, b.y), c.y), least(least(a.z, b.z), c.z)};
    four.box.high = {greatest(greatest(a.x, b.x), c.x), greatest(greatest(a.y, b.y), c.y), greatest(greatest(a.z, b.z), c.z)};
}

// Triangles of the run in a lane at the present time; returns the index of the first four.
uint32_t place_run(const LocalContactModel& model, uint32_t lane, Range triangles, PlacedSurface& placed) {
    PlacedSurface::Slot& run = placed.run[lane];
    if (run.stamp == placed.stamp) return run.first;
    run = {placed.stamp, placed.fours};
    placed.fours += (triangles.count + 3) / 4;
    if (placed.four.size() < placed.fours) placed.four.resize(placed.fours);
    for (uint32_t k = 0; k < triangles.count; k += 4)
        place_four(model, triangles.first + k, triangles.end() - 1, placed.moment, placed.four[run.first + k / 4]);
    return run.first;
}

// Enlarges squares by more than their rounding error.
Vec4d with_rounding(Vec4d squared) { return squared * (1 + kRounding) + kRounding * kRounding; }

FourPoints side_by_side(const std::array<SurfaceNode::Lanes, 3>& p) {
    const auto lanes = [](const SurfaceNode::Lanes& x) { return (Vec4d)_mm256_cvtps_pd(_mm_load_ps(x.data())); };
    return {lanes(p[0]), lanes(p[1]), lanes(p[2])};
}

// Boxes around the parts of a node at another age, without compliance prediction.
FourBoxes boxes_at(const SurfaceNode& node, double age) {
    const bool back = age < 0;
    const Vec4d ages = all_lanes(age);
    return {side_by_side(node.low) + ages * side_by_side(back ? node.velocity_high : node.velocity_low),
            side_by_side(node.high) + ages * side_by_side(back ? node.velocity_low : node.velocity_high)};
}

// One bit per box that is not farther than the root of `best` from a point.
uint32_t boxes_within(const FourBoxes& box, const FourPoints& p, Vec4d best) {
    const auto off = [](Vec4d low, Vec4d high, Vec4d at) { return greatest(greatest(low - at, at - high), Vec4d{}); };
    const FourPoints apart{off(box.low.x, box.high.x, p.x), off(box.low.y, box.high.y, p.y), off(box.low.z, box.high.z, p.z)};
    return mask_bits(norm2(apart) <= with_rounding(best));
}

// One bit per part of a node that is not farther than the root of `best` from a point; the point is given
// without compliance prediction.
uint32_t parts_within(const NodePlaced& node, const FourPoints& point, double best) {
    return boxes_within(node.box, point, all_lanes(best)) & ((1u << node.lanes) - 1);
}

// A node at the present time; returns its index.
uint32_t place_node(const LocalContactModel& model, uint32_t n, PlacedSurface& placed) {
    PlacedSurface::Slot& slot = placed.node_slot[n];
    if (slot.stamp == placed.stamp) return slot.first;
    slot = {placed.stamp, placed.nodes++};
    if (placed.node.size() < placed.nodes) placed.node.resize(placed.nodes);
    const SurfaceNode& node = model.point_shell.node[n];
    NodePlaced& at = placed.node[slot.first];
    at.box = boxes_at(node, placed.moment.age);
    at.part = node.part, at.lanes = node.lanes;
    return slot.first;
}

bool comes_before(double squared, uint32_t triangle, double other_squared, uint32_t other) {
    return squared < other_squared || (squared == other_squared && triangle < other);
}

// The nearest triangle so far.
struct Nearer {
    uint32_t triangle = kNone;
    double squared_distance = 0;
    double limit() const { return squared_distance; }  // m^2, search radius
    void take(uint32_t t, double squared) {
        if (comes_before(squared, t, squared_distance, triangle)) triangle = t, squared_distance = squared;
    }
};

// The nearest triangle so far and those around it.
struct NearestEight {
    double around = 0;      // m
    uint32_t hint = kNone;  // taken first
    double most = 0;        // m^2
    uint32_t count = 0;
    std::array<uint32_t, 8> triangle;
    std::array<double, 8> squared;
    double limit() const { return most; }
    void take(uint32_t t, double square) {
        if (t == hint && count > 0) return;
        if (count == 8 && !comes_before(square, t, squared[7], triangle[7])) return;
        size_t k = count < 8 ? count++ : 7;
        for (; k > 0 && comes_before(square, t, squared[k - 1], triangle[k - 1]); --k)
            squared[k] = squared[k - 1], triangle[k] = triangle[k - 1];
        squared[k] = square, triangle[k] = t;
        const double wide = std::sqrt(squared[0]) + around;
        most = std::min(most, wide * wide);
        if (count == 8) most = std::min(most, squared[7]);
    }
};

// Visits the triangles of a run.
template <typename Best>
void try_run(const LocalContactModel& model, uint32_t run, Range triangles, const FourPoints& point, PlacedSurface& placed, Best& best) {
    const uint32_t first = place_run(model, run, triangles, placed);
    for (uint32_t k = 0; k < triangles.count; k += 4) {
        const FourPlaced& four = placed.four[first + k / 4];
        const uint32_t left = triangles.count - k, lanes = left < 4 ? (1u << left) - 1 : 15;
        uint32_t near = boxes_within(four.box, point, all_lanes(best.limit())) & lanes;
        if (near == 0) continue;
        const Vec4d squared = squared_distances(point, four.corner);
        for (near &= mask_bits(squared <= all_lanes(best.limit())); near != 0; near &= near - 1) {
            const auto lane = static_cast<uint32_t>(std::countr_zero(near));
            best.take(triangles.first + k + lane, squared[lane]);
        }
    }
}

// Visits all triangles of a tree that are not farther than best.limit().
template <typename Best>
void search_tree(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, PlacedSurface& placed, Best& best) {
    const SurfaceMoment& at = placed.moment;
    const FourPoints at_point = in_all_lanes(point), back = in_all_lanes(tree.body == at.follower ? Vec3d(point - at.follow) : point);
    std::array<uint32_t, kDeepest> waits;
    size_t waiting = 0;
    for (uint32_t n = tree.root;; n = waits[--waiting]) {
        const NodePlaced& node = placed.node[place_node(model, n, placed)];
        for (uint32_t near = parts_within(node, back, best.limit()); near != 0; near &= near - 1) {
            const auto lane = static_cast<uint32_t>(std::countr_zero(near));
            const Range part = node.part[lane];
            if (part.count > 0)
                try_run(model, 4 * n + lane, part, at_point, placed, best);
            else
                waits[waiting++] = part.first;
        }
        if (waiting == 0) break;
    }
}

TrianglePoint closest_on(const LocalContactModel& model, const SurfaceMoment& at, const Vec3d& point, uint32_t t) {
    const std::array<Vec3d, 3> c = corners_of(model, at, t);
    return closest_point_on_triangle(point, c[0], c[1], c[2]);
}

// ---- sides ----

int corner_in(const Triangle& t, uint32_t vertex) { return t[0] == vertex ? 0 : t[1] == vertex ? 1 : 2; }

Vec3d unit_normal(const std::array<Vec3d, 3>& c) {
    const Vec3d n = triangle_normal(c[0], c[1], c[2]);
    const double length = n.norm();
    return length > 0 ? Vec3d(n / length) : Vec3d(Vec3d::Zero());
}

struct Pseudonormal {
    Vec3d normal = Vec3d::Zero();
    bool rim = false;  // the feature has triangles on one side only
};

void add_wedge(const LocalContactModel& model, const SurfaceMoment& at, uint32_t t, uint32_t vertex, Vec3d& sum) {
    const std::array<Vec3d, 3> c = corners_of(model, at, t);
    const int k = corner_in(model.triangle[t], vertex);
    const Vec3d u = c[(k + 1) % 3] - c[k], v = c[(k + 2) % 3] - c[k];
    sum += std::atan2(u.cross(v).norm(), u.dot(v)) * unit_normal(c);
}

// Triangles around a corner, in one direction and, if that ends at a rim, in the other.
Pseudonormal around_vertex(const LocalContactModel& model, const SurfaceMoment& at, uint32_t start, uint32_t vertex) {
    constexpr uint32_t kMost = 256;  // a fan that does not close within this many triangles is rejected
    Pseudonormal p;
    uint32_t t = start;
    for (uint32_t k = 0; k < kMost && t != kNone; ++k) {
        add_wedge(model, at, t, vertex, p.normal);
        t = model.neighbour[t][(corner_in(model.triangle[t], vertex) + 2) % 3];
        if (t == start) return p;
    }
    p.rim = true;
    t = model.neighbour[start][corner_in(model.triangle[start], vertex)];
    for (uint32_t k = 0; k < kMost && t != kNone && t != start; ++k) {
        add_wedge(model, at, t, vertex, p.normal);
        t = model.neighbour[t][corner_in(model.triangle[t], vertex)];
    }
    return p;
}

Pseudonormal pseudonormal(const LocalContactModel& model, const SurfaceMoment& at, uint32_t t, Feature feature) {
    if (feature == Feature::kFace) return {unit_normal(corners_of(model, at, t)), false};
    if (feature < Feature::kEdge0) return around_vertex(model, at, t, model.triangle[t][static_cast<int>(feature)]);
    const uint32_t across = model.neighbour[t][static_cast<int>(feature) - static_cast<int>(Feature::kEdge0)];
    const Vec3d mine = unit_normal(corners_of(model, at, t));
    if (across == kNone) return {mine, true};
    return {mine + unit_normal(corners_of(model, at, across)), false};
}

Vec3d velocity_at(const LocalContactModel& model, uint32_t t, const std::array<Vec3d, 3>& c, const Vec3d& point) {
    const Vec3d u = c[1] - c[0], v = c[2] - c[0], w = point - c[0];
    const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), area = uu * vv - uv * uv;
    const double b = area > 0 ? std::clamp((vv * u.dot(w) - uv * v.dot(w)) / area, 0.0, 1.0) : 0;
    const double g = area > 0 ? std::clamp((uu * v.dot(w) - uv * u.dot(w)) / area, 0.0, 1.0 - b) : 0;
    const Triangle& index = model.triangle[t];
    return (1 - b - g) * model.velocity[index[0]] + b * model.velocity[index[1]] + g * model.velocity[index[2]];
}

}  // namespace

void build_surface_trees(SurfaceTreeScratch& scratch, LocalContactModel& model) {
    std::vector<SurfaceNode>& node = model.point_shell.node;
    node.clear();
    model.point_shell.tree.clear();
    const uint32_t count = static_cast<uint32_t>(model.triangle.size());
    for (uint32_t begin = 0; begin < count;) {
        uint32_t end = begin + 1;
        while (end < count && model.body[end] == model.body[begin]) ++end;
        model.point_shell.tree.push_back({model.body[begin], static_cast<uint32_t>(node.size()), model.half_thickness[begin]});
        add_runs(model, begin, end, scratch);
        add_node(scratch, 0, static_cast<uint32_t>(scratch.run.size()), node);
        begin = end;
    }
}

void begin_moment(const LocalContactModel& model, const SurfaceMoment& moment, PlacedSurface& placed) {
    constexpr size_t kRoom = 1 << 11;  // covers what a shell usually comes near, so that memory is allocated once
    placed.moment = moment;
    ++placed.stamp;
    placed.nodes = placed.fours = 0;
    if (placed.four.size() < kRoom)
        placed.four.resize(kRoom), placed.node.resize(kRoom), placed.node_slot.reserve(4 * kRoom), placed.run.reserve(16 * kRoom);
    if (placed.node_slot.size() < model.point_shell.node.size())
        placed.node_slot.resize(model.point_shell.node.size()), placed.run.resize(4 * model.point_shell.node.size());
}

NearestTriangle find_nearest(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, uint32_t hint, double reach,
                             PlacedSurface& placed) {
    const SurfaceMoment& at = placed.moment;
    NearestTriangle nearest;
    Nearer best{kNone, reach * reach};
    if (hint != kNone) nearest.at = closest_on(model, at, point, hint);
    if (nearest.at.squared_distance < best.squared_distance) best = {hint, nearest.at.squared_distance};
    search_tree(model, tree, point, placed, best);
    if (best.triangle == kNone) return {};
    nearest.triangle = best.triangle;
    if (best.triangle != hint) nearest.at = closest_on(model, at, point, best.triangle);
    nearest.point = point + nearest.at.offset;
    return nearest;
}

NearestTriangle find_nearest_around(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, uint32_t hint,
                                    double reach, double around, PlacedSurface& placed, TrianglesAround& found) {
    const SurfaceMoment& at = placed.moment;
    NearestTriangle nearest;
    NearestEight best;
    best.around = around, best.most = reach * reach;
    if (hint != kNone) nearest.at = closest_on(model, at, point, hint);
    if (nearest.at.squared_distance <= best.most) best.take(hint, nearest.at.squared_distance), best.hint = hint;
    search_tree(model, tree, point, placed, best);
    found.triangle.fill(kNone);
    std::copy_n(best.triangle.begin(), best.count, found.triangle.begin());
    const double most = std::sqrt(best.most);
    found.others = {best.count > 4 ? std::min(most, std::sqrt(best.squared[4])) : most, most};
    if (best.count == 0) return {};
    nearest.triangle = best.triangle[0];
    if (nearest.triangle != hint) nearest.at = closest_on(model, at, point, nearest.triangle);
    nearest.point = point + nearest.at.offset;
    return nearest;
}

bool nearest_of(const LocalContactModel& model, const TrianglesAround& found, const Vec3d& point, double gone, double far, double reach,
                const PlacedSurface& placed, NearestTriangle& nearest) {
    const FourPoints at_point = in_all_lanes(point);
    Nearer best{kNone, reach * reach};
    const auto is_nearest = [&](double others) {
        const double left = (1 - 1e-9) * std::min(others - gone, far);
        return left > 0 && best.squared_distance < left * left;
    };
    FourTriangles corner;
    bool sure = false;
    for (size_t four = 0; four < 2 && !sure && found.triangle[4 * four] != kNone; ++four) {
        std::array<uint32_t, 4> t;
        for (size_t lane = 0; lane < 4; ++lane) {
            const uint32_t other = found.triangle[4 * four + lane];
            t[lane] = other != kNone ? other : t[lane - 1];
        }
        corners_of_four(model, t, placed.moment, corner);
        const Vec4d squared = squared_distances(at_point, corner);
        for (size_t lane = 0; lane < 4; ++lane) best.take(t[lane], squared[lane]);
        sure = is_nearest(found.others[four]);
    }
    if (!sure && !is_nearest(found.others[1])) return false;
    nearest = {};
    if (best.triangle == kNone) return true;
    nearest.triangle = best.triangle;
    nearest.at = closest_on(model, placed.moment, point, best.triangle);
    nearest.point = point + nearest.at.offset;
    return true;
}

double fastest_around(const LocalContactModel& model, const SurfaceTree& tree, const Vec3d& point, double around, double ahead) {
    double fastest = 0;
    const FourPoints position = in_all_lanes(point);
    std::array<uint32_t, kDeepest> waits;
    size_t waiting = 0;
    for (uint32_t n = tree.root;; n = waits[--waiting]) {
        const SurfaceNode& node = model.point_shell.node[n];
        const Vec4d speed = (Vec4d)_mm256_cvtps_pd(_mm_load_ps(node.speed.data())), reach = all_lanes(around) + all_lanes(ahead) * speed;
        const uint32_t faster = mask_bits(speed > all_lanes(fastest)) & ((1u << node.lanes) - 1);
        const FourBoxes box{side_by_side(node.low), side_by_side(node.high)};
        for (uint32_t near = boxes_within(box, position, reach * reach) & faster; near != 0; near &= near - 1) {
            const auto lane = static_cast<uint32_t>(std::countr_zero(near));
            if (node.part[lane].count > 0)
                fastest = std::max(fastest, static_cast<double>(node.speed[lane]));
            else
                waits[waiting++] = node.part[lane].first;
        }
        if (waiting == 0) break;
    }
    return fastest;
}

SurfaceSide side_of(const LocalContactModel& model, const NearestTriangle& nearest, double before, const PlacedSurface& placed) {
    const uint32_t t = nearest.triangle;
    const std::array<Vec3d, 3> corner = corners_of(model, placed.moment, t);
    const double distance = std::sqrt(nearest.at.squared_distance), half = model.half_thickness[t];
    Pseudonormal out = pseudonormal(model, placed.moment, t, nearest.at.feature);
    if (const double length = out.normal.norm(); length > 0) out.normal /= length;
    SurfaceSide side;
    side.velocity = velocity_at(model, t, corner, nearest.point);
    const double sign = nearest.at.offset.dot(out.normal) > 0 ? -1 : 1;
    if (half > 0) side.side = out.rim || before == 0 ? sign : before;
    side.distance = side.side * sign * distance - half;
    side.normal = distance > 1e-12 ? Vec3d((-side.side * sign / distance) * nearest.at.offset) : Vec3d(side.side * out.normal);
    return side;
}

}  // namespace trocar
