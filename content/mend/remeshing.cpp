#include "content/mend/remeshing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <queue>
#include <utility>

#include "engine/base/check.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

// Half-edge 3 * t + k runs from corner k to corner k + 1 of triangle t. A removed triangle has from = kNone.
struct HalfEdges {
    std::vector<uint32_t> from;
    std::vector<uint32_t> twin;
    std::vector<uint32_t> outgoing;  // one half-edge per vertex; kNone for removed vertices
};

uint32_t next_in(uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
uint32_t previous_in(uint32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }

// Calls visit(h) for every half-edge that leaves a vertex, starting at outgoing[vertex].
template <typename Visit>
void for_each_outgoing(const HalfEdges& edges, uint32_t vertex, const Visit& visit) {
    const uint32_t first = edges.outgoing[vertex];
    uint32_t h = first;
    do {
        visit(h);
        h = edges.twin[previous_in(h)];
    } while (h != first);
}

uint32_t count_neighbours(const HalfEdges& edges, uint32_t vertex) {
    uint32_t count = 0;
    for_each_outgoing(edges, vertex, [&](uint32_t) { ++count; });
    return count;
}

bool are_joined(const HalfEdges& edges, uint32_t a, uint32_t b) {
    bool joined = false;
    for_each_outgoing(edges, a, [&](uint32_t h) { joined |= edges.from[next_in(h)] == b; });
    return joined;
}

HalfEdges link_half_edges(const std::vector<Triangle>& triangle, uint32_t vertices) {
    HalfEdges edges;
    const uint32_t count = static_cast<uint32_t>(3 * triangle.size());
    edges.from.resize(count);
    edges.twin.assign(count, kNone);
    edges.outgoing.assign(vertices, kNone);
    std::vector<uint32_t> first(vertices + 1, 0);
    for (uint32_t h = 0; h < count; ++h) {
        edges.from[h] = triangle[h / 3][h % 3];
        edges.outgoing[edges.from[h]] = h;
        ++first[edges.from[h] + 1];
    }
    for (uint32_t v = 0; v < vertices; ++v) first[v + 1] += first[v];
    std::vector<uint32_t> leaving(count);
    std::vector<uint32_t> at(first.begin(), first.end() - 1);
    for (uint32_t h = 0; h < count; ++h) leaving[at[edges.from[h]]++] = h;
    for (uint32_t h = 0; h < count; ++h) {
        const uint32_t to = edges.from[next_in(h)];
        for (uint32_t i = first[to]; i < first[to + 1]; ++i) {
            if (edges.from[next_in(leaving[i])] == edges.from[h]) edges.twin[h] = leaving[i];
        }
        TROCAR_ASSERT(edges.twin[h] != kNone);
    }
    return edges;
}

Vec3d twice_area(const Vec3d& a, const Vec3d& b, const Vec3d& c) { return (b - a).cross(c - a); }

// Twice the area over the square of the longest edge: 0.87 for an equilateral triangle, 0 for a sliver.
double evenness(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    return twice_area(a, b, c).norm() / std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
}

// Whether the normal turns by less than 60 degrees, and the triangle is no sliver or at least no worse.
bool keeps_shape(const Vec3d& normal_before, double evenness_before, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d normal = twice_area(a, b, c);
    return normal.dot(normal_before) > 0.5 * normal.norm() * normal_before.norm() && evenness(a, b, c) > std::min(0.1, evenness_before);
}

struct Remesher {
    const SurfaceProjection& project;
    std::vector<Vec3d>& position;
    HalfEdges edges;

    const Vec3d& start(uint32_t h) const { return position[edges.from[h]]; }

    Vec3d normal_of(uint32_t h) const { return twice_area(start(h), start(next_in(h)), start(previous_in(h))); }

    double squared_length(uint32_t h) const { return (start(next_in(h)) - start(h)).squaredNorm(); }

    // Exactly two common neighbours (keeps the surface a manifold of its genus), and no vertex left with two
    // faces.
    bool may_collapse(uint32_t h) const {
        const uint32_t a = edges.from[h];
        const uint32_t b = edges.from[next_in(h)];
        uint32_t common = 0;
        for_each_outgoing(edges, a, [&](uint32_t g) { common += are_joined(edges, b, edges.from[next_in(g)]); });
        const uint32_t c = edges.from[previous_in(h)];
        const uint32_t d = edges.from[previous_in(edges.twin[h])];
        return common == 2 && count_neighbours(edges, c) > 3 && count_neighbours(edges, d) > 3;
    }

    // Whether the triangles around vertex `moved`, except those on both sides of the edge to `other`, keep
    // their shape when it moves to `new_position`.
    bool stays_sound(uint32_t moved, uint32_t other, const Vec3d& new_position) const {
        bool sound = true;
        for_each_outgoing(edges, moved, [&](uint32_t g) {
            const uint32_t p = edges.from[next_in(g)];
            const uint32_t q = edges.from[previous_in(g)];
            if (p == other || q == other) return;
            sound = sound &&
                    keeps_shape(normal_of(g), evenness(position[moved], position[p], position[q]), new_position, position[p], position[q]);
        });
        return sound;
    }

    // Merges the end of h into its start; removes two triangles.
    void collapse(uint32_t h, const Vec3d& new_position) {
        const uint32_t g = edges.twin[h];
        const uint32_t a = edges.from[h];
        const uint32_t b = edges.from[g];
        const uint32_t c = edges.from[previous_in(h)];
        const uint32_t d = edges.from[previous_in(g)];
        std::vector<uint32_t>& leaving = scratch;
        leaving.clear();
        for_each_outgoing(edges, b, [&](uint32_t e) { leaving.push_back(e); });
        for (const uint32_t e : leaving) edges.from[e] = a;
        const uint32_t c_to_a = edges.twin[next_in(h)];
        const uint32_t a_to_c = edges.twin[previous_in(h)];
        const uint32_t d_to_a = edges.twin[next_in(g)];
        const uint32_t a_to_d = edges.twin[previous_in(g)];
        edges.twin[c_to_a] = a_to_c;
        edges.twin[a_to_c] = c_to_a;
        edges.twin[d_to_a] = a_to_d;
        edges.twin[a_to_d] = d_to_a;
        edges.outgoing[a] = a_to_c;
        edges.outgoing[b] = kNone;
        edges.outgoing[c] = c_to_a;
        edges.outgoing[d] = d_to_a;
        for (const uint32_t side : {h, g}) {
            for (uint32_t k = 0; k < 3; ++k) edges.from[side / 3 * 3 + k] = kNone;
        }
        position[a] = new_position;
    }

    // Collapses edges, shortest first, until `wanted` triangles are left or no edge can be collapsed.
    void collapse_shortest(uint32_t wanted) {
        uint32_t count = static_cast<uint32_t>(edges.from.size() / 3);
        // an edge rejected once may become collapsible after other collapses
        for (uint32_t before = count + 1; count > wanted && count < before;) {
            before = count;
            count = collapse_pass(count, wanted);
        }
    }

    uint32_t collapse_pass(uint32_t count, uint32_t wanted) {
        struct Entry {
            double length;
            uint32_t edge;
            uint32_t stamp;
            bool operator<(const Entry& o) const {
                return length != o.length ? length > o.length : edge != o.edge ? edge > o.edge : stamp > o.stamp;
            }
        };
        // a vertex's stamp counts its moves: a queue entry older than the last move of an end is stale
        std::vector<uint32_t> stamp(position.size(), 0);
        const auto stamp_of = [&](uint32_t h) { return stamp[edges.from[h]] + stamp[edges.from[next_in(h)]]; };
        std::vector<Entry> heap;
        for (uint32_t h = 0; h < edges.from.size(); ++h) {
            if (edges.from[h] != kNone && h < edges.twin[h]) heap.push_back({squared_length(h), h, 0});
        }
        std::make_heap(heap.begin(), heap.end());
        while (count > wanted && !heap.empty()) {
            std::pop_heap(heap.begin(), heap.end());
            const Entry entry = heap.back();
            heap.pop_back();
            const uint32_t h = entry.edge;
            if (edges.from[h] == kNone || stamp_of(h) != entry.stamp) continue;
            const uint32_t a = edges.from[h];
            const uint32_t b = edges.from[next_in(h)];
            if (!may_collapse(h)) continue;
            const Vec3d new_position = project((position[a] + position[b]) / 2);
            if (!stays_sound(a, b, new_position) || !stays_sound(b, a, new_position)) continue;
            const uint32_t later = std::max(stamp[a], stamp[b]) + 1;
            collapse(h, new_position);
            count -= 2;
            stamp[a] = later;
            for_each_outgoing(edges, a, [&](uint32_t e) {
                const uint32_t one = std::min(e, edges.twin[e]);
                heap.push_back({squared_length(one), one, stamp_of(one)});
                std::push_heap(heap.begin(), heap.end());
            });
        }
        return count;
    }

    // Whether diagonal c d can replace a b: two well-shaped triangles and no duplicate edge.
    bool may_flip(uint32_t h) const {
        const uint32_t g = edges.twin[h];
        const Vec3d &a = start(h), &b = start(g), &c = start(previous_in(h)), &d = start(previous_in(g));
        const Vec3d before = normal_of(h) + normal_of(g);
        const double even = std::min(evenness(a, b, c), evenness(b, a, d));
        if (!keeps_shape(before, even, a, d, c) || !keeps_shape(before, even, d, b, c)) return false;
        if (twice_area(a, d, c).dot(twice_area(d, b, c)) <= 0) return false;
        return !are_joined(edges, edges.from[previous_in(h)], edges.from[previous_in(g)]);
    }

    void flip(uint32_t h) {
        const uint32_t g = edges.twin[h];
        const uint32_t hn = next_in(h), hp = previous_in(h), gn = next_in(g), gp = previous_in(g);
        const uint32_t a = edges.from[h], b = edges.from[g], c = edges.from[hp], d = edges.from[gp];
        const uint32_t b_to_d = edges.twin[gp];
        const uint32_t a_to_c = edges.twin[hp];
        // triangles become (d, b, c) and (c, a, d)
        edges.from[h] = d;
        edges.from[g] = c;
        edges.twin[h] = b_to_d;
        edges.twin[b_to_d] = h;
        edges.twin[g] = a_to_c;
        edges.twin[a_to_c] = g;
        edges.twin[hp] = gp;
        edges.twin[gp] = hp;
        edges.outgoing[a] = gn;
        edges.outgoing[b] = hn;
        edges.outgoing[c] = hp;
        edges.outgoing[d] = gp;
    }

    void flip_towards_six() {
        std::vector<int> excess(position.size(), -6);
        for (const uint32_t v : edges.from) {
            if (v != kNone) ++excess[v];
        }
        for (uint32_t h = 0; h < edges.from.size(); ++h) {
            if (edges.from[h] == kNone || h > edges.twin[h]) continue;
            const uint32_t g = edges.twin[h];
            int& a = excess[edges.from[h]];
            int& b = excess[edges.from[g]];
            int& c = excess[edges.from[previous_in(h)]];
            int& d = excess[edges.from[previous_in(g)]];
            // change in the sum of squares of the four valence excesses
            if (a + b - c - d <= 2 || a <= -3 || b <= -3 || !may_flip(h)) continue;
            --a, --b, ++c, ++d;
            flip(h);
        }
    }

    // Flips every edge whose opposite angles sum to more than 180 degrees; returns the number of flips.
    uint32_t flip_towards_delaunay() {
        uint32_t flips = 0;
        for (uint32_t h = 0; h < edges.from.size(); ++h) {
            if (edges.from[h] == kNone || h > edges.twin[h]) continue;
            double cotangents = 0;
            for (const uint32_t side : {h, edges.twin[h]}) {
                const Vec3d& apex = start(previous_in(side));
                cotangents += (start(side) - apex).dot(start(next_in(side)) - apex) / normal_of(side).norm();
            }
            if (!(cotangents < -1e-9) || count_neighbours(edges, edges.from[h]) <= 4 ||
                count_neighbours(edges, edges.from[edges.twin[h]]) <= 4 || !may_flip(h)) {
                continue;
            }
            flip(h);
            ++flips;
        }
        return flips;
    }

    // Moves all vertices simultaneously along the surface to the area-weighted centroid of their triangles.
    void relax(double weight) {
        moved.assign(position.begin(), position.end());
        parallel_for(static_cast<uint32_t>(position.size()), 256, [&](uint32_t begin, uint32_t end) {
            for (uint32_t v = begin; v < end; ++v)
                if (edges.outgoing[v] != kNone) moved[v] = relaxed(v, weight);
        });
        position.swap(moved);
    }
    Vec3d relaxed(uint32_t v, double weight) const {
        Vec3d sum = Vec3d::Zero();
        Vec3d normal = Vec3d::Zero();
        double area = 0;
        for_each_outgoing(edges, v, [&](uint32_t h) {
            const Vec3d n = normal_of(h);
            const double size = n.norm();
            sum += size / 3 * (position[v] + start(next_in(h)) + start(previous_in(h)));
            normal += n;
            area += size;
        });
        const Vec3d step = sum / area - position[v];
        return project(position[v] + weight * (step - normal * (step.dot(normal) / normal.squaredNorm())));
    }

    std::vector<uint32_t> scratch{};
    std::vector<Vec3d> moved{};
};

// Drops removed triangles and unused vertices; keeps the order of the others.
void compact(const HalfEdges& edges, std::vector<Vec3d>& position, std::vector<Triangle>& triangle) {
    std::vector<uint32_t> row(position.size(), kNone);
    uint32_t kept = 0;
    for (uint32_t v = 0; v < position.size(); ++v) {
        if (edges.outgoing[v] == kNone) continue;
        row[v] = kept;
        position[kept++] = position[v];
    }
    position.resize(kept);
    triangle.clear();
    for (uint32_t h = 0; h < edges.from.size(); h += 3) {
        if (edges.from[h] == kNone) continue;
        triangle.push_back({row[edges.from[h]], row[edges.from[h + 1]], row[edges.from[h + 2]]});
    }
}

}  // namespace

void remesh_evenly(const RemeshParams& params, const SurfaceProjection& project, std::vector<Vec3d>& position,
                   std::vector<Triangle>& triangle) {
    Remesher work{project, position, link_half_edges(triangle, static_cast<uint32_t>(position.size()))};
    // contours contain slivers; after slight smoothing they collapse without rejections
    if (params.rounds > 0) work.relax(0.9), work.relax(0.9);
    work.collapse_shortest(params.triangles);
    compact(work.edges, position, triangle);
    work.edges = link_half_edges(triangle, static_cast<uint32_t>(position.size()));
    for (uint32_t i = 0; i < params.rounds; ++i) {
        work.flip_towards_six();
        work.relax(0.9);
    }
    for (uint32_t i = 0; i < 8 && work.flip_towards_delaunay() > 0; ++i) {
    }
    compact(work.edges, position, triangle);
}

}  // namespace trocar
