#pragma once
#include <filesystem>
#include <string>
namespace trocar {

// A file referenced by another file.
struct LocalFile {
    std::filesystem::path path;  // path to open and to show in messages
    std::string refusal;         // why it must not or cannot be opened; empty = it can
};

// The file that `name` refers to in a file in `folder` ('/' or '\\' between folders, optional file://). It
// must be a regular file below `root` after resolving every symbolic link and '..', so that no input file can
// make the program open a file elsewhere.
LocalFile find_local_file(const std::filesystem::path& root, const std::filesystem::path& folder, std::string name);

}  // namespace trocar
