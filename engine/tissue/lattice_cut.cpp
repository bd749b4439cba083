#include "engine/tissue/lattice_cut.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <set>
#include <tuple>

#include "engine/base/check.hpp"
namespace trocar {
namespace {

using LatticeTet = std::array<uint32_t, 4>;
using LatticePoint = std::array<uint32_t, 4>;  // nodes that it lies between, ascending, kNone last

// Marks the vertex in the middle of an edge between two vertices.
constexpr uint32_t kMiddle = kNone - 1;

// Outward faces of a tetrahedron of positive volume; the first lacks corner 3, then 2, 0, 1.
constexpr uint8_t kLatticeFaces[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
constexpr uint8_t kLacking[4] = {3, 2, 0, 1};

// Even permutations that begin with each corner, and with each pair that has corner 0.
constexpr uint8_t kFromCorner[4][4] = {{0, 1, 2, 3}, {1, 0, 3, 2}, {2, 3, 0, 1}, {3, 2, 1, 0}};
constexpr uint8_t kFromPair[3][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2}};

bool is_even(const std::array<int, 4>& p) {
    int inversions = 0;
    for (int i = 0; i < 4; ++i)
        for (int j = i + 1; j < 4; ++j) inversions += p[i] > p[j];
    return inversions % 2 == 0;
}

LatticePoint point_of(std::initializer_list<uint32_t> nodes) {
    LatticePoint p{kNone, kNone, kNone, kNone};
    std::copy(nodes.begin(), nodes.end(), p.begin());
    std::sort(p.begin(), p.begin() + static_cast<ptrdiff_t>(nodes.size()));
    return p;
}

// Which edges are cut, with quick answers for nodes without any.
class CutEdges {
 public:
    CutEdges(const Lattice& lattice, std::span<const double> at) : edge_(lattice.edge), at_(at), touched_(lattice.nodes, 0) {
        for (size_t e = 0; e < at.size(); ++e)
            if (at[e] > 0) touched_[edge_[e][0]] = touched_[edge_[e][1]] = 1;
    }
    bool touches(uint32_t node) const { return touched_[node]; }
    bool touches(const LatticeTet& t) const { return touched_[t[0]] || touched_[t[1]] || touched_[t[2]] || touched_[t[3]]; }
    // Fraction from a at which the edge to b is cut; 0 = it is whole.
    double from(uint32_t a, uint32_t b) const {
        if (!touched_[a] || !touched_[b]) return 0;
        const std::array<uint32_t, 2> wanted{std::min(a, b), std::max(a, b)};
        const size_t e = static_cast<size_t>(std::lower_bound(edge_.begin(), edge_.end(), wanted) - edge_.begin());
        TROCAR_ASSERT(e < edge_.size() && edge_[e] == wanted);
        return !(at_[e] > 0) ? 0 : a < b ? at_[e] : 1 - at_[e];
    }
    bool is_cut(uint32_t a, uint32_t b) const { return from(a, b) > 0; }

