#include "content/texture.hpp"

#include <algorithm>

#include "engine/error.hpp"
#include "engine/image_file.hpp"
namespace trocar {

std::string load_texture(const std::filesystem::path& folder, Material& material) {
    std::string name = material.texture;
    if (name.starts_with("file://")) name.erase(0, 7);
    if (name.find("://") != std::string::npos) return "texture '" + material.texture + "' is not on this machine";
    std::replace(name.begin(), name.end(), '\\', '/');
    const std::filesystem::path path = folder / name;
    std::error_code ignored;
    if (!std::filesystem::is_regular_file(path, ignored)) return "texture '" + material.texture + "' is missing";
    try {
        material.image = load_image(path);
    } catch (const InputError& error) {
        return std::string("texture not used: ") + error.what();
    }
    return "";
}

}  // namespace trocar
