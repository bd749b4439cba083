#include "content/scene/find_scene.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>

#include "engine/base/error.hpp"
#include "tests/reference/paths.hpp"

namespace trocar {
namespace {
namespace fs = std::filesystem;

// A folder that is named like a scene, as `--out NAME` makes it, does not hide the scene; a file does.
TEST(FindScene, FoldersHideNoScene) {
    const fs::path folder = fs::temp_directory_path() / ("trocar_find_scene_" + std::to_string(getpid())), before = fs::current_path();
    fs::create_directories(folder / "probe_on_liver");
    fs::create_directories(folder / "out");
    setenv("TROCAR_SCENES", (source_folder() / "content/scenes").c_str(), 1);
    fs::current_path(folder);
    EXPECT_EQ(find_scene("probe_on_liver"), source_folder() / "content/scenes/probe_on_liver.toml");
    EXPECT_THROW(find_scene("out"), InputError);
    fs::remove(folder / "probe_on_liver");
    std::ofstream("probe_on_liver") << "seconds = 1\n";
    EXPECT_EQ(find_scene("probe_on_liver"), fs::path("probe_on_liver"));
    fs::current_path(before);
    unsetenv("TROCAR_SCENES");
    fs::remove_all(folder);
}

}  // namespace
}  // namespace trocar
