#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "components/math.hpp"
namespace trocar::vrml {

// The untyped tree of a scene file: flat arrays, names and strings as ranges of bytes of the text, so that neither the
// version of the language nor the meaning of a node matters here. Nodes come in the order their braces open.

struct Word {
    Range bytes;  // without quotes, escapes still in it
    bool quoted = false;
};

// A node in a list. A USE refers to a node that an earlier DEF named, so references never run in circles.
struct NodeRef {
    uint32_t node = kNone;
    bool use = false;
};

struct Field {
    Range name;           // bytes; of an IS the field of this node
    uint32_t offset = 0;  // where its value begins
    Range numbers;        // rows of Document::number
    Range words;          // rows of Document::word
    Range nodes;          // rows of Document::ref
    bool is = false;      // `name IS word`: the value is that of the PROTO's field
};

struct Node {
    Range type;           // bytes
    Range name;           // bytes; of DEF, empty if none
    uint32_t offset = 0;  // where its type stands
    Range fields;         // rows of Document::field
    Range children;       // rows of Document::ref: nodes without a field name (VRML 1.0)
};

// PROTO (body) or EXTERNPROTO (url).
struct Prototype {
    Range name;  // bytes
    uint32_t offset = 0;
    Range interface;  // rows of Document::field, values are the defaults
    Range body;       // rows of Document::ref
    Range url;        // rows of Document::word
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
    Range roots;                        // rows of ref
    std::vector<std::string> warnings;  // what the parser passed over
};

inline std::string_view text_of(const Document& document, Range bytes) {
    return std::string_view(document.text).substr(bytes.first, bytes.count);
}

// "file:line:column" of a byte.
std::string describe_place(const Document& document, uint32_t offset);

// " (in Separator > Group)" from type names, outermost first; the middle of long paths is left out.
std::string describe_path(const std::vector<std::string>& types);

// At most 40 printable characters of a text from a file, for a message.
std::string printable(std::string_view text);

}  // namespace trocar::vrml
