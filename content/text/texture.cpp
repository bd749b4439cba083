#include "content/text/texture.hpp"

#include "engine/base/error.hpp"
#include "engine/files/image_file.hpp"
namespace trocar {

std::string load_texture(const FileRoots& roots, const std::filesystem::path& folder, Material& material) {
    const LocalFile file = find_local_file(roots, folder, material.texture);
    if (!file.refusal.empty()) return "texture '" + material.texture + "' is not read: " + file.refusal;
    try {
        material.image = load_image(file.path);
    } catch (const InputError& error) {
        return std::string("texture not used: ") + error.what();
    }
    return "";
}

}  // namespace trocar
