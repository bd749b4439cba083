#pragma once
#include <cstdint>
#include <string>

#include "engine/base/format.hpp"
#include "engine/base/key_of.hpp"
namespace trocar {

// A CSV field, quoted where RFC 4180 requires it.
inline std::string csv_field(const std::string& text) {
    if (text.find_first_of(",\"\n") == std::string::npos) return text;
    std::string out = "\"";
    for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
    return out + "\"";
}

// Sixteen hexadecimal digits.
inline std::string hex(uint64_t value) { return format("%016llx", static_cast<unsigned long long>(value)); }

}  // namespace trocar
