#include "content/mend/clean_mesh.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>

#include "content/mend/admission.hpp"
#include "content/mend/mesh_box.hpp"
#include "content/mend/orientation.hpp"
#include "engine/base/check.hpp"
#include "engine/base/disjoint_sets.hpp"
#include "engine/geometry/edge_table.hpp"
#include "engine/geometry/predicates.hpp"
namespace trocar {
namespace {

using CellKey = std::array<uint64_t, 3>;

// Mixes the three words so that lattice cells spread (Stafford's variant 13 of the murmur finaliser).
uint64_t hash_cell(const CellKey& key) {
    uint64_t h = 0;
    for (const uint64_t word : key) {
        h += word + 0x9e3779b97f4a7c15ull;
        h = (h ^ h >> 30) * 0xbf58476d1ce4e5b9ull;
        h = (h ^ h >> 27) * 0x94d049bb133111ebull;
        h ^= h >> 31;
    }
    return h;
}

// Hash table from cells to vertices: open addressing from a cell to its first vertex, then a chain.
struct CellHash {
    std::vector<CellKey> key;
    std::vector<uint32_t> head;  // slot -> first vertex of the cell, or kNone
    std::vector<uint32_t> next;  // vertex -> next vertex in the same cell, or kNone

    explicit CellHash(size_t vertices) : key(std::bit_ceil(2 * vertices + 2)), head(key.size(), kNone), next(vertices, kNone) {}
    uint32_t& find(const CellKey& cell) {
        size_t slot = hash_cell(cell) & (head.size() - 1);
        while (head[slot] != kNone && key[slot] != cell) slot = (slot + 1) & (head.size() - 1);
        if (head[slot] == kNone) key[slot] = cell;
        return head[slot];
    }
};

// Equal coordinates give equal cells: -0 counts as 0.
CellKey exact_cell(const Vec3d& p) {
    return {std::bit_cast<uint64_t>(p.x() + 0.0), std::bit_cast<uint64_t>(p.y() + 0.0), std::bit_cast<uint64_t>(p.z() + 0.0)};
}

// Open addressing without the keys, which the positions are: files of facets have millions of them.
std::vector<uint32_t> map_equal(const std::vector<Vec3d>& position) {
    std::vector<uint32_t> to(position.size()), first(std::bit_ceil(2 * position.size() + 2), kNone);
    for (uint32_t v = 0; v < position.size(); ++v) {
        size_t slot = hash_cell(exact_cell(position[v])) & (first.size() - 1);
        while (first[slot] != kNone && position[first[slot]] != position[v]) slot = (slot + 1) & (first.size() - 1);
        if (first[slot] == kNone) first[slot] = v;
        to[v] = first[slot];
    }
    return to;
}

// Cells are one tolerance wide: a partner within the tolerance is in one of the 27 cells around. Indices
// count from the low corner and are not negative; tolerances below 2^-40 of the box are rounding noise
// anyway.
std::vector<uint32_t> map_near(const std::vector<Vec3d>& position, const Box& box, double tolerance) {
    const double cell = std::max(tolerance, 0x1p-40 * (box.max - box.min).maxCoeff());
    std::vector<uint32_t> to(position.size());
    CellHash cells(position.size());
    for (uint32_t v = 0; v < position.size(); ++v) {
        const Vec3d scaled = (position[v] - box.min) / cell;
        CellKey centre;
        for (int k = 0; k < 3; ++k) centre[k] = static_cast<uint64_t>(scaled[k]) + 1;
        to[v] = v;
        for (int i = 0; i < 27; ++i) {
            const CellKey around{centre[0] + i % 3 - 1, centre[1] + i / 3 % 3 - 1, centre[2] + i / 9 - 1};
            for (uint32_t u = cells.find(around); u != kNone; u = cells.next[u]) {
                if (u < to[v] && (position[u] - position[v]).norm() <= tolerance) to[v] = u;
            }
        }
        if (to[v] != v) continue;
        uint32_t& first = cells.find(centre);
        cells.next[v] = first;
        first = v;
    }
    return to;
}

uint32_t drop_repeated_index_faces(Mesh& mesh) {
    std::vector<uint8_t> dropped(mesh.triangle.size(), 0);
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const auto& [a, b, c] = mesh.triangle[t];
        dropped[t] = a == b || b == c || c == a;
    }
    return drop_faces(mesh, dropped);
}

// How often each edge is used, while removals of faces are tried.
struct EdgeUse {
    const EdgeTable& table;
    std::vector<std::array<uint32_t, 3>> edge_of_face;
    std::vector<int> uses;     // faces at the edge
    std::vector<int> balance;  // uses in edge direction minus uses against it

