#include "content/mend/orientation.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/base/disjoint_sets.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/winding_number.hpp"
namespace trocar {
namespace {

struct Piece {
    std::vector<uint32_t> face;
    Box box;
    double volume = 0;  // m^3, about the centre of the box
    bool closed = true;
    bool flat = false;
};

// Calls visit(a face of the set, balance) for every set that uses an edge, where balance = uses in edge
// direction minus uses against it.
template <typename Visit>
void for_each_balance(const Mesh& mesh, const EdgeTable& table, uint32_t e, std::vector<uint32_t>& sets,
                      std::vector<std::pair<uint32_t, int>>& use, const Visit& visit) {
    // sorted by set: with coincident copies of a shape, an edge has as many users as there are copies
    use.clear();
    for (const uint32_t h : table.users(e)) {
        use.push_back({find_set(sets, h / 3), half_edge_start(mesh.triangle, h) == table.edge[e][0] ? 1 : -1});
    }
    std::sort(use.begin(), use.end());
    for (size_t i = 0, k = 0; i < use.size(); i = k) {
        int balance = 0;
        for (; k < use.size() && use[k].first == use[i].first; ++k) balance += use[k].second;
        visit(use[i].first, balance);
    }
}

// Sets of faces, each represented by its lowest face, as find_inside_out_pieces describes them.
std::vector<uint32_t> partition_pieces(const Mesh& mesh, const EdgeTable& table) {
    const uint32_t faces = static_cast<uint32_t>(mesh.triangle.size());
    std::vector<uint32_t> sets = make_sets(faces);
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        const auto users = table.users(e);
        if (users.size() == 2) join_sets(sets, users[0] / 3, users[1] / 3);
    }
    std::vector<uint8_t> open(faces, 0);
    std::vector<std::pair<uint32_t, int>> use;
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        for_each_balance(mesh, table, e, sets, use, [&](uint32_t set, int balance) { open[set] |= balance != 0; });
    }
    // stored for every face, because joining changes the representatives
    for (uint32_t t = 0; t < faces; ++t) open[t] = open[find_set(sets, t)];
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        uint32_t last = kNone;
        for (const uint32_t h : table.users(e)) {
            if (!open[h / 3]) continue;
            if (last != kNone) join_sets(sets, last, h / 3);
            last = h / 3;
        }
    }
    return sets;
}

std::vector<Piece> gather_pieces(const Mesh& mesh, const EdgeTable& table) {
    std::vector<uint32_t> sets = partition_pieces(mesh, table);
    std::vector<Piece> pieces;
    std::vector<uint32_t> piece_of(mesh.triangle.size());
    std::vector<std::pair<uint32_t, int>> use;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const uint32_t lowest = find_set(sets, t);
        piece_of[t] = lowest == t ? static_cast<uint32_t>(pieces.size()) : piece_of[lowest];
        if (lowest == t) pieces.emplace_back();
        Piece& piece = pieces[piece_of[t]];
        piece.face.push_back(t);
        for (const uint32_t v : mesh.triangle[t]) grow(piece.box, mesh.position[v]);
    }
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        for_each_balance(mesh, table, e, sets, use, [&](uint32_t set, int balance) { pieces[piece_of[set]].closed &= balance == 0; });
    }
    for (Piece& piece : pieces) {
        const Vec3d middle = 0.5 * (piece.box.min + piece.box.max);
        double area = 0;
        for (const uint32_t t : piece.face) {
            const Vec3d a = mesh.position[mesh.triangle[t][0]] - middle, b = mesh.position[mesh.triangle[t][1]] - middle,
                        c = mesh.position[mesh.triangle[t][2]] - middle;
            const Vec3d normal = triangle_normal(a, b, c);  // b x c would lose the volume of a needle
            piece.volume += a.dot(normal) / 6;
            area += 0.5 * normal.norm();
        }
        // below the rounding of the sum the sign of the volume is meaningless
        piece.flat = std::abs(piece.volume) <= 1e-13 * area * (piece.box.max - piece.box.min).norm();
    }
    return pieces;
}

struct Flood {
    std::vector<uint32_t> across;  // half-edge -> its opposite at a two-face edge, or kNone
    std::vector<uint8_t> seen;     // per face
    std::vector<uint8_t> turned;   // per face: 1 = orientation opposite to the seed of its patch
    std::vector<uint32_t> patch;   // faces of the current patch
};

