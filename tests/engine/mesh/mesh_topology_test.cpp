#include "engine/mesh/mesh_topology.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <set>

#include "engine/geometry/space_curve.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

using namespace reference;

// Everything that add_prototype promises, recomputed by brute force with ordered maps.
void check_topology(const Mesh& mesh, const MeshView& view) {
    ASSERT_EQ(view.position.size(), mesh.position.size());
    ASSERT_EQ(view.triangle.size(), mesh.triangle.size());
    std::map<std::array<uint32_t, 2>, std::vector<std::pair<uint32_t, uint32_t>>> sides;
    std::vector<std::set<uint32_t>> incident(mesh.position.size());
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        EXPECT_EQ(view.triangle[t], mesh.triangle[t]);
        for (uint32_t k = 0; k < 3; ++k) {
            const uint32_t a = mesh.triangle[t][k], b = mesh.triangle[t][(k + 1) % 3];
            sides[{std::min(a, b), std::max(a, b)}].push_back({t, k});
            incident[a].insert(t);
        }
    }
    ASSERT_EQ(view.edge.size(), sides.size());
    double length_sum = 0, longest = 0;
    uint32_t e = 0;
    for (const auto& [edge, users] : sides) {  // a map is ascending, as the edges must be
        ASSERT_EQ(view.edge[e], edge);
        EXPECT_EQ(view.edge_triangle[e][0], users[0].first);
        EXPECT_EQ(view.edge_triangle[e][1], users.size() > 1 ? users[1].first : kNone);
        for (const auto& [t, k] : users) {
            EXPECT_EQ(view.triangle_edge[t][k], e);
            const uint32_t other = users.size() == 2 ? users[0].first + users[1].first - t : kNone;
            EXPECT_EQ(view.neighbour[t][k], other);
        }
        const double length = (mesh.position[edge[0]] - mesh.position[edge[1]]).norm();
        length_sum += length;
        longest = std::max(longest, length);
        ++e;
    }
    for (uint32_t v = 0; v < mesh.position.size(); ++v) {
        const std::vector<uint32_t> expected(incident[v].begin(), incident[v].end());
        const std::vector<uint32_t> got(view.incident.begin() + view.incident_first[v], view.incident.begin() + view.incident_first[v + 1]);
        EXPECT_EQ(got, expected);
        EXPECT_EQ(view.component[v] == kNone, expected.empty());
    }
    EXPECT_NEAR(view.info->mean_edge, sides.empty() ? 0 : length_sum / double(sides.size()), 1e-12 * longest);
    EXPECT_DOUBLE_EQ(view.info->max_edge, longest);
}

void check_springs(const MeshView& view, const Springs& springs, uint32_t row) {
    const SpringInfo& info = springs.info[row];
    const Range shares = springs.vertices[row];
    const uint32_t vertices = static_cast<uint32_t>(view.position.size());
    ASSERT_EQ(info.slices.count, (vertices + 15) / 16);
    ASSERT_EQ(shares.count, info.slices.count * 16);
    std::vector<std::set<uint32_t>> around(vertices);
    for (const auto& [a, b] : view.edge) {
        around[a].insert(b);
        around[b].insert(a);
    }
    double area = 0;
    for (uint32_t s = 0; s < info.slices.count; ++s) {
        const uint32_t* column = springs.slice_column.data() + info.slices.first + row + s;
        size_t widest = 0;
        for (uint32_t lane = 0; lane < 16; ++lane) {
            const uint32_t v = s * 16 + lane;
            std::vector<uint32_t> got;
            for (uint32_t c = column[0]; c < column[1]; ++c) {
                const uint32_t n = springs.neighbour[c * 16 + lane];
                const float rest = springs.rest_length[c * 16 + lane];
                if (n == v) {
                    EXPECT_EQ(rest, 0.0f);
                    continue;
                }
                EXPECT_EQ(got.size(), c - column[0]) << "padding before a spring";
                got.push_back(n);
                EXPECT_EQ(rest, static_cast<float>((view.position[v] - view.position[n]).norm()));
            }
            const std::vector<uint32_t> expected =
                v < vertices ? std::vector<uint32_t>(around[v].begin(), around[v].end()) : std::vector<uint32_t>();
            EXPECT_EQ(got, expected) << "vertex " << v;
            widest = std::max(widest, expected.size());
            const float share = springs.area_share[shares.first + v];
            EXPECT_TRUE(v < vertices || share == 0.0f);
            area += share;
        }
        EXPECT_EQ(column[1] - column[0], widest);
    }
    EXPECT_NEAR(area, view.info->area, 1e-6 * view.info->area);
    EXPECT_DOUBLE_EQ(info.mean_rest, view.info->mean_edge);
}

