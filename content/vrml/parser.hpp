#pragma once
#include <string>

#include "content/load_mesh.hpp"
#include "content/vrml/node.hpp"
namespace trocar::vrml {

inline constexpr uint32_t kNestingLimit = 1000;     // nodes around a node
inline constexpr uint32_t kNodeLimit = 5'000'000;   // nodes, and fields, of a file
inline constexpr uint32_t kWordLimit = 20'000'000;  // strings and words of a file

// What to say of a file that has more than it may have of something.
std::string more_than(uint32_t limit, std::string_view what);

// The share of the work of a file that reading its text is; the rest is building its surfaces.
inline constexpr double kTextShare = 0.6;

// Parses VRML 1.0, VRML97, Inventor 2.1 or X3D in its classic spelling; one grammar, without a list of node types,
// serves all. Routes are dropped, an unknown USE is a warning, a USE inside its own DEF an error. Throws InputError
// "file:line:column: reason (in Separator > Group)".
Document parse_document(std::string text, std::filesystem::path path, const LoadProgress& progress = {});

}  // namespace trocar::vrml
