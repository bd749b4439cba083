#include "content/mend/admission.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "content/mend/orientation.hpp"
#include "content/mend/self_crossing.hpp"
#include "engine/base/disjoint_sets.hpp"
#include "engine/geometry/edge_table.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/predicates.hpp"
namespace trocar {
namespace {

void measure(const Mesh& mesh, MeshJudgement& out) {
    std::vector<uint8_t> used(mesh.position.size(), 0);
    Box box;
    for (const Triangle& t : mesh.triangle) {
        for (const uint32_t v : t) {
            used[v] = 1;
            grow(box, mesh.position[v]);
        }
    }
    out.unused_vertices = static_cast<uint32_t>(std::count(used.begin(), used.end(), 0));
    out.bbox_min = box.min;
    out.bbox_max = box.max;
    // summed about the centre of the box to avoid cancellation, then moved to the origin by the vector area
    // (zero for a closed surface up to rounding, so omitted there)
    const Vec3d middle = 0.5 * (box.min + box.max);
    Vec3d vector_area = Vec3d::Zero();
    for (const Triangle& t : mesh.triangle) {
        const Vec3d a = mesh.position[t[0]] - middle, b = mesh.position[t[1]] - middle, c = mesh.position[t[2]] - middle;
        const Vec3d normal = triangle_normal(a, b, c);
        out.volume += a.dot(normal) / 6;
        out.area += 0.5 * normal.norm();
        vector_area += 0.5 * normal;
    }
    if (!out.closed || out.flipped_edges > 0) out.volume += middle.dot(vector_area) / 3;
}

// Counts vertices with several fans. A fan: faces around a vertex connected across two-face edges.
uint32_t count_bow_ties(const Mesh& mesh, const EdgeTable& table) {
    const uint32_t corners = static_cast<uint32_t>(3 * mesh.triangle.size());
    std::vector<uint32_t> sets = make_sets(corners);
    std::vector<uint8_t> excused(mesh.position.size(), 0);
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        const auto users = table.users(e);
        for (const uint32_t end : table.edge[e]) {
            if (users.size() > 2) excused[end] = 1;
            if (users.size() != 2) continue;
            const auto corner_at = [&](uint32_t h) { return half_edge_start(mesh.triangle, h) == end ? h : h / 3 * 3 + (h + 1) % 3; };
            join_sets(sets, corner_at(users[0]), corner_at(users[1]));
        }
    }
    std::vector<uint32_t> fans(mesh.position.size(), 0);
    for (uint32_t c = 0; c < corners; ++c) {
        if (find_set(sets, c) == c) ++fans[mesh.triangle[c / 3][c % 3]];
    }
    uint32_t count = 0;
    for (size_t v = 0; v < fans.size(); ++v) count += fans[v] > 1 && !excused[v];
    return count;
}

uint32_t count_duplicates(const Mesh& mesh) {
    std::vector<Triangle> rows = mesh.triangle;
    for (Triangle& t : rows) std::sort(t.begin(), t.end());
    std::sort(rows.begin(), rows.end());
    uint32_t count = 0;
    for (size_t i = 1; i < rows.size(); ++i) count += rows[i] == rows[i - 1];
    return count;
}

// Height of a face over its longest edge, relative to the length of that edge.
double relative_height(const Mesh& mesh, const Triangle& t) {
    const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
    const double longest = std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
    return (b - a).cross(c - a).norm() / longest;
}

// Counts edges by kind; true if every edge is used equally often in both directions.
bool count_edges(const Mesh& mesh, const EdgeTable& table, MeshJudgement& out) {
    bool balanced = true;
    out.closed = !table.edge.empty();
    for (uint32_t e = 0; e < table.edge.size(); ++e) {
        const auto users = table.users(e);
        int balance = 0;
        for (const uint32_t h : users) balance += half_edge_start(mesh.triangle, h) == table.edge[e][0] ? 1 : -1;
        out.boundary_edges += users.size() == 1;
        out.non_manifold_edges += users.size() > 2;
        out.flipped_edges += users.size() == 2 && balance != 0;
        out.closed &= users.size() % 2 == 0;
        balanced &= balance == 0;
    }
    return balanced;
}

void add_reason(std::string& reason, uint32_t count, const char* what) {
    if (count > 0) reason += (reason.empty() ? "" : ", ") + std::to_string(count) + " " + what;
}

std::string describe_defects(const MeshJudgement& j) {
    std::string text;
    add_reason(text, j.boundary_edges, "boundary edges");
    add_reason(text, j.non_manifold_edges, "non-manifold edges");
    add_reason(text, j.flipped_edges, "edges between faces of opposite winding");
    add_reason(text, j.bow_tie_vertices, "vertices with several fans");
    add_reason(text, j.inside_out, "pieces inside out");
    add_reason(text, j.doubly_inside, "pieces inside another solid piece");
    add_reason(text, j.zero_area, "faces without area");
    add_reason(text, j.duplicate, "doubled faces");
    add_reason(text, j.self_crossing, "pairs of faces that cross");
    add_reason(text, j.self_touching, "pairs of faces that touch");
    return text;
}

void admit(MeshJudgement& j, bool balanced) {
    const std::string defects = describe_defects(j);
    const double size = (j.bbox_max - j.bbox_min).norm();
    const bool encloses = std::abs(j.volume) > 1e-12 * j.area * size;
    if (j.area == 0) {
        j.admitted_as = Admission::kRefused;
        j.reason = "no face has an area";
    } else if (!balanced) {
        j.admitted_as = Admission::kSheet;
        j.reason = "open: " + defects;
    } else if (!encloses) {
        j.admitted_as = Admission::kSheet;
        j.reason = "closed, but encloses nothing" + (defects.empty() ? "" : ": " + defects);
    } else if (!defects.empty()) {
        j.admitted_as = Admission::kWinding;
        j.reason = "closed, but not solid: " + defects;
    } else {
        j.admitted_as = Admission::kSolid;
        j.reason = j.self_crossing_tested ? "closed, manifold, oriented outward, no self-crossing"
                                          : "closed, manifold, oriented outward; self-crossing not tested";
    }
}

}  // namespace

