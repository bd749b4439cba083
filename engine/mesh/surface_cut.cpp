#include "engine/mesh/surface_cut.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace trocar {
namespace {

using CutEdge = std::array<uint32_t, 2>;  // vertices, lower first

CutEdge cut_edge(uint32_t a, uint32_t b) { return {std::min(a, b), std::max(a, b)}; }

// Six times the signed volume; zero counts as positive, so that an end in the plane of a sweep is on one side of it.
double six_volume(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) { return (b - a).cross(c - a).dot(d - a); }
bool is_on_positive_side(double v) { return v >= 0; }

// Side of the line from a to b on which the line from p to q passes; from b to a it is always the other one, so that of two triangles
// with that edge exactly one is met by a line through it.
bool passes_positive(const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b) {
    const bool ascends = std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
    return ascends ? is_on_positive_side(six_volume(p, q, a, b)) : !is_on_positive_side(six_volume(p, q, b, a));
}

// Where a segment goes through a triangle: fraction of its length from p; NaN if it does not.
double crossing_along(const Vec3d& p, const Vec3d& q, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    constexpr double kNo = std::numeric_limits<double>::quiet_NaN();
    const double at_p = six_volume(a, b, c, p), at_q = six_volume(a, b, c, q);
    if (is_on_positive_side(at_p) == is_on_positive_side(at_q)) return kNo;
    const bool ab = passes_positive(p, q, a, b), bc = passes_positive(p, q, b, c), ca = passes_positive(p, q, c, a);
    if (ab != bc || bc != ca) return kNo;
    return at_p / (at_p - at_q);
}

double distance_to_line(const Vec3d& x, const Vec3d& a, const Vec3d& b) {
    const double length = (b - a).norm();
    return length > 0 ? (x - a).cross(b - a).norm() / length : (x - a).norm();
}

// Part of the sweep, 0..1, at which its edge comes to a point.
double time_of(const EdgeSweep& s, const Vec3d& x) {
    const double before = distance_to_line(x, s.a0, s.b0), after = distance_to_line(x, s.a1, s.b1);
    return before + after > 0 ? before / (before + after) : 0;
}

// A vertex of the path, where the sweep crosses an edge.
struct CutPoint {
    CutEdge edge{};
    uint32_t vertex = kNone;  // kNone: to be made
    double along = 0;         // of the edge
    double time = 0;          // of the sweep
};

Box box_of_sweep(const EdgeSweep& s) {
    Box box;
    for (const Vec3d& p : {s.a0, s.b0, s.a1, s.b1}) box.min = box.min.cwiseMin(p), box.max = box.max.cwiseMax(p);
    return box;
}

// m, by which a vertex has moved during the sweep.
Vec3d moved_by(const CutMesh& mesh, uint32_t v) {
    return mesh.before.empty() ? Vec3d(Vec3d::Zero()) : Vec3d(mesh.place[v] - mesh.before[v]);
}

// Triangles whose boxes, of all their way, meet that of the sweep.
std::vector<uint32_t> near_triangles(const EdgeSweep& sweep, const CutMesh& mesh) {
    const Box box = box_of_sweep(sweep);
    std::vector<uint32_t> near;
    for (uint32_t t = 0; t < mesh.triangles; ++t) {
        const auto& c = mesh.triangle[t];
        Vec3d low = mesh.place[c[0]].cwiseMin(mesh.place[c[1]]).cwiseMin(mesh.place[c[2]]);
        Vec3d high = mesh.place[c[0]].cwiseMax(mesh.place[c[1]]).cwiseMax(mesh.place[c[2]]);
        for (const uint32_t v : c)
            low = low.cwiseMin(mesh.place[v] - moved_by(mesh, v)), high = high.cwiseMax(mesh.place[v] - moved_by(mesh, v));
        if ((low.array() <= box.max.array()).all() && (high.array() >= box.min.array()).all()) near.push_back(t);
    }
    return near;
}

// The crossed edges, ascending.
std::vector<CutPoint> find_path(const EdgeSweep& sweep, const CutMesh& mesh, std::span<const uint32_t> near) {
    std::vector<CutEdge> edges;
    for (const uint32_t t : near)
        for (int k = 0; k < 3; ++k) edges.push_back(cut_edge(mesh.triangle[t][k], mesh.triangle[t][(k + 1) % 3]));
    std::sort(edges.begin(), edges.end());
    edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
    std::vector<CutPoint> path;
    for (const CutEdge& e : edges) {
        const Vec3d &p = mesh.place[e[0]], &q = mesh.place[e[1]];
        const Vec3d moved = 0.5 * (moved_by(mesh, e[0]) + moved_by(mesh, e[1]));
        const EdgeSweep s{sweep.a0 + moved, sweep.b0 + moved, sweep.a1, sweep.b1};
        const double along = crossing_of(s, p, q);
        if (std::isnan(along)) continue;
        CutPoint point{e, kNone, along, time_of(s, p + along * (q - p))};
        const double length = (mesh.rest[e[1]] - mesh.rest[e[0]]).norm(), snap = kSnap * std::max(length, mesh.mean_edge);
        if (std::min(along, 1 - along) * length < snap) point.vertex = along < 0.5 ? e[0] : e[1];
        path.push_back(point);
    }
    return path;
}

// The path point on an edge; null if the edge is not crossed.
const CutPoint* point_on(std::span<const CutPoint> path, const CutEdge& edge) {
    const auto found = std::lower_bound(path.begin(), path.end(), edge, [](const CutPoint& p, const CutEdge& e) { return p.edge < e; });
    return found != path.end() && found->edge == edge ? &*found : nullptr;
}

// Pairs of path vertices that follow each other within a triangle, by the time of the sweep. A tip comes first.
void connect_path(const Triangle& corner, std::span<const CutPoint> path, std::span<const uint32_t> front, std::vector<CutEdge>& joined) {
    std::vector<std::pair<double, uint32_t>> met;
    for (int k = 0; k < 3; ++k) {
        if (const CutPoint* p = point_on(path, cut_edge(corner[k], corner[(k + 1) % 3]))) met.push_back({p->time, p->vertex});
    }
    if (met.empty()) return;
    for (const uint32_t v : corner)
        if (std::binary_search(front.begin(), front.end(), v)) met.push_back({-1, v});
    std::sort(met.begin(), met.end());
    for (size_t i = 1; i < met.size(); ++i)
        if (met[i].second != met[i - 1].second) joined.push_back(cut_edge(met[i].second, met[i - 1].second));
}

// Splits triangles along the split edges of the path.
class Splitter {
 public:
    Splitter(CutMesh& mesh, std::span<const CutPoint> path, std::span<const CutEdge> joined) : mesh_(mesh), path_(path), joined_(joined) {}
    void split(uint32_t t) {
        const Triangle corner = mesh_.triangle[t];
        std::array<uint32_t, 3> middle{kNone, kNone, kNone};
        std::array<double, 3> along{};
        int count = 0, first = 0;
        for (int k = 0; k < 3; ++k) {
            const CutEdge e = cut_edge(corner[k], corner[(k + 1) % 3]);
            const CutPoint* p = point_on(path_, e);
            if (!p || p->vertex == e[0] || p->vertex == e[1]) continue;
            middle[k] = p->vertex, along[k] = corner[k] == e[0] ? p->along : 1 - p->along, ++count;
        }
        if (count == 0) return;
        // turned so that with one split edge it is the first, with two the first and the second
        while (count < 3 && (middle[first] == kNone || (count == 2 && middle[(first + 1) % 3] == kNone))) ++first;
        const auto at = [&](int k) { return corner[(first + k) % 3]; };
        const auto mid = [&](int k) { return middle[(first + k) % 3]; };
        from_ = t, taken_ = false;
        for (int k = 0; k < 3; ++k)
            corner_[k] = at(k), middle_[k] = mid(k), along_[k] = along[(first + k) % 3], uv_[k] = mesh_.uv[t][(first + k) % 3];
        if (count == 1) {
            add({at(0), mid(0), at(2)}), add({mid(0), at(1), at(2)});
        } else if (count == 2) {
            add({mid(0), at(1), mid(1)});
            // the diagonal that the path needs, else the shorter one
            const bool needed = is_joined(mid(0), at(2)), other = is_joined(at(0), mid(1));
            const double a = (mesh_.rest[mid(0)] - mesh_.rest[at(2)]).norm(), b = (mesh_.rest[at(0)] - mesh_.rest[mid(1)]).norm();
            if (needed || (!other && a <= b))
                add({at(0), mid(0), at(2)}), add({mid(0), mid(1), at(2)});
            else
                add({at(0), mid(0), mid(1)}), add({at(0), mid(1), at(2)});
        } else {
            add({at(0), mid(0), mid(2)}), add({mid(0), at(1), mid(1)}), add({mid(2), mid(1), at(2)}), add({mid(0), mid(1), mid(2)});
        }
    }

