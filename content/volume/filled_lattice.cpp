#include "content/volume/filled_lattice.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

using TetCorners = std::array<Vec3d, 4>;
using Tetrahedron = std::array<uint32_t, 4>;

double volume_of(const TetCorners& c) { return (c[1] - c[0]).dot((c[2] - c[0]).cross(c[3] - c[0])) / 6; }

struct Moments {
    double volume = 0;            // m^3
    Vec3d first = Vec3d::Zero();  // m^4, volume times centroid
    void add(const TetCorners& c, double sign) {
        const double v = sign * std::abs(volume_of(c));
        volume += v, first += v / 4 * (c[0] + c[1] + c[2] + c[3]);
    }
};

// The three tetrahedra of a wedge between two triangles.
void add_wedge(const std::array<Vec3d, 3>& a, const std::array<Vec3d, 3>& b, std::vector<TetCorners>& out) {
    out.push_back({a[0], a[1], a[2], b[2]});
    out.push_back({a[0], a[1], b[1], b[2]});
    out.push_back({a[0], b[0], b[1], b[2]});
}

// Adds to `out` the part of a tetrahedron where normal . x <= offset, as tetrahedra of either orientation.
void keep_below(const TetCorners& c, const Vec3d& normal, double offset, std::vector<TetCorners>& out) {
    std::array<double, 4> d;
    std::array<int, 4> order;
    int in = 0, out_count = 0;
    for (int k = 0; k < 4; ++k) {
        d[k] = normal.dot(c[k]) - offset;
        if (d[k] <= 0)
            order[in++] = k;
        else
            order[3 - out_count++] = k;
    }
    const auto cut = [&](int i, int j) -> Vec3d { return c[i] + d[i] / (d[i] - d[j]) * (c[j] - c[i]); };
    const auto [p, q, r, s] = order;
    if (in == 4) out.push_back(c);
    if (in == 1) out.push_back({c[p], cut(p, q), cut(p, r), cut(p, s)});
    if (in == 2) add_wedge({c[p], cut(p, r), cut(p, s)}, {c[q], cut(q, r), cut(q, s)}, out);
    if (in == 3) add_wedge({c[p], c[q], c[r]}, {cut(p, s), cut(q, s), cut(r, s)}, out);
}

// Intersections of tetrahedra with the prisms below the triangles of a surface.
struct PrismClipper {
    std::span<const Vec3d> position;
    std::span<const Triangle> triangle;
    std::vector<TetCorners> part{}, next{};

    void clip(const Vec3d& normal, double offset) {
        next.clear();
        for (const TetCorners& c : part) keep_below(c, normal, offset, next);
        part.swap(next);
    }
    // Adds what lies below triangle t (towards -z), negative if the triangle faces down.
    void add_below(uint32_t t, const TetCorners& c, Moments& sum) {
        const Vec3d p[3] = {position[triangle[t][0]], position[triangle[t][1]], position[triangle[t][2]]};
        const Vec3d normal = (p[1] - p[0]).cross(p[2] - p[0]);
        if (normal.z() == 0) return;
        const double sign = normal.z() > 0 ? 1 : -1;
        part.assign(1, c);
        for (int k = 0; k < 3 && !part.empty(); ++k) {
            const Vec3d edge = p[(k + 1) % 3] - p[k], outward(sign * edge.y(), -sign * edge.x(), 0);
            clip(outward, outward.dot(p[k]));
        }
        if (!part.empty()) clip(sign * normal, sign * normal.dot(p[0]));
        for (const TetCorners& piece : part) sum.add(piece, sign);
    }
};

struct CubicLattice {
    Vec3d origin;
    double spacing;
    std::array<uint32_t, 3> cells;  // of corners; as many centres

    uint32_t site(const std::array<int, 3>& half) const {
        const uint32_t cell = (static_cast<uint32_t>(half[2] / 2) * cells[1] + static_cast<uint32_t>(half[1] / 2)) * cells[0] +
                              static_cast<uint32_t>(half[0] / 2);
        return 2 * cell + static_cast<uint32_t>(half[0] & 1);
    }
    size_t sites() const { return size_t{2} * cells[0] * cells[1] * cells[2]; }
    Vec3d place(uint32_t site) const {
        const uint32_t cell = site / 2;
        const Vec3d half(2 * (cell % cells[0]) + (site & 1), 2 * (cell / cells[0] % cells[1]) + (site & 1),
                         2 * (cell / cells[0] / cells[1]) + (site & 1));
        return origin + spacing / 2 * half;
    }
};

