#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "components/math.hpp"
namespace trocar::vrml {

enum class TokenKind : uint8_t {
    kEnd,
    kNumber,  // decimal or hexadecimal; nan, inf and their kin too, as a number that is not finite
    kWord,    // anything else without quotes: names, keywords, bare file names
    kString,  // quoted; the token covers what lies between the quotes, escapes still in it
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

// A place in the text of a file. Blanks, commas and control characters separate tokens; '#' begins a comment up to CR
// or LF wherever it stands outside a string.
struct Lexer {
    std::string_view text;
    uint32_t at = 0;
};

inline constexpr uint32_t kStringLimit = 1u << 20;  // bytes of one token

// A fault in the text, to be given a place by whoever knows the file.
struct LexicalFault {
    uint32_t offset;
    const char* reason;
};

// The next token. Throws LexicalFault at a string that does not end and at a token longer than kStringLimit.
Token next_token(Lexer& lexer);

// The same without moving on.
Token peek_token(const Lexer& lexer);

// Appends the finite numbers that follow, kNumberRun at most, up to the first token of another kind or number that is
// not finite.
inline constexpr size_t kNumberRun = size_t{1} << 18;
void read_numbers(Lexer& lexer, std::vector<double>& numbers);

// The next run of bytes without blank, comma, bracket, quote or '#', whatever it looks like: names after DEF may begin
// with a digit.
Token next_name(Lexer& lexer);

// What a quoted string means: \" and \\ are unescaped.
std::string unescape(std::string_view quoted);

// Line and column, both from 1, of a byte. CR, LF and CR LF end a line.
struct Place {
    uint32_t line = 1;
    uint32_t column = 1;
};
Place find_place(std::string_view text, uint32_t offset);

}  // namespace trocar::vrml
