#pragma once
#include <algorithm>
#include <cstring>
namespace trocar {

// The number whose bytes begin at `at`, little endian unless `big`.
template <typename T>
T number_from_bytes(const char* at, bool big) {
    char bytes[sizeof(T)];
    std::memcpy(bytes, at, sizeof(T));
    if (big) std::reverse(std::begin(bytes), std::end(bytes));
    T value;
    std::memcpy(&value, bytes, sizeof(T));
    return value;
}

}  // namespace trocar
