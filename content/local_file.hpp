#pragma once
#include <filesystem>
#include <string>
namespace trocar {

// A file that another file names.
struct LocalFile {
    std::filesystem::path path;  // to open, and to name in messages
    std::string refusal;         // why it must not or cannot be opened, else empty
};

// The file a file in `folder` means by `name` ('/' or '\\' between folders, file:// before it or not), which must be a
// regular file below `root` after every symbolic link and '..' is followed: no file that is read may make the program
// open another one elsewhere.
LocalFile find_local_file(const std::filesystem::path& root, const std::filesystem::path& folder, std::string name);

}  // namespace trocar
