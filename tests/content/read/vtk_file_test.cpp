#include "content/read/vtk_file.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

std::string error_of(const std::string& bytes) { return load_error(bytes, "a.vtk"); }

const std::string kHead = "# vtk DataFile Version 3.0\nany title: BINARY POINTS\nASCII\nDATASET POLYDATA\n";
const std::string kPoints = "POINTS 4 float\n0 0 0 1 0 0\n0 1 0 0 0 1\n";
const std::string kPolygons = "POLYGONS 4 16\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

template <typename T>
void put(std::string& bytes, std::initializer_list<T> values) {
    for (const T value : values) {
        char raw[sizeof(T)];
        std::memcpy(raw, &value, sizeof(T));
        std::reverse(std::begin(raw), std::end(raw));
        bytes.append(raw, sizeof(T));
    }
}

TEST(VtkFile, parts_of_text) {
    expect_tetra(kHead + kPoints + kPolygons, "VTK ascii");
    expect_tetra(kHead + "FIELD FieldData 2\nTIME 1 1 double\n0.5\nmore 2 2 int\n1 2 3 4\n" + kPoints +
                     "METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\nVERTICES 1 2\n1 "
                     "0\nLINES 1 3\n2 0 1\n" +
                     kPolygons,
                 "VTK ascii");
    const LoadedMesh with_data =
        load_mesh(kHead + kPoints + kPolygons + "POINT_DATA 4\nSCALARS a float\nLOOKUP_TABLE default\n1 2 3 4\n", "a.vtk");
    EXPECT_TRUE(warns(with_data, "a.vtk:13: data of points and cells is passed over"));
    expect_tetra("# vtk DataFile Version 5.1\nvtk output\nASCII\nDATASET POLYDATA\n" + kPoints +
                     "POLYGONS 5 12\nOFFSETS vtktypeint64\n0 3 6 9 12\nCONNECTIVITY vtktypeint64\n0 2 1 0 1 3 1 2 3\n0 "
                     "3 2\n",
                 "VTK ascii");
    std::string bytes = kHead + kPoints + kPolygons;
    bytes.replace(bytes.find("float"), 5, "unsigned_char");
    expect_tetra(bytes, "VTK ascii");
    std::string precise = kHead + kPoints + kPolygons;
    precise.replace(precise.find("0 0 0 1"), 5, "0.1 1e-9 3");
    EXPECT_EQ(load_mesh(precise, "a.vtk").mesh.position[0], Vec3d(0.1, 1e-9, 3));
}

TEST(VtkFile, strips_turn_one_way) {
    const LoadedMesh loaded =
        load_mesh(kHead + "POINTS 5 double\n0 0 0 1 0 0 0 1 0 1 1 0 0 2 0\nTRIANGLE_STRIPS 1 6\n5 0 1 2 3 4\n", "a.vtk");
    ASSERT_EQ(loaded.mesh.triangle.size(), 3u);
    EXPECT_EQ(loaded.mesh.triangle[1], (Triangle{2, 1, 3}));
    EXPECT_EQ(loaded.mesh.triangle[2], (Triangle{2, 3, 4}));
    EXPECT_DOUBLE_EQ(sum_mesh(loaded.mesh).area, 1.5);
    EXPECT_EQ(sum_mesh(loaded.mesh).unpaired, 5u);  // only at the boundary
}

TEST(VtkFile, bytes_are_big_endian) {
    std::string head = kHead;
    head.replace(head.find("ASCII"), 5, "BINARY");
    std::string bytes = head + "POINTS 4 double\n";
    put<double>(bytes, {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1});
    bytes += "\nPOLYGONS 4 16\n";
    put<int32_t>(bytes, {3, 0, 2, 1, 3, 0, 1, 3, 3, 1, 2, 3, 3, 0, 3, 2});
    expect_tetra(bytes + "\n", "VTK binary");
    std::string newer = head + "FIELD FieldData 1\nTIME 1 1 double\n";
    put<double>(newer, {0.5});
    newer += "\nPOINTS 4 short\n";
    put<int16_t>(newer, {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1});
    newer += "\nPOLYGONS 5 12\nOFFSETS vtktypeint64\n";
    put<int64_t>(newer, {0, 3, 6, 9, 12});
    newer += "\nCONNECTIVITY vtktypeint64\n";
    put<int64_t>(newer, {0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2});
    expect_tetra(newer, "VTK binary");
    for (const std::string& whole : {bytes, newer}) {
        for (size_t size = 20; size < whole.size(); ++size) EXPECT_NE(error_of(whole.substr(0, size)), "no error") << size;
    }
}

