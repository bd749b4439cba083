#include "content/text/local_file.hpp"

#include <gtest/gtest.h>
#include <sys/inotify.h>
#include <unistd.h>

#include <cstring>

#include "engine/files/image_file.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

// Counts how often files in a folder are opened, by any process.
struct OpenWatch {
    int fd = ::inotify_init1(IN_NONBLOCK);
    explicit OpenWatch(const fs::path& folder) { ::inotify_add_watch(fd, folder.c_str(), IN_OPEN | IN_ACCESS); }
    ~OpenWatch() { ::close(fd); }
    // Since the previous call; opening the folder itself does not count.
    int opened() const {
        alignas(inotify_event) char bytes[4096];
        int count = 0;
        for (ssize_t got; (got = ::read(fd, bytes, sizeof bytes)) > 0;) {
            for (ssize_t at = 0; at < got;) {
                inotify_event event;
                std::memcpy(&event, bytes + at, sizeof event);
                count += event.len > 0 && (event.mask & IN_ISDIR) == 0;
                at += static_cast<ssize_t>(sizeof event + event.len);
            }
        }
        return count;
    }
};

struct LocalFiles : FolderTest {
    fs::path inside, outside;
    void SetUp() override {
        FolderTest::SetUp();
        inside = folder / "in";
        outside = folder / "out";
        put("out/box.wrl", "#VRML V2.0 utf8\nPROTO P [] { Shape { geometry Box {} } }\nShape { geometry Box {} }\n");
        put("out/box.x3d", "<X3D><Scene><Shape><Box/></Shape></Scene></X3D>");
        put("out/look.mtl", "newmtl red\nKd 1 0 0\nmap_Kd skin.png\n");
        save_png(Image{1, 1, {9, 8, 7, 255}}, put("out/skin.png", ""));
        put("in/own.mtl", "newmtl red\nKd 1 0 0\nmap_Kd ../out/skin.png\n");
        fs::create_symlink("../out/box.wrl", inside / "link.wrl");
        fs::create_symlink("../out/skin.png", inside / "link.png");
        fs::create_directory_symlink("../out", inside / "door");
    }
};

const std::string kOwn =
    "Shape { geometry IndexedFaceSet { coord Coordinate { point [0 0 0 1 0 0 0 1 0] } coordIndex "
    "[0 1 2] } }\n";

const std::string kX3dOwn =
    "<Shape><IndexedFaceSet coordIndex='0 1 2'><Coordinate point='0 0 0 1 0 0 0 1 0'/></IndexedFaceSet></Shape></Scene></X3D>";

std::string with_texture(const std::string& name) {
    return "#VRML V2.0 utf8\nShape { appearance Appearance { texture ImageTexture { url \"" + name + "\" } } " + kOwn.substr(8);
}

