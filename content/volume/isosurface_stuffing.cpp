#include "content/volume/isosurface_stuffing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <string>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

// Best worst-case angles in a sweep over all stencils, moves and cut points: 10.78 to 164.74 degrees.
constexpr double kAlphaLong = 0.2851, kAlphaShort = 0.3987;

// Site 2 * cell is the cell's lower corner, site 2 * cell + 1 its centre. Coordinates in half-cells: corners
// even, centres odd. A site owns its edges towards +x; of the long edges, those along the axes.
using Half = std::array<int, 3>;
constexpr std::array<Half, 7> kOwned{{{2, 0, 0}, {0, 2, 0}, {0, 0, 2}, {1, -1, -1}, {1, -1, 1}, {1, 1, -1}, {1, 1, 1}}};
constexpr int kLongEdges = 3;

struct BodyCentredLattice {
    std::array<uint32_t, 3> cells{};
    Vec3d origin = Vec3d::Zero();
    double spacing = 1;

    uint64_t cell_count() const { return uint64_t(cells[0]) * cells[1] * cells[2]; }
    uint32_t cell_at(uint32_t x, uint32_t y, uint32_t z) const { return (z * cells[1] + y) * cells[0] + x; }
    std::array<uint32_t, 3> cell_of(uint32_t site) const {
        const uint32_t cell = site / 2;
        return {cell % cells[0], cell / cells[0] % cells[1], cell / cells[0] / cells[1]};
    }
    Half half_of(uint32_t site) const {
        const auto c = cell_of(site);
        const int odd = static_cast<int>(site & 1);
        return {int(2 * c[0]) + odd, int(2 * c[1]) + odd, int(2 * c[2]) + odd};
    }
    uint32_t site_at(const Half& h) const {
        return 2 * cell_at(uint32_t(h[0]) / 2, uint32_t(h[1]) / 2, uint32_t(h[2]) / 2) + (uint32_t(h[0]) & 1);
    }
    Vec3d position(uint32_t site) const {
        const Half h = half_of(site);
        return origin + spacing / 2 * Vec3d(h[0], h[1], h[2]);
    }
    // Site at the far end of an edge from a site in direction +d or -d. Both must be inside the lattice.
    uint32_t across(uint32_t site, const Half& d, int sign) const {
        const Half h = half_of(site);
        return site_at({h[0] + sign * d[0], h[1] + sign * d[1], h[2] + sign * d[2]});
    }
    bool on_rim(uint32_t site) const {
        const auto c = cell_of(site);
        for (int k = 0; k < 3; ++k) {
            if (c[k] == 0 || c[k] + 1 >= cells[k]) return true;
        }
        return false;
    }
};

BodyCentredLattice make_lattice(const StuffingParams& params, const Box& box) {
    TROCAR_ASSERT(params.spacing > 0 && params.steepness > 0);
    BodyCentredLattice lattice;
    lattice.spacing = params.spacing;
    const Vec3d extent = box.max - box.min;
    double cells = 2;
    for (int k = 0; k < 3; ++k) {
        // two cells of margin on either side, so that the inside never reaches the boundary of the lattice
        const double count = std::ceil(extent[k] / params.spacing) + 5;
        if (!(count >= 5 && count < 1e6)) throw InputError("tetrahedra: the box of the solid is not finite or the spacing too small");
        lattice.cells[k] = static_cast<uint32_t>(count);
        lattice.origin[k] = (box.min[k] + box.max[k]) / 2 - (count - 0.5) / 2 * params.spacing;
        cells *= count;
    }
    if (cells > 0x1p27) {
        throw InputError("tetrahedra: a spacing of " + std::to_string(params.spacing) + " needs a lattice of " +
                         std::to_string(static_cast<uint64_t>(cells)) + " points; 134217728 are the most");
    }
    return lattice;
}

// Field value at every site. Blocks proven free of surface get an infinite value with the sign at their
// centre.
struct FieldSampler {
    const BodyCentredLattice& lattice;
    const DistanceField& distance;
    double steepness;
    std::vector<float> value{};

    struct Block {
        std::array<uint32_t, 3> first, end;
    };