Mesh make_fan_of_three() {  // one edge, three triangles
    Mesh m;
    m.position = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {-1, 1, 0}, {-1, -1, 0}};
    m.triangle = {{0, 1, 2}, {0, 1, 3}, {1, 0, 4}};
    return m;
}

Mesh make_bow_tie() {  // two tetrahedra that share one vertex
    Mesh m = make_tetrahedron();
    m.position.insert(m.position.end(), {{-1, 0, 0}, {0, -1, 0}, {0, 0, -1}});
    m.triangle.insert(m.triangle.end(), {{0, 4, 5}, {0, 6, 4}, {4, 6, 5}, {0, 5, 6}});
    return m;
}

// Several prototypes in one store: breaks when ranges ignore the elements of earlier prototypes.
TEST(MeshTopology, RowsAgreeWithBruteForce) {
    std::vector<Mesh> samples{make_tetrahedron(),
                              make_sphere({1, 2, 3}, 0.5, 3),
                              make_sheet(7),
                              make_moebius(9),
                              make_fan_of_three(),
                              make_bow_tie(),
                              Mesh{},
                              make_box({0, 0, 0}, {1, 2, 3})};
    samples.push_back(make_sphere({0, 0, 0}, 1, 2));
    shuffle(samples.back(), 5);
    samples.back().position.insert(samples.back().position.begin() + 3, 2, Vec3d(9, 9, 9));  // isolated vertices
    for (Triangle& t : samples.back().triangle) {
        for (uint32_t& v : t) v += v >= 3 ? 2 : 0;
    }
    Meshes meshes;
    Springs springs;
    for (uint32_t i = 0; i < samples.size(); ++i) {
        ASSERT_EQ(add_prototype(meshes, samples[i], Admission::kSheet), i);
        if (i != 2) add_springs(springs, meshes, i);  // a prototype skipped keeps an empty element
    }
    for (uint32_t i = 0; i < samples.size(); ++i) {
        check_topology(samples[i], mesh_view(meshes, i));
        if (i != 2) check_springs(mesh_view(meshes, i), springs, i);
    }
    EXPECT_EQ(springs.info[2].slices.count, 0u);
    EXPECT_EQ(springs.vertices[2].count, 0u);
}

TEST(MeshTopology, PiecesAreEdgeConnected) {
    Meshes meshes;
    Mesh two = make_tetrahedron();
    append(two, make_sphere({5, 0, 0}, 1, 1));
    shuffle(two, 3);
    add_prototype(meshes, two, Admission::kSolid);
    EXPECT_EQ(meshes.info[0].components, 2u);
    const MeshView view = mesh_view(meshes, 0);
    const uint32_t first = view.component[view.triangle[0][0]];
    EXPECT_EQ(first, 0u);  // pieces are numbered by their lowest triangle
    for (const Triangle& t : view.triangle) {
        const bool ball = view.position[t[0]].x() > 3;
        for (const uint32_t v : t) EXPECT_EQ(view.component[v] == first, ball == (view.position[view.triangle[0][0]].x() > 3));
    }
    // a common corner does not join pieces, an edge of three triangles does
    add_prototype(meshes, make_bow_tie(), Admission::kWinding);
    EXPECT_EQ(meshes.info[1].components, 2u);
    EXPECT_EQ(mesh_view(meshes, 1).component[0], 0u);
    add_prototype(meshes, make_fan_of_three(), Admission::kSheet);
    EXPECT_EQ(meshes.info[2].components, 1u);
    for (const auto& n : mesh_view(meshes, 2).neighbour) EXPECT_EQ(n[0], kNone);
}

// Far from the origin, cones about it would cancel: at 1e4 diagonals 1e-9 of the volume would be lost.
TEST(MeshTopology, MeasuresOfABox) {
    const Vec3d low(1e4, -2e4, 3e4), size(1, 2, 3);
    Meshes meshes;
    add_prototype(meshes, make_box(low, low + size), Admission::kSolid);
    const MeshInfo& info = meshes.info[0];
    EXPECT_NEAR(info.volume, 6, 1e-12);
    EXPECT_NEAR(info.area, 22, 1e-11);
    EXPECT_DOUBLE_EQ(info.max_edge, std::sqrt(13.0));
    EXPECT_EQ(info.box.min, low);
    EXPECT_EQ(info.box.max, low + size);
    EXPECT_DOUBLE_EQ(info.radius, (Vec3d(1e4 + 1, -2e4, 3e4 + 3)).norm());
}

