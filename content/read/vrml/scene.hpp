#pragma once
#include <map>
#include <memory>
#include <set>
#include <span>

#include "content/read/vrml/node.hpp"
#include "content/read/vrml/node_types.hpp"
#include "content/text/local_file.hpp"
namespace trocar::vrml {

// A node in a file of the scene, as seen from one instance of a PROTO (scope 0: none).
struct NodeId {
    uint32_t document = 0;
    uint32_t node = kNone;
    uint32_t scope = 0;
    auto operator<=>(const NodeId&) const = default;
};

// A PROTO in a file of the scene.
struct PrototypeId {
    uint32_t document = 0;
    uint32_t row = kNone;
};

// One instance of a PROTO, from which IS takes its values.
struct Scope {
    NodeId instance;
    PrototypeId prototype;
    uint32_t depth = 0;
};

// A file and the role of each of its nodes.
struct SceneFile {
    Document document;
    Language language = Language::kBoth;  // from its nodes, otherwise from its header
    std::string format;
    std::vector<Role> role;  // one per node
};

// A file with the files it inlines, and the warnings so far.
struct Scene {
    FileRoots roots;
    std::vector<std::unique_ptr<SceneFile>> file;  // 0 is the main file
    std::vector<Scope> scope;
    std::map<NodeId, uint32_t> scope_of_instance;
    std::map<std::string, uint32_t> file_of_path;
    std::vector<std::string> warnings;
    std::set<std::string> warned;  // keys of warnings given only once
};

// A field's value and the scope of its nodes; field is null if the node has none.
struct Value {
    const Document* document = nullptr;
    const Field* field = nullptr;
    uint32_t file = 0;
    uint32_t scope = 0;
    explicit operator bool() const { return field != nullptr; }
};

// Adds a parsed file: roles, language, and a warning for each unknown node type, unknown field, and a header
// that is missing or contradicts the nodes.
uint32_t add_file(Scene& scene, Document document);

// Loads a file referenced by `from`; kNone and a warning if unreadable or outside the roots.
uint32_t load_file(Scene& scene, uint32_t from, const std::string& url, uint32_t offset);

// The first readable file of a url field, or kNone.
uint32_t load_first(Scene& scene, const Value& url);

// True the first time a key is given, as long as there are not too many: limits the number of warnings.
bool first_time(Scene& scene, const std::string& key);

// Follows instances of PROTOs to the node they represent; role kUnknown if there is none. Throws InputError
// if prototypes nest deeper than kInlineLimit.
NodeId resolve(Scene& scene, NodeId id);

Role role_of(const Scene& scene, NodeId id);
const Node& node_of(const Scene& scene, NodeId id);
std::string type_of(const Scene& scene, NodeId id);
std::string position_of(const Scene& scene, NodeId id);

// The value of a field; IS is resolved to the instance's value or the PROTO's default.
Value find_value(const Scene& scene, NodeId id, std::string_view name);

// The numbers of a field; InputError with file and line if there is a word among them.
std::span<const double> numbers_of(const Value& value);
// The same; InputError also if there are some numbers or a word, but fewer than `least` numbers.
std::span<const double> numbers_of(const Value& value, size_t least);
std::span<const double> numbers_at(const Scene& scene, NodeId id, std::string_view name);  // empty for no node
double number_of(const Scene& scene, NodeId id, std::string_view name, double otherwise);  // the first number
std::vector<std::string> urls_of(const Value& value);                                      // strings or words, at most 16
std::string text_of(const Value& value);                                                   // first string or word, empty if none
NodeId first_node(Scene& scene, const Value& value);                                       // resolved; node kNone if none
bool flag_of(const Value& value, bool otherwise);                                          // TRUE or FALSE

// Position of the k-th number of a value, found by parsing its text again.
std::string location_of_number(const Value& value, uint32_t k);

}  // namespace trocar::vrml
