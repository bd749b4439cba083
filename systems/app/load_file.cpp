#include "systems/app/load_file.hpp"

#include <filesystem>

#include "systems/app/progress.hpp"
namespace trocar {

LoadedMesh load_file(const std::string& file) {
    const std::filesystem::path path = file;
    Progress progress("reading " + path.filename().string());
    return load_mesh(path, [&](double done) { progress.show(done, "read"); });
}

}  // namespace trocar
