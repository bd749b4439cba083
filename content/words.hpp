#pragma once
#include <filesystem>
#include <string>
#include <string_view>

#include "components/math.hpp"
namespace trocar {

// Words of a text file between blanks and control characters, with the line they stand in. CR, LF and CR LF end a line.
struct Words {
    const char* at;
    const char* end;
    const std::filesystem::path& path;
    uint64_t line = 1;
    char comment = '\0';  // begins a comment up to the end of the line; '\0' = there are none

    [[noreturn]] void fail(const std::string& reason) const;  // InputError "file:line: reason"
    void skip_blanks();
    // The next word, empty at the end of the file.
    std::string_view next();
    // The same without moving on.
    std::string_view peek() const;
    // The rest of the line, without its end, and moves to the next line.
    std::string_view rest_of_line();
    // The next word as a number; fails when it is none or not finite. One that `may_be_bad` is nan then.
    double number(bool may_be_bad = false);
    // The next word as a whole number in [0, most].
    uint64_t count(const char* what, uint64_t most);
};

// ASCII letters in lower case.
std::string lower_case(std::string_view text);

// Compares without regard to case; `lower` is in lower case.
bool same_word(std::string_view word, std::string_view lower);

// A word as a message shows it: in quotes, 40 characters at most, '?' for what cannot be printed.
std::string shown(std::string_view word);

}  // namespace trocar
