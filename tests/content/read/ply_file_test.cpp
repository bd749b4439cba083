#include "content/read/ply_file.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "engine/files/image_file.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

std::string error_of(const std::string& bytes) { return load_error(bytes, "a.ply"); }

const std::string kVertices = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n";
const std::string kFaces = "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";
const std::string kHead =
    "ply\nformat ascii 1.0\ncomment by hand\nobj_info x\nelement vertex 4\nproperty float x\nproperty float y\n"
    "property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n";

template <typename T>
void put(std::string& bytes, T value, bool big) {
    char raw[sizeof(T)];
    std::memcpy(raw, &value, sizeof(T));
    if (big) std::reverse(std::begin(raw), std::end(raw));
    bytes.append(raw, sizeof(T));
}

// A tetrahedron with the given types of coordinates, counts and corners, surrounded by an element and
// properties to skip.
template <typename Coordinate, typename Count, typename Corner>
std::string binary_tetra(const char* coordinate, const char* count, const char* corner, bool big, const std::string& line_end = "\n") {
    const std::string head = std::string("ply\nformat binary_") + (big ? "big" : "little") +
                             "_endian 1.0\nelement camera 2\nproperty list uint16 double range\nelement vertex 4\nproperty short quality\n"
                             "property " +
                             coordinate + " z\nproperty " + coordinate + " y\nproperty uchar flag\nproperty " + coordinate +
                             " x\nelement face 4\nproperty list char short other\nproperty list " + count + " " + corner +
                             " vertex_index\nend_header\n";
    std::string bytes;
    for (const char c : head) {
        if (c == '\n')
            bytes += line_end;
        else
            bytes += c;
    }
    put<uint16_t>(bytes, 2, big);
    put<double>(bytes, 1, big);
    put<double>(bytes, 2, big);
    put<uint16_t>(bytes, 0, big);
    constexpr int kPoints[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (const auto& p : kPoints) {
        put<int16_t>(bytes, -7, big);
        put<Coordinate>(bytes, static_cast<Coordinate>(p[2]), big);
        put<Coordinate>(bytes, static_cast<Coordinate>(p[1]), big);
        put<uint8_t>(bytes, 255, big);
        put<Coordinate>(bytes, static_cast<Coordinate>(p[0]), big);
    }
    constexpr int kCorners[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    for (const auto& c : kCorners) {
        put<int8_t>(bytes, 1, big);
        put<int16_t>(bytes, 9, big);
        put<Count>(bytes, 3, big);
        for (const int v : c) put<Corner>(bytes, static_cast<Corner>(v), big);
    }
    return bytes;
}

TEST(PlyFile, text_and_bytes_of_either_order_give_the_same) {
    expect_tetra(kHead + kVertices + kFaces, "PLY ascii");
    std::string carriage;
    for (const char c : kHead + kVertices + kFaces) carriage += c == '\n' ? std::string("\r\n") : std::string(1, c);
    expect_tetra(carriage, "PLY ascii");
    for (const bool big : {false, true}) {
        expect_tetra((binary_tetra<float, uint8_t, int32_t>("float", "uchar", "int", big)), "PLY binary");
        expect_tetra((binary_tetra<double, uint32_t, uint8_t>("float64", "uint32", "uint8", big)), "PLY binary");
        expect_tetra((binary_tetra<int8_t, int16_t, uint16_t>("int8", "short", "ushort", big)), "PLY binary");
        expect_tetra((binary_tetra<int32_t, int32_t, double>("int", "int32", "double", big)), "PLY binary");
        expect_tetra((binary_tetra<float, uint8_t, int32_t>("float", "uchar", "int", big, "\r\n")), "PLY binary");
        expect_tetra((binary_tetra<float, uint8_t, int32_t>("float", "uchar", "int", big, "\r")), "PLY binary");
    }
}

// Breaks when the byte after a header with CR line ends is taken for the second half of a line end.
TEST(PlyFile, data_may_begin_with_a_line_feed) {
    std::string bytes =
        "ply\rformat binary_big_endian 1.0\relement other 1\rproperty uchar a\relement vertex 3\rproperty uchar "
        "x\rproperty uchar y\rproperty uchar z\relement face 1\rproperty list uchar uchar vertex_index\rend_header\r";
    for (const int byte : {10, 0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2}) bytes += static_cast<char>(byte);
    EXPECT_DOUBLE_EQ(sum_mesh(load_mesh(bytes, "a.ply").mesh).area, 0.5);
}

TEST(PlyFile, text_is_read_to_double) {
    std::string text = kHead + "0.1 1e-9 3\n" + kVertices.substr(6) + kFaces;
    EXPECT_EQ(load_mesh(text, "a.ply").mesh.position[0], Vec3d(0.1, 1e-9, 3));
}

TEST(PlyFile, polygons_and_strips) {
    const std::string points = "ply\nformat ascii 1.0\nelement vertex 5\nproperty double x\nproperty double y\nproperty double z\n";
    const LoadedMesh concave = load_mesh(points +
                                             "element face 2\nproperty list int int vertex_index\nend_header\n"
                                             "0 0 0 2 0 0 2 2 0 1 .5 0 0 2 0\n5 0 1 2 3 4\n2 0 1\n",
                                         "a.ply");
    EXPECT_DOUBLE_EQ(sum_mesh(concave.mesh).area, 2.5);
    EXPECT_TRUE(warns(concave, "1 polygons dropped: fewer than three corners"));
    // two strips; the first contains a repeated corner
    const LoadedMesh strips = load_mesh(points +
                                            "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
                                            "0 0 0 1 0 0 0 1 0 1 1 0 0 2 0\n9 0 1 2 3 3 4 -1 0 1\n",
                                        "a.ply");
    ASSERT_EQ(strips.mesh.triangle.size(), 2u);
    EXPECT_EQ(strips.mesh.triangle[0], (Triangle{0, 1, 2}));
    EXPECT_EQ(strips.mesh.triangle[1], (Triangle{2, 1, 3}));
}

struct PlyFiles : FolderTest {};

TEST_F(PlyFiles, texture_coordinates_of_vertices_and_of_corners) {
    save_png(Image{1, 1, {9, 8, 7, 255}}, put("a b.png", ""));
    std::string head = kHead;
    head.replace(head.find("comment by hand"), 15, "comment TextureFile a b.png");
    std::string by_vertex = head;
    by_vertex.replace(by_vertex.find("element face"), 0, "property float s\nproperty float t\n");
    const LoadedMesh vertex = load_mesh(put("v.ply", by_vertex + "0 0 0 .5 .25\n1 0 0 1 0\n0 1 0 0 1\n0 0 1 nan 1\n" + kFaces));
    ASSERT_EQ(vertex.mesh.uv.size(), 4u);
    EXPECT_EQ(vertex.mesh.uv[0][0].u, .5f);
    EXPECT_EQ(vertex.mesh.uv[0][0].v, .25f);
    EXPECT_EQ(vertex.mesh.uv[1][2].v, 0);  // NaN is replaced
    EXPECT_EQ(vertex.mesh.material[0].image.rgba, (std::vector<uint8_t>{9, 8, 7, 255}));
    std::string by_corner = head;
    by_corner.replace(by_corner.find("end_header"), 0, "property list uchar float texcoord\n");
    const LoadedMesh corner = load_mesh(put("c.ply", by_corner + kVertices +
                                                         "3 0 2 1 6 .1 .2 .3 .4 .5 .6\n3 0 1 3 0\n3 1 2 3 0\n"
                                                         "3 0 3 2 2 1 1\n"));
    ASSERT_EQ(corner.mesh.uv.size(), 4u);
    EXPECT_EQ(corner.mesh.uv[0][2].u, .5f);
    EXPECT_EQ(corner.mesh.uv[0][2].v, .6f);
    EXPECT_EQ(corner.mesh.uv[3][0].u, 1);
}

TEST(PlyFile, what_is_wrong_is_said_with_its_place) {
    const auto changed = [](const std::string& from, const std::string& to) {
        std::string text = kHead + kVertices + kFaces;
        return text.replace(text.find(from), from.size(), to);
    };
    EXPECT_EQ(error_of(changed("3 1 2 3", "3 1 2 9")), "a.ply: polygon 2 (from 0) has corner 9 when there are 4 points");
    EXPECT_EQ(error_of(changed("3 1 2 3", "3 1 2 -1")), "a.ply:18: a corner that is no number of a vertex");
    EXPECT_EQ(error_of(changed("3 1 2 3", "300 1 2 3")), "a.ply:18: a list that is longer than the file");
    EXPECT_EQ(error_of(changed("3 1 2 3", "-3 1 2 3")), "a.ply:18: a list of 'vertex_indices' without a whole count");
    EXPECT_EQ(error_of(changed("1 0 0", "1 nan 0")), "a.ply:13: a coordinate that is not finite");
    EXPECT_EQ(error_of(changed("1 0 0", "1 zero 0")), "a.ply:13: a coordinate that is not finite");
    EXPECT_EQ(error_of(changed("vertex 4", "vertex 400000000")),
              "a.ply:12: the header names 400000000 rows of 'vertex', the file has room for no more than 9");
    EXPECT_EQ(error_of(changed("float x", "floot x")), "a.ply:6: unknown type 'floot' of a property");
    EXPECT_EQ(error_of(changed("float x", "float w")), "a.ply:12: the vertices have no x, y and z");
    EXPECT_EQ(error_of(changed("ascii", "ebcdic")), "a.ply:2: unknown format 'ebcdic'");
    EXPECT_TRUE(
        warns(load_mesh(changed("obj_info", "Created by"), "a.ply"), "a.ply:4: unknown line 'Created' in the header is passed over"));
    EXPECT_EQ(error_of(changed("end_header", "end")), "a.ply:20: the file ends before end_header");
    const std::string whole = binary_tetra<float, uint8_t, int32_t>("float", "uchar", "int", true);
    EXPECT_EQ(error_of(whole.substr(0, whole.size() - 1)), "a.ply: face 3: the file ends here");
    for (size_t size = 4; size < whole.size(); ++size) EXPECT_NE(error_of(whole.substr(0, size)), "no error") << size;
    const std::string text = kHead + kVertices + kFaces;
    for (size_t size = 4; size + 2 < text.size(); ++size) EXPECT_NE(error_of(text.substr(0, size)), "no error") << size;
}

}  // namespace
}  // namespace trocar
