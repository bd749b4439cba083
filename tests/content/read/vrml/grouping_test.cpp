#include <gtest/gtest.h>

#include <random>

#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

// A box of side 2 around the origin, inside a node given by its opening and closing text.
LoadedMesh xml(const std::string& open, const std::string& close) {
    return load_text("<X3D><Scene>" + open + "<Shape><Box size='2 2 2'/></Shape>" + close + "</Scene></X3D>");
}
LoadedMesh classic(const std::string& open, const std::string& close) {
    return load_text("#VRML V2.0 utf8\n" + open + "Shape { geometry Box { size 2 2 2 } }" + close);
}

// Where the box lies: the middle and the sides of its box.
void expect_box(const LoadedMesh& loaded, const Vec3d& middle, const Vec3d& sides, const std::string& what) {
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_LT(((sums.min + sums.max) / 2 - middle).norm(), 1e-12) << what;
    EXPECT_LT((sums.max - sums.min - sides).norm(), 1e-12) << what;
    EXPECT_NEAR(sums.volume, sides.prod(), 1e-9 * sides.prod()) << what;
    EXPECT_TRUE(loaded.warnings.empty()) << what << ": " << loaded.warnings[0];
}

TEST(VrmlGrouping, every_grouping_node_keeps_its_children) {
    const Vec3d here = Vec3d::Zero(), one = Vec3d::Constant(2);
    for (const std::string type :
         {"HAnimSegment", "Segment", "CADAssembly", "CADLayer", "PickableGroup", "ScreenGroup", "Layer", "LayoutLayer", "Viewport",
          "ViewpointGroup", "Group", "Anchor", "Billboard", "Collision", "StaticGroup"}) {
        expect_box(xml("<" + type + ">", "</" + type + ">"), here, one, type);
        expect_box(classic(type + " { children [ ", " ] }"), here, one, type);
    }
    for (const std::string type : {"HAnimJoint", "Joint", "HAnimSite", "Site", "CADPart", "EspduTransform", "Transform"}) {
        expect_box(xml("<" + type + " translation='1 2 3' scale='2 1 1'>", "</" + type + ">"), {1, 2, 3}, {4, 2, 2}, type);
        expect_box(classic(type + " { translation 1 2 3 scale 2 1 1 children [ ", " ] }"), {1, 2, 3}, {4, 2, 2}, type);
    }
    expect_box(xml("<CADFace><Group containerField='shape'>", "</Group></CADFace>"), here, one, "CADFace");
    expect_box(classic("LayerSet { layers [ Layer { children [ ", " ] } ] }"), here, one, "LayerSet");
}

// Humanoids of both generations: joints one below the other, repeated in the lists that only name them.
TEST(VrmlGrouping, a_humanoid_shows_its_skeleton_once) {
    for (int depth = 1; depth <= 10; ++depth) {
        std::string open = "<HAnimHumanoid scale='3 3 3' translation='0 0 5'>", close, joints;
        std::string old_open = "Humanoid { translation 0 0 5 scale 3 3 3 humanoidBody [ ", old_close, old_joints;
        for (int k = 0; k < depth; ++k) {
            const std::string name = "J" + std::to_string(k);
            open += "<HAnimJoint DEF='" + name + "' translation='1 0 0'" + (k == 0 ? " containerField='skeleton'>" : ">");
            close += "</HAnimJoint>";
            joints += "<HAnimJoint USE='" + name + "' containerField='joints'/>";
            old_open += "DEF " + name + " Joint { translation 1 0 0 children [ ";
            old_close += " ] }";
            old_joints += " USE " + name;
        }
        const Vec3d middle(3 * depth, 0, 5), sides = Vec3d::Constant(6);
        expect_box(xml(open + "<HAnimSegment DEF='S'>",
                       "</HAnimSegment>" + close + "<HAnimSegment USE='S' containerField='segments'/>" + joints + "</HAnimHumanoid>"),
                   middle, sides, open);
        expect_box(
            classic(old_open + "DEF S Segment { children [ ", " ] }" + old_close + " ] segments USE S joints [ " + old_joints + " ] }"),
            middle, sides, old_open);
    }
    // a skin moves with the humanoid, beside its skeleton
    const LoadedMesh both = load_text(
        "<X3D><Scene><HAnimHumanoid translation='0 7 0'><HAnimJoint containerField='skeleton'><Shape><Box/></Shape></HAnimJoint>"
        "<Shape containerField='skin'><Box/></Shape></HAnimHumanoid><Shape><Box/></Shape></Scene></X3D>");
    EXPECT_NEAR(sum_mesh(both.mesh).volume, 24, 1e-9);
    EXPECT_NEAR(sum_mesh(both.mesh).max.y(), 8, 1e-12);
    EXPECT_NEAR(sum_mesh(both.mesh).min.y(), -1, 1e-12);
}

