#include "content/write/save_mesh.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <pugixml.hpp>

#include "engine/files/text_file.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

// Doubles that need all digits, three materials, an image shared by two of them.
Mesh make_mesh() {
    Mesh mesh;
    mesh.name = "a \"b\"\n#c";
    mesh.position = {{0.1, 1.0 / 3, -1e-300}, {123456789.123456789, 0, 5e-324}, {-0.0, 2e17, 1}, {1, 1.0000000000000002, 3}};
    mesh.triangle = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    mesh.triangle_material = {1, 0, 2, 1};
    mesh.uv.resize(4);
    for (size_t t = 0; t < 4; ++t) {
        for (size_t k = 0; k < 3; ++k) mesh.uv[t][k] = {0.1f * static_cast<float>(t), 1.0f / 3 * static_cast<float>(k)};
    }
    mesh.material.resize(3);
    mesh.material[0] = {"one", {0.1f, 0.2f, 0.3f}, {0.5f, 0.25f, 0}, 0.5f, 0.25f, "old.png", {2, 1, {1, 2, 3, 255, 4, 5, 6, 255}}};
    mesh.material[1] = {"two", {0.3f, 0.2f, 0.3f}, {0, 0, 0}, 0.25f, 0, "", {}};
    mesh.material[2] = mesh.material[0];
    mesh.material[2].diffuse[0] = 0.7f;
    return mesh;
}

void expect_same_positions(const Mesh& got, const Mesh& wanted) {
    ASSERT_EQ(got.position.size(), wanted.position.size());
    for (size_t v = 0; v < got.position.size(); ++v) {
        for (int c = 0; c < 3; ++c) EXPECT_EQ(got.position[v][c], wanted.position[v][c]) << v << " " << c;
    }
}

void expect_same_looks(const Mesh& got, const Mesh& wanted) {
    ASSERT_EQ(got.triangle.size(), wanted.triangle.size());
    ASSERT_EQ(got.uv.size(), wanted.uv.size());
    for (size_t t = 0; t < got.triangle.size(); ++t) {
        for (size_t k = 0; k < 3; ++k) {
            EXPECT_EQ(got.uv[t][k].u, wanted.uv[t][k].u);
            EXPECT_EQ(got.uv[t][k].v, wanted.uv[t][k].v);
        }
        const Material& a = got.material.at(got.triangle_material.at(t));
        const Material& b = wanted.material.at(wanted.triangle_material.at(t));
        EXPECT_EQ(a.diffuse, b.diffuse);
        EXPECT_EQ(a.specular, b.specular);
        EXPECT_EQ(a.shininess, b.shininess);
        EXPECT_EQ(a.transparency, b.transparency);
        EXPECT_EQ(a.image.rgba, b.image.rgba);
    }
}

// Compares the positions of corners, since readers may renumber vertices.
void expect_same_corners(const Mesh& got, const Mesh& wanted) {
    ASSERT_EQ(got.triangle.size(), wanted.triangle.size());
    for (size_t t = 0; t < got.triangle.size(); ++t) {
        for (size_t k = 0; k < 3; ++k) {
            const Vec3d &a = got.position[got.triangle[t][k]], &b = wanted.position[wanted.triangle[t][k]];
            for (int c = 0; c < 3; ++c) EXPECT_EQ(a[c], b[c]) << t;
        }
    }
}

struct SaveMesh : FolderTest {
    size_t entries() const {
        return static_cast<size_t>(std::distance(std::filesystem::directory_iterator(folder), std::filesystem::directory_iterator{}));
    }
};

TEST_F(SaveMesh, text_formats_read_back_to_the_same_doubles) {
    const Mesh mesh = make_mesh();
    save_mesh(mesh, folder / "a.obj");
    const LoadedMesh obj = load_mesh(folder / "a.obj");
    EXPECT_TRUE(obj.warnings.empty());
    expect_same_positions(obj.mesh, mesh);
    EXPECT_EQ(obj.mesh.triangle, mesh.triangle);
    expect_same_looks(obj.mesh, mesh);
    EXPECT_EQ(entries(), 3u);  // a.obj, a.mtl, a.png
    save_mesh(mesh, folder / "b.WRL");
    const LoadedMesh wrl = load_mesh(folder / "b.WRL");
    EXPECT_TRUE(wrl.warnings.empty()) << wrl.warnings[0];
    EXPECT_EQ(wrl.mesh.position.size(), mesh.position.size());
    expect_same_corners(wrl.mesh, mesh);
    expect_same_looks(wrl.mesh, mesh);
    EXPECT_EQ(entries(), 5u);  // b.WRL, b.png
}

TEST_F(SaveMesh, stl_rounds_to_float) {
    Mesh mesh = make_mesh();
    save_mesh(mesh, folder / "a.stl");
    EXPECT_EQ(std::filesystem::file_size(folder / "a.stl"), 84u + 4 * 50);
    const LoadedMesh loaded = load_mesh(folder / "a.stl");
    EXPECT_EQ(loaded.format, "STL binary");
    for (Vec3d& p : mesh.position) {
        for (int c = 0; c < 3; ++c) {
            // without the volatile, g++ 12.2 at -O2 drops the rounding of paired double -> float -> double
            // conversions
            const volatile float rounded = static_cast<float>(p[c]);
            p[c] = rounded;
        }
    }
    expect_same_corners(loaded.mesh, mesh);
    mesh.position[0][0] = 1e39;
    EXPECT_THROW(save_mesh(mesh, folder / "b.stl"), InputError);
    EXPECT_FALSE(std::filesystem::exists(folder / "b.stl"));
}

