#include "content/read/vrml/lexer.hpp"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "content/text/number_text.hpp"
namespace trocar::vrml {
namespace {

enum Class : uint8_t { kPlain, kBlank, kDelimiter };

constexpr std::array<uint8_t, 256> classify() {
    std::array<uint8_t, 256> table{};
    for (int c = 0; c <= ' '; ++c) table[static_cast<size_t>(c)] = kBlank;
    table[','] = kBlank;
    for (const char c : {'{', '}', '[', ']', '"', '#'}) table[static_cast<uint8_t>(c)] = kDelimiter;
    return table;
}
constexpr std::array<uint8_t, 256> kClass = classify();

bool is_digit(char c) { return c >= '0' && c <= '9'; }

uint8_t class_of(char c) { return kClass[static_cast<uint8_t>(c)]; }

// First byte that is neither blank nor part of a comment.
const char* skip_blanks(const char* at, const char* end) {
    while (at != end) {
        if (class_of(*at) == kBlank) {
            ++at;
        } else if (*at == '#') {
            while (at != end && *at != '\n' && *at != '\r') ++at;
        } else {
            break;
        }
    }
    return at;
}

const char* skip_word(const char* at, const char* end) {
    while (at != end && class_of(*at) == kPlain) ++at;
    return at;
}

bool same_letters(std::string_view text, std::string_view lower) {
    if (text.size() < lower.size()) return false;
    for (size_t i = 0; i < lower.size(); ++i) {
        if ((text[i] | 0x20) != lower[i]) return false;
    }
    return true;
}

// nan, inf, infinity and nan(...), with optional sign.
bool is_nonfinite_word(std::string_view word) {
    if (!word.empty() && (word[0] == '+' || word[0] == '-')) word.remove_prefix(1);
    if (same_letters(word, "nan")) return word.size() == 3 || word[3] == '(';
    return same_letters(word, "inf") && (word.size() == 3 || (word.size() == 8 && same_letters(word, "infinity")));
}

const char* parse_hexadecimal(const char* at, const char* end, double& value) {
    at += 2;
    const char* const begin = at;
    value = 0;
    for (; at != end; ++at) {
        const char c = static_cast<char>(*at | 0x20);
        const int digit = *at >= '0' && *at <= '9' ? *at - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
        if (digit < 0) break;
        value = value * 16 + digit;
    }
    return at == begin ? nullptr : at;
}

// The number at the start of a bare token, if it ends at a delimiter or at the sign of the next number.
const char* parse_value(const char* at, const char* end, double& value) {
    const bool hexadecimal = end - at > 2 && at[0] == '0' && (at[1] | 0x20) == 'x';
    const char* stop = hexadecimal ? parse_hexadecimal(at, end, value) : parse_number(at, end, value);
    if (!stop) return nullptr;
    if (stop == end || class_of(*stop) == kBlank) return stop;
    if (*stop == '#' && stop[-1] == '.') {
        // Microsoft's printf writes 1.#INF and -1.#IND; everywhere else '#' starts a comment
        const std::string_view rest(stop + 1, static_cast<size_t>(end - stop - 1));
        if (same_letters(rest, "inf") || same_letters(rest, "ind") || same_letters(rest, "qnan") || same_letters(rest, "snan")) {
            value = std::numeric_limits<double>::quiet_NaN();
            return skip_word(stop + 1, end);
        }
    }
    if (class_of(*stop) == kDelimiter) return stop;
    // numbers may be written without a blank in between, 1.5-2; but a name may also begin like this
    const bool next_number = (*stop == '-' || *stop == '+') && stop + 1 != end && (stop[1] == '.' || is_digit(stop[1]));
    return next_number ? stop : nullptr;
}

// Reads a quoted string whose opening quote is at `at`.
Token read_string(Lexer& lexer, const char* at, const char* end) {
    const char* const base = lexer.text.data();
    const char* const begin = at + 1;
    const char* stop = begin;
    while (stop != end && *stop != '"') {
        if (*stop == '\\' && stop + 1 != end) ++stop;
        ++stop;
    }
    const auto offset = static_cast<uint32_t>(begin - base);
    if (stop == end) throw LexicalFault{offset - 1, "a string begins here and does not end"};
    if (stop - begin > kStringLimit) throw LexicalFault{offset - 1, "a string is longer than 1048576 bytes"};
    lexer.at = static_cast<uint32_t>(stop + 1 - base);
    return {TokenKind::kString, offset, static_cast<uint32_t>(stop - begin), 0};
}

}  // namespace

Token next_token(Lexer& lexer) {
    const char* const base = lexer.text.data();
    const char* const end = base + lexer.text.size();
    const char* const at = skip_blanks(base + lexer.at, end);
    const auto offset = static_cast<uint32_t>(at - base);
    lexer.at = offset;
    if (at == end) return {TokenKind::kEnd, offset, 0, 0};
    if (*at == '"') return read_string(lexer, at, end);
    if (class_of(*at) == kDelimiter) {
        lexer.at = offset + 1;
        const TokenKind kind = *at == '{'   ? TokenKind::kOpenBrace
                               : *at == '}' ? TokenKind::kCloseBrace
                               : *at == '[' ? TokenKind::kOpenBracket
                                            : TokenKind::kCloseBracket;
        return {kind, offset, 1, 0};
    }
    if (is_digit(*at) || *at == '-' || *at == '+' || *at == '.') {
        double value = 0;
        if (const char* const stop = parse_value(at, end, value)) {
            lexer.at = static_cast<uint32_t>(stop - base);
            return {TokenKind::kNumber, offset, lexer.at - offset, value};
        }
    }
    const char* const stop = skip_word(at, end);
    if (stop - at > kStringLimit) throw LexicalFault{offset, "a word is longer than 1048576 bytes"};
    lexer.at = static_cast<uint32_t>(stop - base);
    const auto length = static_cast<uint32_t>(stop - at);
    if (length >= 3 && is_nonfinite_word({at, length})) {
        return {TokenKind::kNumber, offset, length, std::numeric_limits<double>::quiet_NaN()};
    }
    return {TokenKind::kWord, offset, length, 0};
}

Token peek_token(const Lexer& lexer) {
    Lexer copy = lexer;
    return next_token(copy);
}

void read_numbers(Lexer& lexer, std::vector<double>& numbers) {
    const char* const base = lexer.text.data();
    const char* const end = base + lexer.text.size();
    const char* at = base + lexer.at;
    for (size_t k = 0; k < kNumberRun; ++k) {
        at = skip_blanks(at, end);
        double value = 0;
        const char* const stop = at == end ? nullptr : parse_value(at, end, value);
        if (!stop || !std::isfinite(value)) break;
        numbers.push_back(value);
        at = stop;
    }
    lexer.at = static_cast<uint32_t>(at - base);
}

Token next_name(Lexer& lexer) {
    const char* const base = lexer.text.data();
    const char* const end = base + lexer.text.size();
    const char* const at = skip_blanks(base + lexer.at, end);
    const char* const stop = skip_word(at, end);
    const auto offset = static_cast<uint32_t>(at - base);
    const auto length = static_cast<uint32_t>(stop - at);
    if (length > kStringLimit) throw LexicalFault{offset, "a name is longer than 1048576 bytes"};
    lexer.at = offset + length;
    return {length == 0 ? TokenKind::kEnd : TokenKind::kWord, offset, length, 0};
}

std::string unescape(std::string_view quoted) {
    std::string text;
    text.reserve(quoted.size());
    for (size_t i = 0; i < quoted.size(); ++i) {
        if (quoted[i] == '\\' && i + 1 < quoted.size() && (quoted[i + 1] == '"' || quoted[i + 1] == '\\')) ++i;
        text += quoted[i];
    }
    return text;
}

TextPosition find_text_position(std::string_view text, uint32_t offset) {
    TextPosition text_position;
    for (uint32_t i = 0; i < offset && i < text.size(); ++i) {
        const bool ends_line = text[i] == '\n' || (text[i] == '\r' && (i + 1 >= text.size() || text[i + 1] != '\n'));
        ++text_position.column;
        if (ends_line) text_position = {text_position.line + 1, 1};
    }
    return text_position;
}

}  // namespace trocar::vrml
