#include "content/read/vrml/x3d.hpp"

#include <gtest/gtest.h>

#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

const std::string kPoints = "<Coordinate point='0 0 0,1 0 0,0 1 0,0 0 1'/>";
const std::string kIndex = "coordIndex='0 2 1 -1 0 1 3 -1 1 2 3 -1 0 3 2'";
const std::string kTetra = "<Shape><IndexedFaceSet " + kIndex + ">" + kPoints + "</IndexedFaceSet></Shape>";

std::string file(const std::string& body) {
    return "<?xml version=\"1.0\"?>\n<X3D version='3.3'><head><meta name='a' content='b'/></head>\n<Scene>" + body + "</Scene></X3D>\n";
}

void expect_tetra(const std::string& text) {
    const LoadedMesh loaded = load_text(text);
    EXPECT_EQ(loaded.format, "X3D") << text;
    EXPECT_EQ(loaded.mesh.position.size(), 4u) << text;
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_DOUBLE_EQ(sums.volume, 1.0 / 6) << text;
    EXPECT_EQ(sums.unpaired, 0u) << text;
    EXPECT_TRUE(loaded.warnings.empty()) << loaded.warnings[0];
}

TEST(X3d, the_tree_is_that_of_the_classic_spelling) {
    expect_tetra(file(kTetra));
    expect_tetra("\xef\xbb\xbf" + file(kTetra));
    expect_tetra("<!DOCTYPE X3D PUBLIC 'a' 'b' [ <!ENTITY x 'y'> ]><X3D><Scene><!-- c -->" + kTetra + "</Scene></X3D>");
    expect_tetra(file("<Switch whichChoice='0'>" + kTetra + "<Shape><Box/></Shape></Switch>"));
    expect_tetra(file("<LOD range='5'>" + kTetra + "<Shape><Box/></Shape></LOD>"));
    expect_tetra(file("<Collision><Shape containerField='proxy'><Box/></Shape>" + kTetra + "</Collision>"));
    expect_tetra(
        file("<Switch><Shape DEF='S'><IndexedFaceSet " + kIndex + ">" + kPoints + "</IndexedFaceSet></Shape></Switch><Shape USE='S'/>"));
    // numbers separated by character references
    std::string text = file(kTetra);
    text.replace(text.find("0 0 0,1"), 7, "0 0&#10;0&#x2c;1");
    expect_tetra(text);
    const LoadedMesh moved =
        load_text(file("<Transform translation='10 0 0'><Transform rotation='0 0 1 1.5707963267948966' scale='2 2 2'>" + kTetra +
                       "</Transform></Transform>"));
    EXPECT_NEAR(sum_mesh(moved.mesh).volume, 8.0 / 6, 1e-12);
    EXPECT_NEAR(sum_mesh(moved.mesh).min[0], 8, 1e-12);
}

TEST(X3d, looks_and_texture_coordinates) {
    const LoadedMesh loaded =
        load_text(file("<Shape><Appearance><Material DEF='M' diffuseColor='1 .5 0'/><PixelTexture image='1 1 3 0x00FF00'/>"
                       "</Appearance><IndexedFaceSet " +
                       kIndex + " ccw='false' texCoordIndex='0 0 0 -1 1 1 1 -1 0 0 0 -1 0 0 0'>" + kPoints +
                       "<TextureCoordinate point='.25 .5 1 0'/></IndexedFaceSet></Shape>"));
    ASSERT_EQ(loaded.mesh.material.size(), 1u);
    EXPECT_EQ(loaded.mesh.material[0].name, "M");
    EXPECT_EQ(loaded.mesh.material[0].diffuse, (std::array<float, 3>{1, .5f, 0}));
    EXPECT_EQ(loaded.mesh.material[0].image.rgba, (std::vector<uint8_t>{0, 255, 0, 255}));
    EXPECT_EQ(loaded.mesh.uv[0][0].v, .5f);
    EXPECT_EQ(loaded.mesh.uv[1][0].u, 1);
    EXPECT_LT(sum_mesh(loaded.mesh).volume, 0);
    for (const char* url : {"'\"a b.png\"'", "\"&quot;a b.png&quot; &quot;c&quot;\"", "'a b.png'"}) {
        const LoadedMesh textured =
            load_text(file("<Shape><Appearance><ImageTexture url=" + std::string(url) + "/></Appearance><Box/></Shape>"));
        EXPECT_EQ(textured.mesh.material[0].texture, "a b.png") << url;
        EXPECT_TRUE(warns(textured, "texture 'a b.png' is not read: there is no such file")) << url;
    }
}