// Breaks when any kind of reference can leave the folder of the file.
TEST_F(LocalFiles, nothing_outside_the_folder_is_opened) {
    const std::string out = outside.string(), x3d_own = kX3dOwn;
    std::vector<std::string> files;
    for (const std::string& name : {std::string("../out/box.wrl"), out + "/box.wrl", "file://" + out + "/box.wrl",
                                    std::string("..\\\\out\\\\box.wrl"), std::string("link.wrl"), std::string("door/box.wrl"),
                                    std::string("./door/../../out/box.wrl"), std::string("http://localhost/../out/box.wrl")}) {
        files.push_back("#VRML V2.0 utf8\nInline { url [ \"" + name + "\" ] }\n" + kOwn);
        files.push_back("#VRML V2.0 utf8\nEXTERNPROTO P [] \"" + name + "#P\"\nP {}\n" + kOwn);
        files.push_back("#VRML V1.0 ascii\nWWWInline { name \"" + name +
                        "\" }\nCoordinate3 { point [0 0 0 1 0 0 0 1 0] } IndexedFaceSet { coordIndex [0 1 2] }\n");
        files.push_back("<X3D><Scene><Inline url='\"" + name + "\"'/><ExternProtoDeclare name='P' url='\"" + name +
                        "#P\"'/><ProtoInstance name='P'/>" + x3d_own);
    }
    for (const std::string& name : {std::string("../out/skin.png"), out + "/skin.png", "file://" + out + "/skin.png",
                                    std::string("..\\\\out\\\\skin.png"), std::string("link.png"), std::string("door/skin.png")}) {
        files.push_back(with_texture(name));
        files.push_back("#VRML V1.0 ascii\nTexture2 { filename \"" + name +
                        "\" }\nCoordinate3 { point [0 0 0 1 0 0 0 1 0] } IndexedFaceSet { coordIndex [0 1 2] }\n");
        files.push_back("<X3D><Scene><Shape><Appearance><ImageTexture url='\"" + name + "\"'/></Appearance>" + x3d_own.substr(7));
        files.push_back("ply\nformat ascii 1.0\ncomment TextureFile " + name +
                        "\nelement vertex 3\nproperty int x\nproperty int y\nproperty int z\nelement face 1\nproperty "
                        "list int int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    }
    for (const char* name : {"../out/look.mtl", "door/look.mtl", "own.mtl"}) {
        files.push_back("mtllib " + std::string(name) + "\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n");
    }
    const OpenWatch watch(outside);
    for (const std::string& text : files) {
        SCOPED_TRACE(text);
        const LoadedMesh loaded = load_mesh(put("in/a.any", text));
        EXPECT_EQ(loaded.mesh.triangle.size(), 1u);
        for (const Material& material : loaded.mesh.material) EXPECT_EQ(material.image.width, 0u);
        EXPECT_FALSE(loaded.warnings.empty());
        EXPECT_EQ(watch.opened(), 0);
    }
    // check that the watch works
    load_mesh(outside / "box.wrl");
    EXPECT_GT(watch.opened(), 0);
    EXPECT_EQ(load_mesh(put("a.wrl", with_texture("in/link.png"))).mesh.material[0].image.width, 1u);
    EXPECT_GT(watch.opened(), 0);
}

TEST_F(LocalFiles, names_are_followed_below_the_folder) {
    put("in/deep/er/b.wrl", "#VRML V2.0 utf8\nInline { url \"../../c.wrl\" }\n");
    put("in/c.wrl", "#VRML V2.0 utf8\nShape { geometry Box {} }\n");
    EXPECT_EQ(load_mesh(put("in/a.wrl", "#VRML V2.0 utf8\nInline { url [ \"gone.wrl\" \"deep\\\\er/b.wrl\" ] }\n")).mesh.triangle.size(),
              12u);
    // an absolute path below the folder is as good as a relative one
    EXPECT_EQ(load_mesh(put("in/a.wrl", "#VRML V2.0 utf8\nInline { url \"" + (inside / "c.wrl").string() + "\" }\n")).mesh.triangle.size(),
              12u);
    EXPECT_EQ(find_local_file({inside}, inside, "").refusal, "it has no name");
    EXPECT_EQ(find_local_file({inside}, inside, std::string("c.wrl\0x", 7)).refusal, "it has no name");
    EXPECT_EQ(find_local_file({inside}, inside, "deep").refusal, "there is no such file");
    EXPECT_EQ(find_local_file({inside}, inside, "https://a/c.wrl").refusal, "it is not on this machine");
    EXPECT_EQ(find_local_file({inside}, inside / "deep", "../c.wrl").refusal, "");
    EXPECT_EQ(find_local_file({folder / "gone"}, folder / "gone", "c.wrl").refusal, "there is no such file");
}

// Folders that the user allows besides: reached by a path from the file, or by a name within them.
TEST_F(LocalFiles, other_roots_are_allowed_by_name) {
    for (const std::string& name : {std::string("../out/box.wrl"), (outside / "box.wrl").string(), std::string("box.wrl"),
                                    std::string("./box.wrl"), std::string("link.wrl"), std::string("door/box.wrl")}) {
        for (const std::string& text : {"#VRML V2.0 utf8\nInline { url [ \"" + name + "\" ] }\n" + kOwn,
                                        "#VRML V2.0 utf8\nEXTERNPROTO P [] \"" + name + "#P\"\nP {}\n" + kOwn,
                                        "#VRML V1.0 ascii\nWWWInline { name \"" + name +
                                            "\" }\nCoordinate3 { point [0 0 0 1 0 0 0 1 0] } IndexedFaceSet { coordIndex [0 1 2] }\n",
                                        "<X3D><Scene><Inline url='\"" + name + "\"'/>" + kX3dOwn}) {
            const fs::path file = put("in/a.any", text);
            EXPECT_EQ(load_mesh(file).mesh.triangle.size(), 1u) << text;
            EXPECT_EQ(load_mesh(file, {{}, {outside}}).mesh.triangle.size(), 13u) << text;
            EXPECT_EQ(load_mesh(file, {{}, {folder / "gone"}}).mesh.triangle.size(), 1u) << text;
        }
    }
    for (const std::string name : {"../out/skin.png", "skin.png", "link.png"}) {
        const LoadedMesh loaded = load_mesh(put("in/a.wrl", with_texture(name)), {{}, {outside}});
        EXPECT_EQ(loaded.mesh.material[0].image.width, 1u) << name;
    }
    for (const std::string name : {"../out/look.mtl", "look.mtl", "own.mtl"}) {
        const LoadedMesh loaded =
            load_mesh(put("in/a.obj", "mtllib " + name + "\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"), {{}, {outside}});
        EXPECT_EQ(loaded.mesh.material[0].image.width, 1u) << name;
    }
    // the folder above stays closed
    put("secret.wrl", "#VRML V2.0 utf8\nShape { geometry Box {} }\n");
    for (const char* name : {"../secret.wrl", "../out/../secret.wrl", "door/../secret.wrl"}) {
        EXPECT_EQ(load_mesh(put("in/a.wrl", "#VRML V2.0 utf8\nInline { url \"" + std::string(name) + "\" }\n" + kOwn), {{}, {outside}})
                      .mesh.triangle.size(),
                  1u)
            << name;
    }
}

// A file name without a folder refers to the current one.
TEST_F(LocalFiles, files_of_the_current_folder) {
    const fs::path before = fs::current_path();
    fs::current_path(folder);
    EXPECT_EQ(find_local_file({""}, "", "in/own.mtl").refusal, "");
    EXPECT_NE(find_local_file({""}, "", "../x").refusal, "");
    fs::current_path(before);
}

}  // namespace
}  // namespace trocar
