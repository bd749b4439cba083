#pragma once
#include <algorithm>
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

}  // namespace trocar