TEST(MeshTopology, LooksFollowTheirTriangles) {
    Mesh m = make_sphere({0, 0, 0}, 1, 3);
    shuffle(m, 11);
    m.material.resize(3);
    for (uint32_t t = 0; t < m.triangle.size(); ++t) {
        const Vec3d& p = m.position[m.triangle[t][0]];
        const Vec3d& q = m.position[m.triangle[t][2]];
        m.uv.push_back({Vec2{float(p.x()), float(p.y())}, Vec2{}, Vec2{float(q.x()), float(q.z())}});
        m.triangle_material.push_back(p.x() > 0 ? 2 : 1);
    }
    const Mesh before = m;
    order_for_locality(m);
    Meshes meshes;
    add_prototype(meshes, make_tetrahedron(), Admission::kSolid);
    add_prototype(meshes, m, Admission::kSolid);
    const MeshView view = mesh_view(meshes, 1);
    for (uint32_t t = 0; t < view.triangle.size(); ++t) {
        const Vec3d& p = view.position[view.triangle[t][0]];
        const Vec3d& q = view.position[view.triangle[t][2]];
        EXPECT_EQ(view.uv[t][0].u, float(p.x()));
        EXPECT_EQ(view.uv[t][0].v, float(p.y()));
        EXPECT_EQ(view.uv[t][2].v, float(q.z()));
        EXPECT_EQ(view.triangle_material[t], p.x() > 0 ? 2 : 1);
    }
    EXPECT_EQ(meshes.materials[0].count, 1u);  // none given: the default
    EXPECT_EQ(meshes.materials[1].first, 1u);
    EXPECT_EQ(meshes.materials[1].count, 3u);
}

TEST(MeshTopology, OrderForLocalityKeepsTheSurfaceAndBringsNeighboursTogether) {
    Mesh m = make_sphere({0, 0, 0}, 1, 5);
    shuffle(m, 7);
    const auto surface = [](const Mesh& mesh) {
        std::multiset<std::array<double, 9>> rows;
        for (const Triangle& t : mesh.triangle) {
            std::array<double, 9> row;
            for (int k = 0; k < 9; ++k) row[k] = mesh.position[t[k / 3]][k % 3];
            rows.insert(row);
        }
        return rows;
    };
    const auto median_distance = [](const Mesh& mesh) {  // in memory, between the corners of an edge
        std::vector<uint32_t> distance;
        for (const Triangle& t : mesh.triangle) distance.push_back(t[0] < t[1] ? t[1] - t[0] : t[0] - t[1]);
        std::nth_element(distance.begin(), distance.begin() + distance.size() / 2, distance.end());
        return distance[distance.size() / 2];
    };
    const auto before = surface(m);
    EXPECT_GT(median_distance(m), 1000u);
    order_for_locality(m);
    EXPECT_EQ(surface(m), before);
    EXPECT_LT(median_distance(m), 16u);  // within a slice of springs
    for (size_t t = 1; t < m.triangle.size(); ++t) {
        EXPECT_LE(*std::min_element(m.triangle[t - 1].begin(), m.triangle[t - 1].end()),
                  *std::min_element(m.triangle[t].begin(), m.triangle[t].end()));
    }
    const Mesh once = m;
    order_for_locality(m);
    EXPECT_EQ(m.position, once.position);
    EXPECT_EQ(m.triangle, once.triangle);
}

// On a grid a Hilbert curve steps to a neighbouring cell each time; one wrong bit of the transform makes it jump.
TEST(MeshTopology, HilbertKeysFollowNeighbouringCells) {
    const Box box{Vec3d(0, 0, 0), Vec3d(16, 16, 16)};
    std::vector<std::pair<uint64_t, Vec3d>> cells;
    for (int i = 0; i < 16 * 16 * 16; ++i) {
        const Vec3d p(i % 16 + 0.5, i / 16 % 16 + 0.5, i / 256 + 0.5);
        cells.push_back({hilbert_key(p, box), p});
    }
    std::sort(cells.begin(), cells.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (size_t i = 1; i < cells.size(); ++i) EXPECT_EQ((cells[i].second - cells[i - 1].second).norm(), 1.0) << i;
    EXPECT_EQ(hilbert_key(Vec3d(-1, -1, NAN), box), hilbert_key(Vec3d(0, 0, 0), box));
}

using MeshTopologyDeathTest = testing::Test;

TEST(MeshTopologyDeathTest, G13_RepeatedIndexIsTheCallersFault) {
    Mesh m = make_tetrahedron();
    m.triangle.push_back({0, 0, 1});
    Meshes meshes;
    EXPECT_DEATH(add_prototype(meshes, m, Admission::kSolid), "check failed");
}

}  // namespace
}  // namespace trocar