    EdgeUse(const Mesh& mesh, const EdgeTable& edges)
        : table(edges), edge_of_face(mesh.triangle.size()), uses(edges.edge.size(), 0), balance(edges.edge.size(), 0) {
        for (uint32_t e = 0; e < edges.edge.size(); ++e) {
            for (const uint32_t h : edges.users(e)) {
                edge_of_face[h / 3][h % 3] = e;
                change(mesh, h, 1);
            }
        }
    }
    void change(const Mesh& mesh, uint32_t h, int by) {
        const uint32_t e = edge_of_face[h / 3][h % 3];
        uses[e] += by;
        balance[e] += half_edge_start(mesh.triangle, h) == table.edge[e][0] ? by : -by;
    }
};

enum class Openness { kOddEdges, kOddOrUnbalancedEdges };

// Drops those candidates whose removal does not open the surface: an edge is open when an odd number of faces
// use it, regardless of winding. Connected candidates are tried together first, then one by one from the
// highest index. For duplicate faces of equal winding, a removal that improves the balance of directions is
// accepted too (a doubled open sheet).
uint32_t drop_where_still_closed(Mesh& mesh, const std::vector<uint8_t>& candidate, Openness openness) {
    if (std::find(candidate.begin(), candidate.end(), 1) == candidate.end()) return 0;
    const uint32_t faces = static_cast<uint32_t>(mesh.triangle.size());
    const EdgeTable table = make_edge_table(mesh.triangle, static_cast<uint32_t>(mesh.position.size()));
    EdgeUse use(mesh, table);
    std::vector<uint32_t> sets = make_sets(faces);
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        uint32_t last = kNone;
        for (const uint32_t h : table.users(e)) {
            if (!candidate[h / 3]) continue;
            if (last != kNone) join_sets(sets, last, h / 3);
            last = h / 3;
        }
    }
    std::vector<std::vector<uint32_t>> group(faces);
    for (uint32_t t = 0; t < faces; ++t) {
        if (candidate[t]) group[find_set(sets, t)].push_back(t);
    }
    std::vector<uint8_t> dropped(faces, 0);
    const auto drop_if_closed = [&](std::span<const uint32_t> rows) {
        int odd = 0, unbalanced = 0;
        const auto change = [&](int by) {
            for (const uint32_t t : rows) {
                for (uint32_t h = 3 * t; h < 3 * t + 3; ++h) {
                    const uint32_t e = use.edge_of_face[t][h % 3];
                    odd -= use.uses[e] & 1;
                    unbalanced -= std::abs(use.balance[e]);
                    use.change(mesh, h, by);
                    odd += use.uses[e] & 1;
                    unbalanced += std::abs(use.balance[e]);
                }
            }
        };
        change(-1);
        if (odd <= 0 || (openness == Openness::kOddOrUnbalancedEdges && unbalanced <= 0)) {
            for (const uint32_t t : rows) dropped[t] = 1;
            return true;
        }
        change(1);
        return false;
    };
    for (const std::vector<uint32_t>& rows : group) {
        if (rows.empty() || drop_if_closed(rows)) continue;
        for (size_t i = rows.size(); rows.size() > 1 && i-- > 0;) drop_if_closed({&rows[i], 1});
    }
    return drop_faces(mesh, dropped);
}