 private:
    std::span<const std::array<uint32_t, 2>> edge_;
    std::span<const double> at_;
    std::vector<uint8_t> touched_;
};

uint32_t corner_index(const LatticeTet& t, uint32_t node) {
    for (uint32_t k = 0; k < 4; ++k)
        if (t[k] == node) return k;
    return kNone;
}

// Part that owns each corner.
std::vector<std::array<uint32_t, 4>> find_owners(const Lattice& lattice, std::span<const CutPart> part) {
    std::vector<std::array<uint32_t, 4>> owner(lattice.tetrahedron.size());
    for (uint32_t p = 0; p < part.size(); ++p)
        for (uint32_t k = 0; k < 4; ++k)
            if (part[p].owned >> k & 1) owner[part[p].tetrahedron][k] = p;
    return owner;
}

// Corners of a part in groups that whole edges join.
std::vector<uint32_t> find_groups(const LatticeTet& t, uint32_t owned, const CutEdges& cuts) {
    std::vector<uint32_t> groups;
    for (uint32_t left = owned; left != 0;) {
        uint32_t group = left & (~left + 1), before = 0;
        while (group != before) {
            before = group;
            for (uint32_t a = 0; a < 4; ++a)
                for (uint32_t b = 0; b < 4; ++b)
                    if ((group >> a & 1) && (left >> b & 1) && !(group >> b & 1) && !cuts.is_cut(t[a], t[b])) group |= 1u << b;
        }
        groups.push_back(group);
        left &= ~group;
    }
    return groups;
}

double six_fold(const std::array<double, 4>& a, const std::array<double, 4>& b, const std::array<double, 4>& c,
                const std::array<double, 4>& d) {
    const auto at = [](const std::array<double, 4>& p) { return Vec3d(p[1], p[2], p[3]); };
    return std::abs((at(b) - at(a)).cross(at(c) - at(a)).dot(at(d) - at(a)));
}

// Fraction of a tetrahedron's volume at a group of its corners, all of whose edges to the others are cut.
double volume_of_group(const LatticeTet& t, uint32_t group, const CutEdges& cuts) {
    const auto corner_volume = [&](uint32_t a) {
        double v = 1;
        for (uint32_t b = 0; b < 4; ++b) v *= b == a ? 1 : cuts.from(t[a], t[b]);
        return v;
    };
    if (std::popcount(group) == 1) return corner_volume(static_cast<uint32_t>(std::countr_zero(group)));
    if (std::popcount(group) == 3) return 1 - corner_volume(static_cast<uint32_t>(std::countr_zero(~group)));
    if (std::popcount(group) == 4) return 1;
    std::array<uint32_t, 4> k{};
    int in = 0, out = 2;
    for (uint32_t i = 0; i < 4; ++i) k[static_cast<size_t>(group >> i & 1 ? in++ : out++)] = i;
    const auto place = [&](uint32_t a, uint32_t b) {  // of the cut point between two corners, in barycentric coordinates
        std::array<double, 4> p{};
        const double s = cuts.from(t[a], t[b]);
        p[a] = 1 - s, p[b] = s;
        return p;
    };
    std::array<double, 4> a{}, b{};
    a[k[0]] = 1, b[k[1]] = 1;
    const auto ac = place(k[0], k[2]), ad = place(k[0], k[3]), bc = place(k[1], k[2]), bd = place(k[1], k[3]);
    return six_fold(a, ac, ad, b) + six_fold(ac, ad, b, bc) + six_fold(ad, b, bc, bd);
}

// Divides the parts whose corners fell into several groups. Returns the nodes of their tetrahedra, ascending.
std::vector<uint32_t> split_parts(const Lattice& lattice, const CutEdges& cuts, std::vector<CutPart>& part) {
    std::vector<uint32_t> touched;
    const size_t before = part.size();
    for (size_t p = 0; p < before; ++p) {
        const CutPart whole = part[p];
        const LatticeTet& t = lattice.tetrahedron[whole.tetrahedron];
        if (std::popcount(whole.owned) < 2 || !cuts.touches(t)) continue;
        const std::vector<uint32_t> groups = find_groups(t, whole.owned, cuts);
        if (groups.size() == 1) continue;
        std::vector<double> volume;
        for (const uint32_t g : groups) volume.push_back(volume_of_group(t, g, cuts));
        const double sum = std::accumulate(volume.begin(), volume.end(), 0.0);
        double left = whole.share;
        for (size_t g = groups.size() - 1; g > 0; --g) {
            CutPart other = whole;
            other.owned = groups[g], other.share = whole.share * volume[g] / sum;
            left -= other.share;
            part.push_back(other);
        }
        part[p].owned = groups[0], part[p].share = left;
        touched.insert(touched.end(), t.begin(), t.end());
    }
    std::sort(touched.begin(), touched.end());
    touched.erase(std::unique(touched.begin(), touched.end()), touched.end());
    return touched;
}

struct PartAround {
    uint32_t part, corner, fan;
};

// Groups of the parts around a node that hang together across faces with the node.
uint32_t find_part_fans(const Lattice& lattice, const std::vector<std::array<uint32_t, 4>>& owner, std::span<const CutPart> part,
                        std::vector<PartAround>& around) {
    const auto row_of = [&](uint32_t p) {
        const auto found = std::lower_bound(around.begin(), around.end(), p, [](const PartAround& a, uint32_t q) { return a.part < q; });
        return static_cast<uint32_t>(found - around.begin());
    };
    uint32_t fans = 0;
    std::vector<uint32_t> open;
    for (uint32_t start = 0; start < around.size(); ++start) {
        if (around[start].fan != kNone) continue;
        around[start].fan = fans;
        open.assign(1, start);
        while (!open.empty()) {
            const PartAround at = around[open.back()];
            open.pop_back();
            const CutPart& own = part[at.part];
            const LatticeTet& t = lattice.tetrahedron[own.tetrahedron];
            for (uint32_t lacking = 0; lacking < 4; ++lacking) {
                const uint32_t beyond = lattice.neighbour[own.tetrahedron][lacking];
                if (lacking == at.corner || beyond == kNone) continue;
                for (uint32_t k = 0; k < 4; ++k) {
                    if (k == lacking || !(own.owned >> k & 1)) continue;
                    const uint32_t next = row_of(owner[beyond][corner_index(lattice.tetrahedron[beyond], t[k])]);
                    if (around[next].fan != kNone) continue;
                    around[next].fan = fans;
                    open.push_back(next);
                }
            }
        }
        ++fans;
    }
    return fans;
}

// Gives every fan of parts around the touched nodes a node of its own.
void part_nodes(const Lattice& lattice, std::span<const uint32_t> touched, LatticePieces& pieces, std::vector<uint32_t>& made) {
    const auto owner = find_owners(lattice, pieces.part);
    std::vector<std::vector<PartAround>> around(touched.size());
    for (uint32_t p = 0; p < pieces.part.size(); ++p) {
        const LatticeTet& t = lattice.tetrahedron[pieces.part[p].tetrahedron];
        for (uint32_t k = 0; k < 4; ++k) {
            const auto found = std::lower_bound(touched.begin(), touched.end(), t[k]);
            if (found != touched.end() && *found == t[k]) around[static_cast<size_t>(found - touched.begin())].push_back({p, k, kNone});
        }
    }
    for (size_t i = 0; i < touched.size(); ++i) {
        const uint32_t node = touched[i], fans = find_part_fans(lattice, owner, pieces.part, around[i]);
        if (fans == 1) continue;
        std::vector<uint32_t> number(fans, kNone), old(fans, kNone), taken;
        for (const PartAround& a : around[i]) {
            old[a.fan] = pieces.part[a.part].node[a.corner];
            if (pieces.part[a.part].owned >> a.corner & 1) number[a.fan] = node;
        }
        for (uint32_t fan = 0; fan < fans; ++fan) {
            if (number[fan] != kNone) continue;
            if (old[fan] != node && std::find(taken.begin(), taken.end(), old[fan]) == taken.end()) {
                number[fan] = old[fan];
            } else {
                number[fan] = static_cast<uint32_t>(pieces.node_of.size());
                pieces.node_of.push_back(node), made.push_back(old[fan]);
            }
            taken.push_back(number[fan]);
        }
        for (const PartAround& a : around[i]) pieces.part[a.part].node[a.corner] = number[a.fan];
    }
}

// A side of a triangle, by what it is a side of: triangles whose sides have equal keys are neighbours.
struct SurfaceSide {
    std::array<uint32_t, 6> key;
    uint32_t side = 0;  // of a cut through a face
    uint32_t triangle = 0, first = 0;
};

// The surface in triangles whose corners are not yet vertices.
class SurfaceMaker {
 public:
    SurfaceMaker(const Lattice& lattice, const CutEdges& cuts, std::span<const CutPart> part)
        : lattice_(lattice), cuts_(cuts), owner_(find_owners(lattice, part)) {}

