#include "content/read/stl_file.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

constexpr float kCorners[4][9] = {
    {0, 0, 0, 0, 1, 0, 1, 0, 0}, {0, 0, 0, 1, 0, 0, 0, 0, 1}, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0, 0, 0, 1, 0, 1, 0}};

std::string binary_tetra(std::string header = "made by a test") {
    header.resize(80, '\0');
    std::string bytes = header + std::string("\4\0\0\0", 4);
    for (const auto& corner : kCorners) {
        bytes += std::string(12, '\0');
        bytes.append(reinterpret_cast<const char*>(corner), 36);
        bytes += std::string(2, '\xff');
    }
    return bytes;
}

std::string ascii_tetra() {
    std::string text = "solid any words facet\n";
    for (const auto& c : kCorners) {
        text += "facet normal 0 0 nan\n outer loop\n";
        for (int k = 0; k < 3; ++k) {
            text += "  vertex " + std::to_string(c[3 * k]) + " " + std::to_string(c[3 * k + 1]) + " " + std::to_string(c[3 * k + 2]) + "\n";
        }
        text += " endloop\nendfacet\n";
    }
    return text + "endsolid any words\n";
}

std::string error_of(const std::string& bytes, const std::string& name = "a.stl") { return load_error(bytes, name); }

TEST(StlFile, both_kinds_are_told_by_content) {
    expect_tetra(binary_tetra(), "STL binary");
    expect_tetra(binary_tetra("solid facet endsolid"), "STL binary");
    expect_tetra(binary_tetra("#VRML V1.0 ascii"), "STL binary");
    expect_tetra(ascii_tetra(), "STL ascii");
    std::string upper = ascii_tetra();
    for (char& c : upper) c = c >= 'a' && c <= 'z' ? static_cast<char>(c & ~0x20) : c == '\n' ? '\r' : c;
    expect_tetra(upper, "STL ascii");
    const LoadedMesh longer = load_mesh(binary_tetra() + "tail", "a.stl");
    EXPECT_EQ(longer.mesh.triangle.size(), 4u);
    EXPECT_TRUE(warns(longer, "bytes after the last facet"));
}

TEST(StlFile, ascii_is_read_to_double) {
    const LoadedMesh loaded =
        load_mesh("solid\nfacet normal 0 0 0 outer loop vertex 0.1 1e-9 3 vertex 1 0 0 vertex 0 1 0 endloop endfacet\nendsolid", "a.stl");
    EXPECT_EQ(loaded.mesh.position[0], Vec3d(0.1, 1e-9, 3));
    EXPECT_EQ(load_mesh(ascii_tetra() + ascii_tetra(), "a.stl").mesh.triangle.size(), 8u);
}

TEST(StlFile, S08_wrong_counts_are_refused_before_anything_is_allocated) {
    std::string bytes = binary_tetra();
    bytes.replace(80, 4, "\xff\xff\xff\xff");
    EXPECT_EQ(error_of(bytes), "a.stl: binary STL names 4294967295 facets but holds only 4");
    for (size_t size = 1; size < binary_tetra().size(); ++size) EXPECT_NE(error_of(binary_tetra().substr(0, size)), "no error") << size;
    EXPECT_EQ(error_of(binary_tetra().substr(0, 200)), "a.stl: binary STL names 4 facets but holds only 2");
}

// Programs that write the header first leave 0 in it.
TEST(StlFile, facets_after_a_count_of_zero_are_read) {
    for (uint32_t facets = 1; facets <= 24; ++facets) {
        std::string bytes(80, facets % 2 ? ' ' : 'v');
        if (facets % 3 == 0) bytes.replace(0, 5, "solid");
        bytes += std::string(4, '\0');
        double area = 0;
        for (uint32_t f = 0; f < facets; ++f) {
            const float side = 1 + static_cast<float>(f), corner[9] = {0, 0, side, side, 0, side, 0, 1, side};
            bytes += std::string(12, '\0');
            bytes.append(reinterpret_cast<const char*>(corner), 36);
            bytes += std::string(2, '\0');
            area += side / 2;
        }
        const LoadedMesh loaded = load_mesh(bytes, "a.STL");
        EXPECT_EQ(loaded.mesh.triangle.size(), facets);
        EXPECT_NEAR(sum_mesh(loaded.mesh).area, area, 1e-9);
        EXPECT_TRUE(warns(loaded, "the header names 0 facets; the " + std::to_string(facets) + " that follow it are read"));
        EXPECT_NE(error_of(bytes + "x"), "no error");  // then nothing says where the facets end
    }
    EXPECT_EQ(error_of(std::string(84, '\0')), "a.stl: STL binary without a face");
}

TEST(StlFile, bad_facets_are_refused_with_their_place) {
    std::string bytes = binary_tetra();
    const float bad = std::numeric_limits<float>::infinity();
    std::memcpy(bytes.data() + 84 + 2 * 50 + 20, &bad, 4);
    EXPECT_EQ(error_of(bytes), "a.stl: facet 2 has a coordinate that is not finite");
    std::string text = ascii_tetra();
    EXPECT_EQ(error_of(std::string(text).replace(text.find("0.000000 1.000000"), 3, "nan")),
              "a.stl:5: expected a finite number, found 'nan00000'");
    EXPECT_EQ(error_of(std::string(text).replace(text.find(" endloop"), 8, "vertex 1 2 3")),
              "a.stl:7: expected 'endloop' after three vertices, found 'vertex'");
    for (size_t size = 30; size + 11 < text.size(); ++size) EXPECT_NE(error_of(text.substr(0, size)), "no error") << size;
    EXPECT_EQ(error_of("solid x\nendsolid x\n"), "a.stl: STL ascii without a face");
}

}  // namespace
}  // namespace trocar