// Random matrices; the last row is the translation, in VRML 1.0 for what follows, later for the children.
TEST(VrmlGrouping, matrices_place_what_they_hold) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> number(-2, 2);
    for (int k = 0; k < 24; ++k) {
        Eigen::Matrix3d linear;
        for (int i = 0; i < 9; ++i) linear(i / 3, i % 3) = number(random);
        const Vec3d shift(number(random), number(random), number(random));
        std::string text;
        const auto add = [&](double value) {
            char digits[40];
            std::snprintf(digits, sizeof digits, "%.17g ", value);
            text += digits;
        };
        for (int c = 0; c < 3; ++c) {
            for (int r = 0; r < 3; ++r) add(linear(r, c));
            add(0);
        }
        for (int r = 0; r < 3; ++r) add(shift[r]);
        text += "1";
        const Vec3d half = linear.cwiseAbs() * Vec3d::Ones();
        const auto check = [&](const LoadedMesh& loaded) {
            const MeshSums sums = sum_mesh(loaded.mesh);
            EXPECT_LT((sums.max - (shift + half)).norm() + (sums.min - (shift - half)).norm(), 1e-12);
            EXPECT_NEAR(std::abs(sums.volume), 8 * std::abs(linear.determinant()), 1e-12);
            EXPECT_TRUE(loaded.warnings.empty());
        };
        check(xml("<MatrixTransform matrix='" + text + "'>", "</MatrixTransform>"));
        check(classic("MatrixTransform { matrix " + text + " children [ ", " ] }"));
        check(load_text("#VRML V1.0 ascii\nSeparator { MatrixTransform { matrix " + text + " } Cube {} }\n"));
    }
    // its siblings stay where they are
    const LoadedMesh beside = load_text(
        "#VRML V2.0 utf8\nMatrixTransform { matrix 1 0 0 0 0 1 0 0 0 0 1 0 9 0 0 1 children Shape { geometry Box {} } }\nShape { geometry "
        "Box "
        "{} }\n");
    EXPECT_NEAR(sum_mesh(beside.mesh).min.x(), -1, 1e-12);
    EXPECT_NEAR(sum_mesh(beside.mesh).max.x(), 10, 1e-12);
}

struct VrmlInline : FolderTest {};

TEST_F(VrmlInline, a_file_is_read_unless_it_is_said_not_to_be) {
    put("b.wrl", "#VRML V2.0 utf8\nShape { geometry Box { size 1 1 1 } }\n");
    const std::string own = "#VRML V2.0 utf8\nShape { geometry Box { size 2 2 2 } }\n";
    for (const char* type : {"Inline", "InlineLoadControl"}) {
        for (const auto& [load, volume] : {std::pair{"", 9.0}, {"load TRUE ", 9.0}, {"load FALSE ", 8.0}}) {
            const LoadedMesh loaded = load_mesh(put("a.wrl", own + type + " { " + load + "url \"b.wrl\" }\n"));
            EXPECT_NEAR(sum_mesh(loaded.mesh).volume, volume, 1e-12) << type << load;
            EXPECT_EQ(warns(loaded, "a file is not read: load is FALSE"), volume == 8) << type << load;
        }
    }
}

}  // namespace
}  // namespace trocar
