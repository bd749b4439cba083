#pragma once
#include <filesystem>
#include <string>
#include <string_view>

#include "components/math.hpp"
namespace trocar {

// Words of a text file between blanks and control characters, with line numbers. CR, LF, CR LF end a line.
struct Words {
    const char* at;
    const char* end;
    const std::filesystem::path& path;
    uint64_t line = 1;
    char comment = '\0';  // starts a comment to the end of the line; '\0' = no comments

    [[noreturn]] void fail(const std::string& reason) const;  // InputError "file:line: reason"
    void skip_blanks();
    // The next word; empty at the end of the file.
    std::string_view next();
    // The same without advancing.
    std::string_view peek() const;
    // The rest of the line, without its end; advances to the next line.
    std::string_view rest_of_line();
    // The next word as a number; fails if it is not a finite number. With `may_be_bad` returns NaN instead.
    double number(bool may_be_bad = false);
    // The next word as an integer in [0, most].
    uint64_t count(const char* what, uint64_t most);
};

// Converts ASCII letters to lower case.
std::string lower_case(std::string_view text);

// Case-insensitive comparison; `lower` is in lower case.
bool same_word(std::string_view word, std::string_view lower);

// A word as shown in messages: quoted, at most 40 characters, '?' for unprintable ones.
std::string shown(std::string_view word);

}  // namespace trocar
