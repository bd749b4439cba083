#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

LoadedMesh load_geometry(const std::string& geometry) { return load_text("#VRML V2.0 utf8\nShape { geometry " + geometry + " }\n"); }

void expect_vector(const Vec3d& a, double x, double y, double z) {
    EXPECT_NEAR(a[0], x, 1e-12);
    EXPECT_NEAR(a[1], y, 1e-12);
    EXPECT_NEAR(a[2], z, 1e-12);
}

// Closed and outward: a box by default, a frustum, a slanted and a hanging prism.
TEST(Extrusion, straight_ones_have_the_volume_of_prisms) {
    const auto volume = [](const std::string& fields) {
        const LoadedMesh loaded = load_geometry("Extrusion { " + fields + " }");
        const MeshSums sums = sum_mesh(loaded.mesh);
        EXPECT_EQ(sums.unpaired, 0u) << fields;
        EXPECT_TRUE(loaded.warnings.empty()) << fields;
        return sums.volume;
    };
    EXPECT_NEAR(volume(""), 4, 1e-12);
    EXPECT_NEAR(volume("scale [1 1, 2 2]"), (4 + 16 + 8) / 3.0, 1e-12);
    EXPECT_NEAR(volume("spine [0 0 0, 0 -2 0]"), 8, 1e-12);
    EXPECT_NEAR(volume("spine [5 5 5, 6 7 8]"), 4 * std::sqrt(14.0), 1e-12);
    EXPECT_NEAR(volume("ccw FALSE"), -4, 1e-12);
    // concave caps
    EXPECT_NEAR(volume("crossSection [2 2, 2 0, 0 0, 0 2, 1 .5, 2 2]"), 2.5, 1e-12);
    // a repeated spine point produces flat sides there
    EXPECT_NEAR(sum_mesh(load_geometry("Extrusion { spine [0 0 0, 0 1 0, 0 1 0, 0 3 0] }").mesh).volume, 12, 1e-12);
    // caps close an open section; its missing side stays open
    const MeshSums open = sum_mesh(load_geometry("Extrusion { crossSection [0 1, 1 0, 0 -1] }").mesh);
    EXPECT_EQ(open.unpaired, 4u);
    EXPECT_NEAR(open.area, 2 * 1 + 2 * std::sqrt(2.0), 1e-12);
}

TEST(Extrusion, a_bent_tube_keeps_its_ends_square_to_the_spine) {
    const LoadedMesh loaded =
        load_geometry("Extrusion { crossSection [.1 .1, .1 -.1, -.1 -.1, -.1 .1, .1 .1] spine [0 0 0, 0 2 0, 2 2 0] }");
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_EQ(sums.unpaired, 0u);
    // the section at the corner is at 45 degrees and not stretched: its half width there is .1 / sqrt(2)
    const double half = .1 / std::sqrt(2.0);
    expect_vector(sums.min, -.1, 0, -.1);
    expect_vector(sums.max, 2, 2.1, .1);
    // two prismatoids between a square of .2 and one of .2 seen under 45 degrees, .2 deep
    const double arm = .2 * (.2 * 2 + 2 * half * 2) / 2;
    EXPECT_NEAR(sums.volume, 2 * arm, 1e-12);
}

TEST(Extrusion, a_ring_has_no_caps) {
    std::string spine;
    const int n = 24;
    for (int k = 0; k <= n; ++k) {
        const double a = 2 * std::numbers::pi * (k % n) / n;
        spine += std::to_string(std::cos(a)) + " 0 " + std::to_string(-std::sin(a)) + ", ";
    }
    const LoadedMesh loaded = load_geometry("Extrusion { crossSection [.1 .1, .1 -.1, -.1 -.1, -.1 .1, .1 .1] spine [" + spine + "] }");
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_EQ(loaded.mesh.triangle.size(), static_cast<size_t>(8 * n));
    EXPECT_EQ(sums.unpaired, 0u);
    // n wedges between squares on radii: height .2 times the ring between two regular polygons
    const double ring = n / 2.0 * std::sin(2 * std::numbers::pi / n) * (1.1 * 1.1 - .9 * .9);
    EXPECT_NEAR(std::abs(sums.volume), .2 * ring, 1e-5);  // the spine has six digits in the file
}

TEST(Extrusion, texture_runs_along_the_section_and_the_spine) {
    const LoadedMesh loaded = load_text(
        "#VRML V2.0 utf8\nShape { appearance Appearance { texture PixelTexture { image 1 1 1 255 } } geometry "
        "Extrusion "
        "{ crossSection [0 0, 3 0, 3 -1] spine [0 0 0, 0 1 0, 0 4 0] beginCap FALSE } }\n");
    ASSERT_EQ(loaded.mesh.uv.size(), 2u * 4 + 1);
    float u = 0, v = 0;
    for (size_t t = 0; t < loaded.mesh.uv.size(); ++t) {
        for (size_t k = 0; k < 3; ++k) {
            const Vec3d p = loaded.mesh.position[loaded.mesh.triangle[t][k]];
            const Vec2 uv = loaded.mesh.uv[t][k];
            const bool cap = t + 1 == loaded.mesh.uv.size();
            u = static_cast<float>(cap ? p[0] / 3 : (p[0] - p[2]) / 4);
            v = static_cast<float>(cap ? (p[2] + 1) / 3 : p[1] / 4);
            EXPECT_FLOAT_EQ(uv.u, u) << t;
            EXPECT_FLOAT_EQ(uv.v, v) << t;
        }
    }
}

