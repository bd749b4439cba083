#include <gtest/gtest.h>

#include <map>
#include <random>

#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

// The same nodes in both spellings, and the volume they must show.
struct RandomWorld {
    std::string classic, xml;
    double volume = 0;
    void add(const RandomWorld& other) {
        classic += other.classic;
        xml += other.xml;
        volume += other.volume;
    }
};

void expect_volume(const RandomWorld& world) {
    const LoadedMesh classic = load_text("#VRML V2.0 utf8\n" + world.classic);
    const LoadedMesh xml = load_text("<X3D><Scene>" + world.xml + "</Scene></X3D>");
    EXPECT_NEAR(sum_mesh(classic.mesh).volume, world.volume, 1e-9 * world.volume) << world.classic;
    EXPECT_NEAR(sum_mesh(xml.mesh).volume, world.volume, 1e-9 * world.volume) << world.xml;
    EXPECT_TRUE(classic.warnings.empty()) << classic.warnings[0];
    EXPECT_TRUE(xml.warnings.empty()) << xml.warnings[0];
}

RandomWorld box(int side) {
    const std::string s = std::to_string(side), size = s + " " + s + " " + s;
    return {"Shape { geometry Box { size " + size + " } }\n", "<Shape><Box size='" + size + "'/></Shape>\n", double(side * side * side)};
}

// A grouping node or, with `owner`, one with a name.
RandomWorld group(const RandomWorld& inside, const std::string& owner = "") {
    return {(owner.empty() ? "" : "DEF " + owner + " ") + "Group { children [\n" + inside.classic + "] }\n",
            "<Group" + (owner.empty() ? "" : " DEF='" + owner + "'") + ">\n" + inside.xml + "</Group>\n", inside.volume};
}

using Scope = std::map<std::string, double>;  // volume by name

// Random declarations, instances and boxes; the oracle reads names as VRML97 4.8.4 says, with one map per body. `self` is the
// prototype whose body this is: it must not contain itself.
RandomWorld random_body(std::mt19937& random, std::vector<Scope> scopes, int depth, const std::string& self) {
    const auto below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
    RandomWorld body = box(1 + below(3));
    for (int k = 0; k < 6; ++k) {
        const std::string name(1, static_cast<char>('A' + below(3)));
        const int what = below(3);
        if (what == 0 && depth < 3 && name != self) {
            std::vector<Scope> inner = scopes;
            inner.back()[name] = -1;  // its own name, inside it
            inner.emplace_back();
            const RandomWorld part = random_body(random, inner, depth + 1, name);
            body.classic += "PROTO " + name + " [] {\n" + group(part).classic + "}\n";
            body.xml += "<ProtoDeclare name='" + name + "'><ProtoBody>\n" + group(part).xml + "</ProtoBody></ProtoDeclare>\n";
            scopes.back()[name] = part.volume;
        } else if (what == 1) {
            for (size_t s = scopes.size(); s-- > 0;) {
                const auto found = scopes[s].find(name);
                if (found == scopes[s].end()) continue;
                if (found->second > 0) body.add({name + " { }\n", "<ProtoInstance name='" + name + "'/>\n", found->second});
                break;
            }
        } else {
            body.add(group(box(1 + below(4))));
        }
    }
    return body;
}

TEST(VrmlPrototypes, names_mean_the_innermost_declaration_before_them) {
    for (uint32_t seed = 1; seed <= 60; ++seed) {
        std::mt19937 random(seed);
        SCOPED_TRACE(seed);
        expect_volume(random_body(random, {{}}, 0, ""));
    }
}

TEST(VrmlPrototypes, a_prototype_comes_before_a_node_type_of_its_name) {
    // HAnim 1.1 and viewers' extensions are written as prototypes whose names later became types
    for (const char* name : {"Joint", "HAnimJoint", "MatrixTransform", "CADPart", "Cube", "Segment"}) {
        const std::string declared = "#VRML V2.0 utf8\nPROTO " + std::string(name) + " [] { " + box(2).classic + " }\n" + name + " {}";
        EXPECT_DOUBLE_EQ(sum_mesh(load_text(declared).mesh).volume, 8) << name;
    }
    // an EXTERNPROTO that leads nowhere leaves the type
    const LoadedMesh lost = load_text(
        "#VRML V2.0 utf8\nEXTERNPROTO Transform [ field MFNode children ] \"gone.wrl\"\nTransform { scale 2 2 2 "
        "children [ " +
        box(1).classic + " ] }");
    EXPECT_DOUBLE_EQ(sum_mesh(lost.mesh).volume, 8);
    EXPECT_TRUE(warns(lost, "file 'gone.wrl' is not read"));
}

