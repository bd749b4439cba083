#pragma once
#include <string>

#include "content/load_mesh.hpp"
#include "content/vrml/node.hpp"
namespace trocar::vrml {

inline constexpr uint32_t kElementNestingLimit = 250;  // nodes around a node; each is a call on the stack

// Whether a text is XML that holds an X3D element.
bool looks_like_x3d(std::string_view text);

// Parses X3D in its XML spelling into the tree parse_document makes of the classic one: attributes become fields,
// elements inside an element the nodes of the field their type or containerField says. Entities of a document type are
// not expanded. Throws InputError "file:line:column: reason (in Scene > Shape)".
Document parse_x3d(std::string text, std::filesystem::path path);

// A scene file of any spelling.
Document read_document(std::string text, std::filesystem::path path, const LoadProgress& progress = {});

}  // namespace trocar::vrml
