#include "engine/draw/render_mesh.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "engine/mesh/mesh_topology.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

struct Split {
    Meshes meshes;
    RenderMesh out;
};

Split split(const Mesh& mesh, bool creases) {
    Split s;
    add_prototype(s.meshes, mesh, Admission::kSolid);
    s.out = split_vertices(mesh_view(s.meshes, 0), creases);
    return s;
}

// the drawn triangles are the mesh's: same corners, same texture coordinates, same winding
void expect_same_triangles(const Split& s) {
    const MeshView mesh = mesh_view(s.meshes, 0);
    ASSERT_EQ(s.out.index.size(), 3 * mesh.triangle.size());
    std::vector<std::array<uint32_t, 3>> drawn, wanted(mesh.triangle.begin(), mesh.triangle.end());
    for (size_t i = 0; i < s.out.index.size(); i += 3)
        drawn.push_back({s.out.source[s.out.index[i]], s.out.source[s.out.index[i + 1]], s.out.source[s.out.index[i + 2]]});
    std::sort(drawn.begin(), drawn.end());
    std::sort(wanted.begin(), wanted.end());
    EXPECT_EQ(drawn, wanted);
}

TEST(RenderMesh, SmoothMeshKeepsItsVertices) {
    const Split s = split(reference::make_sphere({0, 0, 0}, 1, 2), false);
    EXPECT_EQ(s.out.source.size(), s.meshes.position.size());
    EXPECT_EQ(s.out.line.size(), 2 * s.meshes.edge.size());
    expect_same_triangles(s);
}

// a box has 8 vertices, each in three flat faces: 24 elements whose normals are the axes
TEST(RenderMesh, CreasesKeepABoxSharp) {
    const Split s = split(reference::make_box({0, 0, 0}, {1, 2, 3}), true);
    EXPECT_EQ(s.out.source.size(), 24u);
    for (const Vec3& n : s.out.normal) {
        EXPECT_NEAR(n.cwiseAbs().maxCoeff(), 1, 1e-6);
        EXPECT_NEAR(n.norm(), 1, 1e-6);
    }
    expect_same_triangles(s);
}

// a fine sphere has no edge sharper than 40 degrees: every normal is close to radial
TEST(RenderMesh, CreasesLeaveARoundBodyRound) {
    const Split s = split(reference::make_sphere({0, 0, 0}, 1, 4), true);
    EXPECT_EQ(s.out.source.size(), s.meshes.position.size());
    for (size_t row = 0; row < s.out.source.size(); ++row)
        EXPECT_GT(s.out.normal[row].cast<double>().dot(s.meshes.position[s.out.source[row]]), 0.999);
}

// a seam of texture coordinates splits its vertices, and only those
TEST(RenderMesh, SplitsAtTextureSeams) {
    Mesh m = reference::make_sheet(2);  // 9 vertices, 8 triangles
    for (const Triangle& t : m.triangle) {
        const bool right = m.position[t[0]].x() + m.position[t[1]].x() + m.position[t[2]].x() > 1.5;
        std::array<Vec2, 3> uv;
        for (uint32_t k = 0; k < 3; ++k)
            uv[k] = {static_cast<float>(m.position[t[k]].x()) + (right ? 7.0f : 0.0f), static_cast<float>(m.position[t[k]].y())};
        m.uv.push_back(uv);
    }
    const Split s = split(m, false);
    EXPECT_EQ(s.out.source.size(), 12u);  // the three vertices in the middle twice
    expect_same_triangles(s);
    for (size_t row = 0; row < s.out.source.size(); ++row)
        EXPECT_FLOAT_EQ(s.out.uv[row].v, 1.0f - static_cast<float>(m.position[s.out.source[row]].y()));
}

TEST(RenderMesh, GroupsTrianglesByMaterial) {
    Mesh m = reference::make_sheet(2);
    m.material.resize(3);
    m.triangle_material = {2, 0, 2, 0, 0, 2, 0, 2};
    const Split s = split(m, false);
    ASSERT_EQ(s.out.groups.size(), 2u);
    EXPECT_EQ(s.out.groups[0].material, 0u);
    EXPECT_EQ(s.out.groups[0].count, 12u);
    EXPECT_EQ(s.out.groups[1].material, 2u);
    EXPECT_EQ(s.out.groups[1].first, 12u);
    expect_same_triangles(s);
}

}  // namespace
}  // namespace trocar