 private:
    bool is_joined(uint32_t a, uint32_t b) const { return std::binary_search(joined_.begin(), joined_.end(), cut_edge(a, b)); }
    Vec2 uv_of(uint32_t v) const {
        for (int k = 0; k < 3; ++k)
            if (corner_[k] == v) return uv_[k];
        for (int k = 0; k < 3; ++k)
            if (middle_[k] == v) {
                const Vec2 &from = uv_[k], &to = uv_[(k + 1) % 3];
                const float along = static_cast<float>(along_[k]);
                return {from.u + along * (to.u - from.u), from.v + along * (to.v - from.v)};
            }
        return uv_[0];
    }
    void add(const Triangle& part) {
        const uint32_t to = taken_ ? mesh_.triangles++ : from_;
        taken_ = true;
        mesh_.triangle[to] = part;
        mesh_.uv[to] = {uv_of(part[0]), uv_of(part[1]), uv_of(part[2])};
        mesh_.material[to] = mesh_.material[from_];
    }

    CutMesh& mesh_;
    std::span<const CutPoint> path_;
    std::span<const CutEdge> joined_;
    uint32_t from_ = 0;
    bool taken_ = false;
    std::array<uint32_t, 3> corner_{}, middle_{};
    std::array<double, 3> along_{};
    std::array<Vec2, 3> uv_{};
};

// Triangles around some vertices.
struct Around {
    std::vector<uint32_t> vertex;                 // ascending
    std::vector<std::vector<uint32_t>> triangle;  // per element of vertex, ascending
    const std::vector<uint32_t>& of(uint32_t v) const {
        return triangle[static_cast<size_t>(std::lower_bound(vertex.begin(), vertex.end(), v) - vertex.begin())];
    }
};

Around around(const CutMesh& mesh, std::vector<uint32_t> vertex) {
    std::sort(vertex.begin(), vertex.end());
    vertex.erase(std::unique(vertex.begin(), vertex.end()), vertex.end());
    Around a{std::move(vertex), {}};
    a.triangle.resize(a.vertex.size());
    for (uint32_t t = 0; t < mesh.triangles; ++t) {
        for (const uint32_t v : mesh.triangle[t]) {
            const auto found = std::lower_bound(a.vertex.begin(), a.vertex.end(), v);
            if (found != a.vertex.end() && *found == v) a.triangle[static_cast<size_t>(found - a.vertex.begin())].push_back(t);
        }
    }
    return a;
}

bool has_corner(const Triangle& t, uint32_t v) { return t[0] == v || t[1] == v || t[2] == v; }

// Number of the triangles around one end of an edge that have its other end too.
size_t count_sides(const CutMesh& mesh, const std::vector<uint32_t>& around_one, uint32_t other) {
    return static_cast<size_t>(
        std::count_if(around_one.begin(), around_one.end(), [&](uint32_t t) { return has_corner(mesh.triangle[t], other); }));
}

// Fans of triangles around a vertex that hang together across edges that are no slits: number of each triangle's fan.
uint32_t find_fans(const CutMesh& mesh, uint32_t vertex, const std::vector<uint32_t>& triangles, std::vector<uint32_t>& fan) {
    fan.assign(triangles.size(), kNone);
    uint32_t fans = 0;
    std::vector<size_t> open;
    for (size_t start = 0; start < triangles.size(); ++start) {
        if (fan[start] != kNone) continue;
        fan[start] = fans;
        open.assign(1, start);
        while (!open.empty()) {
            const Triangle& t = mesh.triangle[triangles[open.back()]];
            open.pop_back();
            for (const uint32_t far : t) {
                if (far == vertex || std::binary_search(mesh.slit.begin(), mesh.slit.end(), cut_edge(vertex, far))) continue;
                for (size_t next = 0; next < triangles.size(); ++next) {
                    if (fan[next] != kNone || !has_corner(mesh.triangle[triangles[next]], far)) continue;
                    fan[next] = fans;
                    open.push_back(next);
                }
            }
        }
        ++fans;
    }
    return fans;
}

// Duplicates the vertices at ends of slits around which the surface no longer hangs together.
void open_slits(CutMesh& mesh, std::vector<CutVertex>& made) {
    std::vector<uint32_t> ends;
    for (const CutEdge& e : mesh.slit) ends.insert(ends.end(), e.begin(), e.end());
    const Around at = around(mesh, std::move(ends));
    std::vector<uint32_t> fan;
    for (size_t i = 0; i < at.vertex.size(); ++i) {
        const uint32_t v = at.vertex[i], fans = find_fans(mesh, v, at.triangle[i], fan);
        for (uint32_t other = 1; other < fans; ++other) {
            const uint32_t copy = mesh.vertices++;
            mesh.rest[copy] = mesh.rest[v], mesh.place[copy] = mesh.place[v];
            if (!mesh.before.empty()) mesh.before[copy] = mesh.before[v];
            made.push_back({v, v, 0});
            for (size_t k = 0; k < at.triangle[i].size(); ++k) {
                if (fan[k] != other) continue;
                for (uint32_t& corner : mesh.triangle[at.triangle[i][k]])
                    if (corner == v) corner = copy;
            }
        }
    }
}

// Keeps the slits that are still closed: edges of two triangles. The others have opened.
void drop_open_slits(CutMesh& mesh, std::vector<CutEdge>& opened) {
    std::vector<uint32_t> ends;
    for (const CutEdge& e : mesh.slit) ends.push_back(e[0]);
    const Around at = around(mesh, std::move(ends));
    std::erase_if(mesh.slit, [&](const CutEdge& e) {
        const bool open = count_sides(mesh, at.of(e[0]), e[1]) != 2;
        if (open) opened.push_back(e);
        return open;
    });
}

// Adds the edges of the path that separate two triangles to the slits.
double add_slits(CutMesh& mesh, std::span<const CutEdge> joined) {
    std::vector<uint32_t> ends;
    for (const CutEdge& e : joined) ends.push_back(e[0]);
    const Around at = around(mesh, std::move(ends));
    double length = 0;
    for (const CutEdge& e : joined) {
        if (count_sides(mesh, at.of(e[0]), e[1]) != 2 || std::binary_search(mesh.slit.begin(), mesh.slit.end(), e)) continue;
        mesh.slit.insert(std::lower_bound(mesh.slit.begin(), mesh.slit.end(), e), e);
        length += (mesh.rest[e[1]] - mesh.rest[e[0]]).norm();
    }
    return length;
}

// The vertices at which the cut may go on: the last of every connected part of the path, and older ones of which a
// triangle still holds the edge at the end of the sweep.
void move_front(const EdgeSweep& s, std::span<const CutPoint> path, std::span<const CutEdge> joined, CutMesh& mesh) {
    std::vector<std::pair<uint32_t, double>> latest;  // vertex, time; ascending
    for (const CutPoint& p : path) latest.push_back({p.vertex, p.time});
    std::sort(latest.begin(), latest.end());
    std::vector<uint32_t> front;
    // a point is a tip if none that it is joined to is later
    for (size_t i = 0; i < latest.size(); ++i) {
        if (i + 1 < latest.size() && latest[i + 1].first == latest[i].first) continue;
        const auto time_at = [&](uint32_t v) {
            double time = -1;
            for (const auto& [w, t] : latest)
                if (w == v) time = std::max(time, t);
            return time;
        };
        bool last = true;
        for (const CutEdge& e : joined)
            if (e[0] == latest[i].first || e[1] == latest[i].first)
                last = last && time_at(e[0] == latest[i].first ? e[1] : e[0]) <= latest[i].second;
        if (last) front.push_back(latest[i].first);
    }
    std::vector<uint32_t> old;
    for (const uint32_t v : mesh.front)
        if (std::none_of(joined.begin(), joined.end(), [&](const CutEdge& e) { return e[0] == v || e[1] == v; })) old.push_back(v);
    const Around at = around(mesh, old);
    for (const uint32_t v : at.vertex) {
        for (const uint32_t t : at.of(v)) {
            const Triangle& c = mesh.triangle[t];
            if (std::isnan(crossing_along(s.a1, s.b1, mesh.place[c[0]], mesh.place[c[1]], mesh.place[c[2]]))) continue;
            front.push_back(v);
            break;
        }
    }
    std::sort(front.begin(), front.end());
    front.erase(std::unique(front.begin(), front.end()), front.end());
    mesh.front = std::move(front);
}

}  // namespace