    struct Side {
        std::array<uint32_t, 6> key{};
        uint32_t side = 0;
    };
    struct Corner {
        LatticePoint point;
        uint32_t part;
    };
    std::vector<std::array<LatticePoint, 3>> triangle;
    std::vector<uint32_t> part;      // as triangle
    std::vector<uint32_t> face;      // as triangle: the face of the lattice that it lies in, kNone = in none
    std::vector<SurfaceSide> sides;  // three per triangle

    void add_faces() {
        for (uint32_t f = 0; f < lattice_.face.size(); ++f) add_face(f);
    }
    void add_walls() {
        for (uint32_t t = 0; t < lattice_.tetrahedron.size(); ++t)
            if (cuts_.touches(lattice_.tetrahedron[t]) && shows_walls(t)) add_walls_of(t);
    }
    // All pieces of new surface in a tetrahedron, on the sides of their first parts.
    template <typename Visit>  // void(part, other part, points, sides of the first, sides of the other)
    void walls_of(uint32_t t, const Visit& visit) const {
        const auto& own = owner_[t];
        const std::set<uint32_t> parts(own.begin(), own.end());
        if (parts.size() == 4) return four_parts(t, visit);
        if (parts.size() == 3) return three_parts(t, visit);
        if (parts.size() == 2) two_parts(t, visit);
    }

 private:
    bool cut(uint32_t a, uint32_t b) const { return cuts_.is_cut(a, b); }
    static LatticePoint middle(uint32_t a, uint32_t b) { return point_of({a, b}); }

    static Side lattice_side(uint32_t a, uint32_t b, uint32_t end) { return {{0, std::min(a, b), std::max(a, b), end, 0, 0}, 0}; }
    // Of the line in a face that parts x, on whose side this is, from y, not from both others.
    static Side between(uint32_t x, uint32_t y, uint32_t z) {
        const LatticePoint f = point_of({x, y, z});
        return {{1, f[0], f[1], f[2], std::min(x, y), std::max(x, y)}, x < y ? 0u : 1u};
    }
    // Of the line in a face that parts x from both others.
    static Side around(uint32_t x, uint32_t y, uint32_t z, bool on_side_of_x) {
        const LatticePoint f = point_of({x, y, z});
        return {{1, f[0], f[1], f[2], x, kNone}, on_side_of_x ? 0u : 1u};
    }
    static Side within(uint32_t t, uint32_t part, uint32_t line) { return {{2, t, part, line, 0, 0}, 0}; }

    void add_polygon(std::span<const LatticePoint> point, std::span<const Side> side, uint32_t of_part, uint32_t of_face) {
        const uint32_t n = static_cast<uint32_t>(point.size()), number = polygons_++;
        for (uint32_t i = 1; i + 1 < n; ++i) {
            const uint32_t t = static_cast<uint32_t>(triangle.size());
            triangle.push_back({point[0], point[i], point[i + 1]});
            part.push_back(of_part), face.push_back(of_face);
            const auto diagonal = [&](uint32_t end) { return Side{{3, number, end, 0, 0, 0}, 0}; };
            const Side three[3] = {i == 1 ? side[0] : diagonal(i), side[i], i + 2 == n ? side[n - 1] : diagonal(i + 1)};
            for (uint32_t k = 0; k < 3; ++k) sides.push_back({three[k].key, three[k].side, t, k});
        }
    }
    void add_wall(uint32_t own, uint32_t other, std::span<const LatticePoint> point, std::span<const Side> own_side,
                  std::span<const Side> other_side) {
        add_polygon(point, own_side, own, kNone);
        // backwards from the same point: the triangles are the same
        const size_t n = point.size();
        std::vector<LatticePoint> back(n);
        std::vector<Side> side(n);
        for (size_t i = 0; i < n; ++i) back[i] = point[(n - i) % n], side[i] = other_side[n - 1 - i];
        add_polygon(back, side, other, kNone);
    }