CubicLattice lattice_over(const Box& box, double spacing) {
    CubicLattice lattice{{}, spacing, {}};
    double cells = 1;
    for (int k = 0; k < 3; ++k) {
        const double extent = box.max[k] - box.min[k], count = extent / spacing;
        if (!(count >= 0 && count < 1e6)) throw InputError("tetrahedra: the box of the solid is not finite or the spacing too small");
        const double whole = std::abs(count - std::round(count)) < 1e-6 ? std::round(count) : std::ceil(count);
        // two layers of room on either side: tetrahedra reach half a cell beyond
        lattice.cells[k] = static_cast<uint32_t>(whole) + 5;
        const double low = k == 2 ? box.min[k] : 0.5 * (box.min[k] + box.max[k]) - 0.5 * whole * spacing;
        lattice.origin[k] = low - 2 * spacing;
        cells *= lattice.cells[k];
    }
    if (cells > static_cast<double>(kMostCells))
        throw InputError("tetrahedra: a spacing of " + std::to_string(spacing) + " m needs a lattice of " +
                         std::to_string(static_cast<uint64_t>(cells)) + " cells; " + std::to_string(kMostCells) + " are the most");
    return lattice;
}

// All tetrahedra of a lattice: two neighbouring centres and an edge of the face between their cells.
std::vector<Tetrahedron> all_tetrahedra(const CubicLattice& lattice) {
    std::vector<Tetrahedron> all;
    const auto end = [&](int k) { return 2 * static_cast<int>(lattice.cells[k]) - 3; };
    for (int z = 1; z < end(2); z += 2)
        for (int y = 1; y < end(1); y += 2)
            for (int x = 1; x < end(0); x += 2)
                for (int axis = 0; axis < 3; ++axis) {
                    const std::array<int, 3> centre{x, y, z};
                    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
                    std::array<int, 3> far = centre, ring[4] = {centre, centre, centre, centre};
                    far[axis] += 2;
                    for (int k = 0; k < 4; ++k) {
                        ring[k][axis] += 1;
                        ring[k][u] += k == 0 || k == 3 ? 1 : -1;
                        ring[k][v] += k < 2 ? 1 : -1;
                    }
                    for (int k = 0; k < 4; ++k)
                        all.push_back({lattice.site(centre), lattice.site(far), lattice.site(ring[k]), lattice.site(ring[(k + 1) % 4])});
                }
    return all;
}

struct TriangleColumns {
    const CubicLattice& lattice;
    std::vector<std::vector<uint32_t>> bin{};  // triangles over each cell of the xy plane

    template <typename Visit>
    void for_bins(const Vec3d& low, const Vec3d& high, const Visit& visit) const {
        const auto cell = [&](double at, int k) {
            return static_cast<uint32_t>(std::clamp((at - lattice.origin[k]) / lattice.spacing, 0.0, double(lattice.cells[k] - 1)));
        };
        for (uint32_t y = cell(low.y(), 1); y <= cell(high.y(), 1); ++y)
            for (uint32_t x = cell(low.x(), 0); x <= cell(high.x(), 0); ++x) visit(y * lattice.cells[0] + x);
    }
};

struct Reach {
    Vec3d low, high;
};
template <typename Points>
Reach reach_of(const Points& points) {
    Reach r{points[0], points[0]};
    for (const Vec3d& p : points) r.low = r.low.cwiseMin(p), r.high = r.high.cwiseMax(p);
    return r;
}

uint32_t root_of(std::vector<uint32_t>& parent, uint32_t a) {
    while (parent[a] != a) a = parent[a] = parent[parent[a]];
    return a;
}

// Volume and first moment inside the surface, of every tetrahedron of the lattice.
struct LatticeFilling {
    const CubicLattice& lattice;
    std::span<const Vec3d> position;
    std::span<const Triangle> triangle;
    std::vector<Tetrahedron> tetrahedra{};
    std::vector<Moments> inside{};

