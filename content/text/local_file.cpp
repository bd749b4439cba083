#include "content/text/local_file.hpp"

#include <algorithm>
namespace trocar {

LocalFile find_local_file(const std::filesystem::path& root, const std::filesystem::path& folder, std::string name) {
    namespace fs = std::filesystem;
    if (name.starts_with("file://")) name.erase(0, 7);
    std::replace(name.begin(), name.end(), '\\', '/');
    if (name.find("://") != std::string::npos) return {{}, "it is not on this machine"};
    if (name.empty() || name.find('\0') != std::string::npos) return {{}, "it has no name"};
    std::error_code fault;
    const fs::path top = fs::canonical(root / ".", fault);
    if (fault) return {{}, "there is no such file"};
    const fs::path path = fs::weakly_canonical(fs::absolute(folder / name, fault), fault);
    if (fault) return {{}, "there is no such file"};
    const fs::path inside = path.lexically_relative(top);
    if (inside.empty() || *inside.begin() == "..") return {{}, "it lies outside the folder of the file that names it"};
    if (!fs::is_regular_file(path, fault)) return {{}, "there is no such file"};
    return {folder / name, ""};
}

}  // namespace trocar