double crossing_of(const EdgeSweep& s, const Vec3d& p, const Vec3d& q) {
    const double along = crossing_along(p, q, s.a0, s.b0, s.b1);
    return std::isnan(along) ? crossing_along(p, q, s.a0, s.b1, s.a1) : along;
}

CutResult cut_surface(const EdgeSweep& sweep, CutMesh& mesh, std::vector<CutVertex>& made) {
    made.clear();
    CutResult result;
    const std::vector<uint32_t> near = near_triangles(sweep, mesh);
    std::vector<CutPoint> path = find_path(sweep, mesh, near);
    if (path.empty()) {
        move_front(sweep, path, {}, mesh);
        return result;
    }
    uint32_t split = 0;
    for (const CutPoint& p : path) split += p.vertex == kNone;
    // a vertex of the path may be duplicated once for each of the slits at it, two of which are new
    const size_t ends = 2 * (path.size() + mesh.front.size() + mesh.slit.size());
    if (mesh.vertices + split + ends > mesh.rest.size() || mesh.triangles + 2 * size_t{split} > mesh.triangle.size()) {
        result.refused = true;
        return result;
    }
    for (CutPoint& p : path) {
        if (p.vertex != kNone) continue;
        p.vertex = mesh.vertices++;
        const auto between = [&](std::span<Vec3d> of) { of[p.vertex] = of[p.edge[0]] + p.along * (of[p.edge[1]] - of[p.edge[0]]); };
        between(mesh.rest), between(mesh.place);
        if (!mesh.before.empty()) between(mesh.before);
        made.push_back({p.edge[0], p.edge[1], p.along});
    }
    std::vector<CutEdge> joined;
    for (const uint32_t t : near) connect_path(mesh.triangle[t], path, mesh.front, joined);
    std::sort(joined.begin(), joined.end());
    joined.erase(std::unique(joined.begin(), joined.end()), joined.end());
    // a slit whose edge is split is a slit in both parts
    for (const CutPoint& p : path) {
        const auto whole = std::lower_bound(mesh.slit.begin(), mesh.slit.end(), p.edge);
        if (p.vertex == p.edge[0] || p.vertex == p.edge[1] || whole == mesh.slit.end() || *whole != p.edge) continue;
        mesh.slit.erase(whole);
        for (const uint32_t end : p.edge)
            mesh.slit.insert(std::lower_bound(mesh.slit.begin(), mesh.slit.end(), cut_edge(end, p.vertex)), cut_edge(end, p.vertex));
    }
    Splitter splitter(mesh, path, joined);
    for (const uint32_t t : near) splitter.split(t);
    result.length = add_slits(mesh, joined);
    move_front(sweep, path, joined, mesh);
    open_slits(mesh, made);
    drop_open_slits(mesh, result.opened);
    return result;
}

}  // namespace trocar