    void add_face(uint32_t f) {
        Triangle c = lattice_.face[f].corner;
        const uint32_t t = lattice_.face[f].tetrahedron;
        const auto part_at = [&](uint32_t node) { return owner_[t][corner_index(lattice_.tetrahedron[t], node)]; };
        int cuts = 0;
        for (int k = 0; k < 3; ++k) cuts += cut(c[k], c[(k + 1) % 3]);
        // one cut edge becomes the first; of two, the node between them
        while ((cuts == 1 && !cut(c[0], c[1])) || (cuts == 2 && cut(c[1], c[2]))) std::rotate(c.begin(), c.begin() + 1, c.end());
        const auto [x, y, z] = c;
        const auto node = [](uint32_t n) { return point_of({n}); };
        if (cuts == 0) {
            const LatticePoint p[] = {node(x), node(y), node(z)};
            const Side s[] = {lattice_side(x, y, kNone), lattice_side(y, z, kNone), lattice_side(z, x, kNone)};
            add_polygon(p, s, part_at(x), f);
        } else if (cuts == 1) {
            const LatticePoint p[] = {middle(x, y), node(y), node(z), node(x)};
            const Side s[] = {lattice_side(x, y, y), lattice_side(y, z, kNone), lattice_side(z, x, kNone), lattice_side(x, y, x)};
            add_polygon(p, s, part_at(x), f);
        } else if (cuts == 2) {
            const LatticePoint p[] = {node(x), middle(x, y), middle(z, x)};
            const Side s[] = {lattice_side(x, y, x), around(x, y, z, true), lattice_side(z, x, x)};
            add_polygon(p, s, part_at(x), f);
            const LatticePoint q[] = {middle(x, y), node(y), node(z), middle(z, x)};
            const Side r[] = {lattice_side(x, y, y), lattice_side(y, z, kNone), lattice_side(z, x, z), around(x, y, z, false)};
            add_polygon(q, r, part_at(y), f);
        } else {
            for (int k = 0; k < 3; ++k) {
                const uint32_t a = c[k], b = c[(k + 1) % 3], d = c[(k + 2) % 3];
                const LatticePoint p[] = {node(a), middle(a, b), point_of({a, b, d}), middle(d, a)};
                const Side s[] = {lattice_side(a, b, a), between(a, b, d), between(a, d, b), lattice_side(d, a, a)};
                add_polygon(p, s, part_at(a), f);
            }
        }
    }

    // Whether some line of the new surface in a tetrahedron is more than the tip of a cut; else it is a slit that is closed all around.
    bool shows_walls(uint32_t t) const {
        const auto& own = owner_[t];
        for (uint32_t lacking = 0; lacking < 4; ++lacking) {
            const uint32_t beyond = lattice_.neighbour[t][lacking];
            for (uint32_t a = 0; a < 4; ++a) {
                for (uint32_t b = 0; b < a; ++b) {
                    if (a == lacking || b == lacking || own[a] == own[b]) continue;
                    if (beyond == kNone) return true;
                    const LatticeTet &tet = lattice_.tetrahedron[t], &other = lattice_.tetrahedron[beyond];
                    if (owner_[beyond][corner_index(other, tet[a])] != owner_[beyond][corner_index(other, tet[b])]) return true;
                }
            }
        }
        return false;
    }

    void add_walls_of(uint32_t t) {
        walls_of(t, [&](uint32_t own, uint32_t other, std::span<const LatticePoint> point, std::span<const Side> own_side,
                        std::span<const Side> other_side) { add_wall(own, other, point, own_side, other_side); });
    }

    template <typename Visit>
    void two_parts(uint32_t t, const Visit& visit) const {
        const LatticeTet& tet = lattice_.tetrahedron[t];
        const auto& own = owner_[t];
        std::vector<LatticePoint> point;
        std::vector<Side> one, two;
        for (uint32_t alone = 0; alone < 4; ++alone) {
            if (std::count(own.begin(), own.end(), own[alone]) != 1) continue;
            const auto& p = kFromCorner[alone];
            const uint32_t a = tet[p[0]];
            for (int k = 1; k < 4; ++k) {
                const uint32_t x = tet[p[k]], y = tet[p[k == 3 ? 1 : k + 1]];
                point.push_back(middle(a, x));
                if (cut(x, y)) {
                    one.push_back(between(a, x, y)), two.push_back(between(x, a, y));
                    point.push_back(point_of({a, x, y}));
                    one.push_back(between(a, y, x)), two.push_back(between(y, a, x));
                } else {
                    one.push_back(around(a, x, y, true)), two.push_back(around(a, x, y, false));
                }
            }
            return visit(own[p[0]], own[p[1]], point, one, two);
        }
        for (const auto& p : kFromPair) {
            if (own[p[0]] != own[p[1]]) continue;
            const uint32_t a = tet[p[0]], b = tet[p[1]], c = tet[p[2]], d = tet[p[3]];
            point = {middle(a, c), middle(a, d), middle(b, d), middle(b, c)};
            one = {around(a, c, d, true), around(d, a, b, false), around(b, c, d, true), around(c, a, b, false)};
            two = {around(a, c, d, false), around(d, a, b, true), around(b, c, d, false), around(c, a, b, true)};
            return visit(own[p[0]], own[p[2]], point, one, two);
        }
    }

