#pragma once
#include <string>

#include "content/read/load_mesh.hpp"
#include "content/read/vrml/node.hpp"
namespace trocar::vrml {

inline constexpr uint32_t kNestingLimit = 1000;     // nesting depth of nodes
inline constexpr uint32_t kNodeLimit = 5'000'000;   // per file, of nodes and of fields
inline constexpr uint32_t kWordLimit = 20'000'000;  // per file, of strings and words together

// Message for a file that exceeds a limit.
std::string more_than(uint32_t limit, std::string_view what);

// Share of reading the text in the total work on a file; building surfaces is the rest.
inline constexpr double kTextShare = 0.6;

// Parses VRML 1.0, VRML97, Inventor 2.1 or X3D in classic encoding with one grammar that does not know node
// types. Drops routes; an unknown USE is a warning, a USE inside its own DEF an error. Throws InputError
// "file:line:column: reason (in Separator > Group)".
Document parse_document(std::string text, std::filesystem::path path, const LoadProgress& progress = {});

}  // namespace trocar::vrml
