#pragma once
#include <cstddef>
#include <filesystem>
#include <span>
#include <string_view>
namespace trocar {

// New content of one file.
struct FileContents {
    std::filesystem::path path;
    std::string_view bytes;
};

// Writes a file completely or not at all: under a temporary name in the same folder, every write and the
// close checked, then renamed. An existing file keeps its permissions; a symbolic link keeps its target. A
// path that is a device, a pipe or /dev/stdout is written directly. Throws InputError "file: reason" and
// leaves nothing half-written under `path`.
void write_whole_file(const std::filesystem::path& path, std::string_view bytes);
void write_whole_file(const std::filesystem::path& path, std::span<const std::byte> bytes);

// Writes files that belong together: all are staged before any is renamed, in the order given.
void write_whole_files(std::span<const FileContents> files);

}  // namespace trocar