    template <typename Visit>
    void three_parts(uint32_t t, const Visit& visit) const {
        const LatticeTet& tet = lattice_.tetrahedron[t];
        const auto& own = owner_[t];
        std::array<int, 4> p{};
        int alone = 0, paired = 2;
        for (int k = 0; k < 4; ++k) p[static_cast<size_t>(std::count(own.begin(), own.end(), own[k]) == 1 ? alone++ : paired++)] = k;
        if (!is_even(p)) std::swap(p[2], p[3]);
        const uint32_t a = tet[p[0]], b = tet[p[1]], c = tet[p[2]], d = tet[p[3]];
        const uint32_t at_a = own[p[0]], at_b = own[p[1]], at_c = own[p[2]];
        const LatticePoint abc = point_of({a, b, c}), abd = point_of({a, b, d});
        const auto line = [&](uint32_t of_part) { return within(t, of_part, 0); };
        {
            const LatticePoint point[] = {middle(a, b), abc, abd};
            const Side one[] = {between(a, b, c), line(at_a), between(a, b, d)}, two[] = {between(b, a, c), line(at_b), between(b, a, d)};
            visit(at_a, at_b, point, one, two);
        }
        {
            const LatticePoint point[] = {middle(a, c), middle(a, d), abd, abc};
            const Side one[] = {around(a, c, d, true), between(a, d, b), line(at_a), between(a, c, b)};
            const Side two[] = {around(a, c, d, false), between(d, a, b), line(at_c), between(c, a, b)};
            visit(at_a, at_c, point, one, two);
        }
        const LatticePoint point[] = {middle(b, d), middle(b, c), abc, abd};
        const Side one[] = {around(b, c, d, true), between(b, c, a), line(at_b), between(b, d, a)};
        const Side two[] = {around(b, c, d, false), between(c, b, a), line(at_c), between(d, b, a)};
        visit(at_b, at_c, point, one, two);
    }

    template <typename Visit>
    void four_parts(uint32_t t, const Visit& visit) const {
        const LatticeTet& tet = lattice_.tetrahedron[t];
        const auto& own = owner_[t];
        const LatticePoint centre = point_of({tet[0], tet[1], tet[2], tet[3]});
        for (int i = 0; i < 4; ++i) {
            for (int j = i + 1; j < 4; ++j) {
                std::array<int, 4> p{i, j, 0, 0};
                int next = 2;
                for (int k = 0; k < 4; ++k)
                    if (k != i && k != j) p[static_cast<size_t>(next++)] = k;
                if (!is_even(p)) std::swap(p[2], p[3]);
                const uint32_t a = tet[i], b = tet[j], c = tet[p[2]], d = tet[p[3]];
                const LatticePoint point[] = {middle(a, b), point_of({a, b, c}), centre, point_of({a, b, d})};
                const auto lines = [&](uint32_t of_part, int lacking) { return within(t, of_part, static_cast<uint32_t>(lacking)); };
                const Side one[] = {between(a, b, c), lines(own[i], p[3]), lines(own[i], p[2]), between(a, b, d)};
                const Side two[] = {between(b, a, c), lines(own[j], p[3]), lines(own[j], p[2]), between(b, a, d)};
                visit(own[i], own[j], point, one, two);
            }
        }
    }

