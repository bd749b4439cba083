#include "engine/files/text_file.hpp"

#include <fcntl.h>
#include <libdeflate.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

#include "engine/base/error.hpp"
#include "engine/base/format.hpp"
namespace trocar {
namespace {

constexpr size_t kChunk = size_t{1} << 20;
constexpr uint64_t kStreamLimit = uint64_t{1} << 28;  // smaller, because a pipe or device does not report its size

// File descriptor, closed by the destructor.
struct Descriptor {
    int fd = -1;
    ~Descriptor() {
        if (fd >= 0) ::close(fd);
    }
};

[[noreturn]] void fail_to_read(const std::filesystem::path& path, const std::string& reason) {
    throw InputError(path.string() + ": " + reason);
}

bool is_gzip(std::string_view bytes) {
    return bytes.size() >= 2 && static_cast<uint8_t>(bytes[0]) == 0x1f && static_cast<uint8_t>(bytes[1]) == 0x8b;
}

// Unpacks one member after another.
std::string unpack(const std::filesystem::path& path, std::string_view packed, uint64_t limit) {
    const std::unique_ptr<libdeflate_decompressor, decltype(&libdeflate_free_decompressor)> reader(libdeflate_alloc_decompressor(),
                                                                                                   libdeflate_free_decompressor);
    std::string text(std::min<uint64_t>(limit + 1, 4 * packed.size() + kChunk), '\0');
    size_t used = 0, written = 0;
    while (is_gzip(packed.substr(used))) {
        size_t got = 0, made = 0;
        const libdeflate_result result = libdeflate_gzip_decompress_ex(reader.get(), packed.data() + used, packed.size() - used,
                                                                       text.data() + written, text.size() - written, &got, &made);
        const bool full = result == LIBDEFLATE_INSUFFICIENT_SPACE;
        if (!full && result != LIBDEFLATE_SUCCESS) fail_to_read(path, "damaged gzip data, or cut short");
        used += got, written += made;
        if (written > limit || (full && text.size() > limit)) fail_to_read(path, "unpacks to more than " + describe_bytes(limit));
        if (full) text.resize(std::min<uint64_t>(limit + 1, 2 * text.size()));
    }
    text.resize(written);
    return text;
}

// Bytes of the first character of the text; 0 for a control character and for invalid UTF-8.
size_t shown_length(std::string_view text) {
    const auto at = [&](size_t k) { return static_cast<uint32_t>(static_cast<uint8_t>(text[k])); };
    if (at(0) < 0x80) return at(0) >= ' ' && at(0) != 0x7f ? 1 : 0;
    const size_t length = at(0) >= 0xf0 ? 4 : at(0) >= 0xe0 ? 3 : 2;
    if (at(0) < 0xc2 || at(0) > 0xf4 || text.size() < length) return 0;
    uint32_t code = at(0) & (0x7fu >> length);
    for (size_t k = 1; k < length; ++k) {
        if ((at(k) & 0xc0) != 0x80) return 0;
        code = code << 6 | (at(k) & 0x3f);
    }
    constexpr uint32_t kFirst[] = {0, 0, 0xa0, 0x800, 0x10000};  // below 0xa0 more control characters
    const bool surrogate = code >= 0xd800 && code < 0xe000;
    return code >= kFirst[length] && code < 0x110000 && !surrogate ? length : 0;
}

}  // namespace

std::string one_line(std::string_view text) {
    std::string line;
    for (size_t at = 0; at < text.size();) {
        const size_t length = shown_length(text.substr(at));
        if (length > 0) {
            line += text.substr(at, length);
            at += length;
            continue;
        }
        line += text[at] == '\n'   ? "\\n"
                : text[at] == '\r' ? "\\r"
                : text[at] == '\t' ? "\\t"
                                   : format("\\x%02x", static_cast<unsigned char>(text[at]));
        ++at;
    }
    return line;
}

std::string describe_bytes(uint64_t bytes) {
    if (bytes < 10000) return std::to_string(bytes) + " bytes";
    const bool large = bytes >= uint64_t{1} << 30;
    return format(large ? "%.1f GiB" : "%.1f MiB", static_cast<double>(bytes) / (large ? 1 << 30 : 1 << 20));
}

std::string read_file_bytes(const std::filesystem::path& path, uint64_t limit) {
    Descriptor file{::open(path.c_str(), O_RDONLY | O_CLOEXEC)};
    if (file.fd < 0) fail_to_read(path, std::strerror(errno));
    struct stat info {};
    if (::fstat(file.fd, &info) != 0) fail_to_read(path, std::strerror(errno));
    if (S_ISDIR(info.st_mode)) fail_to_read(path, "is a folder, not a file");
    uint64_t expected = kChunk;
    if (S_ISREG(info.st_mode)) {
        expected = static_cast<uint64_t>(info.st_size);
        if (expected > limit) fail_to_read(path, "has " + describe_bytes(expected) + ", the limit is " + describe_bytes(limit));
    } else {
        limit = std::min(limit, kStreamLimit);
    }
    std::string bytes;
    size_t filled = 0;
    while (true) {
        // one byte more than the reported size, so that the end is detected without growing
        if (filled == bytes.size()) bytes.resize(std::max<uint64_t>(filled + filled / 2, expected) + 1);
        const ssize_t got = ::read(file.fd, bytes.data() + filled, bytes.size() - filled);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) fail_to_read(path, std::strerror(errno));
        if (got == 0) break;
        filled += static_cast<size_t>(got);
        if (filled > limit) fail_to_read(path, "is longer than the limit of " + describe_bytes(limit));
    }
    bytes.resize(filled);
    return bytes;
}

std::string read_text_file(const std::filesystem::path& path, uint64_t limit) {
    std::string bytes = read_file_bytes(path, limit);
    return is_gzip(bytes) ? unpack(path, bytes, limit) : bytes;
}

}  // namespace trocar
