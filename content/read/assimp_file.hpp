#pragma once
#include <filesystem>
#include <string_view>

#include "content/read/load_mesh.hpp"
namespace trocar {

// Reads glTF, GLB, Collada, FBX, 3DS, LWO, Blender and other formats that assimp knows, in the child program
// trocar-assimp-reader, limited by file size: 3 s of processor time plus 1 s per MB, 512 MiB of memory plus
// 64 bytes per byte. `path` names the file in messages, gives the format by its extension if the content does
// not, and gives the folder that referenced files must be in. Flattens nodes with their transforms,
// triangulates polygons, drops animation. Coordinates are rounded to 32-bit floats (Debian's build of
// assimp); a warning says so. Not welded. Throws InputError "file: reason", also if the child crashed,
// exceeded its limits or returned invalid data.
LoadedMesh read_with_assimp(std::string_view bytes, const std::filesystem::path& path, const FileRoots& roots);

}  // namespace trocar
