#pragma once
#include "content/read/load_mesh.hpp"
#include "content/read/vrml/node.hpp"
namespace trocar::vrml {

inline constexpr uint64_t kTriangleLimit = 50'000'000;  // triangles of all surfaces together
inline constexpr uint64_t kExpansionLimit = 1'000'000;  // node visits in addition to one per node of the file
inline constexpr uint32_t kInlineLimit = 8;             // nesting depth of files, and of prototypes

// Whether a text begins with a header of VRML, Inventor or X3D, or with a node in their syntax.
bool looks_like_vrml(std::string_view text);

// All surfaces of a parsed file as one mesh in root coordinates: applies transforms, ear-clips polygons,
// makes one material per appearance, loads textures. Ignores normals, creaseAngle and solid: drawing computes
// its own normals, and judge_mesh decides what is closed. The version (1.0 or 97) follows from the node
// names, or else from the header. Not welded. Throws InputError "file:line:column: reason (in Separator >
// IndexedFaceSet)" if limits are exceeded, for a non-finite point, and for recursive files or prototypes;
// anything else it cannot use is a warning.
LoadedMesh flatten_document(Document document, const LoadOptions& options);

}  // namespace trocar::vrml
