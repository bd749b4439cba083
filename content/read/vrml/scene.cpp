#include "content/read/vrml/scene.hpp"

#include <algorithm>

#include "content/read/vrml/flatten.hpp"
#include "content/read/vrml/lexer.hpp"
#include "content/read/vrml/x3d.hpp"
#include "content/text/words.hpp"
#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
namespace trocar::vrml {
namespace {

namespace fs = std::filesystem;

struct Header {
    Language language = Language::kBoth;
    std::string format;
};

// Parses the first line, case-insensitively; empty format if it is not a header.
Header read_header(std::string_view text) {
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    while (!text.empty() && static_cast<unsigned char>(text[0]) <= ' ') text.remove_prefix(1);
    const std::string line = lower_case(text.substr(0, 32));
    if (line.starts_with("#vrml v1")) return {Language::kOne, "VRML 1.0"};
    if (line.starts_with("#vrml v2")) return {Language::k97, "VRML97"};
    if (line.starts_with("<")) return {Language::k97, "X3D"};
    if (line.starts_with("#x3d v")) return {Language::k97, "X3D (classic)"};
    if (line.starts_with("#inventor v")) return {Language::kOne, "Inventor"};
    if (line.starts_with("#vrml")) return {Language::kBoth, "VRML"};
    return {};
}

// A type unknown to VRML 1.0 may name a known base type (isA).
Role role_by_kinship(const Document& document, const Node& node) {
    for (uint32_t f = node.fields.first; f < node.fields.end(); ++f) {
        const Field& field = document.field[f];
        if (text_of(document, field.name) != "isA") continue;
        for (uint32_t w = field.words.first; w < field.words.end(); ++w) {
            const NodeType type = find_node_type(text_of(document, document.word[w].bytes));
            if (type.role != Role::kUnknown) return type.role;
        }
    }
    return Role::kUnknown;
}

void warn_about_fields(Scene& scene, const Document& document, const Node& node, const NodeType& type) {
    for (uint32_t f = node.fields.first; f < node.fields.end(); ++f) {
        const Field& field = document.field[f];
        const std::string_view name = text_of(document, field.name);
        if (has_field(type, name)) continue;
        const std::string shown = std::string(type.name) + "." + printable(name);
        if (!first_time(scene, "field " + shown)) continue;
        scene.warnings.push_back(describe_location(document, field.offset) + ": unknown field " + shown);
    }
}

void judge_nodes(Scene& scene, SceneFile& file) {
    const Document& document = file.document;
    uint32_t old_nodes = 0, new_nodes = 0;
    for (const Node& node : document.node) {
        // a PROTO comes before a known type of its name; so does an EXTERNPROTO, if it leads anywhere (see resolve)
        const NodeType type = node.prototype != kNone ? NodeType{} : find_node_type(text_of(document, node.type));
        Role role = type.role;
        old_nodes += type.language == Language::kOne;
        new_nodes += type.language == Language::k97;
        if (role != Role::kUnknown) {
            warn_about_fields(scene, document, node, type);
        } else if (node.prototype == kNone) {
            role = role_by_kinship(document, node);
            const std::string name = printable(text_of(document, node.type));
            if (role == Role::kUnknown && first_time(scene, "node " + name)) {
                scene.warnings.push_back(describe_location(document, node.offset) + ": unknown node " + name + " is passed over");
            }
        }
        file.role.push_back(role);
    }
    const Header header = read_header(document.text);
    file.language = old_nodes == new_nodes ? header.language : old_nodes > new_nodes ? Language::kOne : Language::k97;
    const std::string name = file.language == Language::kOne ? "VRML 1.0" : "VRML97";
    file.format = header.format.empty() ? name : header.format;
    if (header.format.empty()) {
        scene.warnings.push_back(document.path.string() + ":1:1: no VRML header; read as " + name);
    } else if (header.language != Language::kBoth && header.language != file.language) {
        scene.warnings.push_back(document.path.string() + ":1:1: the header says " + header.format + " but the nodes are of " + name +
                                 "; read as " + name);
        file.format = name;
    }
}

}  // namespace

bool first_time(Scene& scene, const std::string& key) {
    constexpr size_t kLimit = 200;
    return scene.warned.size() < kLimit && scene.warned.insert(key).second;
}

uint32_t add_file(Scene& scene, Document document) {
    if (scene.scope.empty()) scene.scope.emplace_back();
    for (std::string& warning : document.warnings) scene.warnings.push_back(std::move(warning));
    scene.file.push_back(std::make_unique<SceneFile>());
    scene.file.back()->document = std::move(document);
    judge_nodes(scene, *scene.file.back());
    return static_cast<uint32_t>(scene.file.size() - 1);
}

uint32_t load_file(Scene& scene, uint32_t from, const std::string& url, uint32_t offset) {
    const Document& document = scene.file[from]->document;
    const auto pass_over = [&](const std::string& reason) {
        if (first_time(scene, "file " + url)) {
            scene.warnings.push_back(describe_location(document, offset) + ": file '" + printable(url) + "' is not read: " + reason);
        }
        return kNone;
    };
    if (scene.file.size() > 1000) return pass_over("more than 1000 files");
    const LocalFile local = find_local_file(scene.roots, document.path.parent_path(), url);
    if (!local.refusal.empty()) return pass_over(local.refusal);
    std::error_code fault;
    const std::string key = fs::canonical(local.path, fault).string();
    const auto known = scene.file_of_path.find(key);
    if (known != scene.file_of_path.end()) return known->second;
    uint32_t row = kNone;
    if (std::string text = read_text_file(local.path); looks_like_vrml(text)) {
        row = add_file(scene, read_document(std::move(text), local.path));
    } else {
        pass_over("it is not VRML");
    }
    scene.file_of_path[key] = row;
    return row;
}

uint32_t load_first(Scene& scene, const Value& url) {
    for (const std::string& name : urls_of(url)) {
        const uint32_t row = load_file(scene, url.file, name, url.field->offset);
        if (row != kNone) return row;
    }
    return kNone;
}

const Node& node_of(const Scene& scene, NodeId id) { return scene.file[id.document]->document.node[id.node]; }

Role role_of(const Scene& scene, NodeId id) { return scene.file[id.document]->role[id.node]; }

std::string type_of(const Scene& scene, NodeId id) {
    return printable(text_of(scene.file[id.document]->document, node_of(scene, id).type));
}

std::string position_of(const Scene& scene, NodeId id) {
    return describe_location(scene.file[id.document]->document, node_of(scene, id).offset);
}

// The PROTO that an EXTERNPROTO refers to, from the first of its files that declares it; row kNone if none does. Without a
// "#name" it is the first of the file.
static PrototypeId find_elsewhere(Scene& scene, PrototypeId external) {
    const Document& document = scene.file[external.document]->document;
    Field field;
    field.words = document.prototype[external.row].url;
    for (const std::string& url : urls_of(Value{&document, &field, external.document, 0})) {
        const size_t hash = url.find('#');
        const uint32_t file = load_file(scene, external.document, url.substr(0, hash), document.prototype[external.row].offset);
        if (file == kNone) continue;
        const Document& other = scene.file[file]->document;
        for (uint32_t row = 0; row < other.prototype.size(); ++row) {
            const bool named = hash == std::string::npos || text_of(other, other.prototype[row].name) == url.substr(hash + 1);
            if (named && !other.prototype[row].nested) return {file, row};
        }
    }
    return {};
}

NodeId resolve(Scene& scene, NodeId id) {
    while (role_of(scene, id) == Role::kUnknown) {
        PrototypeId found{id.document, node_of(scene, id).prototype};
        const auto prototype_of = [&scene](PrototypeId p) { return scene.file[p.document]->document.prototype[p.row]; };
        for (int hop = 0; found.row != kNone && prototype_of(found).url.count > 0; ++hop) {
            if (hop > 8) return id;
            found = find_elsewhere(scene, found);
        }
        const Range body = found.row == kNone ? Range{} : prototype_of(found).body;
        if (body.count == 0) {
            scene.file[id.document]->role[id.node] = find_node_type(type_of(scene, id)).role;
            return id;
        }
        const uint32_t depth = scene.scope[id.scope].depth + 1;
        if (depth > kInlineLimit) {
            throw InputError(position_of(scene, id) + ": prototypes nested deeper than the limit of " + std::to_string(kInlineLimit));
        }
        const auto [scope, fresh] = scene.scope_of_instance.try_emplace(id, static_cast<uint32_t>(scene.scope.size()));
        if (fresh) scene.scope.push_back({id, found, depth});
        id = {found.document, scene.file[found.document]->document.ref[body.first].node, scope->second};
    }
    return id;
}

Value find_value(const Scene& scene, NodeId id, std::string_view name) {
    const auto search = [](const Document& document, Range rows, std::string_view wanted) -> const Field* {
        for (uint32_t f = rows.first; f < rows.end(); ++f) {
            if (text_of(document, document.field[f].name) == wanted) return &document.field[f];
        }
        return nullptr;
    };
    const Document* document = &scene.file[id.document]->document;
    const Field* field = search(*document, node_of(scene, id).fields, name);
    while (field && field->is) {
        if (id.scope == 0 || field->words.count == 0) return {};
        const std::string_view outer = text_of(*document, document->word[field->words.first].bytes);
        const Scope& scope = scene.scope[id.scope];
        id = scope.instance;
        document = &scene.file[id.document]->document;
        field = search(*document, node_of(scene, id).fields, outer);
        if (!field) {
            id.document = scope.prototype.document;
            document = &scene.file[id.document]->document;
            field = search(*document, document->prototype[scope.prototype.row].interface, outer);
            if (field && field->is) return {};
        }
    }
    return field ? Value{document, field, id.document, id.scope} : Value{};
}

std::span<const double> numbers_of(const Value& value) {
    if (!value) return {};
    if (value.field->numbers.count > 0 && value.field->words.count > 0) {
        const Range bytes = value.document->word[value.field->words.first].bytes;
        throw InputError(describe_location(*value.document, bytes.first) + ": '" + printable(text_of(*value.document, bytes)) +
                         "' among the numbers of '" + printable(text_of(*value.document, value.field->name)) + "'");
    }
    return std::span(value.document->number).subspan(value.field->numbers.first, value.field->numbers.count);
}

std::span<const double> numbers_of(const Value& value, size_t least) {
    const std::span<const double> numbers = numbers_of(value);
    if (!value || value.field->is || numbers.size() >= least || (numbers.empty() && value.field->words.count == 0)) return numbers;
    throw InputError(describe_location(*value.document, value.field->offset) + ": '" +
                     printable(text_of(*value.document, value.field->name)) + "' has " + std::to_string(numbers.size()) + " of " +
                     std::to_string(least) + " numbers");
}

std::span<const double> numbers_at(const Scene& scene, NodeId id, std::string_view name) {
    return id.node == kNone ? std::span<const double>{} : numbers_of(find_value(scene, id, name));
}

double number_of(const Scene& scene, NodeId id, std::string_view name, double otherwise) {
    const std::span<const double> numbers = numbers_of(find_value(scene, id, name), 1);
    return numbers.empty() ? otherwise : numbers[0];
}

std::vector<std::string> urls_of(const Value& value) {
    std::vector<std::string> urls;
    if (!value) return urls;
    for (uint32_t w = value.field->words.first; w < value.field->words.end() && urls.size() < 16; ++w) {
        const Word& word = value.document->word[w];
        const std::string_view text = text_of(*value.document, word.bytes);
        urls.push_back(word.quoted ? unescape(text) : std::string(text));
        if (urls.back().empty()) urls.pop_back();
    }
    return urls;
}

std::string text_of(const Value& value) {
    const std::vector<std::string> all = urls_of(value);
    return all.empty() ? "" : all[0];
}

NodeId first_node(Scene& scene, const Value& value) {
    if (!value || value.field->nodes.count == 0) return {};
    return resolve(scene, {value.file, value.document->ref[value.field->nodes.first].node, value.scope});
}

bool flag_of(const Value& value, bool otherwise) {
    const std::string text = lower_case(text_of(value));
    return text == "true" ? true : text == "false" ? false : otherwise;
}

std::string location_of_number(const Value& value, uint32_t k) {
    Lexer lexer{value.document->text, value.field->offset};
    try {
        for (Token token = next_token(lexer); token.kind != TokenKind::kEnd; token = next_token(lexer)) {
            if (token.kind == TokenKind::kNumber && k-- == 0) return describe_location(*value.document, token.offset);
        }
    } catch (const LexicalFault&) {  // impossible: this text has been lexed before
    }
    return describe_location(*value.document, value.field->offset);
}

}  // namespace trocar::vrml
