#include "engine/files/capture_file.hpp"

#include <zstd.h>

#include <cerrno>
#include <cstring>

#include "engine/base/error.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/files/text_file.hpp"
namespace trocar {
namespace {

constexpr char kMagic[] = "trocarCP";
constexpr uint32_t kVersion = 5, kByteOrder = 0x01020304;
constexpr size_t kKindSize = 8, kRecordHeaderSize = kKindSize + 3 * sizeof(uint64_t);
constexpr uint64_t kMostUnpacked = uint64_t{4} << 30;  // bytes, all records together
constexpr uint32_t kMostArrays = 1 << 16;              // of a record; the largest has some hundred
constexpr int kZstdLevel = 3;

template <typename T>
void append(std::vector<std::byte>& out, const T& value) {
    const std::byte* bytes = reinterpret_cast<const std::byte*>(&value);
    out.insert(out.end(), bytes, bytes + sizeof value);
}

std::vector<std::byte> pack(const CaptureRecord& record) {
    std::vector<std::byte> raw;
    size_t size = sizeof(uint32_t);
    for (const CaptureArray& a : record.arrays)
        size += sizeof(uint16_t) + a.name.size() + sizeof a.type + sizeof a.columns + sizeof a.rows + a.bytes.size();
    raw.reserve(size);  // growing would copy a state three times
    append(raw, static_cast<uint32_t>(record.arrays.size()));
    for (const CaptureArray& a : record.arrays) {
        append(raw, static_cast<uint16_t>(a.name.size()));
        const std::byte* name = reinterpret_cast<const std::byte*>(a.name.data());
        raw.insert(raw.end(), name, name + a.name.size());
        append(raw, a.type);
        append(raw, a.columns);
        append(raw, a.rows);
        raw.insert(raw.end(), a.bytes.begin(), a.bytes.end());
    }
    return raw;
}

// Reads values from the front of a span of bytes; false if too few are left.
struct ByteReader {
    std::span<const std::byte> bytes;
    template <typename T>
    bool take(T& value) {
        if (bytes.size() < sizeof value) return false;
        std::memcpy(&value, bytes.data(), sizeof value);
        bytes = bytes.subspan(sizeof value);
        return true;
    }
    bool take(std::span<const std::byte>& out, uint64_t count) {
        if (bytes.size() < count) return false;
        out = bytes.first(count);
        bytes = bytes.subspan(count);
        return true;
    }
};

bool unpack_array(ByteReader& reader, CaptureArray& a) {
    uint16_t name_size = 0;
    std::span<const std::byte> name, rows;
    if (!reader.take(name_size) || !reader.take(name, name_size) || !reader.take(a.type) || !reader.take(a.columns) || !reader.take(a.rows))
        return false;
    if (a.type >= ArrayType::kCount || a.columns == 0 || a.columns > 1024) return false;
    const uint64_t row_size = a.columns * element_size(a.type);
    if (a.rows > reader.bytes.size() / row_size || !reader.take(rows, a.rows * row_size)) return false;
    a.name.assign(reinterpret_cast<const char*>(name.data()), name.size());
    a.bytes.assign(rows.begin(), rows.end());
    return true;
}

bool unpack(std::span<const std::byte> raw, CaptureRecord& record) {
    ByteReader reader{raw};
    uint32_t arrays = 0;
    if (!reader.take(arrays) || arrays > kMostArrays) return false;
    for (uint32_t i = 0; i < arrays; ++i) {
        CaptureArray array;
        if (!unpack_array(reader, array)) return false;
        record.arrays.push_back(std::move(array));
    }
    return reader.bytes.empty();
}

// Checksum of a record: its kind, padded with zeros, and its content.
uint64_t hash_of(std::span<const std::byte> kind, std::span<const std::byte> stored) {
    StateHash hash;
    hash.add_bytes(kind.data(), kind.size());
    hash.add_bytes(stored.data(), stored.size());
    return hash.value;
}

// Reads one record from the front of the rest of a file. Returns the reason of a failure, else "".
std::string read_record(ByteReader& file, uint64_t& unpacked, CaptureRecord& record) {
    std::span<const std::byte> kind, stored;
    uint64_t stored_size = 0, raw_size = 0, hash = 0;
    if (!file.take(kind, kKindSize) || !file.take(stored_size) || !file.take(raw_size) || !file.take(hash) ||
        !file.take(stored, stored_size))
        return "is cut short";
    if (hash_of(kind, stored) != hash) return "is damaged: its checksum does not fit";
    if (raw_size > kMostUnpacked - unpacked) return "would unpack to more than 4 GiB";
    if (ZSTD_getFrameContentSize(stored.data(), stored.size()) != raw_size) return "does not unpack";
    unpacked += raw_size;
    std::vector<std::byte> raw(raw_size);
    const size_t got = ZSTD_decompress(raw.data(), raw.size(), stored.data(), stored.size());
    if (ZSTD_isError(got) || got != raw_size) return "does not unpack";
    if (!unpack(raw, record)) return "holds arrays that do not fit together";
    const char* letters = reinterpret_cast<const char*>(kind.data());
    record.kind.assign(letters, strnlen(letters, kKindSize));
    return "";
}

}  // namespace

const char* name_of(ArrayType type) {
    constexpr const char* kNames[] = {"u8", "u16", "u32", "u64", "f32", "f64"};
    return kNames[static_cast<size_t>(type)];
}

const CaptureArray& find_array(const CaptureRecord& record, const std::string& name, ArrayType type, uint32_t columns) {
    for (const CaptureArray& a : record.arrays) {
        if (a.name != name) continue;
        if (a.type != type || a.columns != columns)
            throw InputError("record " + record.kind + ": array " + name + " is " + std::to_string(a.columns) + " x " + name_of(a.type) +
                             ", not " + std::to_string(columns) + " x " + name_of(type));
        return a;
    }
    throw InputError("record " + record.kind + ": array " + name + " is missing");
}

CaptureWriter::CaptureWriter(const std::filesystem::path& path) : path_(path), file_(std::fopen(path.c_str(), "wbe"), std::fclose) {
    if (!file_) throw InputError(path.string() + ": cannot be written: " + std::strerror(errno));
    std::vector<std::byte> header;
    for (size_t i = 0; i < 8; ++i) header.push_back(static_cast<std::byte>(kMagic[i]));
    append(header, kVersion);
    append(header, kByteOrder);
    write(header);
}

void CaptureWriter::write(std::span<const std::byte> bytes) {
    if (std::fwrite(bytes.data(), 1, bytes.size(), file_.get()) != bytes.size() || std::fflush(file_.get()) != 0)
        throw InputError(path_.string() + ": cannot be written: " + std::strerror(errno));
}

void CaptureWriter::add(const CaptureRecord& record) {
    const std::vector<std::byte> raw = pack(record);
    std::vector<std::byte> out(kRecordHeaderSize + ZSTD_compressBound(raw.size()));
    const size_t stored = ZSTD_compress(out.data() + kRecordHeaderSize, out.size() - kRecordHeaderSize, raw.data(), raw.size(), kZstdLevel);
    if (ZSTD_isError(stored)) throw InputError(path_.string() + ": cannot be compressed: " + ZSTD_getErrorName(stored));
    out.resize(kRecordHeaderSize + stored);
    std::memcpy(out.data(), record.kind.data(), std::min(record.kind.size(), kKindSize));
    const std::span<const std::byte> all(out);
    const uint64_t sizes[3] = {stored, raw.size(), hash_of(all.first(kKindSize), all.subspan(kRecordHeaderSize))};
    std::memcpy(out.data() + kKindSize, sizes, sizeof sizes);
    write(out);
}

void CaptureWriter::finish() {
    add({"end", {}});
    if (std::fclose(file_.release()) != 0) throw InputError(path_.string() + ": cannot be written: " + std::strerror(errno));
}

CaptureFile read_capture(const std::filesystem::path& path) {
    const std::string text = read_file_bytes(path);
    const auto fail = [&](const std::string& reason) { throw InputError(path.string() + ": " + reason); };
    ByteReader file{std::as_bytes(std::span(text))};
    std::span<const std::byte> magic;
    uint32_t order = 0;
    CaptureFile capture;
    if (!file.take(magic, 8) || std::memcmp(magic.data(), kMagic, 8) != 0) fail("is not a capture");
    if (!file.take(capture.version) || !file.take(order)) fail("capture is cut short inside its header");
    if (order != kByteOrder) fail("capture of a machine of another byte order");
    if (capture.version != kVersion)
        fail("capture of version " + std::to_string(capture.version) + "; this program reads version " + std::to_string(kVersion));
    uint64_t unpacked = 0;
    while (true) {
        if (file.bytes.empty()) {
            capture.damage = "was not finished";
            return capture;
        }
        const size_t at = text.size() - file.bytes.size();
        CaptureRecord record;
        if (const std::string reason = read_record(file, unpacked, record); !reason.empty()) {
            capture.damage =
                "breaks off: record " + std::to_string(capture.records.size() + 1) + " at byte " + std::to_string(at) + " " + reason;
            return capture;
        }
        if (record.kind == "end") break;
        capture.records.push_back(std::move(record));
    }
    if (!file.bytes.empty()) capture.damage = "is followed by something else";
    return capture;
}

}  // namespace trocar