    const Lattice& lattice_;
    const CutEdges& cuts_;
    std::vector<std::array<uint32_t, 4>> owner_;
    uint32_t polygons_ = 0;
};

// Pairs of sides: two that lie on the same side of a cut, or at its tip the two on both sides.
std::vector<std::array<uint32_t, 2>> pair_sides(std::vector<SurfaceSide>& sides) {
    std::sort(sides.begin(), sides.end(), [](const SurfaceSide& a, const SurfaceSide& b) {
        return std::tie(a.key, a.side, a.triangle, a.first) < std::tie(b.key, b.side, b.triangle, b.first);
    });
    std::vector<std::array<uint32_t, 2>> pairs;
    for (uint32_t begin = 0, end = 0; begin < sides.size(); begin = end) {
        while (end < sides.size() && sides[end].key == sides[begin].key) ++end;
        TROCAR_ASSERT((end - begin) % 2 == 0);
        for (uint32_t i = begin; i < end; i += 2) {
            TROCAR_ASSERT(end - begin == 2 || sides[i].side == sides[i + 1].side);
            pairs.push_back({i, i + 1});
        }
    }
    return pairs;
}

uint32_t root_of(std::vector<uint32_t>& parent, uint32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

// Weights of a point on the corners of a tetrahedron.
std::array<double, 4> weights_of(const LatticePoint& point, const LatticeTet& t, const CutEdges& cuts) {
    std::array<double, 4> weight{};
    const auto nodes = static_cast<uint32_t>(std::count_if(point.begin(), point.end(), [](uint32_t n) { return n != kNone; }));
    if (nodes == 1) {
        weight[corner_index(t, point[0])] = 1;
        return weight;
    }
    const double share = 2.0 / (nodes * (nodes - 1));
    for (uint32_t i = 0; i < nodes; ++i) {
        for (uint32_t j = i + 1; j < nodes; ++j) {
            const double along = cuts.from(point[i], point[j]);
            weight[corner_index(t, point[i])] += share * (1 - along), weight[corner_index(t, point[j])] += share * along;
        }
    }
    return weight;
}

// Corners that are the same vertex: three per triangle, in the order of the triangles.
struct VertexClasses {
    std::vector<std::vector<uint32_t>> corners;  // of a class, ascending
    std::vector<uint32_t> of;                    // class of a corner
};

VertexClasses find_classes(const SurfaceMaker& made, std::span<const SurfaceSide> sides, std::span<const std::array<uint32_t, 2>> pairs) {
    std::vector<uint32_t> parent;
    for (uint32_t c = 0; c < 3 * made.triangle.size(); ++c) parent.push_back(c);
    const auto join = [&](uint32_t a, uint32_t b) {
        TROCAR_ASSERT(made.triangle[a / 3][a % 3] == made.triangle[b / 3][b % 3]);
        a = root_of(parent, a), b = root_of(parent, b);
        parent[std::max(a, b)] = std::min(a, b);
    };
    for (const auto& [i, j] : pairs) {
        const SurfaceSide &a = sides[i], &b = sides[j];
        join(3 * a.triangle + a.first, 3 * b.triangle + (b.first + 1) % 3);
        join(3 * a.triangle + (a.first + 1) % 3, 3 * b.triangle + b.first);
    }
    VertexClasses classes;
    classes.of.resize(parent.size());
    for (uint32_t c = 0; c < parent.size(); ++c) {
        const uint32_t root = root_of(parent, c);
        if (root == c) classes.of[c] = static_cast<uint32_t>(classes.corners.size()), classes.corners.emplace_back();
        classes.of[c] = classes.of[root];
        classes.corners[classes.of[c]].push_back(c);
    }
    return classes;
}

// Numbers of vertices for the classes: one that a vertex with that point and one of the parts has, else a free one.
std::vector<uint32_t> number_vertices(const Lattice& lattice, const CutEdges& cuts, const SurfaceMaker& made, const VertexClasses& classes,
                                      LatticePieces& pieces, std::set<uint32_t>& free) {
    std::vector<std::pair<LatticePoint, uint32_t>> known;
    for (uint32_t v = 0; v < pieces.vertex.size(); ++v) known.push_back({pieces.vertex[v].point, v});
    std::sort(known.begin(), known.end());
    const auto point_at = [&](uint32_t c) { return made.triangle[classes.corners[c][0] / 3][classes.corners[c][0] % 3]; };
    std::vector<uint32_t> order(classes.corners.size()), number(order.size(), kNone);
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return point_at(a) < point_at(b); });
    for (uint32_t v = 0; v < pieces.vertex.size(); ++v) free.insert(v);
    for (const uint32_t c : order) {
        const LatticePoint point = point_at(c);
        for (auto k = std::lower_bound(known.begin(), known.end(), std::pair{point, 0u}); k != known.end() && k->first == point; ++k) {
            const auto has_part = [&](uint32_t corner) { return made.part[corner / 3] == pieces.vertex[k->second].part; };
            if (!free.contains(k->second) || std::none_of(classes.corners[c].begin(), classes.corners[c].end(), has_part)) continue;
            number[c] = k->second;
            free.erase(k->second);
            break;
        }
    }
    for (const uint32_t c : order) {
        if (number[c] == kNone) {
            if (free.empty()) free.insert(static_cast<uint32_t>(pieces.vertex.size())), pieces.vertex.emplace_back();
            number[c] = *free.begin();
            free.erase(free.begin());
        }
        uint32_t part = kNone;
        for (const uint32_t corner : classes.corners[c]) part = std::min(part, made.part[corner / 3]);
        const CutPart& own = pieces.part[part];
        pieces.vertex[number[c]] = {point_at(c), part, own.node, weights_of(point_at(c), lattice.tetrahedron[own.tetrahedron], cuts)};
    }
    return number;
}

// Where two pairs of sides have the same vertices at both ends, a closed slit between open ones, a vertex is put in
// the middle of each of them: no edge has more than two triangles then. Returns the vertices in the middle of the sides of each triangle.
std::vector<std::array<uint32_t, 3>> add_middles(const SurfaceMaker& made, std::span<const SurfaceSide> sides,
                                                 std::span<const std::array<uint32_t, 2>> pairs, std::span<const uint32_t> corner,
                                                 LatticePieces& pieces, std::set<uint32_t>& free) {
    struct Named {
        std::array<uint32_t, 2> ends;
        uint32_t pair;
    };
    std::vector<Named> named;
    for (uint32_t p = 0; p < pairs.size(); ++p) {
        const SurfaceSide& s = sides[pairs[p][0]];
        const uint32_t u = corner[3 * s.triangle + s.first], v = corner[3 * s.triangle + (s.first + 1) % 3];
        named.push_back({{std::min(u, v), std::max(u, v)}, p});
    }
    std::sort(named.begin(), named.end(),
              [](const Named& a, const Named& b) { return std::tie(a.ends, a.pair) < std::tie(b.ends, b.pair); });
    std::vector<std::array<uint32_t, 3>> middle(made.triangle.size(), {kNone, kNone, kNone});
    for (size_t begin = 0, end = 0; begin < named.size(); begin = end) {
        while (end < named.size() && named[end].ends == named[begin].ends) ++end;
        for (size_t i = begin; end - begin > 1 && i < end; ++i) {
            if (free.empty()) free.insert(static_cast<uint32_t>(pieces.vertex.size())), pieces.vertex.emplace_back();
            const uint32_t v = *free.begin();
            free.erase(free.begin());
            const auto& ends = named[i].ends;
            const uint32_t part = made.part[sides[pairs[named[i].pair][0]].triangle];
            CutSolidVertex half{{ends[0], ends[1], kMiddle, kNone}, part, pieces.part[part].node, {}};
            for (const uint32_t e : ends)
                for (int k = 0; k < 4; ++k) {
                    const auto& node = pieces.vertex[e].node;
                    const auto at = std::find(half.node.begin(), half.node.end(), node[k]);
                    TROCAR_ASSERT(at != half.node.end() || pieces.vertex[e].weight[k] == 0);
                    if (at != half.node.end()) half.weight[static_cast<size_t>(at - half.node.begin())] += 0.5 * pieces.vertex[e].weight[k];
                }
            pieces.vertex[v] = half;
            for (const uint32_t s : pairs[named[i].pair]) middle[sides[s].triangle][sides[s].first] = v;
        }
    }
    return middle;
}

// Appends a triangle, in parts if its sides have vertices in the middle.
void add_triangle(const Triangle& corner, const Triangle& middle, const std::array<Vec2, 3>& uv, uint16_t material, LatticePieces& pieces) {
    const auto put = [&](const Triangle& t, const std::array<Vec2, 3>& at) {
        pieces.triangle.push_back(t), pieces.uv.push_back(at), pieces.material.push_back(material);
    };
    const int split = static_cast<int>(std::count_if(middle.begin(), middle.end(), [](uint32_t v) { return v != kNone; }));
    if (split == 0) return put(corner, uv);
    size_t first = 0;  // so that one split side is the first, and two are the first and the second
    while (split < 3 && (middle[first] == kNone || (split == 2 && middle[(first + 1) % 3] == kNone))) ++first;
    Triangle c{}, m{};
    std::array<Vec2, 3> u{}, h{};
    for (size_t k = 0; k < 3; ++k) c[k] = corner[(first + k) % 3], m[k] = middle[(first + k) % 3], u[k] = uv[(first + k) % 3];
    for (size_t k = 0; k < 3; ++k) h[k] = {0.5f * (u[k].u + u[(k + 1) % 3].u), 0.5f * (u[k].v + u[(k + 1) % 3].v)};
    if (split == 1) {
        put({c[0], m[0], c[2]}, {u[0], h[0], u[2]}), put({m[0], c[1], c[2]}, {h[0], u[1], u[2]});
    } else if (split == 2) {
        put({m[0], c[1], m[1]}, {h[0], u[1], h[1]});
        put({c[0], m[0], m[1]}, {u[0], h[0], h[1]}), put({c[0], m[1], c[2]}, {u[0], h[1], u[2]});
    } else {
        put({c[0], m[0], m[2]}, {u[0], h[0], h[2]}), put({m[0], c[1], m[1]}, {h[0], u[1], h[1]});
        put({m[2], m[1], c[2]}, {h[2], h[1], u[2]}), put({m[0], m[1], m[2]}, {h[0], h[1], h[2]});
    }
}

// Texture coordinates of a point in a face.
Vec2 uv_in_face(const LatticePoint& point, const LatticeFace& face, const std::array<Vec2, 3>& uv, const CutEdges& cuts) {
    const std::array<double, 4> weight = weights_of(point, {face.corner[0], face.corner[1], face.corner[2], kNone - 2}, cuts);
    double u = 0, v = 0;
    for (size_t k = 0; k < 3; ++k) u += weight[k] * double{uv[k].u}, v += weight[k] * double{uv[k].v};
    return {static_cast<float>(u), static_cast<float>(v)};
}

void make_surface_of_pieces(const Lattice& lattice, const CutEdges& cuts, LatticePieces& pieces) {
    SurfaceMaker made(lattice, cuts, pieces.part);
    made.add_faces();
    made.add_walls();
    const auto pairs = pair_sides(made.sides);
    const VertexClasses classes = find_classes(made, made.sides, pairs);
    std::set<uint32_t> free;
    const std::vector<uint32_t> number = number_vertices(lattice, cuts, made, classes, pieces, free);
    std::vector<uint32_t> corner(classes.of.size());
    for (size_t c = 0; c < corner.size(); ++c) corner[c] = number[classes.of[c]];
    const auto middle = add_middles(made, made.sides, pairs, corner, pieces, free);
    pieces.triangle.clear(), pieces.uv.clear(), pieces.material.clear();
    for (uint32_t t = 0; t < made.triangle.size(); ++t) {
        std::array<Vec2, 3> uv{};
        const uint32_t f = made.face[t];
        for (size_t k = 0; f != kNone && k < 3; ++k) uv[k] = uv_in_face(made.triangle[t][k], lattice.face[f], lattice.uv[f], cuts);
        add_triangle({corner[3 * t], corner[3 * t + 1], corner[3 * t + 2]}, middle[t], uv, f == kNone ? lattice.wall : lattice.material[f],
                     pieces);
    }
    // vertices that nothing uses are where the first one is
    for (const uint32_t v : free) pieces.vertex[v] = {{kNone, kNone, kNone, kNone}, 0, pieces.vertex[0].node, pieces.vertex[0].weight};
}

bool is_boxed(const Box& box, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) {
    const Vec3d low = a.cwiseMin(b).cwiseMin(c).cwiseMin(d), high = a.cwiseMax(b).cwiseMax(c).cwiseMax(d);
    return (low.array() <= box.max.array()).all() && (high.array() >= box.min.array()).all();
}

}  // namespace

