#pragma once
#include <string>

#include "content/read/load_mesh.hpp"
#include "content/read/vrml/node.hpp"
namespace trocar::vrml {

inline constexpr uint32_t kElementNestingLimit = 250;  // nesting depth; each level is a recursive call

// Whether a text is XML with an X3D element.
bool looks_like_x3d(std::string_view text);

// Parses a scene file in any encoding. X3D in XML becomes the same tree as by parse_document: attributes become fields; child
// elements become nodes of the field given by their type or containerField. Does not expand entities of a document
// type. Throws InputError "file:line:column: reason (in Scene > Shape)".
Document read_document(std::string text, std::filesystem::path path, const LoadProgress& progress = {});

}  // namespace trocar::vrml