    TetCorners corners(const Tetrahedron& t) const {
        return {lattice.place(t[0]), lattice.place(t[1]), lattice.place(t[2]), lattice.place(t[3])};
    }
    void run() {
        tetrahedra = all_tetrahedra(lattice);
        for (Tetrahedron& t : tetrahedra)
            if (volume_of(corners(t)) < 0) std::swap(t[2], t[3]);
        inside.resize(tetrahedra.size());
        TriangleColumns columns{lattice, std::vector<std::vector<uint32_t>>(size_t{lattice.cells[0]} * lattice.cells[1])};
        std::vector<Reach> reach;
        for (uint32_t i = 0; i < triangle.size(); ++i) {
            const Triangle& t = triangle[i];
            reach.push_back(reach_of(std::array<Vec3d, 3>{position[t[0]], position[t[1]], position[t[2]]}));
            columns.for_bins(reach[i].low, reach[i].high, [&](uint32_t bin) { columns.bin[bin].push_back(i); });
        }
        PrismClipper clipper{position, triangle};
        std::vector<uint32_t> seen(triangle.size(), kNone);
        const auto clip = [&](uint32_t i) {
            const TetCorners c = corners(tetrahedra[i]);
            const Reach own = reach_of(c);
            columns.for_bins(own.low, own.high, [&](uint32_t bin) {
                for (const uint32_t t : columns.bin[bin]) {
                    if (seen[t] == i || reach[t].high.z() < own.low.z()) continue;
                    seen[t] = i;
                    clipper.add_below(t, c, inside[i]);
                }
            });
        };
        fill_by_parts(crossed(columns, reach), clip);
    }
    // Whether the box of a tetrahedron meets that of a triangle.
    std::vector<uint8_t> crossed(const TriangleColumns& columns, const std::vector<Reach>& reach) const {
        const double room = 1e-9 * lattice.spacing;
        std::vector<uint8_t> near(tetrahedra.size(), 0);
        for (uint32_t i = 0; i < tetrahedra.size(); ++i) {
            const Reach own = reach_of(corners(tetrahedra[i]));
            columns.for_bins(own.low, own.high, [&](uint32_t bin) {
                for (const uint32_t t : columns.bin[bin]) {
                    if (near[i]) break;
                    near[i] =
                        (reach[t].low.array() <= own.high.array() + room).all() && (reach[t].high.array() >= own.low.array() - room).all();
                }
            });
        }
        return near;
    }
    // Tetrahedra that the surface does not cross and that hang together are all inside or all outside: one of them tells.
    template <typename Clip>
    void fill_by_parts(const std::vector<uint8_t>& near, const Clip& clip) {
        std::vector<uint32_t> parent(lattice.sites()), first(lattice.sites(), kNone);
        std::iota(parent.begin(), parent.end(), 0u);
        for (uint32_t i = 0; i < tetrahedra.size(); ++i) {
            if (near[i]) continue;
            for (int k = 1; k < 4; ++k) {
                const uint32_t a = root_of(parent, tetrahedra[i][0]), b = root_of(parent, tetrahedra[i][k]);
                parent[std::max(a, b)] = std::min(a, b);
            }
        }
        for (uint32_t i = 0; i < tetrahedra.size(); ++i) {
            if (near[i]) {
                clip(i);
                continue;
            }
            uint32_t& teller = first[root_of(parent, tetrahedra[i][0])];
            if (teller == kNone) teller = i, clip(i);
            const TetCorners c = corners(tetrahedra[i]);
            const bool full = inside[teller].volume > 0.5 * volume_of(c);
            inside[i] = {};
            if (full) inside[i].add(c, 1);
        }
    }
};

// Gives the parts of nearly empty tetrahedra to fuller neighbours.
struct Giver {
    const std::vector<Tetrahedron>& tetrahedra;
    std::vector<double> share;  // enclosed part of each
    double least;
    std::vector<std::vector<uint32_t>> around{};  // per site
    std::vector<uint8_t> kept{};

