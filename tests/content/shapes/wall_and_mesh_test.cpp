#include "content/shapes/wall_and_mesh.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <map>

#include "content/mend/admission.hpp"
#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

// Boundary loops, in the direction of their triangles. Every vertex starts at most one.
std::vector<std::vector<uint32_t>> boundary_loops(const Mesh& mesh) {
    std::map<std::pair<uint32_t, uint32_t>, int> side;
    for (const Triangle& t : mesh.triangle) {
        for (int k = 0; k < 3; ++k) ++side[{t[k], t[(k + 1) % 3]}];
    }
    std::map<uint32_t, uint32_t> next;
    for (const auto& [ends, count] : side) {
        EXPECT_EQ(count, 1);
        if (!side.count({ends.second, ends.first})) {
            EXPECT_TRUE(next.emplace(ends.first, ends.second).second);
        }
    }
    std::vector<std::vector<uint32_t>> loops;
    while (!next.empty()) {
        loops.emplace_back();
        for (auto at = next.begin(); at != next.end(); at = next.find(loops.back().back())) {
            loops.back().push_back(at->second);
            next.erase(at);
        }
    }
    return loops;
}

double enclosed_area(const Mesh& mesh, const std::vector<uint32_t>& loop) {
    double twice = 0;
    for (size_t i = 0; i < loop.size(); ++i) {
        const Vec3d &a = mesh.position[loop[i]], &b = mesh.position[loop[(i + 1) % loop.size()]];
        twice += a.x() * b.y() - a.y() * b.x();
    }
    return twice / 2;
}

TEST(SurgicalMesh, HasOneRimAndALoopAroundEveryPore) {
    for (const uint32_t triangles : {1000u, 10000u, 100000u}) {
        const MeshCells cells = divide_mesh(triangles);
        const Mesh mesh = make_surgical_mesh(cells);
        EXPECT_EQ(mesh.triangle.size(), cells.triangles());
        EXPECT_NEAR(double(mesh.triangle.size()), triangles, 0.1 * triangles);
        const auto loops = boundary_loops(mesh);
        EXPECT_EQ(loops.size(), 1 + cells.pores());
        double pores = 0;
        uint32_t rims = 0;
        for (const auto& loop : loops) {
            const double area = enclosed_area(mesh, loop);
            if (area > 0) {
                ++rims;
                EXPECT_NEAR(area, 0.15 * 0.1, 1e-12);
            } else {
                pores -= area;
                // the pore has the same share of each cell; cells of the outer rows, cut straight, are 1/12
                // smaller
                const double share = -area * (cells.columns * cells.rows) / 0.015 / (0.76 * 0.76);
                EXPECT_GT(share, 11.0 / 12 - 1e-9);
                EXPECT_LT(share, 1 + 1e-9);
            }
        }
        EXPECT_EQ(rims, 1u);
        const MeshJudgement judgement = judge_mesh(mesh);
        EXPECT_EQ(judgement.admitted_as, Admission::kSheet);
        EXPECT_NEAR(judgement.area + pores, 0.015, 1e-12);
        EXPECT_EQ(judgement.self_crossing + judgement.self_touching + judgement.flipped_edges + judgement.degenerate, 0u);
        EXPECT_EQ(judgement.components, 1u);
        EXPECT_TRUE(judgement.manifold);
        // a sheet with h holes: vertices - edges + triangles = 1 - h
        const uint32_t edges = (3 * judgement.triangles + judgement.boundary_edges) / 2;
        EXPECT_EQ(int(judgement.vertices) - int(edges) + int(judgement.triangles), 1 - int(cells.pores()));
        for (const Triangle& t : mesh.triangle) {
            const Vec3d &a = mesh.position[t[0]], &b = mesh.position[t[1]], &c = mesh.position[t[2]];
            ASSERT_GT((b - a).cross(c - a).z(), 0);
        }
    }
}

TEST(SurgicalMesh, PoresAreMillimetresWideWhereThereAreTrianglesEnough) {
    EXPECT_LT(0.15 / divide_mesh(10000).columns, 6.6e-3);
    EXPECT_LT(0.15 / divide_mesh(100000).columns, 6.6e-3);
    EXPECT_GT(reference::survey_shape(make_surgical_mesh(divide_mesh(10000))).min_angle, 12);
    EXPECT_GT(reference::survey_shape(make_surgical_mesh(divide_mesh(100000))).min_angle, 12);
}

