#pragma once
#include <map>
#include <memory>
#include <set>
#include <span>
#include <unordered_map>

#include "content/vrml/node.hpp"
#include "content/vrml/node_types.hpp"
namespace trocar::vrml {

// A node of one of the files of a scene, seen from inside one instance of a PROTO (scope 0: none).
struct NodeId {
    uint32_t document = 0;
    uint32_t node = kNone;
    uint32_t scope = 0;
    auto operator<=>(const NodeId&) const = default;
};

// One instance of a PROTO: where IS finds its values.
struct Scope {
    NodeId instance;
    uint32_t document = 0;  // that holds the PROTO
    uint32_t prototype = 0;
    uint32_t depth = 0;
};

// A file and what each of its nodes is for.
struct SceneFile {
    Document document;
    Language language = Language::kBoth;  // told by its nodes, else its header
    std::string format;
    std::vector<Role> role;                                    // one per node
    std::unordered_map<std::string_view, uint32_t> prototype;  // row of the last of that name
};

// A file with those it inlines, and what was passed over so far.
struct Scene {
    std::vector<std::unique_ptr<SceneFile>> file;  // 0 is the one asked for
    std::vector<Scope> scope;
    std::map<NodeId, uint32_t> scope_of_instance;
    std::map<std::string, uint32_t> file_of_path;
    std::vector<std::string> warnings;
    std::set<std::string> warned;  // what is said once only
};

// A field's value and where its nodes live; field is null when the node has none.
struct Value {
    const Document* document = nullptr;
    const Field* field = nullptr;
    uint32_t file = 0;
    uint32_t scope = 0;
    explicit operator bool() const { return field != nullptr; }
};

// Adds a parsed file: roles, language, a warning for each unknown type of node, unknown field, and a header that is
// missing or contradicts the nodes.
uint32_t add_file(Scene& scene, Document document);

// Reads a file that `from` names, unless it lies outside the folder of the scene's first file or cannot be read: then
// kNone and a warning.
uint32_t load_file(Scene& scene, uint32_t from, const std::string& url, uint32_t offset);

// The first of the files a url field names that can be read, or kNone.
uint32_t load_first(Scene& scene, const Value& url);

// True the first time a key is given, and while there are not too many: then something may be said about it.
bool first_time(Scene& scene, const std::string& key);

// Follows instances of PROTOs to the node they stand for. Its role is kUnknown where there is none. Throws InputError
// when prototypes nest deeper than kInlineLimit.
NodeId resolve(Scene& scene, NodeId id);

Role role_of(const Scene& scene, NodeId id);
const Node& node_of(const Scene& scene, NodeId id);
std::string type_of(const Scene& scene, NodeId id);
std::string place_of(const Scene& scene, NodeId id);

// The value of a field, through IS to the instance or the default of the PROTO.
Value find_value(const Scene& scene, NodeId id, std::string_view name);

// The numbers of a field; InputError with file and line where a word stands among them.
std::span<const double> numbers_of(const Value& value);
// The same; also where there are some, or a word, but not as many as `least`.
std::span<const double> numbers_of(const Value& value, size_t least);
std::span<const double> numbers_at(const Scene& scene, NodeId id, std::string_view name);  // empty for no node
std::vector<std::string> urls_of(const Value& value);                                      // the strings or words, at most 16
std::string text_of(const Value& value);                                                   // first string or word, empty if none
NodeId first_node(Scene& scene, const Value& value);                                       // resolved; node kNone if none
bool flag_of(const Value& value, bool otherwise);                                          // TRUE or FALSE

// Place of the k-th number of a value, found by reading its text again.
std::string place_of_number(const Value& value, uint32_t k);

}  // namespace trocar::vrml
