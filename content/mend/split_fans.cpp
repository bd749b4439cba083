#include "content/mend/split_fans.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "engine/base/disjoint_sets.hpp"
#include "engine/geometry/edge_table.hpp"
namespace trocar {
namespace {

// Half-edge of one edge with its angle around the edge.
struct Spoke {
    double angle;
    uint32_t half_edge;
    bool forward;  // true: the solid is on the side of smaller angles; false: of larger ones
};

std::vector<Spoke> sort_around(const Mesh& mesh, const EdgeTable& table, uint32_t e) {
    const Vec3d &tail = mesh.position[table.edge[e][0]], &head = mesh.position[table.edge[e][1]];
    const Vec3d axis = (head - tail).normalized();
    const Vec3d x = axis.unitOrthogonal(), y = axis.cross(x);
    std::vector<Spoke> spokes;
    for (const uint32_t h : table.users(e)) {
        const Vec3d to = mesh.position[mesh.triangle[h / 3][(h + 2) % 3]] - tail;
        spokes.push_back({std::atan2(to.dot(y), to.dot(x)), h, half_edge_start(mesh.triangle, h) == table.edge[e][0]});
    }
    std::stable_sort(spokes.begin(), spokes.end(), [](const Spoke& a, const Spoke& b) { return a.angle < b.angle; });
    return spokes;
}

// Matches faces with solid between them like brackets: solid behind a face opens, solid before it closes.
template <typename Join>
void match_around(const std::vector<Spoke>& spokes, const Join& join) {
    std::vector<size_t> open;
    std::vector<uint8_t> matched(spokes.size(), 0);
    for (size_t round = 0; round < 2 * spokes.size(); ++round) {
        const size_t i = round % spokes.size();
        if (matched[i]) continue;
        if (!spokes[i].forward) {
            if (round < spokes.size()) open.push_back(i);
        } else if (!open.empty()) {
            join(spokes[open.back()].half_edge, spokes[i].half_edge);
            matched[open.back()] = matched[i] = 1;
            open.pop_back();
        }
    }
}

// The edges of a mesh, and the sets of corners that stay together at a vertex.
struct CornerFans {
    EdgeTable table;
    std::vector<uint32_t> sets;
};

uint32_t next_corner(uint32_t c) { return c / 3 * 3 + (c + 1) % 3; }

CornerFans join_fans(const Mesh& mesh) {
    CornerFans fans{make_edge_table(mesh.triangle, static_cast<uint32_t>(mesh.position.size())),
                    make_sets(static_cast<uint32_t>(3 * mesh.triangle.size()))};
    const auto join = [&](uint32_t h, uint32_t g) {
        if (half_edge_start(mesh.triangle, h) == half_edge_start(mesh.triangle, g)) return;  // orientations disagree: stays a boundary
        join_sets(fans.sets, h, next_corner(g));
        join_sets(fans.sets, next_corner(h), g);
    };
    for (uint32_t e = 0; e < fans.table.edge.size(); ++e) {
        const auto users = fans.table.users(e);
        if (users.size() == 2) join(users[0], users[1]);
        if (users.size() > 2) match_around(sort_around(mesh, fans.table, e), join);
    }
    return fans;
}

// Whether more than two faces of an edge lie in the same fans at both its ends.
bool cannot_be_parted(const Mesh& mesh, CornerFans& fans, uint32_t e) {
    std::vector<std::array<uint32_t, 2>> ends;
    for (const uint32_t h : fans.table.users(e)) {
        std::array<uint32_t, 2> end{find_set(fans.sets, h), find_set(fans.sets, next_corner(h))};
        if (half_edge_start(mesh.triangle, h) != fans.table.edge[e][0]) std::swap(end[0], end[1]);
        ends.push_back(end);
    }
    std::sort(ends.begin(), ends.end());
    for (size_t i = 2; i < ends.size(); ++i) {
        if (ends[i] == ends[i - 2]) return true;
    }
    return false;
}

// Divides the face of a half-edge at the vertex `middle` of its edge.
void halve_face(Mesh& mesh, uint32_t h, uint32_t middle) {
    const uint32_t t = h / 3, k = h % 3, next = (k + 1) % 3;
    mesh.triangle.push_back(mesh.triangle[t]);
    mesh.triangle.back()[k] = mesh.triangle[t][next] = middle;
    if (!mesh.triangle_material.empty()) mesh.triangle_material.push_back(uint16_t{mesh.triangle_material[t]});
    if (mesh.uv.empty()) return;
    std::array<Vec2, 3> row = mesh.uv[t];
    const Vec2 uv{(row[k].u + row[next].u) / 2, (row[k].v + row[next].v) / 2};
    mesh.uv[t][next] = row[k] = uv;
    mesh.uv.push_back(row);
}

// Halves edges that cannot be parted, at most one of a face, between the first `vertices`: halves of doubled faces stay
// together however often they are halved. Returns their number.
uint32_t halve_edges(Mesh& mesh, CornerFans& fans, uint32_t vertices) {
    std::vector<uint8_t> halved(mesh.triangle.size(), 0);
    uint32_t count = 0;
    for (uint32_t e = 0; e < fans.table.edge.size(); ++e) {
        const auto users = fans.table.users(e);
        if (users.size() <= 2 || std::any_of(users.begin(), users.end(), [&](uint32_t h) { return halved[h / 3]; })) continue;
        if (fans.table.edge[e][1] >= vertices || !cannot_be_parted(mesh, fans, e)) continue;
        const auto [a, b] = fans.table.edge[e];
        mesh.position.push_back((mesh.position[a] + mesh.position[b]) / 2);
        for (const uint32_t h : users) {
            halved[h / 3] = 1;
            halve_face(mesh, h, static_cast<uint32_t>(mesh.position.size() - 1));
        }
        ++count;
    }
    return count;
}

}  // namespace

SplitReport split_fans(Mesh& mesh, double apart) {
    SplitReport report;
    CornerFans fans = join_fans(mesh);
    const auto vertices = static_cast<uint32_t>(mesh.position.size());
    while (const uint32_t halved = halve_edges(mesh, fans, vertices)) {
        report.halved += halved;
        fans = join_fans(mesh);
    }
    std::vector<uint32_t>& sets = fans.sets;
    const uint32_t corners = static_cast<uint32_t>(3 * mesh.triangle.size());
    for (uint32_t e = 0; e < fans.table.edge.size(); ++e) report.edges += fans.table.users(e).size() > 2;
    // the fan with the lowest face keeps the vertex
    const uint32_t before = static_cast<uint32_t>(mesh.position.size());
    std::vector<uint32_t> fan_of_vertex(before, kNone), vertex_of_fan(corners, kNone);
    std::vector<uint8_t> split(before, 0);
    for (uint32_t c = 0; c < corners; ++c) {
        if (find_set(sets, c) != c) continue;
        const uint32_t v = mesh.triangle[c / 3][c % 3];
        if (fan_of_vertex[v] == kNone) {
            fan_of_vertex[v] = c;
            vertex_of_fan[c] = v;
        } else {
            split[v] = 1;
            vertex_of_fan[c] = static_cast<uint32_t>(mesh.position.size());
            const Vec3d same = mesh.position[v];
            mesh.position.push_back(same);
            split.push_back(1);
            ++report.vertices;
        }
    }
    for (uint32_t c = 0; c < corners; ++c) mesh.triangle[c / 3][c % 3] = vertex_of_fan[find_set(sets, c)];
    std::vector<Vec3d> sum(mesh.position.size(), Vec3d::Zero());
    std::vector<uint32_t> count(mesh.position.size(), 0);
    for (const Triangle& t : mesh.triangle) {
        for (int k = 0; k < 3; ++k) {
            if (!split[t[k]]) continue;
            sum[t[k]] += mesh.position[t[(k + 1) % 3]] + mesh.position[t[(k + 2) % 3]];
            count[t[k]] += 2;
        }
    }
    for (uint32_t v = 0; v < split.size(); ++v) {
        if (split[v] && count[v] > 0) mesh.position[v] += apart * (sum[v] / count[v] - mesh.position[v]);
    }
    return report;
}

}  // namespace trocar
