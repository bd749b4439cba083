#include "content/read/obj_file.hpp"

#include <gtest/gtest.h>

#include "engine/files/image_file.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

const std::string kTetra = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";

void expect_tetra(const std::string& text) {
    const LoadedMesh loaded = load_mesh(text, "a.obj");
    EXPECT_EQ(loaded.format, "OBJ");
    EXPECT_EQ(loaded.mesh.position.size(), 4u);
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_DOUBLE_EQ(sums.volume, 1.0 / 6);
    EXPECT_EQ(sums.unpaired, 0u);
}

std::string error_of(const std::string& text) {
    try {
        read_obj(text, "a.obj");
    } catch (const InputError& error) {
        return error.what();
    }
    return "no error";
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
    for (size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
        text.replace(at, from.size(), to);
    }
    return text;
}

TEST(ObjFile, S10_a_tetrahedron_in_all_spellings) {
    expect_tetra(kTetra);
    expect_tetra(replaced(kTetra, "\n", "\r\n"));
    expect_tetra(replaced(kTetra, "\n", "\r"));
    expect_tetra("\xef\xbb\xbf# comment\n\no thing\ng a b\ns off\n" + replaced(kTetra, " ", "  \t") + "l 1 2\np 1");
    expect_tetra(replaced(kTetra, "f 1 3 2\n", "f 1 \\\n 3\\\r\n 2 # end\n"));
    expect_tetra("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf -4 -2 -3\nf -4 -3 -1\nf -3 -2 -1\nf -4 -1 -2");
    // negative numbers count back from the vertices so far
    expect_tetra("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -1 -2\nv 0 0 1\nf 1 2 -1\nf 2 3 -1\nf 1 -1 3");
    expect_tetra(
        "v 0 0 0 1.0\nv 1 0 0 .5 .5 .5\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nvt 0 0\nf 1//1 3//-1 2//1\nf 1/1/1 2/-1/1 4/1/1\nf "
        "2/1 "
        "3/1 4/1\nf 1/ 4/ 3/\n");
}

