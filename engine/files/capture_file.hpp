#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "engine/base/error.hpp"
namespace trocar {

// Element type of a stored array.
enum class ArrayType : uint8_t { kU8, kU16, kU32, kU64, kF32, kF64, kCount };
constexpr size_t element_size(ArrayType type) {  // bytes
    constexpr size_t kSizes[] = {1, 2, 4, 8, 4, 8};
    return kSizes[static_cast<size_t>(type)];
}
const char* name_of(ArrayType type);  // "u8", "f32", ...

// A named array of rows x columns elements, row-major.
struct CaptureArray {
    std::string name;
    ArrayType type = ArrayType::kU8;
    uint64_t rows = 0;
    uint32_t columns = 1;
    std::vector<std::byte> bytes;  // rows * columns * element_size(type)
};

// Everything written at one moment: "header", "scene", "state", "step", "picture", "end".
struct CaptureRecord {
    std::string kind;  // at most 8 letters
    std::vector<CaptureArray> arrays;
};

// The array of that name and type with `columns` columns. Throws InputError "record KIND: reason".
const CaptureArray& find_array(const CaptureRecord& record, const std::string& name, ArrayType type, uint32_t columns);

// A number, a text or a list of numbers as an array of one column; reading throws InputError as find_array.
template <typename T>
concept Number = std::is_same_v<std::remove_const_t<T>, uint64_t> || std::is_same_v < std::remove_const_t<T>,
double > ;
template <Number T>
std::span<T> elements_in(T& number) {
    return {&number, 1};
}
template <typename List>
auto elements_in(List& list) -> decltype(std::span(list.data(), list.size())) {
    return {list.data(), list.size()};
}
template <typename T>
constexpr ArrayType kElementType = sizeof(T) == 1          ? ArrayType::kU8
                                   : std::is_integral_v<T> ? ArrayType::kU64
                                                           : ArrayType::kF64;

template <typename T>
void add_value(CaptureRecord& record, const std::string& name, const T& value) {
    const auto elements = elements_in(value);
    const auto bytes = std::as_bytes(elements);
    record.arrays.push_back(
        {name, kElementType<typename decltype(elements)::value_type>, elements.size(), 1, {bytes.begin(), bytes.end()}});
}
template <typename T>
void read_value(const CaptureRecord& record, const std::string& name, T& value) {
    const CaptureArray& a = find_array(record, name, kElementType<typename decltype(elements_in(value))::value_type>, 1);
    if constexpr (requires { value.resize(1); }) value.resize(a.rows);
    const auto to = std::as_writable_bytes(elements_in(value));
    if (to.size() != a.bytes.size()) throw InputError("record " + record.kind + ": " + name + " is not one number");
    std::copy(a.bytes.begin(), a.bytes.end(), to.begin());
}

// A capture file: "trocarCP", version, byte-order mark 0x01020304, then records. A record: its kind (8
// letters), bytes stored, bytes unpacked, a hash of the stored bytes (8 bytes each), then the arrays, zstd.
// Little endian. Records are flushed one by one, so that complete records stay readable after a crash.
class CaptureWriter {
 public:
    // Throws InputError "file: reason", also when a write fails later.
    explicit CaptureWriter(const std::filesystem::path& path);
    void add(const CaptureRecord& record);
    // Writes the "end" record and closes. Without it a reader reports an unfinished capture.
    void finish();

 private:
    void write(std::span<const std::byte> bytes);
    std::filesystem::path path_;
    std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
};

struct CaptureFile {
    uint32_t version = 0;
    std::vector<CaptureRecord> records;  // without "end"
    std::string damage;                  // why reading stopped before the end of the file; empty = complete
};

// Every complete record up to the first truncated or damaged one. Malicious files end in an error or in
// `damage`, within 4 GiB unpacked. Throws InputError "file: reason" if the file is not a capture.
CaptureFile read_capture(const std::filesystem::path& path);

}  // namespace trocar