// Marks faces with the same corners as a face of lower index, in the same or the opposite cyclic order.
void find_doubled_faces(const Mesh& mesh, std::vector<uint8_t>& same, std::vector<uint8_t>& opposite) {
    struct Row {
        Triangle corner;  // ascending
        uint32_t face;
        bool odd;  // the face's winding is opposite to the ascending order
        bool operator<(const Row& other) const { return corner != other.corner ? corner < other.corner : face < other.face; }
    };
    std::vector<Row> rows(mesh.triangle.size());
    for (uint32_t t = 0; t < rows.size(); ++t) {
        const auto& [a, b, c] = mesh.triangle[t];
        rows[t] = {mesh.triangle[t], t, (a > b) != ((b > c) != (c > a))};
        std::sort(rows[t].corner.begin(), rows[t].corner.end());
    }
    std::sort(rows.begin(), rows.end());
    same.assign(rows.size(), 0);
    opposite.assign(rows.size(), 0);
    for (size_t i = 0, j; i < rows.size(); i = j) {
        bool seen[2] = {false, false};
        for (j = i; j < rows.size() && rows[j].corner == rows[i].corner; ++j) {
            if (seen[rows[j].odd])
                same[rows[j].face] = 1;
            else if (j > i)
                opposite[rows[j].face] = 1;
            seen[rows[j].odd] = true;
        }
    }
}

uint32_t count_marked(const std::vector<uint8_t>& marks) { return static_cast<uint32_t>(std::count(marks.begin(), marks.end(), 1)); }

void drop_doubled_faces(Mesh& mesh, CleanReport& report) {
    std::vector<uint8_t> same, opposite;
    find_doubled_faces(mesh, same, opposite);
    const uint32_t doubled = count_marked(same);
    report.duplicate_faces = drop_where_still_closed(mesh, same, Openness::kOddOrUnbalancedEdges);
    report.duplicates_kept = doubled - report.duplicate_faces;
    find_doubled_faces(mesh, same, opposite);
    const uint32_t conflicting = count_marked(opposite);
    report.opposite_faces = drop_where_still_closed(mesh, opposite, Openness::kOddEdges);
    report.opposite_kept = conflicting - report.opposite_faces;
}

void drop_zero_area_faces(Mesh& mesh, CleanReport& report) {
    std::vector<uint8_t> flat(mesh.triangle.size(), 0);
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const auto& [a, b, c] = mesh.triangle[t];
        flat[t] = are_collinear(mesh.position[a], mesh.position[b], mesh.position[c]);
    }
    report.zero_area_faces = drop_where_still_closed(mesh, flat, Openness::kOddEdges);
    report.zero_area_kept = count_marked(flat) - report.zero_area_faces;
}

void orient(Mesh& mesh, CleanReport& report) {
    const uint32_t vertices = static_cast<uint32_t>(mesh.position.size());
    const OrientationReport agreed = agree_orientation(mesh, make_edge_table(mesh.triangle, vertices));
    report.faces_turned = agreed.faces_turned;
    report.unorientable_patches = agreed.unorientable;
    const EdgeTable table = make_edge_table(mesh.triangle, vertices);
    const PieceTurns turns = find_inside_out_pieces(mesh, table);
    report.cavities = turns.cavities;
    report.pieces_turned = turns.pieces;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        if (turns.inside_out[t]) turn_face(mesh, t);
    }
}

}  // namespace

void drop_unused_vertices(Mesh& mesh) {
    std::vector<uint32_t> to(mesh.position.size(), kNone);
    for (const Triangle& t : mesh.triangle) {
        for (const uint32_t v : t) to[v] = 0;
    }
    uint32_t kept = 0;
    for (uint32_t v = 0; v < to.size(); ++v) {
        if (to[v] == kNone) continue;
        mesh.position[kept] = mesh.position[v];
        to[v] = kept++;
    }
    mesh.position.resize(kept);
    for (Triangle& t : mesh.triangle) t = {to[t[0]], to[t[1]], to[t[2]]};
}

uint32_t drop_faces(Mesh& mesh, const std::vector<uint8_t>& dropped) {
    const size_t rows = mesh.triangle.size();
    TROCAR_ASSERT(dropped.size() == rows && (mesh.uv.empty() || mesh.uv.size() == rows));
    TROCAR_ASSERT(mesh.triangle_material.empty() || mesh.triangle_material.size() == rows);
    uint32_t kept = 0;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        if (dropped[t]) continue;
        mesh.triangle[kept] = mesh.triangle[t];
        if (!mesh.uv.empty()) mesh.uv[kept] = mesh.uv[t];
        if (!mesh.triangle_material.empty()) mesh.triangle_material[kept] = mesh.triangle_material[t];
        ++kept;
    }
    const uint32_t count = static_cast<uint32_t>(mesh.triangle.size()) - kept;
    mesh.triangle.resize(kept);
    if (!mesh.uv.empty()) mesh.uv.resize(kept);
    if (!mesh.triangle_material.empty()) mesh.triangle_material.resize(kept);
    return count;
}