TEST(X3d, prototypes_with_and_without_values) {
    const std::string declare =
        "<ProtoDeclare name='Organ'><ProtoInterface><field name='size' type='SFVec3f' accessType='initializeOnly' "
        "value='1 1 1'/><field name='look' type='SFNode' accessType='inputOutput'><Material diffuseColor='0 1 0'/>"
        "</field></ProtoInterface><ProtoBody><Shape><Appearance><IS><connect nodeField='material' protoField='look'/>"
        "</IS></Appearance><Box><IS><connect nodeField='size' protoField='size'/></IS></Box></Shape><TimeSensor/>"
        "</ProtoBody></ProtoDeclare>";
    const LoadedMesh loaded =
        load_text(file(declare + "<ProtoInstance name='Organ'/><Transform translation='9 0 0'><ProtoInstance name='Organ'>"
                                 "<fieldValue name='size' value='2 3 4'/><fieldValue name='look'><Material diffuseColor='1 0 0'/>"
                                 "</fieldValue></ProtoInstance></Transform>"));
    EXPECT_DOUBLE_EQ(sum_mesh(loaded.mesh).volume, 25);
    ASSERT_EQ(loaded.mesh.material.size(), 2u);
    EXPECT_EQ(loaded.mesh.material[0].diffuse, (std::array<float, 3>{0, 1, 0}));
    EXPECT_EQ(loaded.mesh.material[1].diffuse, (std::array<float, 3>{1, 0, 0}));
    // an instance of a coordinate node goes to the field for that node
    expect_tetra(file("<ProtoDeclare name='P'><ProtoBody>" + kPoints +
                      "</ProtoBody></ProtoDeclare><Shape>"
                      "<IndexedFaceSet " +
                      kIndex + "><ProtoInstance name='P'/></IndexedFaceSet></Shape>"));
    EXPECT_NE(error_of_text(file("<ProtoDeclare name='A'><ProtoBody><Group><ProtoInstance name='A'/></Group></ProtoBody>"
                                 "</ProtoDeclare><ProtoInstance name='A'/>"))
                  .find("prototypes nested deeper than the limit"),
              std::string::npos);
}

struct X3dFiles : FolderTest {};

TEST_F(X3dFiles, other_files_in_either_spelling) {
    put("p.x3dv",
        "#X3D V3.2 utf8\nPROFILE Immersive\nPROTO Part [ initializeOnly SFVec3f s 1 1 1 ] { Shape { geometry "
        "Box { size IS s } } }\n");
    put("b.x3d", file("<Shape><Box size='1 1 1'/></Shape>"));
    const LoadedMesh loaded =
        load_mesh(put("a.x3d", file("<ExternProtoDeclare name='Mine' url='\"gone.x3d#Part\" \"p.x3dv#Part\"'><field name='s' "
                                    "type='SFVec3f' accessType='initializeOnly'/></ExternProtoDeclare><ProtoInstance name='Mine'>"
                                    "<fieldValue name='s' value='1 2 3'/></ProtoInstance><Transform translation='5 0 0'><Inline "
                                    "url='\"b.x3d\"'/></Transform><Inline url='\"b.x3d\"' load='false'/>")));
    EXPECT_DOUBLE_EQ(sum_mesh(loaded.mesh).volume, 7);
    EXPECT_TRUE(warns(loaded, "file 'gone.x3d' is not read: there is no such file"));
    const LoadedMesh classic = load_mesh(put("c.wrl", "#VRML V2.0 utf8\nInline { url \"b.x3d\" }\n"));
    EXPECT_DOUBLE_EQ(sum_mesh(classic.mesh).volume, 1);
}

TEST(X3d, broken_files_are_errors_with_a_place) {
    EXPECT_EQ(error_of_text("<X3D>\n<Scene>\n <Group DEF='G'>\n  <Group USE='G'/></Group></Scene></X3D>"),
              "a.wrl:4:4: USE of 'G' inside itself (in Group)");
    EXPECT_EQ(error_of_text("<X3D>\n<Scene>\n<Shape</Scene></X3D>").substr(0, 33), "a.wrl:3:8: not well-formed XML: E");
    EXPECT_EQ(error_of_text(file("<Shape><IndexedFaceSet coordIndex='0 1 2'><Coordinate\npoint='0 0 0 1 nan 0 0 1 0'/>"
                                 "</IndexedFaceSet></Shape>")),
              "a.wrl:4:16: a point that is not finite (in Coordinate)");
    EXPECT_EQ(error_of_text("<X3D><Scene></Scene></X3D>"), "a.wrl: X3D without a face");
    std::string deep = "<X3D><Scene>";
    for (int k = 0; k < 200000; ++k) deep += "<Group>";
    for (int k = 0; k < 200000; ++k) deep += "</Group>";
    EXPECT_NE(error_of_text(deep + "</Scene></X3D>").find("nodes nested deeper than the limit of 250"), std::string::npos);
    const LoadedMesh loaded = load_text(file("<Odd a='1'><Shape><Box/></Shape></Odd><Shape USE='Nope'/>" + kTetra));
    EXPECT_EQ(loaded.mesh.triangle.size(), 4u);
    EXPECT_TRUE(warns(loaded, "a.wrl:3:9: unknown node Odd is passed over"));
    EXPECT_TRUE(warns(loaded, "USE of 'Nope', which no DEF before it names"));
    const LoadedMesh field = load_text(file("<Shape><Box sise='1 1 1'/></Shape>"));
    EXPECT_TRUE(warns(field, "unknown field Box.sise"));
    const std::string whole = file(kTetra);
    for (size_t size = 1; size + 8 < whole.size(); ++size) EXPECT_NE(error_of_text(whole.substr(0, size)), "no error") << size;
}

}  // namespace
}  // namespace trocar
