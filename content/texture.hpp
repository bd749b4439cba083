#pragma once
#include <filesystem>
#include <string>

#include "components/mesh.hpp"
namespace trocar {

// Loads the picture material.texture names, as a path relative to folder that stays below root (local_file.hpp).
// Returns an empty text, or why it could not; then the material keeps its plain colour.
std::string load_texture(const std::filesystem::path& root, const std::filesystem::path& folder, Material& material);

}  // namespace trocar