uint32_t weld_vertices(Mesh& mesh, double tolerance) {
    const std::vector<uint32_t> to =
        tolerance > 0 ? map_near(mesh.position, box_of_points(mesh.position), tolerance) : map_equal(mesh.position);
    for (Triangle& t : mesh.triangle) t = {to[t[0]], to[t[1]], to[t[2]]};
    uint32_t joined = 0;
    for (uint32_t v = 0; v < to.size(); ++v) joined += to[v] != v;
    return joined;
}

CleanReport clean_mesh(Mesh& mesh, const CleanParams& params) {
    CleanReport report;
    report.vertices_before = report.vertices_after = static_cast<uint32_t>(mesh.position.size());
    report.triangles_before = report.triangles_after = static_cast<uint32_t>(mesh.triangle.size());
    report.refused = !find_bad_element(mesh).empty();
    if (report.refused) return report;
    const Box box = box_of_points(mesh.position);
    const double diagonal = mesh.position.empty() ? 0 : (box.max - box.min).norm();
    const std::vector<Triangle> before = mesh.triangle;
    report.welded_vertices = weld_vertices(mesh, params.weld_tolerance * diagonal);
    for (size_t t = 0; params.weld_tolerance > 0 && t < before.size(); ++t) {
        for (int k = 0; k < 3; ++k) {
            const double moved = (mesh.position[before[t][k]] - mesh.position[mesh.triangle[t][k]]).norm();
            report.weld_distance = std::max(report.weld_distance, moved);
        }
    }
    report.repeated_index_faces = drop_repeated_index_faces(mesh);
    drop_doubled_faces(mesh, report);
    drop_zero_area_faces(mesh, report);
    orient(mesh, report);
    drop_unused_vertices(mesh);
    report.vertices_after = static_cast<uint32_t>(mesh.position.size());
    report.triangles_after = static_cast<uint32_t>(mesh.triangle.size());
    report.unused_vertices = report.vertices_before - report.welded_vertices - report.vertices_after;
    return report;
}

CleanReport orient_mesh(Mesh& mesh) {
    CleanReport report;
    report.refused = !find_bad_element(mesh).empty();
    if (!report.refused) orient(mesh, report);
    return report;
}

std::vector<std::string> list_cleaning(const CleanReport& report) {
    std::vector<std::string> lines;
    const auto say = [&](uint32_t count, const char* one, const char* many) {
        if (count > 0) lines.push_back(std::to_string(count) + " " + (count == 1 ? one : many));
    };
    say(report.welded_vertices, "vertex welded", "vertices welded");
    say(report.repeated_index_faces, "face with a repeated corner dropped", "faces with a repeated corner dropped");
    say(report.duplicate_faces, "doubled face dropped", "doubled faces dropped");
    say(report.duplicates_kept, "doubled face kept", "doubled faces kept");
    say(report.opposite_faces, "opposite doubled face dropped", "opposite doubled faces dropped");
    say(report.opposite_kept, "opposite doubled face kept", "opposite doubled faces kept");
    say(report.zero_area_faces, "face without area dropped", "faces without area dropped");
    say(report.zero_area_kept, "face without area kept", "faces without area kept");
    say(report.faces_turned, "face turned to agree", "faces turned to agree");
    say(report.unorientable_patches, "patch cannot be oriented", "patches cannot be oriented");
    say(report.pieces_turned, "piece was inside out and turned", "pieces were inside out and turned");
    say(report.cavities, "hollow kept inward", "hollows kept inward");
    say(report.unused_vertices, "unused vertex dropped", "unused vertices dropped");
    return lines;
}

std::string describe_cleaning(const CleanReport& report) {
    std::string text;
    for (const std::string& line : list_cleaning(report)) text += (text.empty() ? "" : ", ") + line;
    return text;
}

}  // namespace trocar
