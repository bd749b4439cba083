#include "content/scene/make_prototype.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <limits>

#include "content/scene/build_scene.hpp"
#include "content/scene/scene_file.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

using namespace reference;

TEST(MakePrototype, ScalesRecentresAndReports) {
    Meshes meshes;
    Mesh soup = make_soup(make_box({100, 200, 300}, {110, 220, 330}));
    soup.position.push_back({0, 0, 0});  // unused: must affect neither box nor centroid
    PrototypeOptions options;
    options.scale = 1e-3;
    options.recentre = Recentre::kBoxCentre;
    const Prototype made = make_prototype(meshes, soup, options);
    ASSERT_EQ(made.row, 0u);
    EXPECT_EQ(made.judgement.admitted_as, Admission::kSolid);
    EXPECT_EQ(made.cleaning.unused_vertices, 1u);
    EXPECT_EQ(made.cleaning.welded_vertices, 28u);
    EXPECT_NEAR((made.shift - Vec3d(0.105, 0.210, 0.315)).norm(), 0, 1e-15);
    const MeshInfo& info = meshes.info[0];
    EXPECT_EQ(info.admission, Admission::kSolid);
    EXPECT_NEAR(info.volume, 6e-6, 1e-18);
    EXPECT_NEAR(info.radius, Vec3d(5e-3, 10e-3, 15e-3).norm(), 1e-15);
    EXPECT_NEAR((info.box.min + info.box.max).norm(), 0, 1e-15);
}

TEST(MakePrototype, VolumeCentroids) {
    // the centroid of a tetrahedron is a quarter of its corners' sum, also for a mesh far away
    Meshes meshes;
    PrototypeOptions options;
    options.recentre = Recentre::kVolumeCentroid;
    const Prototype made = make_prototype(meshes, make_tetrahedron({1e4, 0, 0}, 1), options);
    EXPECT_NEAR((made.shift - Vec3d(1e4 + 0.25, 0.25, 0.25)).norm(), 0, 1e-11);
    // a ball with an off-centre cavity: (R^3 * 0 - r^3 * c) / (R^3 - r^3)
    Mesh hollow = make_sphere({0, 0, 0}, 2, 4), inner = make_sphere({0.5, 0, 0}, 1, 4);
    turn_inside_out(inner);
    append(hollow, inner);
    EXPECT_NEAR((find_centroid(hollow) - Vec3d(-0.5 / 7, 0, 0)).norm(), 0, 1e-12);
    // open surfaces: the centroid of the area
    EXPECT_NEAR((find_centroid(make_sheet(3)) - Vec3d(0.5, 0.5, 0)).norm(), 0, 1e-15);
    Mesh tray = make_box({0, 0, 0}, {1, 1, 1});
    tray.triangle.erase(tray.triangle.begin() + 2, tray.triangle.begin() + 4);
    EXPECT_NEAR((find_centroid(tray) - Vec3d(0.5, 0.5, (4 * 0.5 + 0) / 5)).norm(), 0, 1e-15);
}

TEST(MakePrototype, G31_G36_RefusedMeshesAppendNothing) {
    Meshes meshes;
    Mesh bad = make_tetrahedron();
    bad.position[1].z() = std::numeric_limits<double>::quiet_NaN();
    PrototypeOptions options;
    options.recentre = Recentre::kVolumeCentroid;
    Prototype made = make_prototype(meshes, bad, options);
    EXPECT_EQ(made.row, kNone);
    EXPECT_EQ(made.judgement.reason, "vertex 1: coordinate is not finite");
    made = make_prototype(meshes, Mesh{}, options);
    EXPECT_EQ(made.row, kNone);
    EXPECT_EQ(made.judgement.reason, "no face");
    EXPECT_TRUE(meshes.info.empty());
    EXPECT_TRUE(meshes.position.empty());
}

// Per-face arrays of wrong size, and missing materials, are rejected with the array's name. Breaks when only
// positions and corners are checked: cleaning and ordering would then access memory past the end of the
// arrays.
TEST(MakePrototype, RowsThatDoNotFitAreRefused) {
    Meshes meshes;
    const Mesh good = make_tetrahedron();
    const auto reason = [&](const Mesh& mesh) {
        const Prototype made = make_prototype(meshes, mesh, {});
        EXPECT_EQ(made.row, kNone);
        return made.judgement.reason;
    };
    Mesh bad = good;
    bad.uv.resize(3);
    EXPECT_EQ(reason(bad), "3 rows of texture coordinates (uv) for 4 faces");
    bad = good;
    bad.triangle_material.assign(5, 0);
    EXPECT_EQ(reason(bad), "5 rows of triangle_material for 4 faces");
    bad.triangle_material = {0, 0, 1, 0};
    EXPECT_EQ(reason(bad), "face 2: names material 1 of 1");
    bad.material.resize(2);
    bad.material[1].image = {2, 2, std::vector<uint8_t>(15)};
    EXPECT_EQ(reason(bad), "material 1: image of 15 bytes is not 2 x 2 pixels");
    EXPECT_TRUE(meshes.info.empty());
    bad.material[1].image.rgba.resize(16);
    EXPECT_EQ(make_prototype(meshes, bad, {}).row, 0u);
}

// The same surface in another order of vertices and faces: same measures, same neighbourhoods in memory.
TEST(MakePrototype, OrdersForLocality) {
    Meshes meshes;
    Mesh m = make_sphere({0, 0, 0}, 1, 3);
    make_prototype(meshes, m, {});
    shuffle(m, 2);
    make_prototype(meshes, m, {});
    const MeshView a = mesh_view(meshes, 0), b = mesh_view(meshes, 1);
    for (size_t v = 0; v < a.position.size(); ++v) ASSERT_EQ(a.position[v], b.position[v]);
    EXPECT_NEAR(a.info->volume, b.info->volume, 1e-14);
}

// Bodies share a prototype only if everything that determines it is equal, however long their file names are
// and whatever those contain. Breaks when they are compared as truncated text.
TEST(Prototypes, FilesWithLongNamesAreNotTakenForEachOther) {
    namespace fs = std::filesystem;
    const fs::path top = fs::path(testing::TempDir()) / "long_names",
                   folder = top / std::string(200, 'a') / std::string(200, 'b') / std::string(200, 'c');
    fs::create_directories(folder);
    const std::string corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    std::ofstream(folder / "a.obj") << corners << "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
    std::ofstream(folder / "b.obj") << corners << "v 1 1 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 5\nf 3 4 5\nf 4 2 5\n";
    std::ofstream scene(top / "scene.toml");
    int number = 0;
    for (const char* body : {"a", "b", "b"}) {
        scene << "[[body]]\nname = \"" << body << ++number << "\"\nfile = \"" << (folder / body).string() << ".obj\"\n";
    }
    scene << "[[body]]\nname = \"half\"\nscale = 0.5\nfile = \"" << (folder / "b").string() << ".obj\"\n";
    scene.close();
    const World w = build_scene(read_scene_file(top / "scene.toml", {})).world;
    const auto triangles = [&](uint32_t body) { return w.meshes.info[w.bodies.mesh[body]].triangles.count; };
    EXPECT_EQ(triangles(0), 4u);
    EXPECT_EQ(triangles(1), 6u);
    EXPECT_EQ(w.bodies.mesh[1], w.bodies.mesh[2]);
    EXPECT_NEAR(w.meshes.info[w.bodies.mesh[3]].radius, 0.5 * w.meshes.info[w.bodies.mesh[1]].radius, 1e-9);
    fs::remove_all(top);
}

}  // namespace
}  // namespace trocar
