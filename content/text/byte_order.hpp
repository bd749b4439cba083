#pragma once
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <iterator>
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

// The types of numbers in files.
enum class Scalar : uint8_t { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble, kInt64, kUint64 };

// Calls `work` with a zero of the type.
template <typename Work>
auto with_scalar(Scalar type, const Work& work) {
    switch (type) {
        case Scalar::kInt8:
            return work(int8_t{});
        case Scalar::kUint8:
            return work(uint8_t{});
        case Scalar::kInt16:
            return work(int16_t{});
        case Scalar::kUint16:
            return work(uint16_t{});
        case Scalar::kInt32:
            return work(int32_t{});
        case Scalar::kUint32:
            return work(uint32_t{});
        case Scalar::kInt64:
            return work(int64_t{});
        case Scalar::kUint64:
            return work(uint64_t{});
        case Scalar::kFloat:
            return work(float{});
        case Scalar::kDouble:
            break;
    }
    return work(double{});
}

inline size_t scalar_bytes(Scalar type) {
    return with_scalar(type, [](auto zero) { return sizeof zero; });
}

inline double scalar_from_bytes(const char* at, Scalar type, bool big) {
    return with_scalar(type, [&](auto zero) { return static_cast<double>(number_from_bytes<decltype(zero)>(at, big)); });
}

}  // namespace trocar
