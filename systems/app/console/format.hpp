#pragma once
#include <cctype>
#include <cstdint>
#include <string>
#include <string_view>

#include "engine/base/format.hpp"
namespace trocar {

// A CSV field, quoted where RFC 4180 requires it.
inline std::string csv_field(const std::string& text) {
    if (text.find_first_of(",\"\n") == std::string::npos) return text;
    std::string out = "\"";
    for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + "\"";
}

// "work_hand_j": the key in files of a field with a unit.
inline std::string key_of(std::string_view name, std::string_view unit) {
    std::string key = std::string(name) + (unit.empty() ? "" : "_");
    for (const char c : unit) key += static_cast<char>(std::tolower(c));
    return key;
}
// Sixteen hexadecimal digits.
inline std::string hex(uint64_t value) { return format("%016llx", static_cast<unsigned long long>(value)); }

}  // namespace trocar