TEST(FineMesh, IsARectangleWithOneRim) {
    for (const uint32_t triangles : {500u, 10000u}) {
        const Mesh mesh = make_fine_mesh(triangles);
        EXPECT_NEAR(double(mesh.triangle.size()), triangles, 0.1 * triangles);
        const auto loops = boundary_loops(mesh);
        ASSERT_EQ(loops.size(), 1u);
        EXPECT_NEAR(enclosed_area(mesh, loops[0]), 0.15 * 0.1, 1e-12);
        const MeshJudgement judgement = judge_mesh(mesh);
        EXPECT_NEAR(judgement.area, 0.015, 1e-12);
        EXPECT_TRUE(judgement.manifold);
        EXPECT_EQ(judgement.components, 1u);
        for (const auto& [a, b, c] : mesh.triangle)
            ASSERT_GT((mesh.position[b] - mesh.position[a]).cross(mesh.position[c] - mesh.position[a]).z(), 0);
    }
}

TEST(HerniaWall, IsAPlateWithAHoleThroughIt) {
    const WallSize size;
    // plate minus the defect, whose sections at height w are ellipses with axes shortened by rim sqrt(1 -
    // (2w/t)^2); bending about the middle surface keeps volumes
    const double a = size.defect_x, b = size.defect_y, e = size.rim;
    const double hole = size.thickness / 2 * M_PI * (2 * a * b - (a + b) * e * M_PI / 2 + 4 * e * e / 3);
    const double volume = size.width * size.height * size.thickness - hole;
    for (const auto& [triangles, error] : {std::pair{1000u, 5e-3}, {10000u, 1e-3}, {100000u, 2e-4}}) {
        const Mesh mesh = make_hernia_wall(size, triangles);
        const auto facts = reference::survey_surface(mesh);
        EXPECT_TRUE(facts.closed && facts.one_fan);
        EXPECT_EQ(facts.components, 1u);
        EXPECT_EQ(facts.euler, 0);
        EXPECT_NEAR(facts.volume / volume, 1, error) << triangles;
        EXPECT_EQ(judge_mesh(mesh).admitted_as, Admission::kSolid);
        // the outer surface faces outward at half the thickness from the middle surface, the inner one inward
        double outside = 0, inside = 0;
        for (size_t t = 0; t < mesh.triangle.size(); ++t) {
            const Triangle& corner = mesh.triangle[t];
            const Vec3d &p = mesh.position[corner[0]], &q = mesh.position[corner[1]], &r = mesh.position[corner[2]];
            const double from_axis = std::hypot(p.x(), p.z() + size.bend);
            const Vec3d normal = (q - p).cross(r - p);
            const double facing = normal.dot(Vec3d(p.x(), 0, p.z() + size.bend)) / from_axis;
            if (mesh.triangle_material[t] == 1) {
                ASSERT_NEAR(from_axis, size.bend + size.thickness / 2, 1e-12);
                ASSERT_GT(facing, 0.9 * normal.norm());
                outside += normal.norm() / 2;
            } else if (mesh.triangle_material[t] == 2) {
                ASSERT_NEAR(from_axis, size.bend - size.thickness / 2, 1e-12);
                ASSERT_LT(facing, -0.9 * normal.norm());
                inside += normal.norm() / 2;
            }
        }
        const double plan = size.width * size.height - M_PI * a * b;
        EXPECT_NEAR(outside / (plan * (1 + size.thickness / 2 / size.bend)), 1, 5 * error);
        EXPECT_NEAR(inside / (plan * (1 - size.thickness / 2 / size.bend)), 1, 5 * error);
    }
}

// A straight line along z through the defect meets no face; a line beside it meets two.
TEST(HerniaWall, TheDefectIsOpen) {
    const WallSize size;
    const Mesh mesh = make_hernia_wall(size, 2000);
    const auto hits = [&](double x, double y) {
        int count = 0;
        for (const Triangle& t : mesh.triangle) {
            int inside = 0;
            for (int k = 0; k < 3; ++k) {
                const Vec3d &a = mesh.position[t[k]], &b = mesh.position[t[(k + 1) % 3]];
                inside += (b.x() - a.x()) * (y - a.y()) - (b.y() - a.y()) * (x - a.x()) > 0 ? 1 : -1;
            }
            count += std::abs(inside) == 3;
        }
        return count;
    };
    EXPECT_EQ(hits(0.0001, 0.0002), 0);
    EXPECT_EQ(hits(0.0189, 0.0003), 0);
    EXPECT_EQ(hits(0.0301, 0.0003), 2);
    EXPECT_EQ(hits(0.0003, 0.0251), 2);
}

}  // namespace
}  // namespace trocar