    void fill(const Block& b, float v) {
        for (uint32_t z = b.first[2]; z < b.end[2]; ++z) {
            for (uint32_t y = b.first[1]; y < b.end[1]; ++y) {
                for (uint32_t x = b.first[0]; x < b.end[0]; ++x) {
                    const size_t site = 2 * size_t(lattice.cell_at(x, y, z));
                    value[site] = value[site + 1] = v;
                }
            }
        }
    }
    // Centre of a block's sites; `reach` receives the distance to the farthest site.
    Vec3d middle(const Block& b, double& reach) const {
        Vec3d low, high;
        for (int k = 0; k < 3; ++k) {
            low[k] = lattice.origin[k] + lattice.spacing * b.first[k];
            high[k] = lattice.origin[k] + lattice.spacing * (b.end[k] - 0.5);
        }
        reach = (high - low).norm() / 2;
        return (low + high) / 2;
    }
    std::vector<Block> split(const Block& whole, uint32_t side) const {
        std::vector<Block> parts;
        for (uint32_t z = whole.first[2]; z < whole.end[2]; z += side) {
            for (uint32_t y = whole.first[1]; y < whole.end[1]; y += side) {
                for (uint32_t x = whole.first[0]; x < whole.end[0]; x += side) {
                    parts.push_back(
                        {{x, y, z},
                         {std::min(x + side, whole.end[0]), std::min(y + side, whole.end[1]), std::min(z + side, whole.end[2])}});
                }
            }
        }
        return parts;
    }
    void sample(const std::vector<Block>& blocks) {
        std::vector<Vec3d> points;
        std::vector<uint32_t> sites;
        for (const Block& b : blocks) {
            for (uint32_t z = b.first[2]; z < b.end[2]; ++z) {
                for (uint32_t y = b.first[1]; y < b.end[1]; ++y) {
                    for (uint32_t x = b.first[0]; x < b.end[0]; ++x) {
                        for (uint32_t odd = 0; odd < 2; ++odd) {
                            sites.push_back(2 * lattice.cell_at(x, y, z) + odd);
                            points.push_back(lattice.position(sites.back()));
                        }
                    }
                }
            }
        }
        std::vector<double> found(points.size());
        distance(points, found);
        for (size_t i = 0; i < sites.size(); ++i) value[sites[i]] = static_cast<float>(found[i]);
    }
    void run() {
        value.resize(2 * lattice.cell_count());
        std::vector<Block> blocks{{{0, 0, 0}, lattice.cells}};
        for (const uint32_t side : {16u, 4u, 2u}) {
            std::vector<Block> smaller, near;
            for (const Block& b : blocks) {
                for (const Block& part : split(b, side)) smaller.push_back(part);
            }
            std::vector<Vec3d> points;
            std::vector<double> reach(smaller.size()), found(smaller.size());
            for (size_t i = 0; i < smaller.size(); ++i) points.push_back(middle(smaller[i], reach[i]));
            distance(points, found);
            for (size_t i = 0; i < smaller.size(); ++i) {
                if (std::abs(found[i]) > 1.001 * steepness * reach[i])
                    fill(smaller[i], std::copysign(INFINITY, static_cast<float>(found[i])));
                else
                    near.push_back(smaller[i]);
            }
            blocks.swap(near);
        }
        sample(blocks);
    }
};

// The working lattice. Sign: 1 inside, 0 on the surface, -1 outside.
struct Stuffer {
    BodyCentredLattice lattice;
    const DistanceField& distance;
    std::vector<int8_t> sign{};
    std::vector<uint8_t> cut_mask{};    // bit mask of a site's owned edges that have a cut point
    std::vector<uint32_t> first_cut{};  // index of the site's first cut point
    std::vector<Vec3d> cut{};
    std::vector<float> along{};        // cut point's position as a fraction of the edge from its owner
    std::vector<uint32_t> moved_to{};  // per site: cut point it was moved to, or kNone

    struct Edge {
        uint32_t owner;
        int direction;
    };
    uint32_t cut_row(const Edge& e) const {
        const uint32_t below = cut_mask[e.owner] & ((1u << e.direction) - 1);
        return first_cut[e.owner] + static_cast<uint32_t>(std::popcount(below));
    }
    bool is_cut(const Edge& e) const { return cut_mask[e.owner] >> e.direction & 1; }

    void find_signs(const std::vector<float>& value) {
        sign.resize(value.size());
        for (size_t i = 0; i < value.size(); ++i) sign[i] = value[i] < 0 ? 1 : value[i] > 0 ? -1 : 0;
        for (uint32_t site = 0; site < sign.size(); ++site) {
            if (sign[site] >= 0 && lattice.on_rim(site)) throw InputError("tetrahedra: the solid leaves its box");
        }
    }

