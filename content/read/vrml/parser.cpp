#include "content/read/vrml/parser.hpp"

#include <algorithm>
#include <utility>

#include "content/read/vrml/lexer.hpp"
#include "engine/base/error.hpp"
namespace trocar::vrml {
namespace {

enum class FrameKind : uint8_t {
    kFile,
    kNode,       // Type { ...
    kArray,      // field [ ...
    kSingle,     // field followed by one node
    kInterface,  // PROTO name [ ...
    kExternal,   // EXTERNPROTO name [ ...
    kBody,       // PROTO name [...] { ...
};

// A syntax element whose end has not been read yet.
struct Frame {
    FrameKind kind = FrameKind::kFile;
    uint32_t row = kNone;      // index of the node or prototype
    uint32_t first_ref = 0;    // into Parser::refs
    uint32_t first_field = 0;  // into Parser::fields
    uint32_t offset = 0;       // of its opening bracket or name
    Field field;               // array and single
};

struct Parser : DocumentBuilder {
    Lexer lexer;
    std::vector<Frame> frames;
    std::vector<NodeRef> refs;  // of open frames; moved to the document when their frame ends
    std::vector<Field> fields;  // likewise
};

std::string_view token_text(const Parser& p, const Token& token) {
    return std::string_view(p.document.text).substr(token.offset, token.length);
}

Range range_of(const Token& token) { return {token.offset, token.length}; }

std::string shown(const Parser& p, const Token& token) {
    switch (token.kind) {
        case TokenKind::kEnd:
            return "the end of the file";
        case TokenKind::kString:
            return "a string";
        default:
            return '\'' + printable(token_text(p, token)) + '\'';
    }
}

template <typename Row>
Range move_tail(std::vector<Row>& from, uint32_t first, std::vector<Row>& to) {
    const Range range{static_cast<uint32_t>(to.size()), static_cast<uint32_t>(from.size()) - first};
    to.insert(to.end(), from.begin() + first, from.end());
    from.resize(first);
    return range;
}

void push_frame(Parser& p, FrameKind kind, uint32_t row, uint32_t offset, const Field& field = {}) {
    if (p.frames.size() > 3 * kNestingLimit) {
        fail(p, offset, "brackets nested deeper than " + std::to_string(3 * kNestingLimit));
    }
    p.frames.push_back({kind, row, static_cast<uint32_t>(p.refs.size()), static_cast<uint32_t>(p.fields.size()), offset, field});
}

void add_field(Parser& p, const Field& field) {
    if (p.fields.size() + p.document.field.size() >= kNodeLimit) {
        fail(p, field.offset, more_than(kNodeLimit, "fields"));
    }
    p.fields.push_back(field);
}

void add_word(Parser& p, Field& field, const Token& token) {
    std::vector<Word>& word = p.document.word;
    if (word.size() >= kWordLimit) fail(p, token.offset, more_than(kWordLimit, "words"));
    if (field.words.count == 0) field.words.first = static_cast<uint32_t>(word.size());
    // values after a nested node would not be contiguous; no supported node type mixes them
    if (field.words.end() != word.size()) return;
    word.push_back({range_of(token), token.kind == TokenKind::kString});
    ++field.words.count;
}

// Adds the number token just read and all numbers that follow.
void add_numbers(Parser& p, Field& field, const Token& token) {
    std::vector<double>& number = p.document.number;
    if (field.numbers.count == 0) field.numbers.first = static_cast<uint32_t>(number.size());
    const bool together = field.numbers.end() == number.size();
    const size_t before = number.size();
    number.push_back(token.number);
    read_numbers(p.lexer, number);
    if (number.size() >= kNone) fail(p, token.offset, "more numbers than 32 bits can count");
    if (together) {
        field.numbers.count = static_cast<uint32_t>(number.size()) - field.numbers.first;
    } else {
        number.resize(before);
    }
}

// Ends a field with a single node after that node was read.
void close_single(Parser& p) {
    while (p.frames.back().kind == FrameKind::kSingle) {
        Field field = p.frames.back().field;
        field.nodes = move_tail(p.refs, p.frames.back().first_ref, p.document.ref);
        p.frames.pop_back();
        add_field(p, field);
    }
}

void open_node(Parser& p, const Token& type, Range name) {
    const Token brace = next_token(p.lexer);
    if (brace.kind != TokenKind::kOpenBrace) {
        fail(p, brace.offset, "expected '{' after node type " + shown(p, type) + ", found " + shown(p, brace));
    }
    if (p.open.size() > kNestingLimit) {
        fail(p, type.offset, "nodes nested deeper than the limit of " + std::to_string(kNestingLimit));
    }
    const uint32_t prototype = visible_prototype(p, token_text(p, type));
    const uint32_t row = add_node(p, range_of(type), prototype, name, text_of(p.document, name), type.offset);
    push_frame(p, FrameKind::kNode, row, type.offset);
    p.open.push_back({row, false});
}

void close_node(Parser& p) {
    const Frame frame = p.frames.back();
    Node& node = p.document.node[frame.row];
    node.fields = move_tail(p.fields, frame.first_field, p.document.field);
    node.children = move_tail(p.refs, frame.first_ref, p.document.ref);
    p.open.pop_back();
    p.frames.pop_back();
    p.refs.push_back({frame.row, false});
    close_single(p);
}

void read_use(Parser& p, const Token& keyword) {
    const Token name = next_name(p.lexer);
    if (name.length == 0) fail(p, keyword.offset, "USE without a name");
    const uint32_t row = find_used_node(p, token_text(p, name), name.offset);
    if (row != kNone) p.refs.push_back({row, true});
    close_single(p);
}

void read_definition(Parser& p, const Token& keyword) {
    const Token name = next_name(p.lexer);
    if (name.length == 0) fail(p, keyword.offset, "DEF without a name");
    const Token type = next_token(p.lexer);
    if (type.kind != TokenKind::kWord) {
        fail(p, type.offset, "expected a node type after DEF, found " + shown(p, type));
    }
    open_node(p, type, range_of(name));
}

// Interface keywords of PROTO and Script in VRML97 and X3D. Event fields have no value.
bool is_event(std::string_view word) { return word == "eventIn" || word == "eventOut" || word == "inputOnly" || word == "outputOnly"; }
bool is_interface(std::string_view word) {
    return word == "field" || word == "exposedField" || word == "initializeOnly" || word == "inputOutput" || is_event(word);
}
bool is_value_type(std::string_view word) {
    return word.size() > 3 && (word.starts_with("SF") || word.starts_with("MF")) && word[2] >= 'A' && word[2] <= 'Z';
}

// True if a word at the position of a value starts a node.
bool begins_node(const Parser& p, const Token& token) {
    const std::string_view word = token_text(p, token);
    return word == "DEF" || word == "USE" || peek_token(p.lexer).kind == TokenKind::kOpenBrace;
}

void read_node_word(Parser& p, const Token& token) {
    const std::string_view word = token_text(p, token);
    if (word == "USE") {
        read_use(p, token);
    } else if (word == "DEF") {
        read_definition(p, token);
    } else {
        open_node(p, token, {});
    }
}

// Reads the value of the field whose name was just read. Leaves a frame open if nodes or a bracket follow.
void read_value(Parser& p, Range name) {
    Field field;
    field.name = name;
    const Token token = peek_token(p.lexer);
    field.offset = token.kind == TokenKind::kString ? token.offset - 1 : token.offset;  // position of its quote
    switch (token.kind) {
        case TokenKind::kOpenBracket:
            next_token(p.lexer);
            push_frame(p, FrameKind::kArray, kNone, token.offset, field);
            return;
        case TokenKind::kNumber:
            while (peek_token(p.lexer).kind == TokenKind::kNumber) add_numbers(p, field, next_token(p.lexer));
            break;
        case TokenKind::kString:
            while (peek_token(p.lexer).kind == TokenKind::kString) add_word(p, field, next_token(p.lexer));
            break;
        case TokenKind::kWord: {
            next_token(p.lexer);
            const std::string_view word = token_text(p, token);
            if (word == "IS") {
                field.is = true;
                add_word(p, field, next_name(p.lexer));
            } else if (begins_node(p, token)) {
                push_frame(p, FrameKind::kSingle, kNone, token.offset, field);
                read_node_word(p, token);
                return;
            } else {
                add_word(p, field, token);
                // VRML 1.0 writes flag sets as (SIDES | TOP)
                Token part = token;
                while (word[0] == '(' && !token_text(p, part).ends_with(')') && peek_token(p.lexer).kind == TokenKind::kWord) {
                    part = next_token(p.lexer);
                    add_word(p, field, part);
                }
            }
            break;
        }
        default:
            break;  // a field without a value
    }
    add_field(p, field);
}

// Reads one interface line after its first word. Values are stored like those of any field.
void read_interface(Parser& p, std::string_view access, bool with_value) {
    next_name(p.lexer);  // skip the type: values are recognised by their syntax
    const Token name = next_name(p.lexer);
    if (name.length == 0) fail(p, name.offset, "expected a field name");
    if (!is_event(access) && with_value) return read_value(p, range_of(name));
    const Token is = peek_token(p.lexer);
    if (is.kind == TokenKind::kWord && token_text(p, is) == "IS") {
        next_token(p.lexer);
        next_name(p.lexer);
    }
    Field field;
    field.name = range_of(name);
    field.offset = name.offset;
    if (!is_event(access)) add_field(p, field);
}

void open_prototype(Parser& p, const Token& keyword, bool external) {
    const Token name = next_name(p.lexer);
    const Token bracket = next_token(p.lexer);
    if (name.length == 0 || bracket.kind != TokenKind::kOpenBracket) {
        fail(p, bracket.offset, "expected a name and '[' after " + shown(p, keyword));
    }
    const uint32_t row = add_prototype(p, range_of(name), token_text(p, name), name.offset);
    push_frame(p, external ? FrameKind::kExternal : FrameKind::kInterface, row, keyword.offset);
}

void close_interface(Parser& p) {
    const Frame frame = p.frames.back();
    p.document.prototype[frame.row].interface = move_tail(p.fields, frame.first_field, p.document.field);
    p.refs.resize(frame.first_ref);
    p.frames.pop_back();
    if (frame.kind == FrameKind::kInterface) {
        const Token brace = next_token(p.lexer);
        if (brace.kind != TokenKind::kOpenBrace) fail(p, brace.offset, "expected '{' and the body of the PROTO");
        push_frame(p, FrameKind::kBody, frame.row, brace.offset);
        p.open.push_back({frame.row, true});
        p.scopes.emplace_back();
        return;
    }
    Field url;
    const bool array = peek_token(p.lexer).kind == TokenKind::kOpenBracket;
    if (array) next_token(p.lexer);
    while (peek_token(p.lexer).kind == TokenKind::kString) add_word(p, url, next_token(p.lexer));
    if (array && next_token(p.lexer).kind != TokenKind::kCloseBracket) {
        fail(p, p.lexer.at, "expected ']' after the file names of the EXTERNPROTO");
    }
    p.document.prototype[frame.row].url = url.words;
}

// Reads a statement that may occur between nodes. False if the word starts none.
bool read_statement(Parser& p, const Token& token) {
    const std::string_view word = token_text(p, token);
    if (word == "PROTO" || word == "EXTERNPROTO") {
        if (peek_token(p.lexer).kind == TokenKind::kOpenBrace) return false;
        open_prototype(p, token, word == "EXTERNPROTO");
        return true;
    }
    if (word == "ROUTE") {
        next_name(p.lexer);
        const Token to = next_name(p.lexer);
        if (token_text(p, to) != "TO") fail(p, to.offset, "expected TO in a ROUTE");
        next_name(p.lexer);
        return true;
    }
    return word == "NULL";
}

// Reads an X3D statement between the header and the nodes.
bool read_file_statement(Parser& p, const Token& token) {
    const std::string_view word = token_text(p, token);
    if (word == "PROFILE" || word == "COMPONENT") {
        next_name(p.lexer);
        return true;
    }
    if (word == "UNIT") {  // category, name, factor
        const Token category = next_name(p.lexer);
        next_name(p.lexer);
        const Token factor = next_token(p.lexer);
        if (factor.kind != TokenKind::kNumber) fail(p, factor.offset, "expected a factor in a UNIT, found " + shown(p, factor));
        if (token_text(p, category) == "length" && factor.number != 1)
            warn(p, token.offset, "a unit of length is not applied: give a scale");
        return true;
    }
    if (word == "EXPORT" || word == "IMPORT") {  // NODE [AS NAME], FILE.NODE [AS NAME]
        next_name(p.lexer);
        if (token_text(p, peek_token(p.lexer)) == "AS") {
            next_token(p.lexer);
            next_name(p.lexer);
        }
        return true;
    }
    if (word == "META") {
        while (peek_token(p.lexer).kind == TokenKind::kString) next_token(p.lexer);
        return true;
    }
    return false;
}

void read_root_node(Parser& p, const Token& token) {
    if (token.kind != TokenKind::kWord || !begins_node(p, token)) fail(p, token.offset, "expected a node, found " + shown(p, token));
    read_node_word(p, token);
}

void step_file(Parser& p, const Token& token) {
    if (token.kind == TokenKind::kCloseBrace || token.kind == TokenKind::kCloseBracket) {
        return warn(p, token.offset, shown(p, token) + " closes nothing and is passed over");
    }
    const bool statement = token.kind == TokenKind::kWord && (read_statement(p, token) || read_file_statement(p, token));
    if (!statement) read_root_node(p, token);
}

void step_node(Parser& p, const Token& token) {
    switch (token.kind) {
        case TokenKind::kCloseBrace:
            return close_node(p);
        case TokenKind::kWord: {
            if (read_statement(p, token)) return;
            if (begins_node(p, token)) return read_node_word(p, token);
            const std::string_view word = token_text(p, token);
            const Token next = peek_token(p.lexer);
            if (is_interface(word) && next.kind == TokenKind::kWord && is_value_type(token_text(p, next))) {
                return read_interface(p, word, true);
            }
            return read_value(p, range_of(token));
        }
        case TokenKind::kOpenBracket:
            warn(p, token.offset, "values without a field name are passed over");
            return push_frame(p, FrameKind::kArray, kNone, token.offset);
        case TokenKind::kNumber:
        case TokenKind::kString:
            return warn(p, token.offset, "a value without a field name is passed over");
        default:
            fail(p, token.offset, "expected a field, a node or '}', found " + shown(p, token));
    }
}

void step_array(Parser& p, const Token& token) {
    switch (token.kind) {
        case TokenKind::kCloseBracket: {
            Field field = p.frames.back().field;
            field.nodes = move_tail(p.refs, p.frames.back().first_ref, p.document.ref);
            p.frames.pop_back();
            if (field.name.count > 0) add_field(p, field);
            return close_single(p);
        }
        case TokenKind::kNumber:
            return add_numbers(p, p.frames.back().field, token);
        case TokenKind::kString:
            return add_word(p, p.frames.back().field, token);
        case TokenKind::kWord:
            if (read_statement(p, token)) return;
            if (begins_node(p, token)) return read_node_word(p, token);
            return add_word(p, p.frames.back().field, token);
        case TokenKind::kOpenBracket:
            return push_frame(p, FrameKind::kArray, kNone, token.offset);
        default:
            fail(p, token.offset, "expected ']', found " + shown(p, token));
    }
}

void step_interface(Parser& p, const Token& token) {
    if (token.kind == TokenKind::kCloseBracket) return close_interface(p);
    if (token.kind != TokenKind::kWord || !is_interface(token_text(p, token))) {
        fail(p, token.offset, "expected a field of the PROTO or ']', found " + shown(p, token));
    }
    read_interface(p, token_text(p, token), p.frames.back().kind == FrameKind::kInterface);
}

void step_body(Parser& p, const Token& token) {
    if (token.kind == TokenKind::kCloseBrace) {
        p.document.prototype[p.frames.back().row].body = move_tail(p.refs, p.frames.back().first_ref, p.document.ref);
        p.fields.resize(p.frames.back().first_field);
        p.frames.pop_back();
        p.open.pop_back();
        p.scopes.pop_back();
        return;
    }
    if (token.kind != TokenKind::kWord || !read_statement(p, token)) read_root_node(p, token);
}

std::string describe_open(const Parser& p) {
    const Frame& frame = p.frames.back();
    const TextPosition text_position = find_text_position(p.document.text, frame.offset);
    return "the file ends before what begins at " + std::to_string(text_position.line) + ":" + std::to_string(text_position.column) +
           " is closed";
}

void parse(Parser& p, const LoadProgress& progress) {
    constexpr uint32_t kEvery = 1u << 22;  // bytes between two progress reports
    uint32_t report_at = kEvery;
    push_frame(p, FrameKind::kFile, kNone, 0);
    while (true) {
        if (progress && p.lexer.at >= report_at) {
            progress(kTextShare * p.lexer.at / static_cast<double>(p.document.text.size()));
            report_at = p.lexer.at + std::min(kEvery, kNone - p.lexer.at);
        }
        const Token token = next_token(p.lexer);
        const FrameKind kind = p.frames.back().kind;
        if (token.kind == TokenKind::kEnd) {
            if (kind != FrameKind::kFile) fail(p, token.offset, describe_open(p));
            break;
        }
        switch (kind) {
            case FrameKind::kFile:
                step_file(p, token);
                break;
            case FrameKind::kNode:
                step_node(p, token);
                break;
            case FrameKind::kArray:
                step_array(p, token);
                break;
            case FrameKind::kInterface:
            case FrameKind::kExternal:
                step_interface(p, token);
                break;
            case FrameKind::kBody:
                step_body(p, token);
                break;
            case FrameKind::kSingle:
                fail(p, token.offset, "expected a node, found " + shown(p, token));
        }
    }
    p.document.roots = move_tail(p.refs, 0, p.document.ref);
}

std::string describe_path(const DocumentBuilder& b) {
    std::vector<std::string> types;
    for (const auto& [row, body] : b.open) {
        const Range name = body ? b.document.prototype[row].name : b.document.node[row].type;
        types.push_back((body ? "PROTO " : "") + printable(text_of(b.document, name)));
    }
    return vrml::describe_path(types);
}

}  // namespace

void fail(const DocumentBuilder& b, uint32_t offset, const std::string& reason) {
    throw InputError(describe_location(b.document, offset) + ": " + reason + describe_path(b));
}

void warn(DocumentBuilder& b, uint32_t offset, const std::string& text) {
    constexpr size_t kWarningLimit = 100;
    if (b.document.warnings.size() >= kWarningLimit) {
        ++b.suppressed;
    } else {
        b.document.warnings.push_back(describe_location(b.document, offset) + ": " + text + describe_path(b));
    }
}

uint32_t visible_prototype(const DocumentBuilder& b, std::string_view name) {
    for (size_t s = b.scopes.size(); s-- > 0;) {
        if (const auto found = b.scopes[s].prototype.find(name); found != b.scopes[s].prototype.end()) return found->second;
    }
    return kNone;
}

uint32_t add_node(DocumentBuilder& b, Range type, uint32_t prototype, Range name, std::string_view known_as, uint32_t offset) {
    const auto row = static_cast<uint32_t>(b.document.node.size());
    if (row >= kNodeLimit) fail(b, offset, more_than(kNodeLimit, "nodes"));
    b.document.node.push_back({type, name, offset, {}, {}, prototype});
    if (!known_as.empty()) b.scopes.back().node[known_as] = row;
    return row;
}

uint32_t add_prototype(DocumentBuilder& b, Range name, std::string_view known_as, uint32_t offset) {
    const auto row = static_cast<uint32_t>(b.document.prototype.size());
    if (row >= kNodeLimit) fail(b, offset, more_than(kNodeLimit, "prototypes"));
    b.document.prototype.push_back({name, offset, {}, {}, {}, b.scopes.size() > 1});
    b.scopes.back().prototype[known_as] = row;
    return row;
}

uint32_t find_used_node(DocumentBuilder& b, std::string_view name, uint32_t offset) {
    const auto found = b.scopes.back().node.find(name);
    if (found == b.scopes.back().node.end()) {
        warn(b, offset, "USE of '" + printable(name) + "', which no DEF before it names");
        return kNone;
    }
    bool handle = false;
    for (size_t i = b.open.size(); i-- > 0 && !b.open[i].body;) {
        const Node& node = b.document.node[b.open[i].row];
        handle = handle || node.prototype != kNone || text_of(b.document, node.type) == "Script";
        if (b.open[i].row != found->second) continue;
        if (!handle) fail(b, offset, "USE of '" + printable(name) + "' inside itself");
        return kNone;
    }
    return found->second;
}

Document finish_document(DocumentBuilder& b) {
    if (b.suppressed > 0) {
        b.document.warnings.push_back(b.document.path.string() + ": " + std::to_string(b.suppressed) + " more warnings left out");
    }
    return std::move(b.document);
}

std::string more_than(uint32_t limit, std::string_view what) {
    std::string text = "more than ";
    text += std::to_string(limit);
    text += ' ';
    text += what;
    return text;
}

std::string describe_location(const Document& document, uint32_t offset) {
    const TextPosition text_position = find_text_position(document.text, offset);
    return document.path.string() + ":" + std::to_string(text_position.line) + ":" + std::to_string(text_position.column);
}

std::string describe_path(const std::vector<std::string>& types) {
    if (types.empty()) return "";
    std::string text;
    for (size_t i = 0; i < types.size(); ++i) {
        if (types.size() > 8 && i == 3) {
            text += " > ...";
            i = types.size() - 4;
        }
        text += (i == 0 ? "" : " > ") + types[i];
    }
    return " (in " + text + ")";
}

std::string printable(std::string_view text) {
    std::string shown;
    for (const char c : text.substr(0, 40)) shown += c >= ' ' && c < 127 ? c : '?';
    return text.size() > 40 ? shown + "..." : shown;
}

Document parse_document(std::string text, std::filesystem::path path, const LoadProgress& progress) {
    if (text.size() >= kNone) throw InputError(path.string() + ": more text than 32 bits can number");
    Parser p;
    p.document.path = std::move(path);
    p.document.text = std::move(text);
    p.lexer.text = p.document.text;
    if (p.document.text.starts_with("\xef\xbb\xbf")) p.lexer.at = 3;
    try {
        parse(p, progress);
    } catch (const LexicalFault& fault) {
        fail(p, fault.offset, fault.reason);
    }
    return finish_document(p);
}

}  // namespace trocar::vrml
