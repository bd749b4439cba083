#include "content/read/vrml/x3d.hpp"

#include <algorithm>
#include <map>
#include <pugixml.hpp>

#include "content/read/vrml/flatten.hpp"
#include "content/read/vrml/lexer.hpp"
#include "content/read/vrml/node_types.hpp"
#include "content/read/vrml/parser.hpp"
#include "engine/base/error.hpp"
namespace trocar::vrml {
namespace {

using pugi::xml_node;

// A node and the field of its parent that receives it.
struct Child {
    std::string container;
    NodeRef ref;
};

// State of the parser. The document's text is the file's, so that positions can be found. Text that does not
// occur verbatim in the file (field names that XML omits, values with &quot;) is appended.
struct XmlParser : DocumentBuilder {
    std::string buffer;  // copy of the file; pugixml modifies it in place
    std::map<std::string, Range, std::less<>> appended;
};

uint32_t offset_of(const XmlParser& p, const char* inside) { return static_cast<uint32_t>(inside - p.buffer.data()); }

uint32_t offset_of(const XmlParser& p, const xml_node& node) { return node.name()[0] == '\0' ? 0 : offset_of(p, node.name()); }

Range append(XmlParser& p, std::string_view text) {
    const auto found = p.appended.find(text);
    if (found != p.appended.end()) return found->second;
    if (p.document.text.size() + text.size() >= kNone) fail(p, 0, "more text than 32 bits can number");
    const Range range{static_cast<uint32_t>(p.document.text.size()), static_cast<uint32_t>(text.size())};
    p.document.text += text;
    if (text.size() < 64) p.appended.emplace(text, range);
    return range;
}

// Position in the text of a name or value from pugixml. Replaced entities other than '&' make it differ.
Range range_of(XmlParser& p, const char* inside) {
    const std::string_view value(inside);
    if (value.empty()) return {};
    const uint32_t offset = offset_of(p, inside);
    const bool as_written = std::string_view(p.document.text).substr(offset, value.size()) == value;
    if (as_written && value.find('&') == std::string_view::npos) return {offset, static_cast<uint32_t>(value.size())};
    return append(p, value);
}

void add_word(XmlParser& p, Field& field, Range bytes, bool quoted) {
    std::vector<Word>& word = p.document.word;
    if (word.size() >= kWordLimit) fail(p, field.offset, more_than(kWordLimit, "words"));
    if (bytes.count > kStringLimit) fail(p, field.offset, "a string is longer than 1048576 bytes");
    if (field.words.count == 0) field.words.first = static_cast<uint32_t>(word.size());
    word.push_back({bytes, quoted});
    ++field.words.count;
}

std::string_view without_space(std::string_view text) {
    while (!text.empty() && static_cast<unsigned char>(text.front()) <= ' ') text.remove_prefix(1);
    while (!text.empty() && static_cast<unsigned char>(text.back()) <= ' ') text.remove_suffix(1);
    return text;
}

// Attributes have no type: reads numbers, quoted strings, or otherwise the whole value as one word.
void read_value(XmlParser& p, Range value, Field& field) {
    const std::string_view whole = std::string_view(p.document.text).substr(0, value.end());
    const std::string_view inside = without_space(whole.substr(value.first));
    if (inside.empty()) return;
    Lexer lexer{whole, value.first};
    try {
        Token token = next_token(lexer);
        if (token.kind != TokenKind::kNumber && token.kind != TokenKind::kString) {
            const auto first = static_cast<uint32_t>(inside.data() - p.document.text.data());
            return add_word(p, field, {first, static_cast<uint32_t>(inside.size())}, false);
        }
        field.numbers.first = static_cast<uint32_t>(p.document.number.size());
        for (; token.kind != TokenKind::kEnd; token = next_token(lexer)) {
            if (token.kind == TokenKind::kNumber) {
                p.document.number.push_back(token.number);
                read_numbers(lexer, p.document.number);  // stops after kNumberRun numbers; the loop continues
            } else if (token.kind == TokenKind::kString || token.kind == TokenKind::kWord) {
                add_word(p, field, {token.offset, token.length}, token.kind == TokenKind::kString);
            }
        }
    } catch (const LexicalFault& fault) {
        warn(p, field.offset, std::string("the rest of a value is passed over: ") + fault.reason);
    }
    field.numbers.count = static_cast<uint32_t>(p.document.number.size()) - field.numbers.first;
}

Field read_attribute(XmlParser& p, Range name, const pugi::xml_attribute& attribute) {
    Field field;
    field.name = name;
    field.offset = attribute.value()[0] == '\0' ? offset_of(p, attribute.name()) : offset_of(p, attribute.value());
    read_value(p, range_of(p, attribute.value()), field);
    return field;
}

// The parent's field for a node without containerField; a prototype's instance goes where the first node of its body would go.
std::string default_container(const XmlParser& p, uint32_t node) {
    for (uint32_t depth = 0; p.document.node[node].prototype != kNone; ++depth) {
        const Range body = p.document.prototype[p.document.node[node].prototype].body;
        if (body.count == 0 || depth > kInlineLimit) return "children";
        node = p.document.ref[body.first].node;
    }
    const std::string_view type = text_of(p.document, p.document.node[node].type);
    const Role role = find_node_type(type).role;
    constexpr std::pair<Role, const char*> kContainers[] = {{Role::kAppearance, "appearance"},
                                                            {Role::kMaterial, "material"},
                                                            {Role::kTexture, "texture"},
                                                            {Role::kTextureTransform, "textureTransform"},
                                                            {Role::kTextureCoordinate, "texCoord"},
                                                            {Role::kCoordinate, "coord"},
                                                            {Role::kColor, "color"},
                                                            {Role::kElevationGrid, "geometry"},
                                                            {Role::kExtrusion, "geometry"}};
    for (const auto& [known, container] : kContainers) {
        if (role == known) return container;
    }
    if (takes_points(role) || is_primitive(role)) return "geometry";
    if (type == "Normal") return "normal";
    if (type.starts_with("Metadata")) return "metadata";
    if (type == "Text" || type == "IndexedLineSet" || type == "PointSet" || type == "LineSet") return "geometry";
    if (type == "FontStyle") return "fontStyle";
    return "children";
}

Range add_refs(XmlParser& p, const std::vector<NodeRef>& refs) {
    const Range range{static_cast<uint32_t>(p.document.ref.size()), static_cast<uint32_t>(refs.size())};
    p.document.ref.insert(p.document.ref.end(), refs.begin(), refs.end());
    return range;
}

Range add_fields(XmlParser& p, const std::vector<Field>& fields, uint32_t offset) {
    const Range range{static_cast<uint32_t>(p.document.field.size()), static_cast<uint32_t>(fields.size())};
    if (range.first + fields.size() > kNodeLimit) {
        fail(p, offset, more_than(kNodeLimit, "fields"));
    }
    p.document.field.insert(p.document.field.end(), fields.begin(), fields.end());
    return range;
}

std::vector<Child> read_children(XmlParser& p, const xml_node& parent);

std::vector<NodeRef> refs_of(const std::vector<Child>& children) {
    std::vector<NodeRef> refs;
    for (const Child& child : children) refs.push_back(child.ref);
    return refs;
}

// Adds one field per container, in order of first occurrence.
void add_child_fields(XmlParser& p, const std::vector<Child>& children, uint32_t offset, std::vector<Field>& fields) {
    std::vector<std::string> containers;
    for (const Child& child : children) {
        if (std::find(containers.begin(), containers.end(), child.container) == containers.end()) {
            containers.push_back(child.container);
        }
    }
    for (const std::string& container : containers) {
        std::vector<NodeRef> refs;
        for (const Child& child : children) {
            if (child.container == container) refs.push_back(child.ref);
        }
        Field field;
        field.name = append(p, container);
        field.offset = offset;
        field.nodes = add_refs(p, refs);
        fields.push_back(field);
    }
}

// <field name= value=> or <fieldValue name= value=>, with nodes inside if it is of a node type.
void add_named_field(XmlParser& p, const xml_node& element, std::vector<Field>& fields) {
    const pugi::xml_attribute name = element.attribute("name"), value = element.attribute("value");
    if (name.value()[0] == '\0') return warn(p, offset_of(p, element), "a field without a name is passed over");
    Field field;
    if (value) {
        field = read_attribute(p, range_of(p, name.value()), value);
    } else {
        field.name = range_of(p, name.value());
        field.offset = offset_of(p, element);
    }
    field.nodes = add_refs(p, refs_of(read_children(p, element)));
    fields.push_back(field);
}

// <IS><connect nodeField= protoField=/></IS>
void add_connections(XmlParser& p, const xml_node& is, std::vector<Field>& fields) {
    for (const xml_node& connect : is.children("connect")) {
        Field field;
        field.name = range_of(p, connect.attribute("nodeField").value());
        field.offset = offset_of(p, connect);
        field.is = true;
        add_word(p, field, range_of(p, connect.attribute("protoField").value()), false);
        fields.push_back(field);
    }
}

void read_prototype(XmlParser& p, const xml_node& element, bool external) {
    const char* const name = element.attribute("name").value();
    const uint32_t row = add_prototype(p, range_of(p, name), name, offset_of(p, element));
    if (external) {
        if (const pugi::xml_attribute url = element.attribute("url")) {
            p.document.prototype[row].url = read_attribute(p, {}, url).words;
        }
        return;
    }
    std::vector<Field> fields;
    p.scopes.emplace_back();
    p.open.push_back({row, true});
    for (const xml_node& field : element.child("ProtoInterface").children("field")) add_named_field(p, field, fields);
    p.document.prototype[row].interface = add_fields(p, fields, offset_of(p, element));
    const std::vector<NodeRef> body = refs_of(read_children(p, element.child("ProtoBody")));
    p.document.prototype[row].body = add_refs(p, body);
    p.open.pop_back();
    p.scopes.pop_back();
}

// Reads a node with its contents. Returns its reference, or none for a USE without a node to refer to.
NodeRef read_node(XmlParser& p, const xml_node& element, const char* type) {
    const uint32_t offset = offset_of(p, element);
    if (const pugi::xml_attribute use = element.attribute("USE")) return {find_used_node(p, use.value(), offset), true};
    const bool instance = type != element.name();
    const bool unknown = instance || find_node_type(type).role == Role::kUnknown;
    const char* const name = element.attribute("DEF").value();
    const uint32_t row = add_node(p, range_of(p, type), unknown ? visible_prototype(p, type) : kNone, range_of(p, name), name, offset);
    p.open.push_back({row, false});
    std::vector<Field> fields;
    for (const pugi::xml_attribute& attribute : element.attributes()) {
        constexpr std::string_view kNoFields[] = {"DEF", "USE", "containerField", "class", "id", "style"};
        const std::string_view key = attribute.name();
        if (instance || std::find(std::begin(kNoFields), std::end(kNoFields), key) != std::end(kNoFields)) continue;
        fields.push_back(read_attribute(p, range_of(p, attribute.name()), attribute));
    }
    for (const xml_node& child : element.children()) {
        const std::string_view kind = child.name();
        if (kind == "IS") add_connections(p, child, fields);
        if (kind == "field" || kind == "fieldValue") add_named_field(p, child, fields);
    }
    add_child_fields(p, read_children(p, element), offset, fields);
    p.document.node[row].fields = add_fields(p, fields, offset);
    p.open.pop_back();
    return {row, false};
}

// Reads the nodes inside an element, and declares prototypes.
std::vector<Child> read_children(XmlParser& p, const xml_node& parent) {
    if (p.open.size() > kElementNestingLimit) {
        fail(p, offset_of(p, parent), "nodes nested deeper than the limit of " + std::to_string(kElementNestingLimit));
    }
    std::vector<Child> children;
    for (const xml_node& element : parent.children()) {
        if (element.type() != pugi::node_element) continue;
        const std::string_view name = element.name();
        constexpr std::string_view kNoNodes[] = {"field", "fieldValue", "IS", "ROUTE", "IMPORT", "EXPORT", "head"};
        if (std::find(std::begin(kNoNodes), std::end(kNoNodes), name) != std::end(kNoNodes)) continue;
        if (name == "ProtoDeclare" || name == "ExternProtoDeclare") {
            read_prototype(p, element, name[0] == 'E');
            continue;
        }
        const bool instance = name == "ProtoInstance";
        const char* const type = instance ? element.attribute("name").value() : element.name();
        const NodeRef ref = read_node(p, element, type);
        if (ref.node == kNone) continue;
        const char* const container = element.attribute("containerField").value();
        children.push_back({container[0] != '\0' ? container : default_container(p, ref.node), ref});
    }
    return children;
}

// Rejects files with too many elements or attributes before the tree is built.
void check_size(const XmlParser& p) {
    uint64_t elements = 0, values = 0;
    for (size_t k = 0; k + 1 < p.document.text.size(); ++k) {
        elements += p.document.text[k] == '<' && p.document.text[k + 1] != '/';
        values += p.document.text[k] == '=';
    }
    if (elements > kNodeLimit) fail(p, 0, more_than(kNodeLimit, "elements"));
    if (values > kWordLimit) fail(p, 0, more_than(kWordLimit, "attributes"));
}

Document parse_x3d(std::string text, std::filesystem::path path) {
    if (text.size() >= kNone) throw InputError(path.string() + ": more text than 32 bits can number");
    XmlParser p;
    p.document.path = std::move(path);
    p.document.text = std::move(text);
    check_size(p);
    p.buffer = p.document.text;
    const size_t first = p.buffer.find('<');
    pugi::xml_document xml;
    const pugi::xml_parse_result result =
        xml.load_buffer_inplace(p.buffer.data() + first, p.buffer.size() - first, pugi::parse_escapes, pugi::encoding_utf8);
    if (!result) {
        fail(p, static_cast<uint32_t>(first + static_cast<size_t>(result.offset)),
             std::string("not well-formed XML: ") + result.description());
    }
    const xml_node root = xml.child("X3D");
    for (const xml_node& unit : root.child("head").children("unit")) {
        const double factor = unit.attribute("conversionFactor").as_double(1);
        if (std::string_view(unit.attribute("category").value()) == "length" && factor != 1)
            warn(p, offset_of(p, unit), "a unit of length is not applied: give a scale");
    }
    const xml_node scene = root.child("Scene");
    p.document.roots = add_refs(p, refs_of(read_children(p, scene ? scene : root)));
    return finish_document(p);
}

}  // namespace

bool looks_like_x3d(std::string_view text) {
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    const size_t first = text.find_first_not_of(" \t\r\n");
    if (first == std::string_view::npos || text[first] != '<') return false;
    return text.substr(0, kStringLimit).find("<X3D") != std::string_view::npos;
}

Document read_document(std::string text, std::filesystem::path path, const LoadProgress& progress) {
    return looks_like_x3d(text) ? parse_x3d(std::move(text), std::move(path)) : parse_document(std::move(text), std::move(path), progress);
}

}  // namespace trocar::vrml
