#include "content/read/off_file.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

std::string error_of(const std::string& bytes) { return load_error(bytes, "a.off"); }

const std::string kTetra = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

TEST(OffFile, headers_comments_and_colours) {
    expect_tetra("OFF\n4 4 6\n" + kTetra, "OFF");
    expect_tetra("OFF 4 4 0\n" + kTetra, "OFF");
    expect_tetra("# by hand\nOFF # three\r\n# a\r\n4 4 6 # counts\r\n\r\n" + kTetra, "OFF");
    expect_tetra(
        "COFF\n4 4 6\n0 0 0 255 0 0 255\n1 0 0 255 0 0 255 # red\n0 1 0 .1 .2 .3 1\n0 0 1 0 0 0 1\n"
        "3 0 2 1 255 0 0\n3 0 1 3\n3 1 2 3 0.1 0.2 0.3\n3 0 3 2 7\n",
        "OFF");
    const LoadedMesh textured =
        load_mesh("STCNOFF\n3 1 0\n0 0 0 0 0 1 1 1 1 1 .25 .5\n1 0 0 0 0 1 1 1 1 1 1 0\n0 1 0 0 0 1 1 1 1 1 0 1\n3 0 1 2\n", "a.off");
    ASSERT_EQ(textured.mesh.uv.size(), 1u);
    EXPECT_EQ(textured.mesh.uv[0][0].u, .25f);
    EXPECT_EQ(textured.mesh.uv[0][0].v, .5f);
}

TEST(OffFile, bytes_are_big_endian) {
    std::string bytes = "STNOFF BINARY\n";
    const auto put = [&](auto value) {
        char raw[4];
        std::memcpy(raw, &value, 4);
        std::reverse(std::begin(raw), std::end(raw));
        bytes.append(raw, 4);
    };
    for (const int n : {4, 4, 6}) put(n);
    constexpr float kPoints[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (const auto& p : kPoints) {
        for (const float c : p) put(c);
        for (int k = 0; k < 3; ++k) put(7.0f);
        put(0.5f);
        put(0.75f);
    }
    constexpr int kCorners[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
    for (const auto& c : kCorners) {
        put(3);
        for (const int v : c) put(v);
        put(2);
        put(1.0f);
        put(1.0f);
    }
    expect_tetra(bytes, "OFF binary");
    EXPECT_EQ(load_mesh(bytes, "a.off").mesh.uv[3][2].v, .75f);
    for (size_t size = 4; size < bytes.size(); ++size) EXPECT_NE(error_of(bytes.substr(0, size)), "no error") << size;
}

TEST(OffFile, what_is_wrong_is_said_with_its_place) {
    EXPECT_EQ(error_of("4OFF\n4 4 6\n" + kTetra), "a.off:1: only OFF files of three dimensions are read");
    EXPECT_EQ(error_of("OFF\n4 4 6\n" + kTetra.substr(0, 8) + "x" + kTetra.substr(9)), "a.off:4: expected a finite number, found 'x'");
    EXPECT_EQ(error_of("OFF\n4000000000 4 6\n" + kTetra),
              "a.off:2: a number of vertices 4000000000: the file has room for no more than 37");
    EXPECT_EQ(error_of("OFF\n4 4 6\n" + kTetra + "3 0 0 0\n"), "no error");
    EXPECT_EQ(error_of("OFF\n3 4 6\n" + kTetra.substr(6)), "a.off: polygon 1 (from 0) has corner 3 when there are 3 points");
    EXPECT_EQ(error_of("OFF\n4 4 6\n" + std::string(kTetra).replace(24, 7, "3 0 2.5 1")),
              "a.off:7: a corner that is no number of a vertex");
    const std::string whole = "OFF\n4 4 6\n" + kTetra;
    for (size_t size = 4; size + 2 < whole.size(); ++size) EXPECT_NE(error_of(whole.substr(0, size)), "no error") << size;
}

}  // namespace
}  // namespace trocar