void find_lattice(std::span<const std::array<uint32_t, 4>> tetrahedron, std::vector<std::array<uint32_t, 4>>& neighbour,
                  std::vector<std::array<uint32_t, 2>>& edge, std::vector<LatticeFace>& face) {
    struct Use {
        Triangle sorted, corner;
        uint32_t tetrahedron, lacking;
    };
    std::vector<Use> uses;
    for (uint32_t t = 0; t < tetrahedron.size(); ++t) {
        const LatticeTet& c = tetrahedron[t];
        for (int f = 0; f < 4; ++f) {
            const Triangle corner{c[kLatticeFaces[f][0]], c[kLatticeFaces[f][1]], c[kLatticeFaces[f][2]]};
            Triangle sorted = corner;
            std::sort(sorted.begin(), sorted.end());
            uses.push_back({sorted, corner, t, kLacking[f]});
        }
        for (int i = 0; i < 4; ++i)
            for (int j = i + 1; j < 4; ++j) edge.push_back({std::min(c[i], c[j]), std::max(c[i], c[j])});
    }
    std::sort(edge.begin(), edge.end());
    edge.erase(std::unique(edge.begin(), edge.end()), edge.end());
    std::sort(uses.begin(), uses.end(),
              [](const Use& a, const Use& b) { return std::tie(a.sorted, a.tetrahedron) < std::tie(b.sorted, b.tetrahedron); });
    neighbour.assign(tetrahedron.size(), {kNone, kNone, kNone, kNone});
    for (size_t i = 0; i < uses.size(); ++i) {
        const Use& use = uses[i];
        if (i + 1 < uses.size() && uses[i + 1].sorted == use.sorted) {
            const Use& other = uses[++i];
            neighbour[use.tetrahedron][use.lacking] = other.tetrahedron;
            neighbour[other.tetrahedron][other.lacking] = use.tetrahedron;
        } else {
            face.push_back({use.corner, use.tetrahedron});
        }
    }
}