// Propagates the seed's orientation over its patch; false if the patch cannot be oriented (Moebius band).
bool flood_patch(const Mesh& mesh, uint32_t seed, Flood& flood) {
    bool orientable = true;
    flood.patch.assign(1, seed);
    flood.seen[seed] = 1;
    for (uint32_t i = 0; i < flood.patch.size(); ++i) {
        const uint32_t t = flood.patch[i];
        for (uint32_t h = 3 * t; h < 3 * t + 3; ++h) {
            if (flood.across[h] == kNone) continue;
            const uint32_t u = flood.across[h] / 3;
            // consistent neighbours use their edge in opposite directions
            const bool same_way = half_edge_start(mesh.triangle, h) == half_edge_start(mesh.triangle, flood.across[h]);
            const uint8_t wanted = flood.turned[t] ^ static_cast<uint8_t>(same_way);
            if (!flood.seen[u]) {
                flood.seen[u] = 1;
                flood.turned[u] = wanted;
                flood.patch.push_back(u);
            } else {
                orientable &= flood.turned[u] == wanted;
            }
        }
    }
    return orientable;
}

bool lies_within(const Mesh& mesh, const Piece& inner, const Piece& outer) {
    if ((inner.box.min.array() < outer.box.min.array()).any()) return false;
    if ((inner.box.max.array() > outer.box.max.array()).any()) return false;
    // three faces spread over the piece: pieces that intersect each other are not nested
    for (const size_t i : {size_t{0}, inner.face.size() / 2, inner.face.size() - 1}) {
        const Vec3d& corner = mesh.position[mesh.triangle[inner.face[i]][0]];
        int windings = 0;
        if (!count_windings(mesh.position, mesh.triangle, outer.face, corner, windings) || windings == 0) return false;
    }
    return true;
}

}  // namespace

void turn_face(Mesh& mesh, uint32_t face) {
    std::swap(mesh.triangle[face][1], mesh.triangle[face][2]);
    if (!mesh.uv.empty()) std::swap(mesh.uv[face][1], mesh.uv[face][2]);
}

OrientationReport agree_orientation(Mesh& mesh, const EdgeTable& table) {
    OrientationReport report;
    const uint32_t faces = static_cast<uint32_t>(mesh.triangle.size());
    Flood flood{std::vector<uint32_t>(3 * faces, kNone), std::vector<uint8_t>(faces, 0), std::vector<uint8_t>(faces, 0), {}};
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        const auto users = table.users(e);
        if (users.size() != 2) continue;
        flood.across[users[0]] = users[1];
        flood.across[users[1]] = users[0];
    }
    for (uint32_t seed = 0; seed < faces; ++seed) {
        if (flood.seen[seed]) continue;
        const bool orientable = flood_patch(mesh, seed, flood);
        report.unorientable += !orientable;
        const auto turns = std::count_if(flood.patch.begin(), flood.patch.end(), [&](uint32_t t) { return flood.turned[t]; });
        const uint8_t minority = 2 * static_cast<size_t>(turns) <= flood.patch.size();
        for (const uint32_t t : flood.patch) flood.turned[t] = orientable && flood.turned[t] == minority;
    }
    for (uint32_t t = 0; t < faces; ++t) {
        if (!flood.turned[t]) continue;
        turn_face(mesh, t);
        ++report.faces_turned;
    }
    return report;
}

PieceTurns find_inside_out_pieces(const Mesh& mesh, const EdgeTable& table) {
    PieceTurns out;
    out.inside_out.assign(mesh.triangle.size(), 0);
    const std::vector<Piece> pieces = gather_pieces(mesh, table);
    // from the outside in: a surrounding piece has the larger volume
    std::vector<uint32_t> order;
    for (uint32_t p = 0; p < pieces.size(); ++p) {
        if (pieces[p].closed && !pieces[p].flat) order.push_back(p);
    }
    std::stable_sort(order.begin(), order.end(),
                     [&](uint32_t a, uint32_t b) { return std::abs(pieces[a].volume) > std::abs(pieces[b].volume); });
    std::vector<uint8_t> turned(pieces.size(), 0);
    std::vector<int> inside(pieces.size(), 0);  // winding number just inside, once all are oriented correctly
    for (uint32_t i = 0; i < order.size(); ++i) {
        const uint32_t p = order[i];
        const bool outward = pieces[p].volume > 0;
        uint32_t around = kNone;
        for (uint32_t k = i; k-- > 0 && around == kNone;) {
            if (lies_within(mesh, pieces[p], pieces[order[k]])) around = order[k];
        }
        const int outside = around == kNone ? 0 : inside[around];
        const bool wanted = outside == 0 || outward != static_cast<bool>(turned[around]);
        inside[p] = outside + (wanted ? 1 : -1);
        turned[p] = wanted != outward;
        out.pieces += turned[p];
        out.cavities += !wanted;
        out.doubly_inside += inside[p] > 1;
        for (const uint32_t t : pieces[p].face) out.inside_out[t] = turned[p];
    }
    return out;
}

}  // namespace trocar