    void find_cuts(std::vector<float>& value) {
        std::vector<std::array<uint32_t, 2>> ends;
        cut_mask.assign(sign.size(), 0);
        first_cut.assign(sign.size(), 0);
        for (uint32_t site = 0; site < sign.size(); ++site) {
            first_cut[site] = static_cast<uint32_t>(ends.size());
            if (lattice.on_rim(site)) continue;
            for (int d = 0; d < 7; ++d) {
                const uint32_t other = lattice.across(site, kOwned[d], 1);
                if (sign[site] * sign[other] >= 0) continue;
                cut_mask[site] |= uint8_t(1u << d);
                ends.push_back({site, other});
            }
        }
        sample_ends(ends, value);
        place_cuts(value, ends);
    }

    // Samples the ends of cut edges that are in blocks filled with one value.
    void sample_ends(const std::vector<std::array<uint32_t, 2>>& ends, std::vector<float>& value) const {
        std::vector<uint32_t> sites;
        for (const auto& e : ends) {
            for (const uint32_t site : e) {
                if (std::isinf(value[site])) sites.push_back(site);
            }
        }
        std::sort(sites.begin(), sites.end());
        sites.erase(std::unique(sites.begin(), sites.end()), sites.end());
        std::vector<Vec3d> points;
        for (const uint32_t site : sites) points.push_back(lattice.position(site));
        std::vector<double> found(points.size());
        distance(points, found);
        for (size_t i = 0; i < sites.size(); ++i) value[sites[i]] = static_cast<float>(found[i]);
    }

    // Regula falsi (Illinois) on all cut edges at once.
    void place_cuts(const std::vector<float>& value, const std::vector<std::array<uint32_t, 2>>& ends) {
        const size_t n = ends.size();
        std::vector<double> low(n, 0), high(n, 1), at_low(n), at_high(n), found(n);
        std::vector<int8_t> side(n, 0);
        cut.resize(n);
        along.resize(n);
        std::vector<Vec3d> from(n), edge(n);
        for (size_t i = 0; i < n; ++i) {
            at_low[i] = value[ends[i][0]], at_high[i] = value[ends[i][1]];
            from[i] = lattice.position(ends[i][0]);
            edge[i] = lattice.position(ends[i][1]) - from[i];
        }
        for (int round = 0; round < 4; ++round) {
            for (size_t i = 0; i < n; ++i) {
                const double t = low[i] + (high[i] - low[i]) * at_low[i] / (at_low[i] - at_high[i]);
                along[i] = static_cast<float>(t);
                cut[i] = from[i] + double(along[i]) * edge[i];
            }
            if (round == 3) break;
            distance(cut, found);
            for (size_t i = 0; i < n; ++i) {
                const double t = along[i];
                if ((found[i] < 0) == (at_low[i] < 0)) {
                    low[i] = t, at_low[i] = found[i];
                    if (side[i] == 1) at_high[i] /= 2;
                    side[i] = 1;
                } else {
                    high[i] = t, at_high[i] = found[i];
                    if (side[i] == -1) at_low[i] /= 2;
                    side[i] = -1;
                }
            }
        }
    }

    // Calls visit(edge, neighbour, fraction of the edge to its cut point) for every cut edge at a site.
    template <typename Visit>
    void for_each_cut(uint32_t site, const Visit& visit) const {
        for (int d = 0; d < 7; ++d) {
            const Edge own{site, d};
            if (is_cut(own)) visit(own, double(along[cut_row(own)]));
            const Edge other{lattice.across(site, kOwned[d], -1), d};
            if (is_cut(other)) visit(other, 1 - double(along[cut_row(other)]));
        }
    }

    // Moves each site in turn to the nearest violating cut point and removes the cut points on its edges.
    void warp() {
        std::vector<uint8_t> live(cut.size(), 1);
        moved_to.assign(sign.size(), kNone);
        for (uint32_t site = 0; site < sign.size(); ++site) {
            if (sign[site] == 0 || lattice.on_rim(site)) continue;
            double nearest = 1e300;
            uint32_t to = kNone;
            for_each_cut(site, [&](const Edge& e, double part) {
                const bool is_long = e.direction < kLongEdges;
                const double edge = part * (is_long ? 1 : std::sqrt(0.75));
                if (!live[cut_row(e)] || part >= (is_long ? kAlphaLong : kAlphaShort) || edge >= nearest) return;
                nearest = edge;
                to = cut_row(e);
            });
            if (to == kNone) continue;
            for_each_cut(site, [&](const Edge& e, double) { live[cut_row(e)] = 0; });
            sign[site] = 0;
            moved_to[site] = to;
        }
    }
};