LatticePieces whole_pieces(const Lattice& lattice) {
    LatticePieces pieces;
    pieces.cut_at.assign(lattice.edge.size(), 0.0);
    for (uint32_t t = 0; t < lattice.tetrahedron.size(); ++t) pieces.part.push_back({t, 15, lattice.tetrahedron[t], 1.0});
    pieces.node_of.resize(lattice.nodes);
    std::iota(pieces.node_of.begin(), pieces.node_of.end(), 0u);
    make_surface_of_pieces(lattice, {lattice, pieces.cut_at}, pieces);
    return pieces;
}

std::vector<std::pair<uint32_t, double>> crossed_edges(const EdgeSweep& sweep, const Lattice& lattice, std::span<const Vec3d> place,
                                                       std::span<const Vec3d> before, std::span<const double> cut_at) {
    Box box;
    for (const Vec3d& p : {sweep.a0, sweep.b0, sweep.a1, sweep.b1}) box.min = box.min.cwiseMin(p), box.max = box.max.cwiseMax(p);
    std::vector<std::pair<uint32_t, double>> crossed;
    for (uint32_t e = 0; e < lattice.edge.size(); ++e) {
        const auto [a, b] = lattice.edge[e];
        if (cut_at[e] > 0 || !is_boxed(box, place[a], place[b], before[a], before[b])) continue;
        const Vec3d moved = 0.5 * (place[a] - before[a] + place[b] - before[b]);
        const double along = crossing_of({sweep.a0 + moved, sweep.b0 + moved, sweep.a1, sweep.b1}, place[a], place[b]);
        if (!std::isnan(along)) crossed.push_back({e, std::clamp(along, kSnap, 1 - kSnap)});
    }
    return crossed;
}

bool cut_lattice(const Lattice& lattice, std::span<const std::pair<uint32_t, double>> crossed, LatticePieces& pieces,
                 std::vector<uint32_t>& made) {
    made.clear();
    for (const auto& [edge, along] : crossed) pieces.cut_at[edge] = along;
    const CutEdges cuts(lattice, pieces.cut_at);
    const std::vector<uint32_t> touched = split_parts(lattice, cuts, pieces.part);
    if (touched.empty()) return false;
    part_nodes(lattice, touched, pieces, made);
    make_surface_of_pieces(lattice, cuts, pieces);
    return true;
}

double wall_area(const Lattice& lattice, const LatticePieces& pieces, std::span<const Vec3d> rest) {
    const CutEdges cuts(lattice, pieces.cut_at);
    const SurfaceMaker maker(lattice, cuts, pieces.part);
    double area = 0;
    for (uint32_t t = 0; t < lattice.tetrahedron.size(); ++t) {
        const LatticeTet& tet = lattice.tetrahedron[t];
        if (!cuts.touches(tet)) continue;
        const auto place = [&](const LatticePoint& point) {
            const std::array<double, 4> weight = weights_of(point, tet, cuts);
            Vec3d p = Vec3d::Zero();
            for (size_t k = 0; k < 4; ++k) p += weight[k] * rest[tet[k]];
            return p;
        };
        maker.walls_of(t, [&](uint32_t, uint32_t, std::span<const LatticePoint> point, const auto&, const auto&) {
            for (size_t i = 1; i + 1 < point.size(); ++i)
                area += 0.5 * (place(point[i]) - place(point[0])).cross(place(point[i + 1]) - place(point[0])).norm();
        });
    }
    return area;
}

}  // namespace trocar
