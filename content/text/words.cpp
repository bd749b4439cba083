#include "content/text/words.hpp"

#include <cmath>
#include <limits>

#include "content/text/number_text.hpp"
#include "engine/base/error.hpp"
namespace trocar {
namespace {

bool is_space(char c) { return static_cast<unsigned char>(c) <= ' '; }

}  // namespace

void Words::fail(const std::string& reason) const { throw InputError(path.string() + ":" + std::to_string(line) + ": " + reason); }

void Words::skip_blanks() {
    for (; at != end; ++at) {
        if (comment != '\0' && *at == comment) {
            while (at + 1 != end && at[1] != '\n' && at[1] != '\r') ++at;
        } else if (!is_space(*at)) {
            return;
        }
        line += *at == '\n' || (*at == '\r' && (at + 1 == end || at[1] != '\n'));
    }
}

std::string_view Words::next() {
    skip_blanks();
    const char* const begin = at;
    while (at != end && !is_space(*at)) ++at;
    return {begin, static_cast<size_t>(at - begin)};
}

std::string_view Words::peek() const {
    Words copy = *this;
    return copy.next();
}

std::string_view Words::rest_of_line() {
    const char* const begin = at;
    while (at != end && *at != '\n' && *at != '\r') ++at;
    const std::string_view rest(begin, static_cast<size_t>(at - begin));
    if (at != end) {
        at += *at == '\r' && at + 1 != end && at[1] == '\n' ? 2 : 1;
        ++line;
    }
    return rest;
}

double Words::number(bool may_be_bad) {
    const std::string_view word = next();
    double value = 0;
    const char* const stop = parse_number(word.data(), word.data() + word.size(), value);
    const bool good = !word.empty() && stop == word.data() + word.size() && std::isfinite(value);
    if (good) return value;
    if (!may_be_bad || word.empty()) fail("expected a finite number, found " + shown(word));
    return std::numeric_limits<double>::quiet_NaN();
}

uint64_t Words::count(const char* what, uint64_t most) {
    const std::string_view word = next();
    uint64_t value = 0;
    bool good = !word.empty() && word.size() < 20;
    for (const char c : word) {
        good = good && c >= '0' && c <= '9';
        value = value * 10 + static_cast<uint64_t>(c - '0');
    }
    if (!good) fail(std::string("expected ") + what + ", found " + shown(word));
    if (value > most) {
        fail(std::string(what) + " " + std::string(word) + ": the file has room for no more than " + std::to_string(most));
    }
    return value;
}

std::string lower_case(std::string_view text) {
    std::string out(text);
    for (char& c : out) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c | 0x20) : c;
    return out;
}

bool same_word(std::string_view word, std::string_view lower) { return word.size() == lower.size() && lower_case(word) == lower; }

std::string shown(std::string_view word) {
    if (word.empty()) return "the end of the file";
    std::string text = "'";
    for (const char c : word.substr(0, 40)) text += c > ' ' && c < 127 ? c : '?';
    return text + "'";
}

}  // namespace trocar