// A corner of a stencil: a site, or the cut point between two sites.
struct Corner {
    uint32_t site;
    uint32_t other = kNone;
};

struct Filler {
    const Stuffer& s;
    TetMesh mesh{};
    std::vector<uint32_t> site_vertex, cut_vertex;

    uint32_t vertex(const Corner& c) {
        uint32_t* known = nullptr;
        Vec3d position;
        if (c.other == kNone) {
            known = &site_vertex[c.site];
            if (*known == kNone) position = s.moved_to[c.site] == kNone ? s.lattice.position(c.site) : s.cut[s.moved_to[c.site]];
        } else {
            const uint32_t row = s.cut_row(edge_between(c.site, c.other));
            known = &cut_vertex[row];
            if (*known == kNone) position = s.cut[row];
        }
        if (*known == kNone) {
            *known = static_cast<uint32_t>(mesh.position.size());
            mesh.position.push_back(position);
        }
        return *known;
    }
    Stuffer::Edge edge_between(uint32_t a, uint32_t b) const {
        const Half from = s.lattice.half_of(a), to = s.lattice.half_of(b);
        const Half edge{to[0] - from[0], to[1] - from[1], to[2] - from[2]};
        for (int d = 0; d < 7; ++d) {
            if (edge == kOwned[d]) return {a, d};
            if (edge[0] == -kOwned[d][0] && edge[1] == -kOwned[d][1] && edge[2] == -kOwned[d][2]) return {b, d};
        }
        TROCAR_ASSERT(false);
        return {};
    }
    void emit(const Corner& a, const Corner& b, const Corner& c, const Corner& d) {
        mesh.tetrahedron.push_back({vertex(a), vertex(b), vertex(c), vertex(d)});
    }

    // A lattice face with inside corners p and q and outside corner m leaves a quadrilateral. Returns whether
    // its diagonal starts at p (and ends on q m). If only one cut edge is long, it starts at the corner with
    // the short edge. If both are short, the parity rule decides: at p if an odd number of its coordinates
    // exceed m's.
    bool starts_at(uint32_t p, uint32_t q, uint32_t m) const {
        const bool p_long = (p & 1) == (m & 1), q_long = (q & 1) == (m & 1);
        if (p_long != q_long) return q_long;
        const Half a = s.lattice.half_of(p), c = s.lattice.half_of(m);
        int larger = 0;
        for (int k = 0; k < 3; ++k) larger += a[k] > c[k] ? 1 : 0;
        return (larger & 1) == 1;
    }

    double squared_distance(const Corner& a, const Corner& b) {
        const uint32_t i = vertex(a), j = vertex(b);
        return (mesh.position[i] - mesh.position[j]).squaredNorm();
    }

    // Three tetrahedra of the prism with triangles low and high. before[k]: the diagonal between columns k
    // and k + 1 starts at the low end of column k. The three must not form a cycle.
    void fill_prism(const std::array<Corner, 3>& low, const std::array<Corner, 3>& high, const std::array<bool, 3>& before) {
        // a column's rank is the number of columns before it
        std::array<int, 3> order{};
        for (int k = 0; k < 3; ++k) order[(before[k] ? k + 1 : k) % 3] += 1;
        std::array<int, 3> at{};
        for (int k = 0; k < 3; ++k) at[order[k]] = k;
        const auto [i, j, k] = at;
        const bool even = (j - i + 3) % 3 == 1;
        const auto put = [&](const Corner& a, const Corner& b, const Corner& c, const Corner& d) {
            even ? emit(a, b, c, d) : emit(a, b, d, c);
        };
        put(low[i], low[j], low[k], high[k]);
        put(low[i], low[j], high[k], high[j]);
        put(low[i], high[j], high[k], high[i]);
    }

