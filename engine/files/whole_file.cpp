#include "engine/files/whole_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>
#include <vector>

#include "engine/base/error.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail_to_write(const fs::path& path, const std::string& reason) {
    throw InputError(path.string() + ": cannot write: " + reason);
}

// Temporary files of one call; the destructor removes those that still exist.
struct Staged {
    struct File {
        fs::path temporary, target;
    };
    std::vector<File> files;
    ~Staged() {
        for (const File& file : files) ::unlink(file.temporary.c_str());
    }
};

void write_all(int fd, std::string_view bytes, const fs::path& path) {
    size_t done = 0;
    int fault = 0;
    while (done < bytes.size() && fault == 0) {
        const ssize_t got = ::write(fd, bytes.data() + done, std::min(bytes.size() - done, size_t{1} << 30));
        if (got < 0 && errno != EINTR) fault = errno;
        if (got > 0) done += static_cast<size_t>(got);
    }
    // some file systems report a full disk only on close
    if (::close(fd) != 0 && fault == 0 && errno != EINTR) fault = errno;
    if (fault != 0) fail_to_write(path, std::strerror(fault));
}

// A standard stream of this process must be appended to, even if redirected to a regular file.
bool names_own_stream(const fs::path& path) {
    const std::string text = path.lexically_normal().string();
    return text == "/dev/stdout" || text == "/dev/stderr" || text.starts_with("/dev/fd/") || text.starts_with("/proc/self/fd/");
}

void stage(const FileContents& file, const fs::path& target, const struct stat* existing, Staged& staged) {
    const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
    int fd = -1;
    fs::path temporary;
    for (int attempt = 0; fd < 0 && attempt < 1000; ++attempt) {
        temporary = folder / (".trocar-" + std::to_string(::getpid()) + "-" + std::to_string(attempt) + ".tmp");
        fd = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (fd < 0 && errno != EEXIST) break;
    }
    if (fd < 0) fail_to_write(file.path, std::strerror(errno));
    staged.files.push_back({temporary, target});
    if (existing && ::fchmod(fd, existing->st_mode & 0777) != 0) {
        const int fault = errno;
        ::close(fd);
        fail_to_write(file.path, std::strerror(fault));
    }
    write_all(fd, file.bytes, file.path);
}

}  // namespace

void write_whole_files(std::span<const FileContents> files) {
    Staged staged;
    for (const FileContents& file : files) {
        struct stat info {};
        const bool exists = ::stat(file.path.c_str(), &info) == 0;
        if (exists && S_ISDIR(info.st_mode)) fail_to_write(file.path, "it is a folder");
        if (names_own_stream(file.path) || (exists && !S_ISREG(info.st_mode))) {
            const int fd = ::open(file.path.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
            if (fd < 0) fail_to_write(file.path, std::strerror(errno));
            write_all(fd, file.bytes, file.path);
            continue;
        }
        if (exists && ::access(file.path.c_str(), W_OK) != 0) fail_to_write(file.path, std::strerror(errno));
        std::error_code ignored;
        const fs::path target = exists ? fs::canonical(file.path, ignored) : file.path;
        stage(file, target.empty() ? file.path : target, exists ? &info : nullptr, staged);
    }
    // in the order given, so that a file that refers to others appears after them
    for (const Staged::File& file : staged.files) {
        if (::rename(file.temporary.c_str(), file.target.c_str()) != 0) fail_to_write(file.target, std::strerror(errno));
    }
    staged.files.clear();
}

void write_whole_file(const fs::path& path, std::string_view bytes) {
    const FileContents file{path, bytes};
    write_whole_files({&file, 1});
}

void write_whole_file(const fs::path& path, std::span<const std::byte> bytes) {
    write_whole_file(path, std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

}  // namespace trocar