    static int common(const Tetrahedron& a, const Tetrahedron& b) {
        int same = 0;
        for (const uint32_t v : a) same += std::find(b.begin(), b.end(), v) != b.end();
        return same;
    }
    void find_kept(size_t sites) {
        around.resize(sites);
        kept.assign(tetrahedra.size(), 0);
        for (uint32_t t = 0; t < tetrahedra.size(); ++t) {
            for (const uint32_t v : tetrahedra[t]) around[v].push_back(t);
            kept[t] = share[t] >= least;
        }
        keep_bridges();
    }
    template <typename Visit>
    void for_face_neighbours(uint32_t t, const Visit& visit) const {
        for (int k = 0; k < 4; ++k) {
            for (const uint32_t other : around[tetrahedra[t][k]]) {
                if (other == t || common(tetrahedra[t], tetrahedra[other]) < 3) continue;
                // three corners are shared: count it once, at the first of them
                int first = 0;
                while (std::find(tetrahedra[other].begin(), tetrahedra[other].end(), tetrahedra[t][first]) == tetrahedra[other].end())
                    ++first;
                if (first == k) visit(other);
            }
        }
    }
    // Keeps what alone joins kept tetrahedra through faces, the fullest first.
    void keep_bridges() {
        std::vector<uint32_t> parent(tetrahedra.size()), thin;
        std::iota(parent.begin(), parent.end(), 0u);
        const auto join = [&](uint32_t t) {
            for_face_neighbours(t, [&](uint32_t other) {
                if (!kept[other]) return;
                const uint32_t a = root_of(parent, t), b = root_of(parent, other);
                parent[std::max(a, b)] = std::min(a, b);
            });
        };
        for (uint32_t t = 0; t < tetrahedra.size(); ++t) kept[t] ? join(t) : thin.push_back(t);
        std::stable_sort(thin.begin(), thin.end(), [&](uint32_t a, uint32_t b) { return share[a] > share[b]; });
        for (const uint32_t t : thin) {
            uint32_t one = kNone;
            bool joins = false;
            for_face_neighbours(t, [&](uint32_t other) {
                if (!kept[other]) return;
                const uint32_t root = root_of(parent, other);
                joins = joins || (one != kNone && one != root);
                one = root;
            });
            if (joins) kept[t] = 1, join(t);
        }
    }
    // The fullest kept tetrahedron that shares most corners; kNone where there is none.
    uint32_t taker(uint32_t t) const {
        uint32_t best = kNone;
        int most = 0;
        for (const uint32_t v : tetrahedra[t]) {
            for (const uint32_t other : around[v]) {
                if (other == t || !kept[other]) continue;
                const int same = common(tetrahedra[t], tetrahedra[other]);
                if (same > most || (same == most && (share[other] > share[best] || (share[other] == share[best] && other < best))))
                    best = other, most = same;
            }
        }
        return best;
    }
};

}  // namespace

FilledLattice fill_lattice(double spacing, std::span<const Vec3d> position, std::span<const Triangle> triangle, double least_fill) {
    TROCAR_ASSERT(spacing > 0 && !position.empty());
    const Reach reach = reach_of(position);
    const CubicLattice lattice = lattice_over({reach.low, reach.high}, spacing);
    LatticeFilling filling{lattice, position, triangle};
    filling.run();
    const double whole = spacing * spacing * spacing / 12;
    constexpr double kNothing = 1e-9;  // of a tetrahedron: rounding
    std::vector<Tetrahedron> used;
    std::vector<Moments> inside;
    std::vector<double> share;
    for (size_t t = 0; t < filling.tetrahedra.size(); ++t) {
        if (!(filling.inside[t].volume > kNothing * whole)) continue;
        used.push_back(filling.tetrahedra[t]), inside.push_back(filling.inside[t]);
        share.push_back(filling.inside[t].volume / whole);
    }
    Giver giver{used, share, least_fill};
    giver.find_kept(lattice.sites());
    FilledLattice made;
    for (uint32_t t = 0; t < used.size(); ++t) {
        if (giver.kept[t]) continue;
        const uint32_t taker = giver.taker(t);
        if (taker == kNone) {
            giver.kept[t] = 1;
            continue;
        }
        ++made.given_away, made.given_volume += inside[t].volume;
        inside[taker].volume += inside[t].volume, inside[taker].first += inside[t].first;
    }
    std::vector<uint32_t> row(lattice.sites(), kNone);
    for (uint32_t t = 0; t < used.size(); ++t) {
        if (!giver.kept[t]) continue;
        for (uint32_t& v : used[t]) {
            if (row[v] == kNone) row[v] = static_cast<uint32_t>(made.tets.position.size()), made.tets.position.push_back(lattice.place(v));
            v = row[v];
        }
        made.tets.tetrahedron.push_back(used[t]);
        made.fill.push_back(inside[t].volume / whole);
        made.centroid.push_back(inside[t].first / inside[t].volume);
    }
    return made;
}

std::vector<double> filled_node_volume(const FilledLattice& lattice) {
    std::vector<double> volume(lattice.tets.position.size(), 0.0);
    for (size_t t = 0; t < lattice.fill.size(); ++t) {
        const Tetrahedron& node = lattice.tets.tetrahedron[t];
        TetCorners c;
        for (int k = 0; k < 4; ++k) c[k] = lattice.tets.position[node[k]];
        const double whole = volume_of(c);
        std::array<double, 4> share;
        for (int k = 0; k < 4; ++k) {
            TetCorners with = c;
            with[k] = lattice.centroid[t];
            share[k] = volume_of(with) / whole;
        }
        // towards equal quarters until the least one is large enough
        const double least = *std::min_element(share.begin(), share.end());
        const double keep = least < kLeastShare ? (0.25 - kLeastShare) / (0.25 - least) : 1;
        for (int k = 0; k < 4; ++k) volume[node[k]] += lattice.fill[t] * whole * (0.25 + keep * (share[k] - 0.25));
    }
    return volume;
}

}  // namespace trocar