    // t: four sites, positively oriented.
    void fill(const std::array<uint32_t, 4>& t) {
        std::array<uint32_t, 4> v = t;
        int inside = 0, outside = 0;
        for (const uint32_t site : v) inside += s.sign[site] > 0, outside += s.sign[site] < 0;
        if (inside == 0) return;
        if (outside == 0) return emit({v[0]}, {v[1]}, {v[2]}, {v[3]});
        // sort: inside corners, then those on the surface; an odd number of swaps is corrected at the end
        bool odd = false;
        for (int round = 0; round < 3; ++round) {
            for (int k = 0; k < 3; ++k) {
                if (s.sign[v[k]] >= s.sign[v[k + 1]]) continue;
                std::swap(v[k], v[k + 1]);
                odd = !odd;
            }
        }
        if (inside == 1) {
            std::array<Corner, 4> c;
            for (int k = 0; k < 4; ++k) c[k] = s.sign[v[k]] < 0 ? Corner{v[0], v[k]} : Corner{v[k]};
            if (odd) std::swap(c[0], c[1]);
            return emit(c[0], c[1], c[2], c[3]);
        }
        if (odd) std::swap(v[0], v[1]);
        if (inside == 2 && outside == 1) return fill_pyramid(v);
        if (inside == 3) {
            const uint32_t m = v[3];
            return fill_prism({Corner{v[0]}, {v[1]}, {v[2]}}, {Corner{v[0], m}, {v[1], m}, {v[2], m}},
                              {starts_at(v[0], v[1], m), starts_at(v[1], v[2], m), starts_at(v[2], v[0], m)});
        }
        fill_wedge(v);
    }

    // v: inside, inside, on the surface, outside.
    void fill_pyramid(const std::array<uint32_t, 4>& v) {
        const auto [p, q, z, m] = v;
        if (starts_at(p, q, m)) {
            emit({p}, {q}, {z}, {q, m});
            emit({p}, {q, m}, {z}, {p, m});
        } else {
            emit({p}, {q}, {z}, {p, m});
            emit({p, m}, {q}, {z}, {q, m});
        }
    }

    // v: inside, inside, outside, outside. Columns p q, pr qr, ps qs.
    void fill_wedge(const std::array<uint32_t, 4>& v) {
        const auto [p, q, r, t] = v;
        const bool first = starts_at(p, q, r);   // column 0 before column 1
        const bool third = !starts_at(p, q, t);  // column 2 before column 0
        bool second = !first;                    // column 1 before 2: free unless column 0 is between them
        if (first != third) second = squared_distance({p, r}, {q, t}) <= squared_distance({q, r}, {p, t});
        fill_prism({Corner{p}, {p, r}, {p, t}}, {Corner{q}, {q, r}, {q, t}}, {first, second, third});
    }

    // Two neighbouring cell centres and an edge of the face between them form a lattice tetrahedron.
    void run() {
        site_vertex.assign(s.sign.size(), kNone);
        cut_vertex.assign(s.cut.size(), kNone);
        const auto& n = s.lattice.cells;
        for (uint32_t z = 1; z + 2 < n[2]; ++z) {
            for (uint32_t y = 1; y + 2 < n[1]; ++y) {
                for (uint32_t x = 1; x + 2 < n[0]; ++x) {
                    for (int axis = 0; axis < 3; ++axis) fill_around_face(x, y, z, axis);
                }
            }
        }
    }
    void fill_around_face(uint32_t x, uint32_t y, uint32_t z, int axis) {
        const std::array<uint32_t, 3> step{1, s.lattice.cells[0], s.lattice.cells[0] * s.lattice.cells[1]};
        const uint32_t cell = s.lattice.cell_at(x, y, z), next = cell + step[axis];
        const uint32_t u = step[(axis + 1) % 3], w = step[(axis + 2) % 3];
        const std::array<uint32_t, 4> ring{2 * next, 2 * (next + u), 2 * (next + u + w), 2 * (next + w)};
        const uint32_t a = 2 * cell + 1, b = 2 * next + 1;
        if (s.sign[a] <= 0 && s.sign[b] <= 0 && s.sign[ring[0]] <= 0 && s.sign[ring[1]] <= 0 && s.sign[ring[2]] <= 0 &&
            s.sign[ring[3]] <= 0) {
            return;
        }
        for (int k = 0; k < 4; ++k) fill({a, b, ring[k], ring[(k + 1) % 4]});
    }
};

double signed_volume(const TetMesh& mesh, const std::array<uint32_t, 4>& t) {
    const Vec3d& o = mesh.position[t[0]];
    return (mesh.position[t[1]] - o).cross(mesh.position[t[2]] - o).dot(mesh.position[t[3]] - o) / 6;
}

// Faces of a positively oriented tetrahedron, outward.
constexpr int kFaces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

// Per tetrahedron face: corners ascending, whether the winding equals this order, and the tetrahedron.
struct FaceUse {
    std::array<uint32_t, 3> corner;
    uint32_t even;
    Triangle face;
};

