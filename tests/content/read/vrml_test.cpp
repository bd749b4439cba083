#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>

#include "content/read/vrml/lexer.hpp"
#include "content/read/vrml/parser.hpp"
#include "content/text/number_text.hpp"
#include "content/text/polygon.hpp"
#include "engine/files/image_file.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

using vrml::Lexer;
using vrml::next_token;
using vrml::Token;
using vrml::TokenKind;

const std::string kTetra = "point [ 0 0 0, 1 0 0, 0 1 0, 0 0 1 ]";
const std::string kTetraFaces = "coordIndex [ 0,2,1,-1, 0,1,3,-1, 1,2,3,-1, 0,3,2,-1 ]";
const std::string kOldTetra = "Coordinate3 { " + kTetra + " } IndexedFaceSet { " + kTetraFaces + " }";
const std::string kNewTetra = "Shape { geometry IndexedFaceSet { coord Coordinate { " + kTetra + " } " + kTetraFaces + " } }";

std::string old_file(const std::string& body) { return "#VRML V1.0 ascii\nSeparator { " + body + " }\n"; }
std::string new_file(const std::string& body) { return "#VRML V2.0 utf8\n" + body + "\n"; }

void expect_near(const Vec3d& a, double x, double y, double z, double tolerance = 1e-12) {
    EXPECT_NEAR(a[0], x, tolerance);
    EXPECT_NEAR(a[1], y, tolerance);
    EXPECT_NEAR(a[2], z, tolerance);
}

void expect_tetra(const std::string& text) {
    const LoadedMesh loaded = load_text(text);
    EXPECT_EQ(loaded.mesh.position.size(), 4u) << text;
    EXPECT_EQ(loaded.mesh.triangle.size(), 4u) << text;
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_DOUBLE_EQ(sums.volume, 1.0 / 6) << text;
    EXPECT_EQ(sums.unpaired, 0u) << text;
}

// --- numbers and tokens

TEST(VrmlLexer, numbers_are_the_nearest_doubles) {
    uint64_t random = 1;
    const auto next = [&random] { return random = random * 6364136223846793005u + 1442695040888963407u; };
    for (int i = 0; i < 200000; ++i) {
        char text[64];
        const uint64_t bits = next();
        double value;
        std::memcpy(&value, &bits, 8);
        if (!std::isfinite(value)) continue;
        const int digits = static_cast<int>(next() >> 33) % 20;
        // random bits, and ordinary values that take the fast path
        if (i % 2 == 0) value = static_cast<double>(static_cast<int64_t>(next())) * 1e-15;
        std::snprintf(text, sizeof text, i % 3 == 0 ? "%.*f" : "%.*g", digits, std::abs(value) < 1e30 ? value : 1.5);
        const double expected = std::strtod(text, nullptr);
        double got = 0;
        const char* const end = parse_number(text, text + std::strlen(text), got);
        ASSERT_EQ(end, text + std::strlen(text)) << text;
        ASSERT_EQ(std::memcmp(&got, &expected, 8), 0) << text;
    }
}

TEST(VrmlLexer, odd_numbers) {
    for (const auto& [text, value] : {std::pair<const char*, double>{"+1.5", 1.5},
                                      {".5", 0.5},
                                      {"5.", 5},
                                      {"-.5e1", -5},
                                      {"1e-400", 0},
                                      {"0.1", 0.1},
                                      {"123456789012345678901234567890", 1.2345678901234568e29},
                                      {"1E+2", 100},
                                      {"9007199254740993", 9007199254740992.0},
                                      {"1e23", 1e23}}) {
        double got = -1;
        EXPECT_EQ(parse_number(text, text + std::strlen(text), got), text + std::strlen(text)) << text;
        EXPECT_EQ(got, value) << text;
    }
    double got = 0;
    const std::string_view rest = "1e5x", none = "-x";
    EXPECT_EQ(parse_number(rest.data(), rest.data() + rest.size(), got), rest.data() + 3);
    EXPECT_EQ(parse_number(none.data(), none.data() + none.size(), got), nullptr);
    const std::string_view large = "1e999";
    parse_number(large.data(), large.data() + large.size(), got);
    EXPECT_TRUE(std::isinf(got));
}

std::string tokens_of(const std::string& text) {
    Lexer lexer{text, 0};
    std::string out;
    for (Token t = next_token(lexer); t.kind != TokenKind::kEnd; t = next_token(lexer)) {
        if (t.kind == TokenKind::kNumber) {
            char number[40];
            std::snprintf(number, sizeof number, "%.17g", t.number);
            out += std::string("n:") + number;
        } else if (t.kind == TokenKind::kString) {
            out += "s:" + vrml::unescape(text.substr(t.offset, t.length));
        } else {
            out += text.substr(t.offset, t.length);
        }
        out += "|";
    }
    return out;
}

TEST(VrmlLexer, comments_end_tokens_wherever_they_stand) {
    EXPECT_EQ(tokens_of("1 2]#p7\n3"), "n:1|n:2|]|n:3|");
    EXPECT_EQ(tokens_of("0,#p0\r4#x\n,,5"), "n:0|n:4|n:5|");
    EXPECT_EQ(tokens_of("-1#end\n0,4"), "n:-1|n:0|n:4|");
    EXPECT_EQ(tokens_of("Sep{#c\r\n}"), "Sep|{|}|");
    EXPECT_EQ(tokens_of("\"a # b\"#c"), "s:a # b|");
}

