#include "content/read/vtp_file.hpp"

#include <gtest/gtest.h>

#include "content/shapes/shape_library.hpp"
#include "content/write/save_mesh.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

std::string vtp_error(const std::string& bytes) { return load_error(bytes, "a.vtp"); }

std::string polydata(const std::string& pieces) {
    return "<?xml version='1.0'?>\n<VTKFile type='PolyData'><PolyData>" + pieces + "</PolyData></VTKFile>";
}

std::string array(const std::string& name, const std::string& numbers) {
    return "<DataArray Name='" + name + "' format='ascii'>" + numbers + "</DataArray>";
}

std::string piece(const std::string& points, const std::string& cells, size_t count = 4, size_t polygons = 4) {
    return "<Piece NumberOfPoints='" + std::to_string(count) + "' NumberOfPolys='" + std::to_string(polygons) + "'><Points>" +
           array("Points", points) + "</Points>" + cells + "</Piece>";
}

const std::string kPoints = "0 0 0 1 0 0\n0 1 0 0 0 1";
const std::string kPolys = "<Polys>" + array("connectivity", "0 2 1 0 1 3 1 2 3 0 3 2") + array("offsets", "3 6 9 12") + "</Polys>";

struct VtpFile : FolderTest {};

TEST_F(VtpFile, what_we_write_comes_back) {
    for (const char* name :
         {"liver", "kidney", "gallbladder", "stomach", "bowel", "hernia_wall", "surgical_mesh", "needle", "probe", "sphere"}) {
        for (const uint64_t seed : {1u, 2u}) {
            Mesh mesh = make_shape(name, 600, seed);
            if (seed == 2) mesh.uv.clear();
            mesh.material.resize(3);
            mesh.triangle_material.clear();
            for (size_t t = 0; t < mesh.triangle.size(); ++t) mesh.triangle_material.push_back(static_cast<uint16_t>((t / 7) % 3));
            save_mesh(mesh, folder / "a.vtp");
            const LoadedMesh back = load_mesh(folder / "a.vtp");
            EXPECT_EQ(back.format, "VTP");
            EXPECT_TRUE(back.warnings.empty());
            ASSERT_EQ(back.mesh.triangle, mesh.triangle) << name;
            EXPECT_EQ(back.mesh.position, mesh.position) << name;
            EXPECT_EQ(back.mesh.triangle_material, mesh.triangle_material) << name;
            ASSERT_EQ(back.mesh.uv.size(), mesh.uv.size()) << name;
            for (size_t t = 0; t < mesh.uv.size(); ++t) {
                for (size_t k = 0; k < 3; ++k) {
                    ASSERT_EQ(back.mesh.uv[t][k].u, mesh.uv[t][k].u);
                    ASSERT_EQ(back.mesh.uv[t][k].v, mesh.uv[t][k].v);
                }
            }
        }
    }
}

TEST_F(VtpFile, pieces_polygons_and_strips) {
    expect_tetra(polydata(piece(kPoints, kPolys)), "VTP");
    expect_tetra("<!-- note -->\n" + polydata(piece(kPoints, kPolys)), "VTP");
    const LoadedMesh two = load_mesh(polydata(piece(kPoints, kPolys) + piece("5 0 0 7 0 0 5 2 0 5 0 2", kPolys)), "a.vtp");
    EXPECT_NEAR(sum_mesh(two.mesh).volume, 1.0 / 6 + 8.0 / 6, 1e-12);
    const LoadedMesh strip =
        load_mesh(polydata(piece("0 0 0 1 0 0 0 1 0 1 1 0 0 2 0",
                                 "<Strips>" + array("connectivity", "0 1 2 3 4") + array("offsets", "5") + "</Strips>", 5, 0)),
                  "a.vtp");
    EXPECT_EQ(strip.mesh.triangle, (std::vector<Triangle>{{0, 1, 2}, {2, 1, 3}, {2, 3, 4}}));
    const LoadedMesh square = load_mesh(
        polydata(piece("0 0 0 1 0 0 1 1 0 0 1 0", "<Polys>" + array("connectivity", "0 1 2 3") + array("offsets", "4") + "</Polys>", 4, 1)),
        "a.vtp");
    EXPECT_EQ(square.mesh.triangle.size(), 2u);
    EXPECT_NEAR(sum_mesh(square.mesh).area, 1, 1e-12);
}

TEST_F(VtpFile, what_is_wrong_is_said) {
    EXPECT_EQ(vtp_error("<VTKFile type='ImageData'/>"), "a.vtp: VTKFile of type 'ImageData' is not read, only PolyData");
    EXPECT_EQ(vtp_error(polydata("")), "a.vtp: VTP without a face");
    EXPECT_EQ(vtp_error(polydata(piece("0 0 0 1 0 0", kPolys))), "a.vtp: a piece has 6 coordinates for 4 points");
    EXPECT_EQ(vtp_error(polydata(piece(kPoints, kPolys, 4, 5))), "a.vtp: a piece has 4 polygons where it names 5");
    EXPECT_EQ(vtp_error(polydata(piece("0 0 0 1 nan 0 0 1 0 0 0 1", kPolys))), "a.vtp: array 'Points': number 4 is not finite");
    const auto polys = [](const std::string& corners, const std::string& ends) {
        return polydata(piece(kPoints, "<Polys>" + array("connectivity", corners) + array("offsets", ends) + "</Polys>", 4, 1));
    };
    EXPECT_EQ(vtp_error(polys("0 1 7", "3")), "a.vtp: a corner is not a whole number below 4");
    EXPECT_EQ(vtp_error(polys("0 1 -1", "3")), "a.vtp: a corner is not a whole number below 4");
    EXPECT_EQ(vtp_error(polys("0 1 2", "4")), "a.vtp: an offset is not a whole number below 4");
    EXPECT_EQ(vtp_error(polydata("<Piece NumberOfPoints='1'><Points><DataArray Name='Points' format='appended'/></Points></Piece>")),
              "a.vtp: array 'Points' is stored as appended; only ascii is read");
    const std::string whole = polydata(piece(kPoints, kPolys));
    for (size_t size = 1; size < whole.size(); ++size) EXPECT_NE(vtp_error(whole.substr(0, size)), "no error") << size;
}

}  // namespace
}  // namespace trocar
