#include "content/read/assimp_file.hpp"

#include <sys/stat.h>

#include "content/mend/admission.hpp"
#include "content/read/mesh_stream.hpp"
#include "engine/files/child_process.hpp"
#include "tests/content/mend/mesh_sums.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

const fs::path kModels = "/usr/share/assimp/models";

std::string error_of(const fs::path& path) { return load_error(path); }

// --- the stream

MeshStream sample_stream() {
    MeshStream stream;
    stream.format = "test";
    stream.warnings = {"one", ""};
    stream.mesh.position = {Vec3d(0, 0.1, -1e300), Vec3d(1, 2, 3), Vec3d(4, 5, 6)};
    stream.mesh.triangle = {{0, 1, 2}, {2, 1, 0}};
    stream.mesh.uv = {{Vec2{0, 1}, Vec2{2, 3}, Vec2{4, 5}}, {Vec2{6, 7}, Vec2{8, 9}, Vec2{10, 11}}};
    stream.mesh.triangle_material = {1, 0};
    stream.mesh.material.resize(2);
    stream.mesh.material[1].name = "red";
    stream.mesh.material[1].texture = "r.png";
    stream.mesh.material[1].diffuse = {1, 0, 0.25f};
    stream.mesh.material[1].transparency = 0.5f;
    stream.picture = {"", std::string("\0png", 4)};
    return stream;
}

std::string reason_of(const std::string& bytes) {
    try {
        decode_mesh_stream(bytes);
    } catch (const InputError& error) {
        return error.what();
    }
    return "accepted";
}

TEST(MeshStream, comes_back_as_it_was) {
    const MeshStream in = sample_stream();
    const MeshStream out = decode_mesh_stream(encode_mesh_stream(in));
    EXPECT_EQ(out.mesh.position, in.mesh.position);
    EXPECT_EQ(out.mesh.triangle, in.mesh.triangle);
    EXPECT_EQ(out.mesh.triangle_material, in.mesh.triangle_material);
    for (size_t t = 0; t < 2; ++t) {
        for (size_t k = 0; k < 3; ++k) {
            EXPECT_EQ(out.mesh.uv[t][k].u, in.mesh.uv[t][k].u);
            EXPECT_EQ(out.mesh.uv[t][k].v, in.mesh.uv[t][k].v);
        }
    }
    EXPECT_EQ(out.mesh.material[1].name, "red");
    EXPECT_EQ(out.mesh.material[1].texture, "r.png");
    EXPECT_EQ(out.mesh.material[1].diffuse, in.mesh.material[1].diffuse);
    EXPECT_EQ(out.mesh.material[1].transparency, 0.5f);
    EXPECT_EQ(out.picture, in.picture);
    EXPECT_EQ(out.warnings, in.warnings);
    EXPECT_EQ(out.format, "test");
}

TEST(MeshStream, every_cut_and_every_addition_is_refused) {
    const std::string whole = encode_mesh_stream(sample_stream());
    for (size_t n = 0; n < whole.size(); ++n) EXPECT_NE(reason_of(whole.substr(0, n)), "accepted") << n;
    EXPECT_EQ(reason_of(whole + "x"), "the reader's answer goes on after its end");
    EXPECT_EQ(reason_of(whole), "accepted");
}

TEST(MeshStream, wrong_rows_are_refused_with_their_number) {
    MeshStream s = sample_stream();
    s.mesh.triangle[1][2] = 3;
    EXPECT_EQ(reason_of(encode_mesh_stream(s)), "face 1 names vertex 3 of 3");
    s = sample_stream();
    s.mesh.position[2].y() = std::nan("");
    EXPECT_EQ(reason_of(encode_mesh_stream(s)), "vertex 2 is not finite");
    s = sample_stream();
    s.mesh.triangle_material[0] = 2;
    EXPECT_EQ(reason_of(encode_mesh_stream(s)), "a face names material 2");
    s = sample_stream();
    s.mesh.uv[0][1].v = std::numeric_limits<float>::infinity();
    EXPECT_EQ(reason_of(encode_mesh_stream(s)), "a texture coordinate is not finite");
    s = sample_stream();
    s.mesh.material[0].shininess = 2;
    EXPECT_NE(reason_of(encode_mesh_stream(s)), "accepted");
    // counts that no file can hold must not be allocated
    std::string bytes = encode_mesh_stream(sample_stream());
    for (size_t at = 14; at < 14 + 48; at += 8) {
        std::string wild = bytes;
        wild[at + 7] = '\x7f';
        EXPECT_NE(reason_of(wild), "accepted") << at;
    }
}

// --- formats. Boxes, cubes and the 3732-face figure that the table of real data lists in its VRML form.

struct Expected {
    const char* file;
    const char* format;
    size_t vertices, triangles;
    double volume, x, y, z;
};

