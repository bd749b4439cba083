#include "engine/surface_tree.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
namespace trocar {
namespace {

constexpr uint32_t kRun = 16;
constexpr double kRounding = 1e-12;  // of squares, beside 1
constexpr double kOnward = 2e-3;     // m, runs are listed for this much more than is asked for: a point hardly goes farther until the next model
constexpr double kFelt = 0.05;       // s, models that are older are asked by their trees
constexpr size_t kMostListed = 1 << 12;  // rows of PlacedSurface::listed

void enlarge(Box& box, const Box& other) {
    box.min = box.min.cwiseMin(other.min);
    box.max = box.max.cwiseMax(other.max);
}

void add_runs(const LocalContactModel& model, uint32_t begin, uint32_t end, SurfaceTreeScratch& scratch) {
    scratch.run.clear();
    scratch.order.clear();
    for (uint32_t first = begin; first < end; first += kRun) {
        SurfaceNode run;
        run.triangles = {first, std::min(kRun, end - first)};
        run.body = model.body[first];
        double fastest2 = 0;
        for (uint32_t t = first; t < run.triangles.end(); ++t) {
            for (const uint32_t v : model.triangle[t]) {
                enlarge(run.box, {model.position[v], model.position[v]});
                enlarge(run.velocity, {model.velocity[v], model.velocity[v]});
                fastest2 = std::max(fastest2, model.velocity[v].squaredNorm());
            }
        }
        run.speed = std::sqrt(fastest2);
        scratch.order.push_back(static_cast<uint32_t>(scratch.run.size()));
        scratch.run.push_back(run);
    }
}

// Nodes of the runs order[begin..end), depth first.
void add_nodes(SurfaceTreeScratch& scratch, uint32_t begin, uint32_t end, std::vector<SurfaceNode>& nodes) {
    const uint32_t row = static_cast<uint32_t>(nodes.size());
    if (end - begin == 1) {
        nodes.push_back(scratch.run[scratch.order[begin]]);
        nodes[row].next = row + 1;
        return;
    }
    SurfaceNode node;
    Box centres;
    for (uint32_t k = begin; k < end; ++k) {
        const SurfaceNode& run = scratch.run[scratch.order[k]];
        const Vec3d centre = run.box.min + run.box.max;
        enlarge(node.box, run.box);
        enlarge(node.velocity, run.velocity);
        enlarge(centres, {centre, centre});
        node.speed = std::max(node.speed, run.speed);
        node.body = run.body;
    }
    nodes.push_back(node);
    int axis;
    (centres.max - centres.min).maxCoeff(&axis);
    const auto comes_before = [&](uint32_t a, uint32_t b) {
        const Box &p = scratch.run[a].box, &q = scratch.run[b].box;
        const double x = p.min[axis] + p.max[axis], y = q.min[axis] + q.max[axis];
        return x != y ? x < y : a < b;
    };
    const uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(scratch.order.begin() + begin, scratch.order.begin() + middle, scratch.order.begin() + end, comes_before);
    add_nodes(scratch, begin, middle, nodes);
    add_nodes(scratch, middle, end, nodes);
    nodes[row].next = static_cast<uint32_t>(nodes.size());
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

// Triangles first, ..., `last` of a run, up to four of them.
FourPlaced place_four(const LocalContactModel& model, uint32_t first, uint32_t last, const SurfaceMoment& at) {
    const bool follows = model.body[first] == at.follower;
    const Vec4d follow = to_vec4(at.follow), age = all_lanes(at.age);
    const auto corner = [&](uint32_t lane, size_t k) {
        const uint32_t v = model.triangle[std::min(first + lane, last)][k];
        const Vec4d p = to_vec4(model.position[v]) + age * to_vec4(model.velocity[v]);
        return follows ? p + follow : p;
    };
    FourPlaced row;
    for (size_t k = 0; k < 3; ++k) row.corner[k] = side_by_side(corner(0, k), corner(1, k), corner(2, k), corner(3, k));
    const auto& [a, b, c] = row.corner;
    row.box.low = {least(least(a.x, b.x), c.x), least(least(a.y, b.y), c.y), least(least(a.z, b.z), c.z)};
    row.box.high = {greatest(greatest(a.x, b.x), c.x), greatest(greatest(a.y, b.y), c.y), greatest(greatest(a.z, b.z), c.z)};
    return row;
}

// Triangles of a run at the moment; row of the first four.
uint32_t place_run(const LocalContactModel& model, uint32_t node, Range rows, PlacedSurface& placed) {
    PlacedSurface::Run& run = placed.run[node];
    if (run.stamp == placed.stamp) return run.first;
    run = {placed.stamp, static_cast<uint32_t>(placed.four.size())};
    for (uint32_t t = rows.first; t < rows.end(); t += 4) placed.four.push_back(place_four(model, t, rows.end() - 1, placed.moment));
    return run.first;
}

// A little more than squares are rounded by.
double with_rounding(double squared) { return squared * (1 + kRounding) + kRounding * kRounding; }

// Box around a node at another age, had it not followed.
struct VecBox {
    Vec4d low, high;
};
VecBox box_at(const SurfaceNode& node, double age) {
    const bool back = age < 0;
    return {to_vec4(node.box.min) + age * to_vec4(back ? node.velocity.max : node.velocity.min),
            to_vec4(node.box.max) + age * to_vec4(back ? node.velocity.min : node.velocity.max)};
}

// Whether everything of a node is farther than the root of `best`; `point` is where it would be had the node not
// followed.
bool is_beyond(const SurfaceNode& node, double age, Vec4d point, double best) {
    const VecBox box = box_at(node, age);
    return norm2(greatest(greatest(box.low - point, point - box.high), Vec4d{})) > with_rounding(best);
}

// One bit a box that is not farther than the root of `best` from a point.
uint32_t boxes_within(const FourBoxes& box, const FourPoints& p, double best) {
    const auto off = [](Vec4d low, Vec4d high, Vec4d at) { return greatest(greatest(low - at, at - high), Vec4d{}); };
    const FourPoints apart{off(box.low.x, box.high.x, p.x), off(box.low.y, box.high.y, p.y), off(box.low.z, box.high.z, p.z)};
    return mask_bits(norm2(apart) <= all_lanes(with_rounding(best)));
}

FourPoints in_all_lanes(const Vec3d& p) { return {all_lanes(p.x()), all_lanes(p.y()), all_lanes(p.z())}; }

void try_triangle(const std::array<Vec3d, 3>& corner, uint32_t t, const Vec3d& point, NearestTriangle& best) {
    const TrianglePoint at = closest_point_on_triangle(point, corner[0], corner[1], corner[2]);
    if (at.squared_distance < best.at.squared_distance ||
        (at.squared_distance == best.at.squared_distance && t < best.triangle)) {
        best.triangle = t;
        best.at = at;
    }
}

// The triangles of a run.
void try_run(const LocalContactModel& model, uint32_t node, Range rows, const Vec3d& point, const FourPoints& at_point, PlacedSurface& placed,
             NearestTriangle& best) {
    const uint32_t first = place_run(model, node, rows, placed);
    for (uint32_t k = 0; k < rows.count; k += 4) {
        const FourPlaced& four = placed.four[first + k / 4];
        const uint32_t left = rows.count - k, lanes = left < 4 ? (1u << left) - 1 : 15;
        for (uint32_t near = boxes_within(four.box, at_point, best.at.squared_distance) & lanes; near != 0; near &= near - 1) {
            const auto lane = static_cast<uint32_t>(std::countr_zero(near));
            if (rows.first + k + lane == best.triangle) continue;
            const auto corner = [&](const FourPoints& p) { return Vec3d(p.x[lane], p.y[lane], p.z[lane]); };
            try_triangle({corner(four.corner[0]), corner(four.corner[1]), corner(four.corner[2])}, rows.first + k + lane, point, best);
        }
    }
}

// All runs of a tree. `back`: the point, had the surface not followed.
void try_tree(const LocalContactModel& model, uint32_t root, const Vec3d& back, const Vec3d& point, const FourPoints& at_point,
              PlacedSurface& placed, NearestTriangle& best) {
    const std::vector<SurfaceNode>& node = model.shell.node;
    const Vec4d from = to_vec4(back);
    for (uint32_t n = root; n < node[root].next;) {
        if (is_beyond(node[n], placed.moment.age, from, best.at.squared_distance)) {
            n = node[n].next;
            continue;
        }
        if (node[n].triangles.count > 0) try_run(model, n, node[n].triangles, point, at_point, placed, best);
        ++n;
    }
}

// The runs that were listed. `back`: the point, had the surface not followed.
void try_listed(const LocalContactModel& model, Range fours, const FourPoints& back, const Vec3d& point, const FourPoints& at_point,
                PlacedSurface& placed, NearestTriangle& best) {
    const Vec4d age = all_lanes(placed.moment.age);
    for (uint32_t k = fours.first; k < fours.end(); ++k) {
        const FourRuns& four = placed.listed[k];
        const FourBoxes box{four.box.low + age * four.velocity.low, four.box.high + age * four.velocity.high};
        for (uint32_t near = boxes_within(box, back, best.at.squared_distance); near != 0; near &= near - 1) {
            const auto lane = static_cast<size_t>(std::countr_zero(near));
            try_run(model, four.node[lane], four.triangles[lane], point, at_point, placed, best);
        }
    }
}

// Lists the runs of a tree nearer than `within` to a place at any time until kFelt.
void list_runs(const LocalContactModel& model, uint32_t root, const Vec3d& place, double within, RunsAround& around, std::vector<FourRuns>& listed) {
    const std::vector<SurfaceNode>& tree = model.shell.node;
    const double within2 = with_rounding(within * within);
    const Vec4d middle = to_vec4(place);
    const FourPoints beyond = in_all_lanes(Vec3d::Constant(std::numeric_limits<double>::infinity()));
    const auto first = static_cast<uint32_t>(listed.size());
    uint32_t lane = 4;
    for (uint32_t n = root; n < tree[root].next;) {
        const SurfaceNode& node = tree[n];
        const VecBox begin = box_at(node, 0), end = box_at(node, kFelt);
        const Vec4d off = greatest(greatest(least(begin.low, end.low) - middle, middle - greatest(begin.high, end.high)), Vec4d{});
        if (norm2(off) > within2) {
            n = node.next;
            continue;
        }
        if (node.triangles.count > 0) {
            if (lane == 4) listed.push_back({{beyond, beyond}, {}, {}, {}}), lane = 0;
            FourRuns& four = listed.back();
            set_lane(four.box.low, lane, begin.low), set_lane(four.box.high, lane, begin.high);
            set_lane(four.velocity.low, lane, to_vec4(node.velocity.min)), set_lane(four.velocity.high, lane, to_vec4(node.velocity.max));
            four.triangles[lane] = node.triangles;
            four.node[lane++] = n;
        }
        ++n;
    }
    around = {root, place, within, {first, static_cast<uint32_t>(listed.size()) - first}};
}

// What is listed of the tree around a point, where that shows all within `distance` of it; lists it if need be. `back`: the
// point, had the surface not followed.
Range runs_around(const LocalContactModel& model, uint32_t root, const Vec3d& back, double distance, uint32_t asker, PlacedSurface& placed) {
    RunsAround& around = placed.around[asker];
    if (around.root == root && (back - around.place).norm() + distance <= around.within) return around.fours;
    if (placed.listed.size() > kMostListed) begin_model(static_cast<uint32_t>(placed.around.size()), placed);
    list_runs(model, root, back, distance + kOnward, placed.around[asker], placed.listed);
    return placed.around[asker].fours;
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

// Triangles around a corner, one way and, where that ends at a rim, the other.
Pseudonormal around_vertex(const LocalContactModel& model, const SurfaceMoment& at, uint32_t start, uint32_t vertex) {
    constexpr uint32_t kMost = 256;  // a fan that does not close is no fan
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
    const Triangle& row = model.triangle[t];
    return (1 - b - g) * model.velocity[row[0]] + b * model.velocity[row[1]] + g * model.velocity[row[2]];
}

}  // namespace

void build_surface_trees(SurfaceTreeScratch& scratch, LocalContactModel& model) {
    model.shell.node.clear();
    const uint32_t count = static_cast<uint32_t>(model.triangle.size());
    for (uint32_t begin = 0; begin < count;) {
        uint32_t end = begin + 1;
        while (end < count && model.body[end] == model.body[begin]) ++end;
        add_runs(model, begin, end, scratch);
        add_nodes(scratch, 0, static_cast<uint32_t>(scratch.run.size()), model.shell.node);
        begin = end;
    }
}

uint32_t tree_count(const LocalContactModel& model) {
    uint32_t count = 0;
    for (uint32_t root = 0; root < model.shell.node.size(); root = next_tree(model, root)) ++count;
    return count;
}

void begin_model(uint32_t askers, PlacedSurface& placed) {
    placed.around.assign(askers, {});
    placed.listed.clear();
    placed.listed.reserve(kMostListed + kMostListed / 2);  // a list may begin below the one and end beyond it
}

void begin_moment(const LocalContactModel& model, const SurfaceMoment& moment, PlacedSurface& placed) {
    constexpr size_t kRoom = 1 << 11;  // for what a shell usually comes near, so that memory is asked for once
    placed.moment = moment;
    ++placed.stamp;
    placed.four.clear();
    if (placed.four.capacity() < kRoom) placed.four.reserve(kRoom), placed.run.reserve(16 * kRoom);
    if (placed.run.size() < model.shell.node.size()) placed.run.resize(model.shell.node.size());
}

NearestTriangle find_nearest(const LocalContactModel& model, uint32_t root, const Vec3d& point, uint32_t hint,
                             double reach, PlacedSurface& placed, uint32_t asker) {
    const SurfaceMoment& at = placed.moment;
    NearestTriangle best;
    best.at.squared_distance = reach * reach;
    if (hint != kNone) try_triangle(corners_of(model, at, hint), hint, point, best);
    const FourPoints at_point = in_all_lanes(point);
    const Vec3d back = model.shell.node[root].body == at.follower ? Vec3d(point - at.follow) : point;
    const double distance = std::sqrt(best.at.squared_distance);
    if (asker != kNone && distance < kOnward && at.age >= 0 && at.age <= kFelt)
        try_listed(model, runs_around(model, root, back, distance, asker, placed), in_all_lanes(back), point, at_point, placed, best);
    else
        try_tree(model, root, back, point, at_point, placed, best);
    best.point = point + best.at.offset;
    return best;
}

double fastest_around(const LocalContactModel& model, uint32_t root, const Vec3d& point, double around) {
    const std::vector<SurfaceNode>& node = model.shell.node;
    double fastest = 0;
    const Vec4d place = to_vec4(point);
    for (uint32_t n = root; n < node[root].next;) {
        const bool passed = node[n].speed <= fastest || is_beyond(node[n], 0, place, around * around);
        if (!passed && node[n].triangles.count > 0) fastest = node[n].speed;
        n = passed ? node[n].next : n + 1;
    }
    return fastest;
}

SurfaceSide side_of(const LocalContactModel& model, const NearestTriangle& nearest, double before,
                    const PlacedSurface& placed) {
    const uint32_t t = nearest.triangle;
    const std::array<Vec3d, 3> corner = corners_of(model, placed.moment, t);
    const double distance = std::sqrt(nearest.at.squared_distance), half = model.half_thickness[t];
    Pseudonormal out = pseudonormal(model, placed.moment, t, nearest.at.feature);
    if (const double length = out.normal.norm(); length > 0) out.normal /= length;
    SurfaceSide side;
    side.velocity = velocity_at(model, t, corner, nearest.point);
    const double place = nearest.at.offset.dot(out.normal) > 0 ? -1 : 1;
    if (half > 0) side.side = out.rim || before == 0 ? place : before;
    side.distance = side.side * place * distance - half;
    side.normal = distance > 1e-12 ? Vec3d((-side.side * place / distance) * nearest.at.offset) : Vec3d(side.side * out.normal);
    return side;
}

}  // namespace trocar
