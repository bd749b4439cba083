#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "components/math.hpp"
namespace trocar::vrml {

enum class TokenKind : uint8_t {
    kEnd,
    kNumber,  // decimal or hexadecimal; also nan, inf and variants, as a non-finite number
    kWord,    // any other unquoted text: names, keywords, bare file names
    kString,  // quoted; the token covers the text between the quotes, escapes included
    kOpenBrace,
    kCloseBrace,
    kOpenBracket,
    kCloseBracket,
};

struct Token {
    TokenKind kind = TokenKind::kEnd;
    uint32_t offset = 0;  // of its first byte in the text
    uint32_t length = 0;
    double number = 0;
};

// A position in the text of a file. Blanks, commas and control characters separate tokens; '#' outside a
// string starts a comment up to CR or LF.
struct Lexer {
    std::string_view text;
    uint32_t at = 0;
};

inline constexpr uint32_t kStringLimit = 1u << 20;  // bytes of one token

// A syntax error; a caller that knows the file adds the position.
struct LexicalFault {
    uint32_t offset;
    const char* reason;
};

// The next token. Throws LexicalFault for an unterminated string or a token longer than kStringLimit.
Token next_token(Lexer& lexer);

// The same without advancing.
Token peek_token(const Lexer& lexer);

// Appends the following finite numbers, at most kNumberRun, up to the first other token or non-finite number.
inline constexpr size_t kNumberRun = size_t{1} << 18;
void read_numbers(Lexer& lexer, std::vector<double>& numbers);

// The next run of bytes without blank, comma, bracket, quote or '#': names after DEF may begin with a digit.
Token next_name(Lexer& lexer);

// The value of a quoted string: unescapes \" and \\.
std::string unescape(std::string_view quoted);

// Line and column of a byte, both from 1. CR, LF and CR LF end a line.
struct TextPosition {
    uint32_t line = 1;
    uint32_t column = 1;
};
TextPosition find_text_position(std::string_view text, uint32_t offset);

}  // namespace trocar::vrml
