#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
namespace trocar {

inline constexpr uint64_t kTextFileLimit = uint64_t{1} << 31;  // bytes, as stored and as unpacked

// The bytes of a whole file as stored. Reads regular files and pipes up to `limit` bytes; a folder, a
// missing, unreadable or longer file throws InputError "file: reason".
std::string read_file_bytes(const std::filesystem::path& path, uint64_t limit = kTextFileLimit);

// The same with gzip (one or more members) unpacked, recognised by its first two bytes. A packed file that is
// damaged, truncated or unpacks to more than `limit` bytes throws InputError.
std::string read_text_file(const std::filesystem::path& path, uint64_t limit = kTextFileLimit);

// The text as a terminal can show it in one line: control characters and invalid UTF-8 escaped: \n, \x1b.
std::string one_line(std::string_view text);

// "12 345 bytes" or "2.0 GiB", for messages about limits.
std::string describe_bytes(uint64_t bytes);

}  // namespace trocar
