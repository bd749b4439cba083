#pragma once
#include <filesystem>
#include <string_view>

#include "content/load_mesh.hpp"
namespace trocar {

// Reads glTF, GLB, Collada, FBX, 3DS, LWO, Blender and what else assimp knows, in the child program
// trocar-assimp-reader with limits that grow with the file: 3 s of processor time and 1 s for each MB, 512 MiB of
// memory and 64 bytes a byte. `path` names the file in messages, tells the format by its extension where the content
// does not, and gives the folder below which files it names may lie. Nodes are flattened with their transforms,
// polygons cut, animation left out; coordinates are rounded to 32-bit floats, as Debian builds assimp, which a warning
// states. Not welded. Throws InputError "file: reason", also when the child crashed, ran out of its limits or answered
// nonsense.
LoadedMesh read_with_assimp(std::string_view bytes, const std::filesystem::path& path);

}  // namespace trocar
