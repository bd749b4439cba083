#include "engine/files/whole_file.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>

#include "engine/base/error.hpp"
#include "engine/files/text_file.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

struct WholeFile : testing::Test {
    fs::path folder = fs::temp_directory_path() / ("trocar_whole_" + std::to_string(::getpid()));
    void SetUp() override { fs::create_directories(folder); }
    void TearDown() override { fs::remove_all(folder); }
    size_t entries() const { return static_cast<size_t>(std::distance(fs::directory_iterator(folder), fs::directory_iterator{})); }
};

std::string write_error(const fs::path& path, std::string_view bytes = "text") {
    try {
        write_whole_file(path, bytes);
    } catch (const InputError& error) {
        return error.what();
    }
    return "no error";
}

TEST_F(WholeFile, writes_and_overwrites_and_leaves_nothing_else) {
    const fs::path path = folder / "a.txt";
    write_whole_file(path, "first");
    EXPECT_EQ(read_file_bytes(path), "first");
    ASSERT_EQ(::chmod(path.c_str(), 0640), 0);
    const std::string longer(3000000, 'x');
    write_whole_file(path, longer);
    EXPECT_EQ(read_file_bytes(path), longer);
    struct stat info {};
    ASSERT_EQ(::stat(path.c_str(), &info), 0);
    EXPECT_EQ(info.st_mode & 0777, 0640u);
    EXPECT_EQ(entries(), 1u);
}

TEST_F(WholeFile, a_link_keeps_pointing_where_it_did) {
    write_whole_file(folder / "real", "old");
    fs::create_symlink("real", folder / "link");
    write_whole_file(folder / "link", "new");
    EXPECT_TRUE(fs::is_symlink(folder / "link"));
    EXPECT_EQ(read_file_bytes(folder / "real"), "new");
}

TEST_F(WholeFile, a_full_device_is_an_error_also_behind_a_link) {
    EXPECT_EQ(write_error("/dev/full"), "/dev/full: cannot write: No space left on device");
    fs::create_symlink("/dev/full", folder / "out.json");
    EXPECT_NE(write_error(folder / "out.json").find("No space left"), std::string::npos);
    EXPECT_EQ(write_error("/dev/null"), "no error");
}

TEST_F(WholeFile, bad_places_are_named) {
    EXPECT_NE(write_error(folder / "absent" / "a").find("absent/a: cannot write: No such file"), std::string::npos);
    EXPECT_NE(write_error(folder).find("it is a folder"), std::string::npos);
    write_whole_file(folder / "file", "x");
    EXPECT_NE(write_error(folder / "file" / "a").find("Not a directory"), std::string::npos);
    if (::geteuid() != 0) {
        fs::permissions(folder, fs::perms::owner_read | fs::perms::owner_exec);
        EXPECT_NE(write_error(folder / "new").find("Permission denied"), std::string::npos);
        fs::permissions(folder, fs::perms::owner_all);
    }
}

// Breaks if a failed write renames, removes or truncates an existing file, or leaves its temporary file.
TEST_F(WholeFile, a_write_that_fails_half_way_leaves_the_old_files) {
    write_whole_file(folder / "a", "old a");
    write_whole_file(folder / "b", "old b");
    // a file size limit simulates a full disk
    rlimit old_limit{};
    ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old_limit), 0);
    const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
    rlimit limit = old_limit;
    limit.rlim_cur = 10000;
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
    const std::string big(50000, 'x');
    const FileContents files[] = {{folder / "a", "new a"}, {folder / "b", big}};
    EXPECT_THROW(write_whole_files(files), InputError);
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &old_limit), 0);
    std::signal(SIGXFSZ, old_handler);
    EXPECT_EQ(read_file_bytes(folder / "a"), "old a");
    EXPECT_EQ(read_file_bytes(folder / "b"), "old b");
    EXPECT_EQ(entries(), 2u);
}

}  // namespace
}  // namespace trocar