TEST(ObjFile, numbers_are_read_to_double) {
    const LoadedMesh loaded = load_mesh("v 0.1 1e-7 123456.789012345678\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "a.obj");
    EXPECT_EQ(loaded.mesh.position[0], Vec3d(0.1, 1e-7, 123456.789012345678));
}

TEST(ObjFile, polygons_are_cut_by_ears) {
    const LoadedMesh loaded = load_mesh("v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 .5 0\nv 0 2 0\nv 9 9 9\nf 1 2 3 4 5\n", "a.obj");
    EXPECT_EQ(loaded.mesh.triangle.size(), 3u);
    EXPECT_EQ(loaded.mesh.position.size(), 5u);
    EXPECT_DOUBLE_EQ(sum_mesh(loaded.mesh).area, 2.5);
    EXPECT_TRUE(warns(load_mesh("v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n", "a.obj"), "cut as a fan"));
}

TEST(ObjFile, texture_coordinates_stay_with_their_corners) {
    const LoadedMesh loaded =
        load_mesh("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt .5\nvt .25 1 0\nf 1 2 4\nf 1/1 2/2 3/-1\nf 2 3 4\n", "a.obj");
    ASSERT_EQ(loaded.mesh.uv.size(), 3u);
    EXPECT_EQ(loaded.mesh.uv[0][2].v, 0);
    EXPECT_EQ(loaded.mesh.uv[1][1].u, .5f);
    EXPECT_EQ(loaded.mesh.uv[1][2].u, .25f);
    EXPECT_EQ(loaded.mesh.uv[1][2].v, 1);
}

struct ObjFiles : FolderTest {};

TEST_F(ObjFiles, materials_come_from_the_file_beside) {
    const Image image{1, 1, {9, 8, 7, 255}};
    save_png(image, put("skin 1.png", ""));
    put("two words.mtl",
        "newmtl red wine\nKd 1 0 0\nKs .5 .5 .5\nNs 64\nd .75\nmap_Kd -s 1 1 1 -clamp on skin 1.png\nnewmtl blue\nKd 0 "
        "0 1\nTr .5\nmap_Kd "
        "gone.png\nnewmtl bad\nKd nan 0 0\n");
    const LoadedMesh loaded =
        load_mesh(put("a.obj",
                      "mtllib two words.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nusemtl red wine\nf 1 2 4\nusemtl "
                      "blue\nf 2 3 4\nusemtl red wine\nf 1 4 3\nusemtl nobody\nf 1 2 3\n"));
    const Mesh& mesh = loaded.mesh;
    EXPECT_EQ(mesh.triangle_material, (std::vector<uint16_t>{0, 1, 2, 1, 3}));
    ASSERT_EQ(mesh.material.size(), 4u);
    EXPECT_EQ(mesh.material[0].diffuse, Material{}.diffuse);
    EXPECT_EQ(mesh.material[1].diffuse, (std::array<float, 3>{1, 0, 0}));
    EXPECT_EQ(mesh.material[1].specular, (std::array<float, 3>{.5f, .5f, .5f}));
    EXPECT_EQ(mesh.material[1].shininess, .5f);
    EXPECT_EQ(mesh.material[1].transparency, .25f);
    EXPECT_EQ(mesh.material[1].image.rgba, image.rgba);
    EXPECT_EQ(mesh.material[2].transparency, .5f);
    EXPECT_TRUE(warns(loaded, "a.obj:9: texture 'gone.png' is not read: there is no such file"));
    EXPECT_TRUE(warns(loaded, "material 'nobody' is not defined"));
    EXPECT_TRUE(warns(loaded, "two words.mtl:12: Kd needs 1 finite numbers, found 'nan'"));
    EXPECT_TRUE(warns(load_mesh(put("b.obj", "mtllib gone.mtl\n" + kTetra)),
                      "b.obj:1: material file 'gone.mtl' is not read: there is no such file"));
}

TEST(ObjFile, S09_errors_name_the_line) {
    const std::string points = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    EXPECT_EQ(error_of(points + "f 1 2 0\n"), "a.obj:4: vertex number 0: they count from 1");
    EXPECT_EQ(error_of(points + "f 1 2 4\n"), "a.obj:4: vertex number 4 when there are 3");
    EXPECT_EQ(error_of(points + "f 1 2 -4\n"), "a.obj:4: vertex number -4 when there are 3");
    EXPECT_EQ(error_of(points + "f 1 2 99999999999999999999\n"), "a.obj:4: vertex number 99999999999999999999 when there are 3");
    EXPECT_EQ(error_of(points + "\n\nf 1 2\n"), "a.obj:6: a face with 2 corners");
    EXPECT_EQ(error_of(points + "f 1/1 2 3\n"), "a.obj:4: texture coordinate number 1 when there are 0");
    EXPECT_EQ(error_of(points + "f 1//1 2 3\n"), "a.obj:4: normal number 1 when there are 0");
    EXPECT_EQ(error_of(points + "f 1 two 3\n"), "a.obj:4: expected the number of a vertex");
    EXPECT_EQ(error_of(points + "f 1 2.5 3\n"), "a.obj:4: a corner that is not v, v/vt, v//vn or v/vt/vn: '2.5'");
    EXPECT_EQ(error_of("v 0 0\n"), "a.obj:1: v needs 3 finite numbers, found 2");
    EXPECT_EQ(error_of("v 0 0 nan\n"), "a.obj:1: v needs 3 finite numbers, found 'nan'");
    EXPECT_EQ(error_of("v 0 1e999 1\n"), "a.obj:1: v needs 3 finite numbers, found '1e999'");
    EXPECT_EQ(error_of("v 0 \\\n 0 x\n"), "a.obj:1: v needs 3 finite numbers, found 'x'");
    EXPECT_EQ(error_of(points + "f 1 2 \\\n 3\nf 1 2\n"), "a.obj:6: a face with 2 corners");
    EXPECT_TRUE(warns(read_obj(points + "bevel on\nf 1 2 3", "a.obj"), "a.obj:4: lines that begin with 'bevel' are passed over"));
    EXPECT_THROW(load_mesh(points, "a.obj"), InputError);
}

}  // namespace
}  // namespace trocar