std::string find_bad_element(const Mesh& mesh) {
    for (size_t v = 0; v < mesh.position.size(); ++v) {
        const double largest = mesh.position[v].cwiseAbs().maxCoeff();
        if (!mesh.position[v].allFinite()) return "vertex " + std::to_string(v) + ": coordinate is not finite";
        if (largest > kFarthestCoordinate) return "vertex " + std::to_string(v) + ": coordinate beyond 1e30";
    }
    const size_t faces = mesh.triangle.size();
    for (size_t t = 0; t < faces; ++t) {
        for (const uint32_t v : mesh.triangle[t]) {
            if (v < mesh.position.size()) continue;
            return "face " + std::to_string(t) + ": names vertex " + std::to_string(v) + " of " + std::to_string(mesh.position.size());
        }
    }
    const auto rows = [&](size_t count, const char* what) {
        return count == 0 || count == faces ? "" : std::to_string(count) + " " + what + " for " + std::to_string(faces) + " faces";
    };
    std::string reason = rows(mesh.uv.size(), "rows of texture coordinates (uv)");
    if (reason.empty()) reason = rows(mesh.triangle_material.size(), "rows of triangle_material");
    return reason;
}

MeshJudgement judge_mesh(const Mesh& mesh, bool test_self_crossing) {
    MeshJudgement out;
    out.vertices = static_cast<uint32_t>(mesh.position.size());
    out.triangles = static_cast<uint32_t>(mesh.triangle.size());
    out.reason = find_bad_element(mesh);
    if (out.reason.empty() && mesh.triangle.empty()) out.reason = "no face";
    if (!out.reason.empty()) return out;

    // a face that names a vertex twice bounds and connects nothing: it is counted and left out
    Mesh faces;
    faces.position = mesh.position;
    for (const Triangle& t : mesh.triangle) {
        const bool repeated = t[0] == t[1] || t[1] == t[2] || t[2] == t[0];
        const bool flat = repeated || are_collinear(mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]);
        out.zero_area += flat;
        out.degenerate += flat || relative_height(mesh, t) <= 1e-7;
        if (!repeated) faces.triangle.push_back(t);
    }
    const EdgeTable table = make_edge_table(faces.triangle, out.vertices);
    const bool balanced = count_edges(faces, table, out);
    std::vector<uint32_t> piece;
    out.components = number_pieces(table, static_cast<uint32_t>(faces.triangle.size()), piece);
    out.bow_tie_vertices = count_bow_ties(faces, table);
    out.duplicate = count_duplicates(faces);
    measure(mesh, out);
    const PieceTurns turns = find_inside_out_pieces(faces, table);
    out.inside_out = turns.pieces;
    out.doubly_inside = turns.doubly_inside;
    out.manifold = out.non_manifold_edges == 0 && out.bow_tie_vertices == 0;
    out.oriented = out.flipped_edges == 0 && (balanced || out.boundary_edges > 0) && out.inside_out == 0;
    if (test_self_crossing) {
        const SelfCrossings crossings = count_self_crossings(faces);
        out.self_crossing_tested = true;
        out.self_crossing = crossings.crossing;
        out.self_touching = crossings.touching;
    }
    admit(out, balanced);
    return out;
}

const char* admission_name(Admission admission) {
    constexpr const char* kNames[] = {"solid", "winding", "sheet", "refused"};
    return kNames[static_cast<int>(admission)];
}

}  // namespace trocar