TEST(VrmlLexer, words_strings_and_hexadecimal) {
    EXPECT_EQ(tokens_of("filename ../a.png 0xFF 0x1f 2nd"), "filename|../a.png|n:255|n:31|2nd|");
    EXPECT_EQ(tokens_of(R"("say \"hi\" \\ \n" x)"), R"(s:say "hi" \ \n|x|)");
    EXPECT_EQ(tokens_of("1.5-2.25+3"), "n:1.5|n:-2.25|n:3|");
    EXPECT_EQ(tokens_of("nan -inf Infinity"), "n:nan|n:nan|n:nan|");
    EXPECT_EQ(tokens_of("1.#QNAN 2"), "n:nan|n:2|");
    EXPECT_EQ(tokens_of("info nancy"), "info|nancy|");
    EXPECT_EQ(tokens_of(""), "");
}

TEST(VrmlLexer, places_count_all_line_ends) {
    const std::string text = "ab\ncd\r\nef\rgh";
    EXPECT_EQ(vrml::find_text_position(text, 0).line, 1u);
    EXPECT_EQ(vrml::find_text_position(text, 4).line, 2u);
    EXPECT_EQ(vrml::find_text_position(text, 4).column, 2u);
    EXPECT_EQ(vrml::find_text_position(text, 7).line, 3u);
    EXPECT_EQ(vrml::find_text_position(text, 7).column, 1u);
    EXPECT_EQ(vrml::find_text_position(text, 11).line, 4u);
    EXPECT_EQ(vrml::find_text_position(text, 11).column, 2u);
}

// --- polygons

// Breaks when ears overlap, leave the polygon or have the wrong orientation.
void expect_cover(const std::vector<Vec3d>& corners, double area, bool simple = true) {
    PolygonScratch scratch;
    std::vector<Triangle> cut;
    EXPECT_EQ(triangulate_polygon(corners, scratch, cut), simple);
    ASSERT_EQ(cut.size(), corners.size() - 2);
    Mesh mesh;
    mesh.position = corners;
    mesh.triangle = cut;
    EXPECT_NEAR(sum_mesh(mesh).area, area, 1e-9 * area);
    Vec3d vector_area = Vec3d::Zero();
    for (const Triangle& t : cut) {
        const Vec3d u = corners[t[1]] - corners[t[0]], v = corners[t[2]] - corners[t[0]];
        vector_area += Vec3d(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) / 2;
    }
    EXPECT_NEAR(vector_area.norm(), area, 1e-9 * area);
}

TEST(Polygon, cuts_cover_exactly_the_polygon) {
    expect_cover({{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {0, 2, 0}}, 4);
    expect_cover({{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {1, .5, 0}, {0, 2, 0}}, 2.5);
    // an arrow head that must not be fanned from its first corner
    expect_cover({{0, 0, 0}, {1, 1, 0}, {0, 4, 0}, {-1, 1, 0}}, 4);
    expect_cover({{1, 1, 0}, {0, 4, 0}, {-1, 1, 0}, {0, 2, 0}}, 2);
    // corners on straight edges
    expect_cover({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 1, 0}, {2, 2, 0}, {1, 2, 0}, {0, 2, 0}, {0, 1, 0}}, 4);
}

TEST(Polygon, combs_spirals_and_far_places) {
    for (const double offset : {0.0, 1e7}) {
        for (const int axis : {0, 1, 2}) {
            std::vector<Vec3d> comb;
            const auto add = [&](double u, double v) {
                Vec3d p = Vec3d::Constant(offset);
                p[axis] += u;
                p[(axis + 1) % 3] += v;
                comb.push_back(p);
            };
            const int teeth = 50;
            add(0, 0);
            add(2 * teeth, 0);
            for (int k = teeth; k-- > 0;) {
                add(2 * k + 1, 8);
                add(2 * k, 1);
            }
            // base of height 0..1 with teeth on it
            PolygonScratch scratch;
            std::vector<Triangle> cut;
            EXPECT_TRUE(triangulate_polygon(comb, scratch, cut));
            ASSERT_EQ(cut.size(), comb.size() - 2);
            double shoelace = 0;
            for (size_t k = 0; k < comb.size(); ++k) {
                const Vec3d a = comb[k] - comb[0], b = comb[(k + 1) % comb.size()] - comb[0];
                shoelace += a[axis] * b[(axis + 1) % 3] - a[(axis + 1) % 3] * b[axis];
            }
            expect_cover(comb, std::abs(shoelace) / 2);
        }
    }
    std::vector<Vec3d> spiral;
    for (int k = 0; k <= 400; ++k) spiral.push_back({(1 + .01 * k) * std::cos(.1 * k), (1 + .01 * k) * std::sin(.1 * k), 0});
    for (int k = 400; k >= 0; --k) {
        spiral.push_back({(1.2 + .01 * k) * std::cos(.1 * k), (1.2 + .01 * k) * std::sin(.1 * k), 0});
    }
    double shoelace = 0;
    for (size_t k = 0; k < spiral.size(); ++k) {
        const Vec3d &a = spiral[k], &b = spiral[(k + 1) % spiral.size()];
        shoelace += a[0] * b[1] - a[1] * b[0];
    }
    expect_cover(spiral, std::abs(shoelace) / 2);
}

TEST(Polygon, what_cannot_be_cut_is_fanned_and_said) {
    PolygonScratch scratch;
    std::vector<Triangle> cut;
    const std::vector<Vec3d> bow_tie{{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 2, 0}};
    const std::vector<Vec3d> flat{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}};
    std::vector<Vec3d> star;  // goes round twice
    for (int k = 0; k < 5; ++k) star.push_back({std::cos(k * 0.8 * std::numbers::pi), std::sin(k * 0.8 * std::numbers::pi), 0});
    for (const auto& corners : {bow_tie, flat, star}) {
        cut.clear();
        EXPECT_FALSE(triangulate_polygon(corners, scratch, cut));
        EXPECT_EQ(cut.size(), corners.size() - 2);
    }
}

// --- whole files

// Figure 3.3 of the thesis. Point 6 belongs to no wall.
TEST(Vrml, thesis_figure_3_3) {
    const LoadedMesh loaded = load_text(
        "#VRML V1.0 ascii\n"
        "\n"
        "Separator {\n"
        "  PointLight {\n"
        "    location 1 1 1\n"
        "  }\n"
        "  Coordinate3 {\n"
        "    point [ -1 0 -1,#p0 these are vertex primitives x,y,z\n"
        "            -1 0 1,#p1\n"
        "            1 0 1,#p2\n"
        "            1 0 -1,#p3\n"
        "            -1 2 -1,#p4\n"
        "            -1 2 1,#p5\n"
        "            1 2 1,#p6\n"
        "            1 2 -1]#p7\n"
        "  }\n"
        "  IndexedFaceSet {\n"
        "    coordIndex [ 0,1,2,3,#The floor\n"
        "                -1,#end of coord for the floor\n"
        "                0,4,5,1,#The back side\n"
        "                -1,#end of coords for back side\n"
        "                0,3,7,4,#the left side\n"
        "                -1]#end of coords for left side\n"
        "  }\n"
        "}\n");
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_EQ(loaded.mesh.position.size() + loaded.unused_points, 8u);
    EXPECT_EQ(loaded.unused_points, 1u);
    EXPECT_EQ(loaded.mesh.triangle.size(), 6u);
    EXPECT_DOUBLE_EQ(sums.area, 12);
    expect_near(sums.min, -1, 0, -1, 0);
    expect_near(sums.max, 1, 2, 1, 0);
    EXPECT_GT(sums.unpaired, 0u);
    EXPECT_TRUE(loaded.warnings.empty());
    EXPECT_EQ(loaded.format, "VRML 1.0");
    EXPECT_EQ(loaded.mesh.name, "a");
}

TEST(Vrml, both_versions_whatever_the_header_says) {
    for (const char* header :
         {"#VRML V1.0 ascii\n", "#VRML V2.0 utf8\n", "#vrml v1.0 ascii\r\n", "\xef\xbb\xbf#VRML V2.0 utf8\r", "", "# a comment\n"}) {
        expect_tetra(header + ("Separator { " + kOldTetra + " }"));
        expect_tetra(header + kNewTetra);
    }
    EXPECT_TRUE(warns(load_text("#VRML V2.0 utf8\nSeparator { " + kOldTetra + " }"), "the header says VRML97"));
    EXPECT_TRUE(warns(load_text("#VRML V1.0 ascii\n" + kNewTetra), "the header says VRML 1.0"));
    EXPECT_TRUE(warns(load_text(kNewTetra), "no VRML header; read as VRML97"));
    EXPECT_TRUE(load_text(new_file(kNewTetra)).warnings.empty());
    std::string carriage = old_file(kOldTetra);
    for (char& c : carriage) c = c == '\n' ? '\r' : c;
    expect_tetra(carriage);
}

TEST(Vrml, a_missing_last_minus_one_is_closed) {
    expect_tetra(old_file("Coordinate3 { " + kTetra + " } IndexedFaceSet { coordIndex [ 0,2,1,-1,0,1,3,-1,1,2,3,-1,0,3,2 ] }"));
}

TEST(Vrml, concave_polygons_keep_their_area) {
    const std::string points = "point[0 0 0,2 0 0,2 2 0,1 .5 0,0 2 0]";
    const LoadedMesh loaded = load_text(old_file("Coordinate3{" + points + "}IndexedFaceSet{coordIndex[0,1,2,3,4]}"));
    EXPECT_EQ(loaded.mesh.triangle.size(), 3u);
    EXPECT_DOUBLE_EQ(sum_mesh(loaded.mesh).area, 2.5);
    const LoadedMesh bad = load_text(old_file("Coordinate3{" + points + "}IndexedFaceSet{coordIndex[0,2,1,4,-1]}"));
    EXPECT_TRUE(warns(bad, "1 polygon cut as a fan"));
}

TEST(Vrml, transforms_of_version_1_accumulate_and_separators_restore) {
    const std::string point = "Coordinate3 { point [1 2 3, 4 2 3, 1 5 3] } IndexedFaceSet { coordIndex [0 1 2 -1] }";
    const auto first = [&](const std::string& before) { return load_text(old_file(before + point)).mesh.position[0]; };
    expect_near(first("Translation { translation 10 20 30 } Scale { scaleFactor 2 3 4 }"), 12, 26, 42);
    expect_near(first("Scale { scaleFactor 2 3 4 } Translation { translation 10 20 30 }"), 22, 66, 132);
    expect_near(first("Rotation { rotation 0 0 1 1.5707963267948966 }"), -2, 1, 3);
    expect_near(first("MatrixTransform { matrix 2 0 0 0 0 3 0 0 0 0 4 0 10 20 30 1 }"), 12, 26, 42);
    // row vector times matrix: x is mapped to y
    expect_near(first("MatrixTransform { matrix 0 1 0 0 -1 0 0 0 0 0 1 0 0 0 0 1 }"), -2, 1, 3);
    expect_near(first("Separator { Translation { translation 9 9 9 } }"), 1, 2, 3);
    expect_near(first("TransformSeparator { Translation { translation 9 9 9 } }"), 1, 2, 3);
    expect_near(first("Group { Translation { translation 9 9 9 } }"), 10, 11, 12);
    expect_near(first("Transform { translation 1 0 0 scaleFactor 2 2 2 center 1 2 3 rotation 0 0 1 3.141592653589793 }"), 2, 2, 3);
    // scaled only along the line x = y: (1, 2, 3) has 1.5 along it, in each of x and y
    expect_near(first("Transform { scaleFactor 2 1 1 scaleOrientation 0 0 1 0.7853981633974483 }"), 2.5, 3.5, 3);
    expect_near(first("TransformSeparator { Coordinate3 { point [7 7 7, 8 7 7, 7 8 7] } } IndexedFaceSet { coordIndex "
                      "[0 1 2] } "),
                7, 7, 7);
}

TEST(Vrml, transforms_of_version_2_nest) {
    const LoadedMesh loaded =
        load_text(new_file("Transform { translation 10 0 0 children Transform { rotation 0 0 1 1.5707963267948966 scale 2 2 2 "
                           "children [ " +
                           kNewTetra + " ] } } Transform { translation 5 5 5 } " + kNewTetra));
    ASSERT_EQ(loaded.mesh.position.size(), 8u);
    expect_near(loaded.mesh.position[0], 10, 0, 0);
    const MeshSums sums = sum_mesh(loaded.mesh);
    expect_near(sums.min, 0, 0, 0);
    expect_near(sums.max, 10, 2, 2);
    EXPECT_NEAR(sums.volume, 9.0 / 6, 1e-12);
}

// Breaks when a mirrored or clockwise face set stays inside out.
TEST(Vrml, surfaces_face_outwards_after_mirrors_and_clockwise_faces) {
    EXPECT_NEAR(sum_mesh(load_text(old_file("Scale { scaleFactor -1 1 1 } " + kOldTetra)).mesh).volume, 1.0 / 6, 1e-15);
    EXPECT_NEAR(sum_mesh(load_text(old_file("ShapeHints { vertexOrdering CLOCKWISE } " + kOldTetra)).mesh).volume, -1.0 / 6, 1e-15);
    std::string clockwise = new_file(kNewTetra);
    clockwise.replace(clockwise.find("coordIndex"), 0, "ccw FALSE ");
    EXPECT_NEAR(sum_mesh(load_text(clockwise).mesh).volume, -1.0 / 6, 1e-15);
}

TEST(Vrml, def_and_use_share_nodes_and_state) {
    const LoadedMesh old_use = load_text(old_file("DEF S Separator { " + kOldTetra + " } Translation { translation 5 0 0 } USE S"));
    EXPECT_EQ(old_use.mesh.position.size(), 8u);
    EXPECT_EQ(sum_mesh(old_use.mesh).max[0], 6);
    expect_tetra(old_file("Switch { DEF 3rd Coordinate3 { " + kTetra + " } } USE 3rd IndexedFaceSet { " + kTetraFaces + " }"));
    const LoadedMesh new_use = load_text(new_file(
        "Group { children [ DEF S Shape { geometry DEF G IndexedFaceSet { coord DEF C Coordinate { " + kTetra + " } " + kTetraFaces +
        " } } Transform { translation 0 7 0 children Shape { geometry USE G } } Transform { translation 0 0 9 "
        "children USE S } ] }"));
    EXPECT_EQ(new_use.mesh.triangle.size(), 12u);
    EXPECT_TRUE(warns(load_text(old_file("USE Nope " + kOldTetra)), "USE of 'Nope', which no DEF before it names"));
    EXPECT_EQ(error_of_text(old_file("DEF A Group { USE A }")), "a.wrl:2:31: USE of 'A' inside itself (in Separator > Group)");
}

TEST(Vrml, switches_and_levels) {
    const std::string shapes = kOldTetra + " Separator { Translation { translation 3 0 0 } " + kOldTetra + " }";
    EXPECT_NE(error_of_text(old_file("Switch { " + shapes + " }")).find("without a face"), std::string::npos);
    // children: Coordinate3, IndexedFaceSet, Separator
    EXPECT_EQ(sum_mesh(load_text(old_file("Switch { whichChild 2 " + shapes + " }")).mesh).min[0], 3);
    EXPECT_EQ(load_text(old_file("Switch { whichChild -3 " + shapes + " }")).mesh.triangle.size(), 8u);
    expect_tetra(old_file("LOD { range [5] Separator { " + kOldTetra + " } Cube {} }"));
    expect_tetra(new_file("LOD { level [ " + kNewTetra + " Shape { geometry Box {} } ] }"));
    expect_tetra(new_file("Switch { whichChoice 1 choice [ Group {} " + kNewTetra + " ] }"));
    expect_tetra(new_file("Switch { choice " + kNewTetra + " } " + kNewTetra));
}

TEST(Vrml, unknown_nodes_and_fields_are_passed_over_with_one_warning_each) {
    const LoadedMesh loaded =
        load_text(old_file("FooNode { fields [SFFloat a, MFVec3f b] a 1 b [1 2 3, 4 5 6] } BarNode { x 1 Cube {} } BarNode { } "
                           "Separator { myField [ 1 [ 2 ] \"three\" Four { five 6 } ] other TRUE } Separator { myField 3 } " +
                           kOldTetra));
    EXPECT_EQ(loaded.mesh.triangle.size(), 4u);
    EXPECT_TRUE(warns(loaded, "2:13: unknown node FooNode is passed over"));
    EXPECT_TRUE(warns(loaded, "unknown node BarNode"));
    EXPECT_TRUE(warns(loaded, "unknown field Separator.myField"));
    EXPECT_TRUE(warns(loaded, "unknown field Separator.other"));
    EXPECT_TRUE(warns(loaded, "unknown node Four"));
    EXPECT_EQ(loaded.warnings.size(), 5u);
    expect_tetra(old_file("Coordinate3 { " + kTetra +
                          " } MyFaces { fields [ MFString isA, MFLong coordIndex ] isA [ "
                          "\"IndexedFaceSet\" ] " +
                          kTetraFaces + " }"));
}

TEST(Vrml, scripts_routes_and_prototypes) {
    const LoadedMesh loaded =
        load_text(new_file("PROTO Organ [ field SFColor col 1 0 0 field MFVec3f pts [] exposedField SFVec3f translation 0 0 0 eventIn "
                           "SFBool on ]\n"
                           "{ Transform { translation IS translation children Shape { appearance Appearance { material Material { "
                           "diffuseColor IS col } }\n"
                           "  geometry IndexedFaceSet { coord Coordinate { point IS pts } " +
                           kTetraFaces +
                           " } } } TimeSensor {} }\n"
                           "EXTERNPROTO Far [ field SFColor col eventOut SFTime t ] [ \"absent.wrl#Far\" ]\n"
                           "Organ { col 0 1 0 pts [0 0 0,1 0 0,0 1 0,0 0 1] translation 7 0 0 }\n"
                           "DEF T TimeSensor { cycleInterval 2 } DEF P PositionInterpolator { key [0 1] keyValue [0 0 0 1 1 1] }\n"
                           "ROUTE T.fraction_changed TO P.set_fraction\n"
                           "Script { url \"javascript: function f(){}\" eventIn SFBool f field SFInt32 a 0x1F field SFNode n USE T "
                           "eventOut SFBool g IS on }\n"
                           "Group { children [ Organ { pts [0 0 0,2 0 0,0 2 0,0 0 2] } Far { col 1 1 1 } ] }"));
    EXPECT_EQ(loaded.mesh.triangle.size(), 8u);
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_NEAR(sums.volume, 9.0 / 6, 1e-12);
    EXPECT_EQ(sums.max[0], 8);
    ASSERT_EQ(loaded.mesh.material.size(), 2u);
    EXPECT_EQ(loaded.mesh.material[0].diffuse, (std::array<float, 3>{0, 1, 0}));
    EXPECT_EQ(loaded.mesh.material[1].diffuse, (std::array<float, 3>{1, 0, 0}));
    EXPECT_TRUE(warns(loaded, "file 'absent.wrl' is not read: there is no such file"));
    EXPECT_NE(error_of_text(new_file("PROTO A [] { Group { children A {} } } A {}")).find("prototypes nested deeper than the limit"),
              std::string::npos);
    // known from its declaration on
    EXPECT_NE(error_of_text(new_file("PROTO A [] { B {} } PROTO B [] { A {} } A {}")).find("unknown node B is passed over"),
              std::string::npos);
}

TEST(Vrml, materials_by_face) {
    const std::string colours = "Material { diffuseColor [1 0 0, 0 1 0] shininess 0.5 } ";
    const auto rows = [&](const std::string& before, const std::string& inside) {
        return load_text(old_file(colours + before + "Coordinate3 { " + kTetra + " } IndexedFaceSet { " + kTetraFaces + inside + " }"));
    };
    EXPECT_EQ(rows("", "").mesh.material.size(), 1u);
    EXPECT_TRUE(rows("", "").mesh.triangle_material.empty());
    const LoadedMesh by_face = rows("MaterialBinding { value PER_FACE } ", "");
    EXPECT_EQ(by_face.mesh.triangle_material, (std::vector<uint16_t>{0, 1, 0, 1}));
    EXPECT_EQ(by_face.mesh.material[1].diffuse, (std::array<float, 3>{0, 1, 0}));
    EXPECT_EQ(by_face.mesh.material[1].shininess, 0.5f);
    const LoadedMesh indexed = rows("MaterialBinding { value PER_FACE_INDEXED } ", " materialIndex [1,1,0,1]");
    EXPECT_EQ(indexed.mesh.triangle_material, (std::vector<uint16_t>{0, 0, 1, 0}));
    EXPECT_EQ(indexed.mesh.material[0].diffuse, (std::array<float, 3>{0, 1, 0}));
    std::string colour = new_file(kNewTetra);
    colour.replace(colour.find("coordIndex"), 0, "color Color { color [1 0 0,0 1 0,0 0 1] } colorPerVertex FALSE colorIndex [2 1 1 0] ");
    const LoadedMesh coloured = load_text(colour);
    EXPECT_EQ(coloured.mesh.triangle_material, (std::vector<uint16_t>{0, 1, 1, 2}));
    EXPECT_EQ(coloured.mesh.material[0].diffuse, (std::array<float, 3>{0, 0, 1}));
}

TEST(Vrml, texture_coordinates_follow_their_own_index) {
    const std::string uv = "point [0 0, 1 0, 0 1, .25 .5]";
    const LoadedMesh own = load_text(old_file("TextureCoordinate2 { " + uv + " } Coordinate3 { " + kTetra + " } IndexedFaceSet { " +
                                              kTetraFaces + " textureCoordIndex [3,2,1,-1,0,1,3,-1,1,2,3,-1,0,3,2,-1] }"));
    ASSERT_EQ(own.mesh.uv.size(), 4u);
    EXPECT_EQ(own.mesh.uv[0][0].u, .25f);
    EXPECT_EQ(own.mesh.uv[0][0].v, .5f);
    EXPECT_EQ(own.mesh.uv[0][1].v, 1);
    std::string same = new_file(kNewTetra);
    same.replace(same.find("coordIndex"), 0, "texCoord TextureCoordinate { " + uv + " } ");
    EXPECT_EQ(load_text(same).mesh.uv[1][2].u, .25f);
    std::string moved = same;
    moved.replace(moved.find("Shape {") + 7, 0,
                  " appearance Appearance { textureTransform TextureTransform { scale 2 4 translation 1 0 center .5 .5 } } ");
    // -C S C T: 2 (.25 + 1 + .5) - .5
    EXPECT_FLOAT_EQ(load_text(moved).mesh.uv[1][2].u, 3.0f);
    EXPECT_FLOAT_EQ(load_text(moved).mesh.uv[1][2].v, 3.5f);
    std::string outside = same;
    outside.replace(outside.find("texCoord "), 0, "texCoordIndex [0 9 1 -1 0] ");
    EXPECT_TRUE(warns(load_text(outside), "corners without a texture coordinate"));
}

struct VrmlFiles : FolderTest {};

TEST_F(VrmlFiles, textures_lie_beside_the_file) {
    const Image image{2, 1, {1, 2, 3, 255, 4, 5, 6, 255}};
    save_png(image, put("skin/a.png", ""));
    const LoadedMesh old_file_loaded = load_mesh(put("a.wrl", old_file("Texture2 { filename skin/a.png } " + kOldTetra)));
    ASSERT_EQ(old_file_loaded.mesh.material.size(), 1u);
    EXPECT_EQ(old_file_loaded.mesh.material[0].image.rgba, image.rgba);
    EXPECT_EQ(old_file_loaded.mesh.material[0].texture, "skin/a.png");
    ASSERT_EQ(old_file_loaded.mesh.uv.size(), 4u);  // computed from the box
    EXPECT_EQ(old_file_loaded.mesh.uv[0][1].v, 1);
    std::string text = new_file(kNewTetra);
    text.replace(text.find("Shape {") + 7, 0, " appearance Appearance { texture ImageTexture { url [\"skin\\\\a.png\" \"b\"] } } ");
    EXPECT_EQ(load_mesh(put("b.wrl", text)).mesh.material[0].image.width, 2u);
    const LoadedMesh missing = load_mesh(put("c.wrl", old_file("Texture2 { filename \"gone.png\" } " + kOldTetra)));
    EXPECT_TRUE(warns(missing, "c.wrl:2:33: texture 'gone.png' is not read: there is no such file"));
    put("bad.png", "no picture");
    EXPECT_TRUE(warns(load_mesh(put("d.wrl", old_file("Texture2 { filename bad.png } " + kOldTetra))), "texture not used"));
    const LoadedMesh pixels = load_text(old_file("Texture2 { image 1 2 3 0xFF0000 0x00FF00 } " + kOldTetra));
    EXPECT_EQ(pixels.mesh.material[0].image.rgba, (std::vector<uint8_t>{0, 255, 0, 255, 255, 0, 0, 255}));
}

TEST_F(VrmlFiles, inlines_stay_below_the_folder) {
    put("parts/t.wrl", old_file("Translation { translation 4 0 0 } " + kOldTetra));
    put("outside.wrl", old_file(kOldTetra));
    const LoadedMesh loaded =
        load_mesh(put("parts/a.wrl", old_file("WWWInline { name \"t.wrl\" } WWWInline { name \"../outside.wrl\" } " + kOldTetra)));
    EXPECT_EQ(loaded.mesh.triangle.size(), 8u);
    EXPECT_EQ(sum_mesh(loaded.mesh).max[0], 5);
    EXPECT_TRUE(warns(loaded, "it lies outside the folder of the file that names it"));
    const LoadedMesh by_url = load_mesh(put("b.wrl", new_file("Transform { scale 2 2 2 children Inline { url \"parts/t.wrl\" } }")));
    EXPECT_EQ(sum_mesh(by_url.mesh).max[0], 10);
    put("self.wrl", old_file("Cube {} WWWInline { name \"self.wrl\" }"));
    EXPECT_THROW(load_mesh(folder / "self.wrl"), InputError);
}

TEST(Vrml, primitives_are_closed_and_have_their_size) {
    const auto volume = [](const std::string& node) {
        const LoadedMesh loaded = load_text(old_file(node));
        const MeshSums sums = sum_mesh(loaded.mesh);
        EXPECT_EQ(sums.unpaired, 0u) << node;
        EXPECT_TRUE(loaded.warnings.empty()) << node;
        return sums.volume;
    };
    const double ring = 16 * std::sin(std::numbers::pi / 16);  // area of a regular 32-gon, radius 1
    EXPECT_NEAR(volume("Cube { width 1 height 2 depth 3 }"), 6, 1e-12);
    EXPECT_NEAR(volume("Cylinder { radius 2 height 3 }"), 12 * ring, 1e-12);
    EXPECT_NEAR(volume("Cone { bottomRadius 2 height 3 }"), 4 * ring, 1e-12);
    // layers between similar polygons: h / 3 (A + B + sqrt(A B))
    double layers = 0;
    for (int k = 0; k < 16; ++k) {
        const double upper = std::numbers::pi * k / 16, lower = std::numbers::pi * (k + 1) / 16;
        const double r = 2 * std::sin(upper), q = 2 * std::sin(lower);
        layers += ring * (2 * std::cos(upper) - 2 * std::cos(lower)) / 3 * (r * r + q * q + r * q);
    }
    EXPECT_NEAR(volume("Sphere { radius 2 }"), layers, 1e-12);
    EXPECT_EQ(load_text(new_file("Shape { geometry Cylinder { top FALSE } }")).mesh.triangle.size(), 96u);
    EXPECT_EQ(load_text(old_file("Cylinder { parts (SIDES | TOP) }")).mesh.triangle.size(), 96u);
    EXPECT_NEAR(sum_mesh(load_text(new_file("Shape { geometry Box { size 1 2 3 } }")).mesh).volume, 6, 1e-12);
}

TEST(Vrml, faces_with_corners_outside_the_points_are_dropped_and_counted) {
    for (const char* index : {"-5", "4", "2000", "99999999999999999999", "1.5", "nan", "0x7fffffff"}) {
        const LoadedMesh loaded = load_text(old_file("Coordinate3 { " + kTetra + " } IndexedFaceSet { coordIndex [0 1 2 -1 0 1 " +
                                                     std::string(index) + " -1 0 2 3 -1 1 2 -1] }"));
        EXPECT_EQ(loaded.mesh.triangle.size(), 2u) << index;
        EXPECT_TRUE(warns(loaded, "1 face dropped: a corner is not among the points (first at a.wrl:2:108)")) << loaded.warnings[0];
        EXPECT_TRUE(warns(loaded, "1 face dropped: fewer than three corners"));
    }
}

TEST(Vrml, points_that_are_not_finite_are_refused_with_their_place) {
    for (const char* bad : {"nan", "inf", "-Infinity", "1e999", "-1e400", "1.#QNAN"}) {
        const std::string error = error_of_text("#VRML V1.0 ascii\nSeparator { Coordinate3 { point [ 0 0 0, # c 7 8\n 1 " +
                                                std::string(bad) + " 0\n, 0 1 0] } IndexedFaceSet { coordIndex [0 1 2] } }");
        EXPECT_EQ(error, "a.wrl:3:4: a point that is not finite (in Separator > Coordinate3)") << bad;
    }
    EXPECT_NE(error_of_text(old_file("Coordinate3 { point [0 0, 1 0 0, 0 1] } IndexedFaceSet { coordIndex [0 1 2] }"))
                  .find("7 numbers do not make points of 3"),
              std::string::npos);
    EXPECT_NE(error_of_text(old_file("Scale { scaleFactor 1e300 1 1 } Scale { scaleFactor 1e300 1 1 } " + kOldTetra)).find("too large"),
              std::string::npos);
    EXPECT_NE(error_of_text(old_file("Translation { translation nan 0 0 } " + kOldTetra)).find("a.wrl:2:39: a number that is not finite"),
              std::string::npos);
}

TEST(Vrml, limits_are_named) {
    const auto nested = [](int depth) {
        std::string text = "#VRML V1.0 ascii\n";
        for (int k = 0; k < depth; ++k) text += "Separator { ";
        text += kOldTetra;
        for (int k = 0; k < depth; ++k) text += " }";
        return text;
    };
    expect_tetra(nested(1000));
    EXPECT_NE(error_of_text(nested(1001)).find("nodes nested deeper than the limit of 1000"), std::string::npos);
    EXPECT_NE(error_of_text(nested(200000)).find("nodes nested deeper than the limit of 1000"), std::string::npos);
    EXPECT_NE(error_of_text("#VRML V1.0 ascii\nSeparator { x " + std::string(100000, '[')).find("nested deeper"), std::string::npos);
    std::string laughs = "DEF L0 Separator { " + kOldTetra + " } ";
    for (int k = 1; k <= 40; ++k) {
        const std::string use = "USE L" + std::to_string(k - 1) + " ";
        laughs += "DEF L" + std::to_string(k) + " Separator { " + use + use + "} ";
    }
    EXPECT_NE(error_of_text(old_file(laughs)).find("more than the limit of 1000000 nodes"), std::string::npos);
    // 1000 uses of 60,000 triangles are few nodes but too many triangles
    std::string fan = "DEF F Separator { Coordinate3 { " + kTetra + " } IndexedFaceSet { coordIndex [ ";
    for (int k = 0; k < 60000; ++k) fan += "0 1 2 -1 ";
    fan += "] } } ";
    for (int k = 0; k < 1000; ++k) fan += "USE F ";
    EXPECT_NE(error_of_text(old_file(fan)).find("more than the limit of 50000000 triangles"), std::string::npos);
    EXPECT_NE(error_of_text(old_file("Info { string \"" + std::string(2000000, 'x') + "\" }")).find("longer than 1048576 bytes"),
              std::string::npos);
    EXPECT_NE(error_of_text(old_file(std::string(2000000, 'x') + " {}")).find("longer than 1048576 bytes"), std::string::npos);
}

TEST(Vrml, broken_text_is_an_error_with_a_place) {
    EXPECT_EQ(error_of_text("#VRML V1.0 ascii\nSeparator { Coordinate3 { point [ 0 0"),
              "a.wrl:2:38: the file ends before what begins at 2:33 is closed (in Separator > Coordinate3)");
    EXPECT_EQ(error_of_text("#VRML V1.0 ascii\nSeparator { Cube { ] }"),
              "a.wrl:2:20: expected a field, a node or '}', found ']' (in Separator > Cube)");
    EXPECT_EQ(error_of_text("#VRML V1.0 ascii\n\"a"), "a.wrl:2:1: a string begins here and does not end");
    EXPECT_EQ(error_of_text("#VRML V1.0 ascii\n12"), "a.wrl:2:1: expected a node, found '12'");
    EXPECT_EQ(error_of_text("#VRML V1.0 ascii\nDEF A [ ]"), "a.wrl:2:7: expected a node type after DEF, found '['");
    EXPECT_EQ(error_of_text("#VRML V2.0 utf8\nShape { geometry USE }"), "a.wrl:2:18: USE without a name (in Shape)");
    EXPECT_EQ(error_of_text("#VRML V1.0 ascii\n"), "a.wrl: VRML 1.0 without a face");
    const std::string whole = old_file(kOldTetra);
    for (size_t size = 1; size + 2 < whole.size(); ++size) EXPECT_NE(error_of_text(whole.substr(0, size)), "no error") << size;
}

// A mistyped number must be an error, not different geometry.
TEST(Vrml, words_among_numbers_and_too_few_of_them_are_refused_with_their_place) {
    const auto refused = [](const std::string& text, const std::string& reason) {
        const std::string error = error_of_text(text);
        EXPECT_NE(error.find(reason), std::string::npos) << text << "\n-> " << error;
        EXPECT_NE(error.find("a.wrl:2:"), std::string::npos) << error;
    };
    std::string points = kTetra;
    points.insert(points.find('0'), "x ");
    refused(old_file("Coordinate3 { " + points + " } IndexedFaceSet { " + kTetraFaces + " }"), "'x' among the numbers of 'point'");
    refused(new_file("Transform { translation 1 2 children Shape { geometry Box {} } }"), "'translation' has 2 of 3 numbers");
    refused(new_file("Shape { geometry Sphere { radius TRUE } }"), "'radius' has 0 of 1 numbers");
    refused(new_file("Shape { geometry Box { size 1 2 } }"), "'size' has 2 of 3 numbers");
    const std::string xml = "<X3D version='3.0'>\n<Scene><Transform translation='1 O 0'><Shape><Box/></Shape></Transform></Scene></X3D>";
    refused(xml, "'O' among the numbers of 'translation'");
}

TEST(Vrml, units_exports_and_scripts_that_know_themselves) {
    EXPECT_TRUE(warns(load_text("#X3D V3.3 utf8\nPROFILE Immersive\nUNIT length mm 0.001\nEXPORT A AS B\nShape { geometry Box {} }"),
                      "a unit of length is not applied"));
    EXPECT_TRUE(warns(
        load_text(
            "<X3D><head><unit category='length' name='mm' conversionFactor='0.001'/></head><Scene><Shape><Box/></Shape></Scene></X3D>"),
        "a unit of length is not applied"));
    EXPECT_EQ(
        load_text(new_file("DEF S Script { field SFNode self USE S directOutput TRUE } Shape { geometry Box {} }")).mesh.triangle.size(),
        12u);
}

TEST(Vrml, seams_are_welded_and_corners_keep_their_texture_coordinates) {
    // two triangles that share an edge, written with six points
    const LoadedMesh loaded =
        load_text(old_file("Coordinate3 { point [0 0 0, 1 0 0, 0 1 0, 1 0 0, 1 1 0, 0 1 -0] } TextureCoordinate2 { "
                           "point [0 0, .1 0, .2 0, .3 0, .4 0, .5 0] } "
                           "IndexedFaceSet { coordIndex [0 1 2 -1 3 4 5 -1] }"));
    EXPECT_EQ(loaded.mesh.position.size(), 4u);
    EXPECT_EQ(sum_mesh(loaded.mesh).unpaired, 4u);
    EXPECT_EQ(loaded.mesh.uv[0][1].u, .1f);
    EXPECT_EQ(loaded.mesh.uv[1][0].u, .3f);
}

}  // namespace
}  // namespace trocar
