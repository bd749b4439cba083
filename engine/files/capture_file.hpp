#pragma once
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>
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

// Numbers and text as arrays of one row and column; reading throws InputError as find_array.
void add_number(CaptureRecord& record, const std::string& name, uint64_t value);
void add_number(CaptureRecord& record, const std::string& name, double value);
void add_text(CaptureRecord& record, const std::string& name, const std::string& text);
uint64_t read_u64(const CaptureRecord& record, const std::string& name);
double read_f64(const CaptureRecord& record, const std::string& name);
std::string read_text(const CaptureRecord& record, const std::string& name);

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