// Version 5.1 with integers of every width, in both codings, and with keywords in any case.
TEST(VtkFile, every_type_of_integer_and_any_case) {
    const std::vector<int> first{0, 3, 6, 9, 12}, corner{0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2}, point{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    const auto list = [](const std::vector<int>& values, const std::string& type, bool binary) {
        std::string bytes;
        for (const int v : values) {
            if (!binary) {
                bytes += std::to_string(v) + " ";
            } else if (type.ends_with("64")) {
                type == "vtktypefloat64" ? put<double>(bytes, {double(v)}) : put<int64_t>(bytes, {v});
            } else if (type.ends_with("32")) {
                type == "vtktypefloat32" ? put<float>(bytes, {float(v)}) : put<int32_t>(bytes, {v});
            } else if (type.ends_with("16")) {
                put<int16_t>(bytes, {static_cast<int16_t>(v)});
            } else {
                put<int8_t>(bytes, {static_cast<int8_t>(v)});
            }
        }
        return bytes + "\n";
    };
    const auto in_case = [](std::string text, int how) {
        for (char& c : text) {
            const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
            if (letter && how == 1) c = static_cast<char>(c | 0x20);
            if (letter && how == 2) c = static_cast<char>(c & ~0x20);
        }
        return text;
    };
    for (const char* const integer : {"vtktypeint8", "vtktypeuint8", "vtktypeint16", "vtktypeuint16", "vtktypeint32", "vtktypeuint32",
                                      "vtktypeint64", "vtktypeuint64"}) {
        for (const char* const real : {"vtktypefloat32", "vtktypefloat64", "vtktypeint16"}) {
            for (const bool binary : {false, true}) {
                for (int how = 0; how < 3; ++how) {
                    const std::string type = integer;
                    expect_tetra(in_case("# vtk DataFile Version 5.1\n", how) + "t\n" + in_case(binary ? "BINARY\n" : "ASCII\n", how) +
                                     in_case("DATASET POLYDATA\nPOINTS 4 " + std::string(real) + "\n", how) + list(point, real, binary) +
                                     in_case("POLYGONS 5 12\nOFFSETS " + type + "\n", how) + list(first, type, binary) +
                                     in_case("CONNECTIVITY " + type + "\n", how) + list(corner, type, binary),
                                 binary ? "VTK binary" : "VTK ascii");
                }
            }
        }
    }
}

// Breaks when a list of one-byte entries is read as doubles, beyond its end.
TEST(VtkFile, corners_are_numbers) {
    std::string bytes = kHead;
    bytes.replace(bytes.find("ASCII"), 5, "BINARY");
    bytes += "POINTS 1 float\n";
    put<float>(bytes, {0, 0, 0});
    for (const char* type : {"string", "bit"}) {
        const std::string list = bytes + "\nPOLYGONS 2 3\nOFFSETS " + type + "\n" + std::string(2, '\0');
        EXPECT_NE(error_of(list).find("a list of corners that are no numbers"), std::string::npos) << error_of(list);
    }
}

TEST(VtkFile, what_is_wrong_is_said_with_its_place) {
    EXPECT_EQ(error_of("# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\n"),
              "a.vtk:4: DATASET 'UNSTRUCTURED_GRID' is not read, only POLYDATA");
    EXPECT_EQ(error_of(kHead + "POINTS 4000000 float\n0 0 0\n"),
              "a.vtk:5: a number of points 4000000: the file has room for no more than 11");
    EXPECT_EQ(error_of(kHead + kPoints + "POLYGONS 2 4\n3 0 1 2\n"), "a.vtk:9: cell 1 runs beyond its list of 4 numbers");
    EXPECT_EQ(error_of(kHead + kPoints + "POLYGONS 1 4\n3 0 1 7\n"), "a.vtk: polygon 0 (from 0) has corner 7 when there are 4 points");
    EXPECT_EQ(error_of(kHead + "POINTS 1 float\n0 inf 0\n"), "a.vtk:6: point 0 has a coordinate that is not a finite number");
    EXPECT_EQ(error_of(kHead + kPoints + "OFFSETS\n"), "a.vtk:8: expected POINTS, POLYGONS or another part of POLYDATA, found 'OFFSETS'");
    EXPECT_EQ(error_of(kHead + kPoints + "POLYGONS 2 3\nOFFSETS vtktypeint64\n0 4\nCONNECTIVITY vtktypeint64\n0 1 2\n"),
              "a.vtk:12: cell 0 begins or ends outside its list of corners");
    const std::string whole = kHead + kPoints + kPolygons;
    for (size_t size = 20; size + 2 < whole.size(); ++size) EXPECT_NE(error_of(whole.substr(0, size)), "no error") << size;
}

}  // namespace
}  // namespace trocar
