#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// What a surface file gave.
struct LoadedMesh {
    Mesh mesh;                          // all its surfaces as one, in file units; v of the texture runs upwards
    std::vector<std::string> warnings;  // one line each, "file:line:column: what" where there is a place
    std::string format;                 // "VRML 1.0", "VRML97", "X3D", "OBJ", "STL ascii", "STL binary", ...
    // VRML: distinct points in the coordinate lists of its surfaces that no face uses; they are not in the mesh. 0 for
    // OBJ, whose vertices belong to the file and not to a surface, and STL, which has none.
    uint64_t unused_points = 0;
};

// What load_mesh reads, for messages.
inline constexpr const char* kFormatsRead =
    "VRML 1.0 and 97, X3D, plain or gzip; OBJ; STL; PLY; OFF; legacy VTK PolyData; through assimp glTF, Collada, FBX, "
    "3DS, LWO and others";

// Called now and then while a long file is read, on the thread that reads, with the share that is done, 0 to 1.
using LoadProgress = std::function<void(double)>;

// Reads a surface: VRML 1.0 or 97 or X3D (XML or classic; each plain or gzip), OBJ, STL, PLY, OFF or legacy VTK
// PolyData, told by content, not by name; anything else is handed to assimp in a process of its own
// (content/assimp_file.hpp). Only files below the folder of `path` are opened besides it.
// Vertices at exactly the same place are joined, vertices without a face dropped; nothing else is repaired. Pictures of
// textures are loaded from beside the file; a missing one is a warning. Throws InputError "file:line:column: reason",
// also when there is not a single triangle.
LoadedMesh load_mesh(const std::filesystem::path& path, const LoadProgress& progress = {});

// The same from bytes already in memory (gzip unpacked); `path` names them in messages and gives the folder.
LoadedMesh load_mesh(std::string bytes, const std::filesystem::path& path, const LoadProgress& progress = {});

}  // namespace trocar
