#pragma once
#include <functional>

#include "components/mesh.hpp"
#include "content/text/local_file.hpp"
namespace trocar {

// Triangles of one shape of a scene graph, first to first + count.
struct MeshPart {
    std::string name;  // DEF name of the shape or of the nearest node above it that has one; may be empty
    uint32_t first = 0, count = 0;
};

// Result of reading a surface file.
struct LoadedMesh {
    Mesh mesh;                          // all surfaces of the file, in file units; texture v runs upwards
    std::vector<std::string> warnings;  // one line each, "file:line:column: what" where the position is known
    std::string format;                 // "VRML 1.0", "VRML97", "X3D", "OBJ", "STL ascii", "STL binary", ...
    // VRML: distinct points in coordinate lists that no face uses; they are not in the mesh. 0 for OBJ, whose
    // vertices belong to the file and not to a surface, and for STL, which has none.
    uint64_t unused_points = 0;
    std::vector<MeshPart> parts{};  // VRML and X3D, in order; shapes below one named node are one part. Empty for other formats
};

// Formats read by load_mesh, for messages.
inline constexpr const char* kFormatsRead =
    "VRML 1.0 and 97, X3D, plain or gzip; OBJ; STL; PLY; OFF; VTK PolyData (.vtk, .vtp in ascii); through assimp glTF, Collada, FBX, "
    "3DS, LWO and others";

// Called occasionally on the reading thread while a long file is read, with the fraction done, 0 to 1.
using LoadProgress = std::function<void(double)>;

struct LoadOptions {
    LoadProgress progress{};
    FileRoots roots{};  // folders whose files the file may name, besides those below its own
};

// Reads a surface: VRML 1.0 or 97 or X3D (XML or classic; plain or gzip), OBJ, STL, PLY, OFF or VTK
// PolyData (.vtk, .vtp), detected by content, not by name. All other files are passed to assimp in a separate process
// (content/read/assimp_file.hpp). Opens no other files than those below the folder of `path` and the given
// roots. Merges identical positions and drops vertices without a face; repairs nothing else. Loads textures from beside the file; a
// missing one is a warning. Throws InputError "file:line:column: reason", also if there is no triangle.
LoadedMesh load_mesh(const std::filesystem::path& path, const LoadOptions& options = {});

// The same for bytes in memory (gzip unpacked); `path` is used in messages and gives the folder.
LoadedMesh load_mesh(std::string bytes, const std::filesystem::path& path, LoadOptions options = {});

}  // namespace trocar