TEST(ElevationGrid, heights_stand_on_their_places_facing_up) {
    const LoadedMesh loaded = load_geometry(
        "ElevationGrid { xDimension 3 zDimension 2 xSpacing .5 zSpacing 2 height [0 1 2, 3 4 5] color Color { color [1 "
        "0 "
        "0, 0 1 0] } colorPerVertex FALSE }");
    ASSERT_EQ(loaded.mesh.position.size(), 6u);
    ASSERT_EQ(loaded.mesh.triangle.size(), 4u);
    const MeshSums sums = sum_mesh(loaded.mesh);
    expect_vector(sums.min, 0, 0, 0);
    expect_vector(sums.max, 1, 5, 2);
    // a plane y = 2 x + 1.5 z over 1 by 2
    EXPECT_NEAR(sums.area, 2 * std::sqrt(1 + 4 + 2.25), 1e-12);
    for (const Triangle& t : loaded.mesh.triangle) {
        const Vec3d a = loaded.mesh.position[t[0]], u = loaded.mesh.position[t[1]] - a, v = loaded.mesh.position[t[2]] - a;
        EXPECT_GT(u[2] * v[0] - u[0] * v[2], 0);
        EXPECT_NEAR(a[1], 2 * a[0] + 1.5 * a[2], 1e-12);
    }
    EXPECT_EQ(loaded.mesh.triangle_material, (std::vector<uint16_t>{0, 0, 1, 1}));
    EXPECT_NE(error_of_text("#VRML V2.0 utf8\nShape { geometry ElevationGrid { xDimension 3 zDimension 2 height [0 1] } }")
                  .find("without a face"),
              std::string::npos);
}

TEST(X3dSets, triangles_fans_strips_and_quadrilaterals) {
    const std::string coord = "coord Coordinate { point [0 0 0, 1 0 0, 1 1 0, 0 1 0, 0 2 0, 1 2 0] }";
    const auto area = [&](const std::string& node) {
        const LoadedMesh loaded = load_geometry(node + " " + coord + " }");
        EXPECT_TRUE(loaded.warnings.empty()) << loaded.warnings[0];
        double z = 0;
        for (const Triangle& t : loaded.mesh.triangle) {
            const Vec3d a = loaded.mesh.position[t[0]], u = loaded.mesh.position[t[1]] - a, v = loaded.mesh.position[t[2]] - a;
            z += (u[0] * v[1] - u[1] * v[0]) / 2;
        }
        return z;  // negative where faces have the opposite orientation
    };
    EXPECT_DOUBLE_EQ(area("IndexedTriangleSet { index [0 1 2, 0 2 3]"), 1);
    EXPECT_DOUBLE_EQ(area("IndexedTriangleSet { ccw FALSE index [0 1 2, 0 2 3]"), -1);
    EXPECT_DOUBLE_EQ(area("TriangleSet {"), 0.5 - 0.5);  // the second triangle has the opposite orientation
    EXPECT_DOUBLE_EQ(sum_mesh(load_geometry("TriangleSet { " + coord + " }").mesh).area, 1);
    EXPECT_DOUBLE_EQ(area("IndexedTriangleFanSet { index [0 1 2 3 -1 3 2 5 4]"), 2);
    EXPECT_DOUBLE_EQ(area("TriangleFanSet { fanCount [4]"), 1);
    EXPECT_DOUBLE_EQ(area("IndexedTriangleStripSet { index [0 1 3 2 4 5 -1]"), 2);
    EXPECT_DOUBLE_EQ(area("TriangleStripSet { stripCount [3 3]"), 0.5 - 0.5);
    EXPECT_DOUBLE_EQ(sum_mesh(load_geometry("TriangleStripSet { stripCount [3 3] " + coord + " }").mesh).area, 1);
    EXPECT_DOUBLE_EQ(area("IndexedQuadSet { index [0 1 2 3, 3 2 5 4]"), 2);
    EXPECT_DOUBLE_EQ(area("QuadSet {"), 1);
    // counts beyond the points use the available points
    EXPECT_DOUBLE_EQ(area("TriangleFanSet { fanCount [4 1000000000 1e300 -7]"), 1);
    EXPECT_TRUE(warns(load_geometry("IndexedQuadSet { index [0 1 2 99, 0 1 2 3] " + coord + " }"),
                      "1 face dropped: a corner is not among the points"));
}

TEST(X3dSets, texture_coordinates_go_with_the_points) {
    const LoadedMesh loaded = load_geometry(
        "IndexedTriangleSet { index [2 0 1] coord Coordinate { point [0 0 0, 1 0 0, 0 1 0] } texCoord "
        "TextureCoordinate "
        "{ point [.1 0, .2 0, .3 0] } }");
    ASSERT_EQ(loaded.mesh.uv.size(), 1u);
    EXPECT_EQ(loaded.mesh.uv[0][0].u, .3f);
    EXPECT_EQ(loaded.mesh.uv[0][1].u, .1f);
}

TEST(MadeSurfaces, what_would_be_too_large_is_refused_before_it_is_made) {
    std::string spine, section;
    for (int k = 0; k < 6000; ++k) {
        spine += "0 " + std::to_string(k) + " 0 ";
        section += std::to_string(k) + " 0 ";
    }
    EXPECT_NE(error_of_text("#VRML V2.0 utf8\nShape { geometry Extrusion { spine [" + spine + "] crossSection [" + section + "] } }")
                  .find("more than the limit of 50000000 triangles"),
              std::string::npos);
}

}  // namespace
}  // namespace trocar
