#pragma once
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <string>
namespace trocar {

// Like printf, for text of any length.
inline std::string format(const char* pattern, auto... values) {
    char buffer[256];
    const int length = std::snprintf(buffer, sizeof buffer, pattern, values...);
    if (length < static_cast<int>(sizeof buffer)) return {buffer, static_cast<size_t>(std::max(length, 0))};
    std::string text(static_cast<size_t>(length), '\0');
    std::snprintf(text.data(), text.size() + 1, pattern, values...);
    return text;
}

// A CSV field, quoted where RFC 4180 requires it.
inline std::string csv_field(const std::string& text) {
    if (text.find_first_of(",\"\n") == std::string::npos) return text;
    std::string out = "\"";
    for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + "\"";
}

// Sixteen hexadecimal digits.
// "work_hand_j": the key in files of a field with a unit.
inline std::string key_of(std::string_view name, std::string_view unit) {
    std::string key = std::string(name) + (unit.empty() ? "" : "_");
    for (const char c : unit) key += static_cast<char>(std::tolower(c));
    return key;
}
inline std::string hex(uint64_t value) { return format("%016llx", static_cast<unsigned long long>(value)); }

}  // namespace trocar
