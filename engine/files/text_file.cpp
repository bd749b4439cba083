#include "engine/files/text_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>

#include "engine/base/error.hpp"
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

// inflate state, ended by the destructor.
struct Inflater {
    z_stream stream{};
    bool ready = false;
    ~Inflater() {
        if (ready) inflateEnd(&stream);
    }
};

std::string unpack(const std::filesystem::path& path, std::string_view packed, uint64_t limit) {
    Inflater inflater;
    z_stream& stream = inflater.stream;
    if (inflateInit2(&stream, 15 + 16) != Z_OK) fail_to_read(path, "cannot start unpacking gzip");
    inflater.ready = true;
    std::string text;
    size_t used = 0, written = 0;
    while (true) {
        // zlib counts in 32 bits, so both buffers are passed in pieces
        const size_t compliance = std::min(packed.size() - used, size_t{1} << 30);
        stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data() + used));
        stream.avail_in = static_cast<uInt>(compliance);
        if (text.size() - written < kChunk) text.resize(std::max(written + kChunk, written + written / 2));
        const size_t room = std::min(text.size() - written, size_t{1} << 30);
        stream.next_out = reinterpret_cast<Bytef*>(text.data() + written);
        stream.avail_out = static_cast<uInt>(room);
        const int status = inflate(&stream, Z_NO_FLUSH);
        used += compliance - stream.avail_in;
        written += room - stream.avail_out;
        if (written > limit) fail_to_read(path, "unpacks to more than " + describe_bytes(limit));
        if (status == Z_STREAM_END) {
            if (!is_gzip(packed.substr(used))) break;
            if (inflateReset(&stream) != Z_OK) fail_to_read(path, "cannot unpack gzip");
        } else if (status == Z_BUF_ERROR || (status == Z_OK && used == packed.size() && stream.avail_out > 0)) {
            fail_to_read(path, "gzip data is cut short after " + describe_bytes(written) + " of text");
        } else if (status != Z_OK) {
            fail_to_read(path, std::string("damaged gzip data: ") + (stream.msg ? stream.msg : "unknown fault"));
        }
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
        char escape[8];
        std::snprintf(escape, sizeof escape, "\\x%02x", static_cast<unsigned char>(text[at]));
        line += text[at] == '\n' ? "\\n" : text[at] == '\r' ? "\\r" : text[at] == '\t' ? "\\t" : escape;
        ++at;
    }
    return line;
}

std::string describe_bytes(uint64_t bytes) {
    char text[32];
    if (bytes < 10000) {
        std::snprintf(text, sizeof text, "%u bytes", static_cast<unsigned>(bytes));
    } else if (bytes < uint64_t{1} << 30) {
        std::snprintf(text, sizeof text, "%.1f MiB", static_cast<double>(bytes) / (1 << 20));
    } else {
        std::snprintf(text, sizeof text, "%.1f GiB", static_cast<double>(bytes) / (1 << 30));
    }
    return text;
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
