#include "systems/app/console/load_file.hpp"

#include <cstdio>
#include <filesystem>

#include "content/shapes/mesh_source.hpp"
#include "engine/base/error.hpp"
#include "systems/app/console/progress.hpp"
namespace trocar {

LoadedMesh load_file(const std::string& file, const FileRoots& roots) {
    Progress progress("reading " + std::filesystem::path(file).filename().string());
    for (const std::filesystem::path& root : roots) {
        if (!std::filesystem::is_directory(root)) throw InputError("--root " + root.string() + ": there is no such folder");
    }
    LoadedMesh loaded = load_mesh_or_shape(file, {[&](double done) { progress.show(done, "read"); }, roots});
    for (const std::string& warning : loaded.warnings) std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
    return loaded;
}

}  // namespace trocar
