#pragma once
#include "content/load_mesh.hpp"
#include "content/vrml/node.hpp"
namespace trocar::vrml {

inline constexpr uint64_t kTriangleLimit = 50'000'000;  // triangles of all surfaces together
inline constexpr uint64_t kExpansionLimit = 1'000'000;  // visits of nodes beyond one for each node of the file
inline constexpr uint32_t kInlineLimit = 8;             // files inside files, prototypes inside prototypes

// Whether a text begins with a header of VRML, Inventor or X3D, or with a node as those languages write it.
bool looks_like_vrml(std::string_view text);

// All surfaces of a parsed file as one mesh in the coordinates of its root: transforms applied, polygons ear-clipped,
// one material per look, textures loaded; normals, creaseAngle and solid have no effect, since drawing makes its own
// normals and contact judges what is closed. Version 1.0 or 97 is told by the node names first, the header second. Not
// welded. Throws InputError "file:line:column: reason (in Separator > IndexedFaceSet)" beyond the limits, at a point
// that is not finite and where files or prototypes run in circles; all else it cannot use is a warning.
LoadedMesh flatten_document(Document document, const LoadProgress& progress = {});

}  // namespace trocar::vrml
