#pragma once
#include <cctype>
#include <string>
#include <string_view>
namespace trocar {

// "work_hand_j": the key in files of a field with a unit.
inline std::string key_of(std::string_view name, std::string_view unit) {
    std::string key = std::string(name) + (unit.empty() ? "" : "_");
    for (const char c : unit) key += static_cast<char>(std::tolower(c));
    return key;
}

}  // namespace trocar