struct VrmlPrototypeFiles : FolderTest {};

TEST_F(VrmlPrototypeFiles, nested_names_are_not_seen_by_other_files) {
    put("parts.wrl",
        "#VRML V2.0 utf8\nPROTO Table [] { PROTO Leg [] { " + box(4).classic + " } Leg {} }\nPROTO Leg [] { " + box(1).classic + " }\n");
    const auto volume = [&](const std::string& url) {
        const std::string text = "#VRML V2.0 utf8\nEXTERNPROTO X [] \"" + url + "\"\nX {}\n" + box(10).classic;
        return sum_mesh(load_mesh(put("a.wrl", text)).mesh).volume - 1000;
    };
    EXPECT_NEAR(volume("parts.wrl#Leg"), 1, 1e-9);
    EXPECT_NEAR(volume("parts.wrl#Table"), 64, 1e-9);
    EXPECT_NEAR(volume("parts.wrl"), 64, 1e-9);  // the first of the file
    EXPECT_NEAR(volume("parts.wrl#Chair"), 0, 1e-9);
}

// A handle to a surrounding node, as scripts hold it, in both spellings.
std::vector<RandomWorld> handles_of(const std::string& owner) {
    const std::string use = "USE " + owner, tag = " USE='" + owner + "'/>";
    const std::string proto = "PROTO P [ field SFNode n NULL field MFNode m [] ] { Group { children Script { field SFNode n IS n } } }\n";
    const std::string declare =
        "<ProtoDeclare name='P'><ProtoInterface><field name='n' type='SFNode' accessType='initializeOnly'/><field name='m' type='MFNode' "
        "accessType='initializeOnly'/></ProtoInterface><ProtoBody><Group><Script><field name='n' type='SFNode' "
        "accessType='initializeOnly'/><IS><connect nodeField='n' protoField='n'/></IS></Script></Group></ProtoBody></ProtoDeclare>\n";
    return {{"Script { field SFNode owner " + use + " url \"a.js\" }", "<Script><field name='owner'><Group" + tag + "</field></Script>"},
            {"Script { field MFNode all [ " + use + " " + use + " ] }",
             "<Script><field name='all'><Group" + tag + "<Group" + tag + "</field></Script>"},
            {"DEF S Script { field SFNode self USE S field SFNode n " + use + " }",
             "<Script DEF='S'><field name='self'><Script USE='S'/></field><field name='n'><Group" + tag + "</field></Script>"},
            {"Script { field SFNode n Group { children [ " + use + " ] } }",
             "<Script><field name='n'><Group><Group" + tag + "</Group></field></Script>"},
            {proto + "P { n " + use + " }",
             declare + "<ProtoInstance name='P'><fieldValue name='n'><Group" + tag + "</fieldValue></ProtoInstance>"},
            {proto + "P { m [ " + use + " ] }",
             declare + "<ProtoInstance name='P'><fieldValue name='m'><Group" + tag + "</fieldValue></ProtoInstance>"}};
}

TEST(VrmlPrototypes, scripts_may_hold_the_nodes_around_them) {
    for (int depth = 0; depth < 5; ++depth) {
        for (const RandomWorld& handle : handles_of("Top")) {
            RandomWorld inside = box(2);
            inside.add({handle.classic + "\n", handle.xml + "\n", 0});
            for (int k = 0; k < depth; ++k) inside = group(inside);
            inside = group(inside, "Top");
            inside.add({"Transform { translation 9 0 0 children USE Top }", "<Transform translation='9 0 0'><Group USE='Top'/></Transform>",
                        inside.volume});
            expect_volume(inside);
        }
    }
    // a node may be defined in such a field and shown elsewhere
    expect_volume({"Script { field SFNode n DEF B " + group(box(3)).classic + " }\nUSE B",
                   "<Script><field name='n'>" + group(box(3), "B").xml + "</field></Script><Group USE='B'/>", 27});
    // any other circle has no meaning
    for (const RandomWorld& circle :
         {group({"USE Top", "<Group USE='Top'/>"}, "Top"), group(group({"USE Top", "<Group USE='Top'/>"}), "Top")}) {
        EXPECT_NE(error_of_text("#VRML V2.0 utf8\n" + circle.classic).find("USE of 'Top' inside itself (in Group"), std::string::npos);
        EXPECT_NE(error_of_text("<X3D><Scene>" + circle.xml + "</Scene></X3D>").find("USE of 'Top' inside itself (in Group"),
                  std::string::npos);
    }
}

}  // namespace
}  // namespace trocar