constexpr Expected kExpected[] = {
    {"glTF2/BoxTextured-glTF/BoxTextured.gltf", "glTF2", 8, 12, 1, 1, 1, 1},
    {"glTF2/BoxTextured-glTF-Binary/BoxTextured.glb", "glTF2", 8, 12, 1, 1, 1, 1},
    {"LWO/LWO2/boxuv.lwo", "LightWave", 8, 12, 1, 1, 1, 1},
    {"BLEND/BlenderDefault_276.blend", "Blender", 8, 12, 8, 2, 2, 2},
    {"3MF/box.3mf", "3mf", 8, 12, 6000, 10, 20, 30},
    {"Collada/cube_with_2UVs.DAE", "Collada", 8, 12, 0.0508 * 0.0508 * 0.0508, 0.0508, 0.0508, 0.0508},
    {"B3D/WusonBlitz.b3d", "BlitzBasic", 2117, 3732, 1.1228, 0.92, 1.516, 3.244},
    {"DXF/wuson.dxf", "DXF", 2117, 3732, 1.1228, 0.92, 3.244, 1.516},
    {"X/Testwuson.X", "XFile", 2117, 3732, 1.1228, 0.92, 3.244, 1.516},
};

TEST(AssimpFile, known_solids_have_their_counts_boxes_and_volumes) {
    if (!fs::exists(kModels)) GTEST_SKIP() << "assimp-testmodels is absent";
    for (const Expected& e : kExpected) {
        SCOPED_TRACE(e.file);
        const LoadedMesh loaded = load_mesh(kModels / e.file);
        const MeshSums sums = sum_mesh(loaded.mesh);
        EXPECT_NE(loaded.format.find(e.format), std::string::npos) << loaded.format;
        EXPECT_EQ(loaded.mesh.position.size(), e.vertices);
        EXPECT_EQ(loaded.mesh.triangle.size(), e.triangles);
        // the table has four digits, and coordinates may be floats
        EXPECT_NEAR(judge_mesh(loaded.mesh, false).volume, e.volume, 1e-4 * e.volume);
        const Vec3d size = sums.max - sums.min;
        EXPECT_NEAR(size.x(), e.x, 4e-4 * e.x);
        EXPECT_NEAR(size.y(), e.y, 4e-4 * e.y);
        EXPECT_NEAR(size.z(), e.z, 4e-4 * e.z);
        EXPECT_TRUE(warns(loaded, "went through 32-bit floats"));
    }
    const LoadedMesh textured = load_mesh(kModels / "glTF2/BoxTextured-glTF-Binary/BoxTextured.glb");
    ASSERT_EQ(textured.mesh.material.size(), 1u);
    EXPECT_EQ(textured.mesh.material[0].image.width, 211u);  // embedded in the file
    EXPECT_EQ(textured.mesh.uv.size(), 12u);
}

// A pyramid under two nodes: one translated, one translated and mirrored. Both must be closed and outward.
const std::string kMirrored = R"(AC3Db
MATERIAL "skin" rgb 1 0 0.5  amb 0 0 0  emis 0 0 0  spec 0 0 0  shi 64  trans 0.25
OBJECT world
kids 2
OBJECT poly
loc 10 0 0
SOLID
kids 0
OBJECT poly
rot -1 0 0 0 1 0 0 0 1
loc 0 20 0
SOLID
kids 0
)";

TEST(AssimpFile, mirrored_nodes_keep_the_outside_out) {
    const std::string solid =
        "numvert 4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\nnumsurf 4\n"
        "SURF 0x00\nmat 0\nrefs 3\n0 0 0\n2 0 0\n1 0 0\nSURF 0x00\nmat 0\nrefs 3\n0 0 0\n1 0 0\n3 0 0\n"
        "SURF 0x00\nmat 0\nrefs 3\n0 0 0\n3 0 0\n2 0 0\nSURF 0x00\nmat 0\nrefs 3\n1 0 0\n2 0 0\n3 0 0";
    std::string text = kMirrored;
    for (size_t at; (at = text.find("SOLID")) != std::string::npos;) text.replace(at, 5, solid);
    const LoadedMesh loaded = load_mesh(text, "a.ac");
    const MeshSums sums = sum_mesh(loaded.mesh);
    EXPECT_EQ(loaded.mesh.position.size(), 8u);
    EXPECT_EQ(loaded.mesh.triangle.size(), 8u);
    EXPECT_EQ(sums.unpaired, 0u);
    EXPECT_NEAR(sums.volume, 2.0 / 6, 1e-12);  // both volumes have the same sign
    EXPECT_EQ(sums.min, Vec3d(-1, 0, 0));
    EXPECT_EQ(sums.max, Vec3d(11, 21, 1));
    ASSERT_FALSE(loaded.mesh.material.empty());
    EXPECT_EQ(loaded.mesh.material[0].name, "skin");
    EXPECT_FLOAT_EQ(loaded.mesh.material[0].diffuse[2], 0.5f);
    EXPECT_FLOAT_EQ(loaded.mesh.material[0].transparency, 0.25f);
}