TEST_F(SaveMesh, ply_holds_doubles_and_texture_coordinates) {
    const Mesh mesh = make_mesh();
    save_mesh(mesh, folder / "a.ply");
    const std::string bytes = read_file_bytes(folder / "a.ply");
    const size_t body = bytes.find("end_header\n") + 11;
    EXPECT_NE(bytes.find("element vertex 4\n"), std::string::npos);
    EXPECT_NE(bytes.find("comment TextureFile a.png\n"), std::string::npos);
    ASSERT_EQ(bytes.size(), body + 4 * 24 + 4 * (1 + 12 + 1 + 24));
    double x;
    std::memcpy(&x, bytes.data() + body + 24, 8);
    EXPECT_EQ(x, mesh.position[1][0]);
    EXPECT_EQ(bytes[body + 96], 3);
    uint32_t corner;
    std::memcpy(&corner, bytes.data() + body + 96 + 1 + 4, 4);
    EXPECT_EQ(corner, 2u);
    const Mesh back = load_mesh(folder / "a.ply").mesh;
    expect_same_positions(back, mesh);
    EXPECT_EQ(back.triangle, mesh.triangle);
}

std::vector<double> numbers_of(const pugi::xml_node& array) {
    std::vector<double> numbers;
    const char* at = array.text().get();
    for (char* end; true; at = end) {
        const double value = std::strtod(at, &end);
        if (end == at) return numbers;
        numbers.push_back(value);
    }
}

TEST_F(SaveMesh, vtp_is_what_vtk_describes_and_reads_back_to_the_same_doubles) {
    Mesh mesh = make_mesh();
    for (const bool seam : {true, false}) {
        if (!seam) {
            for (size_t t = 0; t < 4; ++t) {
                for (size_t k = 0; k < 3; ++k) mesh.uv[t][k] = {0.1f * static_cast<float>(mesh.triangle[t][k]), 0.7f};
            }
        }
        save_mesh(mesh, folder / "a.vtp");
        pugi::xml_document document;
        ASSERT_TRUE(document.load_file((folder / "a.vtp").c_str()));
        const pugi::xml_node file = document.child("VTKFile");
        EXPECT_STREQ(file.attribute("type").value(), "PolyData");
        EXPECT_STREQ(file.attribute("byte_order").value(), "LittleEndian");
        const pugi::xml_node piece = file.child("PolyData").child("Piece");
        EXPECT_EQ(piece.attribute("NumberOfPoints").as_uint(), 4u);
        EXPECT_EQ(piece.attribute("NumberOfPolys").as_uint(), 4u);
        const auto array = [&](const char* group, const char* name) {
            return piece.child(group).find_child_by_attribute("DataArray", "Name", name);
        };
        Mesh back = mesh;
        const std::vector<double> points = numbers_of(array("Points", "Points"));
        ASSERT_EQ(points.size(), 12u);
        for (size_t v = 0; v < 4; ++v) back.position[v] = {points[3 * v], points[3 * v + 1], points[3 * v + 2]};
        expect_same_positions(back, mesh);
        const std::vector<double> corners = numbers_of(array("Polys", "connectivity"));
        ASSERT_EQ(corners.size(), 12u);
        for (size_t i = 0; i < 12; ++i) EXPECT_EQ(corners[i], mesh.triangle[i / 3][i % 3]);
        EXPECT_EQ(numbers_of(array("Polys", "offsets")), (std::vector<double>{3, 6, 9, 12}));
        EXPECT_EQ(numbers_of(array("CellData", "material")), (std::vector<double>{1, 0, 2, 1}));
        const std::vector<double> of_points = numbers_of(array("PointData", "TCoords"));
        const std::vector<double> of_faces = numbers_of(array("CellData", "texture_coordinates"));
        ASSERT_EQ(of_points.size(), seam ? 0u : 8u);
        ASSERT_EQ(of_faces.size(), seam ? 24u : 0u);
        for (size_t i = 0; i < 12; ++i) {
            const Vec2 uv = mesh.uv[i / 3][i % 3];
            const double* got = seam ? &of_faces[2 * i] : &of_points[2 * mesh.triangle[i / 3][i % 3]];
            EXPECT_EQ(static_cast<float>(got[0]), uv.u);
            EXPECT_EQ(static_cast<float>(got[1]), uv.v);
        }
    }
}

TEST_F(SaveMesh, a_plain_mesh_needs_one_file) {
    Mesh mesh = make_mesh();
    mesh.material.clear();
    mesh.triangle_material.clear();
    mesh.uv.clear();
    for (const char* name : {"a.obj", "a.stl", "a.ply", "a.wrl"}) save_mesh(mesh, folder / name);
    EXPECT_EQ(entries(), 4u);
    EXPECT_EQ(load_mesh(folder / "a.obj").mesh.triangle, mesh.triangle);
}

TEST_F(SaveMesh, nothing_is_left_when_it_fails) {
    const Mesh mesh = make_mesh();
    EXPECT_THROW(save_mesh(mesh, folder / "a.xyz"), InputError);
    EXPECT_THROW(save_mesh(mesh, folder / "absent" / "a.obj"), InputError);
    std::filesystem::create_symlink("/dev/full", folder / "a.obj");
    EXPECT_THROW(save_mesh(mesh, folder / "a.obj"), InputError);
    EXPECT_EQ(entries(), 1u);
    Mesh bad = mesh;
    bad.position[0][0] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(save_mesh(bad, folder / "b.obj"), InputError);
    EXPECT_EQ(entries(), 1u);
}

}  // namespace
}  // namespace trocar
