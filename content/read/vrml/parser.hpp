#pragma once
#include <string>
#include <unordered_map>

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

// What the parsers of classic and of XML files share: the document, and what stands open in it.
struct DocumentBuilder {
    // The names that a file or the body of a PROTO gives.
    struct Scope {
        std::unordered_map<std::string_view, uint32_t> node, prototype;
    };
    struct Element {
        uint32_t row;  // of the node, or of the prototype
        bool body;     // the body of a PROTO
    };
    Document document;
    std::vector<Scope> scopes{1};  // of the file, then of the surrounding PROTO bodies
    std::vector<Element> open;     // whose end has not been read yet, outermost first
    size_t suppressed = 0;         // warnings beyond the first hundred
};

[[noreturn]] void fail(const DocumentBuilder& b, uint32_t offset, const std::string& reason);
void warn(DocumentBuilder& b, uint32_t offset, const std::string& text);

// The innermost PROTO of that name declared so far; kNone if there is none. VRML97 4.8.4: a PROTO is known in the file or
// the body that declares it and in bodies within, from its declaration on.
uint32_t visible_prototype(const DocumentBuilder& b, std::string_view name);

// Adds a node or a PROTO under the names it can be found by until its scope ends. The texts behind the names stay in place.
uint32_t add_node(DocumentBuilder& b, Range type, uint32_t prototype, Range name, std::string_view known_as, uint32_t offset);
uint32_t add_prototype(DocumentBuilder& b, Range name, std::string_view known_as, uint32_t offset);

// The node that a USE refers to. kNone with a warning for an unknown name, and for a surrounding node in a field of a
// Script or of a prototype's instance: such a field is a handle of a program and shows nothing. Any other USE of a
// surrounding node is an error.
uint32_t find_used_node(DocumentBuilder& b, std::string_view name, uint32_t offset);

// The finished document, with the number of warnings left out.
Document finish_document(DocumentBuilder& b);

// Parses VRML 1.0, VRML97, Inventor 2.1 or X3D in classic encoding with one grammar that does not know node
// types. Drops routes; an unknown USE is a warning, a USE inside its own DEF an error. Throws InputError
// "file:line:column: reason (in Separator > Group)".
Document parse_document(std::string text, std::filesystem::path path, const LoadProgress& progress = {});

}  // namespace trocar::vrml