// --- errors

struct AssimpTrouble : FolderTest {
    std::string old_helpers;
    void SetUp() override {
        FolderTest::SetUp();
        if (const char* set = std::getenv("TROCAR_LIBEXEC")) old_helpers = set;
    }
    void TearDown() override {
        ::setenv("TROCAR_LIBEXEC", old_helpers.c_str(), 1);
        FolderTest::TearDown();
    }
    // Replaces the reader program by a script.
    void replace_reader(const std::string& script) {
        const fs::path program = put("bin/trocar-assimp-reader", "#!/bin/sh\n" + script);
        ::chmod(program.c_str(), 0755);
        ::setenv("TROCAR_LIBEXEC", program.parent_path().c_str(), 1);
    }
};

TEST_F(AssimpTrouble, a_reader_that_crashes_or_lies_is_one_clear_error) {
    const fs::path path = put("a.glb", "glTF");
    const auto says = [&](const std::string& script) {
        replace_reader(script);
        return error_of(path).substr(path.string().size());
    };
    EXPECT_EQ(says("kill -SEGV $$"), ": its reader crashed (Segmentation fault)");
    EXPECT_EQ(says("echo 'free(): invalid pointer' >&2; kill -ABRT $$"), ": its reader crashed (Aborted): free(): invalid pointer");
    EXPECT_EQ(says("echo hello"), ": the reader's answer is not one of its kind");
    EXPECT_EQ(says("exit 0"), ": the reader's answer is not one of its kind");
    EXPECT_EQ(says("printf 'trocar mesh 1\\n'"), ": the reader's answer ends within its counts");
    EXPECT_EQ(says("echo 'no such chunk' >&2; exit 1"), ": no such chunk");
    EXPECT_NE(says("exit 2").find(": not a format this program reads ("), std::string::npos);
    EXPECT_EQ(says("exit 75").find(": its reader ran out of its "), helper_address_space(1) == 0 ? std::string::npos : 0u);
    EXPECT_EQ(says("exit 9"), ": its reader ended with code 9");
}

TEST_F(AssimpTrouble, files_named_inside_come_from_below_the_folder_only) {
    const std::string binary(840, '\0');
    const auto scene = [](const std::string& uri) {
        return R"({"asset":{"version":"2.0"},"buffers":[{"uri":")" + uri + R"(","byteLength":840}],)" +
               R"("bufferViews":[{"buffer":0,"byteLength":36}],)" +
               R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],)" +
               R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],)" +
               R"("scenes":[{"nodes":[0]}],"scene":0})";
    };
    put("secret.bin", binary);
    put("in/beside.bin", binary);
    fs::create_symlink(folder / "secret.bin", folder / "in/link.bin");
    EXPECT_EQ(error_of(put("in/a.gltf", scene("beside.bin"))), "no error");
    for (const std::string& uri : {std::string("../secret.bin"), (folder / "secret.bin").string(), std::string("link.bin")}) {
        EXPECT_NE(error_of(put("in/a.gltf", scene(uri))).find("could not open referenced file"), std::string::npos) << uri;
    }
}

TEST_F(AssimpTrouble, damaged_files_are_refused_with_a_reason) {
    if (!fs::exists(kModels)) GTEST_SKIP() << "assimp-testmodels is absent";
    EXPECT_NE(error_of(kModels / "glTF2/BoxWithInfinites-glTF-Binary/BoxWithInfinites.glb").find("vertex 0 is not finite"),
              std::string::npos);
    EXPECT_NE(error_of(kModels / "glTF2/RecursiveNodes/RecursiveNodes.gltf").find("recursive reference"), std::string::npos);
    EXPECT_NE(error_of(kModels / "OpenGEX/light_issue1262.ogex").find("found no surface"), std::string::npos);
}

// Every file of the collection ends in a surface or in an error that names it; run_child stops readers that
// do not end.
TEST(AssimpLong, every_model_of_the_collection_ends_in_an_answer_or_an_error) {
    if (!fs::exists(kModels)) GTEST_SKIP() << "assimp-testmodels is absent";
    size_t read = 0, refused = 0;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(kModels)) {
        if (!entry.is_regular_file()) continue;
        try {
            const LoadedMesh loaded = load_mesh(entry.path());
            EXPECT_FALSE(loaded.mesh.triangle.empty());
            ++read;
        } catch (const InputError& error) {
            EXPECT_TRUE(std::string(error.what()).starts_with(entry.path().string())) << error.what();
            EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
            ++refused;
        }
    }
    EXPECT_GE(read, 280u);
    std::printf("%zu read, %zu refused\n", read, refused);
}

}  // namespace
}  // namespace trocar
