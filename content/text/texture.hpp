#pragma once
#include <filesystem>
#include <string>

#include "components/mesh.hpp"
namespace trocar {

// Loads the image named by material.texture, a path relative to folder that must stay below root
// (local_file.hpp). Returns an empty text, or the reason for failure; the material then stays plain.
std::string load_texture(const std::filesystem::path& root, const std::filesystem::path& folder, Material& material);

}  // namespace trocar
