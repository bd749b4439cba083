#pragma once
#include <string>

#include "components/mesh.hpp"
#include "content/text/local_file.hpp"
namespace trocar {

// Loads the image named by material.texture, a path relative to folder that must stay below the roots
// (local_file.hpp). Returns an empty text, or the reason for failure; the material then stays plain.
std::string load_texture(const FileRoots& roots, const std::filesystem::path& folder, Material& material);

}  // namespace trocar