std::vector<FaceUse> sorted_faces(const TetMesh& mesh) {
    std::vector<FaceUse> faces;
    faces.reserve(4 * mesh.tetrahedron.size());
    for (const auto& t : mesh.tetrahedron) {
        for (const auto& f : kFaces) {
            const Triangle face{t[f[0]], t[f[1]], t[f[2]]};
            std::array<uint32_t, 3> sorted = face;
            std::sort(sorted.begin(), sorted.end());
            const size_t k = size_t(std::find(face.begin(), face.end(), sorted[0]) - face.begin());
            faces.push_back({sorted, face[(k + 1) % 3] == sorted[1] ? 1u : 0u, face});
        }
    }
    std::stable_sort(faces.begin(), faces.end(), [](const FaceUse& a, const FaceUse& b) { return a.corner < b.corner; });
    return faces;
}

}  // namespace

TetMesh stuff_isosurface(const StuffingParams& params, const Box& box, const DistanceField& distance) {
    const BodyCentredLattice lattice = make_lattice(params, box);
    FieldSampler sampler{lattice, distance, params.steepness};
    sampler.run();
    Stuffer stuffer{lattice, distance};
    stuffer.find_signs(sampler.value);
    stuffer.find_cuts(sampler.value);
    stuffer.warp();
    Filler filler{stuffer, {}, {}, {}};
    filler.run();
    return std::move(filler.mesh);
}

std::vector<Triangle> boundary_of(const TetMesh& mesh) {
    const std::vector<FaceUse> faces = sorted_faces(mesh);
    std::vector<Triangle> boundary;
    for (size_t i = 0; i < faces.size();) {
        size_t end = i + 1;
        while (end < faces.size() && faces[end].corner == faces[i].corner) ++end;
        if (end - i == 1) boundary.push_back(faces[i].face);
        i = end;
    }
    return boundary;
}

TetFacts judge_tets(const TetMesh& mesh) {
    TetFacts facts;
    facts.min_volume = mesh.tetrahedron.empty() ? 0 : 1e300;
    for (const auto& t : mesh.tetrahedron) {
        const double volume = signed_volume(mesh, t);
        facts.volume += volume;
        facts.inverted += volume > 0 ? 0 : 1;
        facts.min_volume = std::min(facts.min_volume, volume);
        facts.max_volume = std::max(facts.max_volume, volume);
        std::array<Vec3d, 4> normal;
        for (int f = 0; f < 4; ++f) {
            const Vec3d& o = mesh.position[t[kFaces[f][0]]];
            normal[f] = (mesh.position[t[kFaces[f][1]]] - o).cross(mesh.position[t[kFaces[f][2]]] - o);
        }
        for (int f = 0; f < 4; ++f) {
            for (int g = f + 1; g < 4; ++g) {
                // the angle between outward normals is 180 degrees minus the dihedral angle
                const double angle = 180 - std::atan2(normal[f].cross(normal[g]).norm(), normal[f].dot(normal[g])) * 180 / M_PI;
                facts.min_dihedral = std::min(facts.min_dihedral, angle);
                facts.max_dihedral = std::max(facts.max_dihedral, angle);
            }
        }
    }
    const std::vector<FaceUse> faces = sorted_faces(mesh);
    std::vector<std::array<uint32_t, 3>> edges;  // lower vertex, higher vertex, direction
    for (size_t i = 0; i < faces.size();) {
        size_t end = i + 1;
        while (end < faces.size() && faces[end].corner == faces[i].corner) ++end;
        if (end - i > 2 || (end - i == 2 && faces[i].even == faces[i + 1].even)) ++facts.bad_faces;
        if (end - i == 1) {
            ++facts.boundary_faces;
            for (int k = 0; k < 3; ++k) {
                const uint32_t a = faces[i].face[k], b = faces[i].face[(k + 1) % 3];
                edges.push_back({std::min(a, b), std::max(a, b), a < b ? 1u : 0u});
            }
        }
        i = end;
    }
    std::sort(edges.begin(), edges.end());
    for (size_t i = 0; i < edges.size();) {
        size_t end = i, forward = 0;
        while (end < edges.size() && edges[end][0] == edges[i][0] && edges[end][1] == edges[i][1]) forward += edges[end++][2];
        facts.open_edges += 2 * forward == end - i ? 0 : 1;
        i = end;
    }
    return facts;
}

}  // namespace trocar
