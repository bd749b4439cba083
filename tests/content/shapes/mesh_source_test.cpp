#include "content/shapes/mesh_source.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "content/shapes/shape_library.hpp"
#include "engine/base/error.hpp"
#include "tests/reference/closed_surface.hpp"
namespace trocar {
namespace {

TEST(MeshSource, NamesShapesWithTrianglesAndSeed) {
    const auto hash = [](const Mesh& mesh) { return reference::hash_mesh(mesh); };
    EXPECT_EQ(hash(load_mesh_or_shape("shape:probe").mesh), hash(make_shape("probe", 10000)));
    EXPECT_EQ(hash(load_mesh_or_shape("probe").mesh), hash(make_shape("probe", 10000)));
    EXPECT_EQ(hash(load_mesh_or_shape("shape:probe:1000").mesh), hash(make_shape("probe", 1000)));
    EXPECT_EQ(hash(load_mesh_or_shape("shape:gallbladder:1000:7").mesh), hash(make_shape("gallbladder", 1000, 7)));
}

TEST(MeshSource, AFileOfThatNameComesFirst) {
    namespace fs = std::filesystem;
    const fs::path folder = fs::path(testing::TempDir()) / "trocar_mesh_source";
    fs::create_directories(folder);
    std::ofstream(folder / "box") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    const fs::path before = fs::current_path();
    fs::current_path(folder);
    const size_t file = load_mesh_or_shape("box").mesh.triangle.size();
    const size_t shape = load_mesh_or_shape("shape:box:12").mesh.triangle.size();
    fs::current_path(before);
    fs::remove_all(folder);
    EXPECT_EQ(file, 1u);
    EXPECT_EQ(shape, 12u);
}

TEST(MeshSource, RefusesWithTheWordThatIsWrong) {
    for (const auto& [source, part] : {std::pair{"shape:lever", "\"lever\""},
                                       {"shape:", "no shape"},
                                       {"shape:box:many", "\"many\""},
                                       {"shape:box:-12", "\"-12\""},
                                       {"shape:box:12:", "\"\""},
                                       {"shape:box:99999999999", "99999999999"},
                                       {"shape:box:12:1:1", "shape:box:12:1:1"},
                                       {"nowhere.obj", "nowhere.obj"}}) {
        try {
            load_mesh_or_shape(source);
            FAIL() << source;
        } catch (const InputError& error) {
            EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
        }
    }
}

}  // namespace
}  // namespace trocar
