#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "components/math.hpp"
namespace trocar::vrml {

// The untyped tree of a scene file in flat arrays. Names and strings are byte ranges of the text, so the tree
// depends neither on the language version nor on the meaning of a node. Nodes are ordered by opening brace.

struct Word {
    Range bytes;  // without quotes, escapes included
    bool quoted = false;
};

// A node in a list. A USE refers to a node named by an earlier DEF, so references are acyclic.
struct NodeRef {
    uint32_t node = kNone;
    bool use = false;
};

struct Field {
    Range name;           // bytes; of an IS the field of this node
    uint32_t offset = 0;  // start of its value
    Range numbers;        // indices into Document::number
    Range words;          // indices into Document::word
    Range nodes;          // indices into Document::ref
    bool is = false;      // `name IS word`: takes the value of the PROTO's field
};

struct Node {
    Range type;                  // bytes
    Range name;                  // bytes, DEF name; empty if none
    uint32_t offset = 0;         // position of its type
    Range fields;                // indices into Document::field
    Range children;              // indices into Document::ref: nodes without a field name (VRML 1.0)
    uint32_t prototype = kNone;  // index of the PROTO that its type names where it stands
};

// PROTO (body) or EXTERNPROTO (url).
struct Prototype {
    Range name;  // bytes
    uint32_t offset = 0;
    Range interface;      // indices into Document::field; the values are the defaults
    Range body;           // indices into Document::ref
    Range url;            // indices into Document::word
    bool nested = false;  // declared in the body of another PROTO, outside of which its name means nothing
};

struct Document {
    std::filesystem::path path;
    std::string text;
    std::vector<double> number;
    std::vector<Word> word;
    std::vector<NodeRef> ref;
    std::vector<Field> field;
    std::vector<Node> node;
    std::vector<Prototype> prototype;
    Range roots;                        // indices into ref
    std::vector<std::string> warnings;  // skipped input
};

inline std::string_view text_of(const Document& document, Range bytes) {
    return std::string_view(document.text).substr(bytes.first, bytes.count);
}

// "file:line:column" of a byte.
std::string describe_location(const Document& document, uint32_t offset);

// " (in Separator > Group)" from type names, outermost first; long paths are shortened in the middle.
std::string describe_path(const std::vector<std::string>& types);

// Up to 40 printable characters of a text from a file, for messages.
std::string printable(std::string_view text);

}  // namespace trocar::vrml
