#include "content/text/local_file.hpp"

#include <algorithm>
namespace trocar {
namespace {

namespace fs = std::filesystem;

// Why a file must not or cannot be opened.
std::string refusal_of(const fs::path& file, const FileRoots& roots) {
    std::error_code fault;
    const fs::path path = fs::weakly_canonical(fs::absolute(file, fault), fault);
    if (fault) return "there is no such file";
    const bool allowed = std::any_of(roots.begin(), roots.end(), [&](const fs::path& root) {
        const fs::path top = fs::canonical(root / ".", fault), inside = path.lexically_relative(top);
        return !fault && !inside.empty() && *inside.begin() != "..";
    });
    if (!allowed) return fault ? "there is no such file" : "it lies outside the folder of the file that names it";
    return fs::is_regular_file(path, fault) ? "" : "there is no such file";
}

}  // namespace

LocalFile find_local_file(const FileRoots& roots, const fs::path& folder, std::string name) {
    if (name.starts_with("file://")) name.erase(0, 7);
    std::replace(name.begin(), name.end(), '\\', '/');
    if (name.find("://") != std::string::npos) return {{}, "it is not on this machine"};
    if (name.empty() || name.find('\0') != std::string::npos) return {{}, "it has no name"};
    const std::string refusal = refusal_of(folder / name, roots);
    if (refusal.empty()) return {folder / name, ""};
    for (size_t k = 1; k < roots.size(); ++k) {
        if (refusal_of(roots[k] / name, roots).empty()) return {roots[k] / name, ""};
    }
    return {{}, refusal};
}

}  // namespace trocar
