#include "engine/surface_tree.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/geometry/vec4.hpp"
namespace trocar {
namespace {

constexpr uint32_t kRun = 16;
constexpr double kRounding = 1e-12;  // of squares, beside 1

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

Vec4d smaller(Vec4d a, Vec4d b) { return (Vec4d)_mm256_min_pd((__m256d)a, (__m256d)b); }
Vec4d larger(Vec4d a, Vec4d b) { return (Vec4d)_mm256_max_pd((__m256d)a, (__m256d)b); }

PlacedTriangle place(const LocalContactModel& model, uint32_t t, const SurfaceMoment& at) {
    PlacedTriangle row;
    for (int k = 0; k < 3; ++k) row.corner[k] = corner_of(model, at, model.body[t], model.triangle[t][k]);
    const Vec4d a = to_vec4(row.corner[0]), b = to_vec4(row.corner[1]), c = to_vec4(row.corner[2]);
    row.box = {to_vec3(smaller(smaller(a, b), c)), to_vec3(larger(larger(a, b), c))};
    return row;
}

// Triangles of a run at the moment; row of the first.
uint32_t place_run(const LocalContactModel& model, uint32_t node, PlacedSurface& placed) {
    PlacedSurface::Run& run = placed.run[node];
    if (run.stamp == placed.stamp) return run.first;
    run = {placed.stamp, static_cast<uint32_t>(placed.triangle.size())};
    const Range rows = model.shell.node[node].triangles;
    for (uint32_t t = rows.first; t < rows.end(); ++t) placed.triangle.push_back(place(model, t, placed.moment));
    return run.first;
}

// Whether a box is farther than the root of `best`.
bool is_beyond(Vec4d low, Vec4d high, Vec4d point, double best) {
    const Vec4d off = larger(larger(low - point, point - high), Vec4d{});
    return norm2(off) > best * (1 + kRounding) + kRounding * kRounding;
}

// Whether everything of a node is farther than the root of `best`; `point` is where it would be had the node not
// followed.
bool is_beyond(const SurfaceNode& node, double age, Vec4d point, double best) {
    const bool back = age < 0;
    const Vec4d low = to_vec4(node.box.min) + age * to_vec4(back ? node.velocity.max : node.velocity.min);
    const Vec4d high = to_vec4(node.box.max) + age * to_vec4(back ? node.velocity.min : node.velocity.max);
    return is_beyond(low, high, point, best);
}

void try_triangle(const PlacedTriangle& row, uint32_t t, const Vec3d& point, NearestTriangle& best) {
    const TrianglePoint at = closest_point_on_triangle(point, row.corner[0], row.corner[1], row.corner[2]);
    if (at.squared_distance < best.at.squared_distance ||
        (at.squared_distance == best.at.squared_distance && t < best.triangle)) {
        best.triangle = t;
        best.at = at;
    }
}

// ---- sides ----

int corner_in(const Triangle& t, uint32_t vertex) { return t[0] == vertex ? 0 : t[1] == vertex ? 1 : 2; }

Vec3d unit_normal(const std::array<Vec3d, 3>& c) {
    const Vec3d n = triangle_normal(c[0], c[1], c[2]);
    const double length = n.norm();
    return length > 0 ? Vec3d(n / length) : Vec3d(Vec3d::Zero());
}

std::array<Vec3d, 3> corners_of(const LocalContactModel& model, const SurfaceMoment& at, uint32_t t) {
    const Triangle& v = model.triangle[t];
    return {corner_of(model, at, model.body[t], v[0]), corner_of(model, at, model.body[t], v[1]),
            corner_of(model, at, model.body[t], v[2])};
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

void begin_moment(const LocalContactModel& model, const SurfaceMoment& moment, PlacedSurface& placed) {
    constexpr size_t kRoom = 1 << 13;  // for what a shell usually comes near, so that memory is asked for once
    placed.moment = moment;
    ++placed.stamp;
    placed.triangle.clear();
    if (placed.triangle.capacity() < kRoom) placed.triangle.reserve(kRoom), placed.run.reserve(4 * kRoom);
    if (placed.run.size() < model.shell.node.size()) placed.run.resize(model.shell.node.size());
}

NearestTriangle find_nearest(const LocalContactModel& model, uint32_t root, const Vec3d& point, uint32_t hint,
                             double reach, PlacedSurface& placed) {
    const std::vector<SurfaceNode>& node = model.shell.node;
    const SurfaceMoment& at = placed.moment;
    const Vec4d back = to_vec4(node[root].body == at.follower ? Vec3d(point - at.follow) : point);
    const Vec4d at_point = to_vec4(point);
    NearestTriangle best;
    best.at.squared_distance = reach * reach;
    if (hint != kNone) {
        try_triangle(place(model, hint, at), hint, point, best);
    }
    for (uint32_t n = root; n < node[root].next;) {
        if (is_beyond(node[n], at.age, back, best.at.squared_distance)) {
            n = node[n].next;
            continue;
        }
        const Range rows = node[n].triangles;
        const uint32_t first = rows.count > 0 ? place_run(model, n, placed) : 0;
        for (uint32_t t = rows.first; t < rows.end(); ++t) {
            const PlacedTriangle& row = placed.triangle[first + (t - rows.first)];
            if (is_beyond(to_vec4(row.box.min), to_vec4(row.box.max), at_point, best.at.squared_distance)) continue;
            try_triangle(row, t, point, best);
        }
        ++n;
    }
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
