#pragma once
#include <filesystem>
#include <string>
#include <vector>
namespace trocar {

// A file referenced by another file.
struct LocalFile {
    std::filesystem::path path;  // path to open and to show in messages
    std::string refusal;         // why it must not or cannot be opened; empty = it can
};

// Folders below which a file may lie that another one names: that of the file given to the program, then those the user
// allows besides, in which names are looked for, too.
using FileRoots = std::vector<std::filesystem::path>;

// The file that `name` refers to in a file in `folder` ('/' or '\\' between folders, optional file://). It
// must be a regular file below one of the roots after resolving every symbolic link and '..', so that no input file can
// make the program open a file elsewhere.
LocalFile find_local_file(const FileRoots& roots, const std::filesystem::path& folder, std::string name);

}  // namespace trocar
