#include <fcntl.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "content/read/load_mesh.hpp"
#include "reference/paths.hpp"

// The program as a reader: hostile files within limits, and progress on a terminal.
namespace trocar {
namespace {

namespace fs = std::filesystem;

struct Outcome {
    int status = 0;
    std::string err;
};

constexpr rlim_t kProcessorSeconds = 120;  // for what never ends: the slowest takes 1 s, 25 under the address sanitizer

// Runs `trocar check FILE` with kProcessorSeconds and 1 GiB of address space; a crash or an exceeded limit is
// a signal or exit code 3.
Outcome check_within_limits(const fs::path& file, const fs::path& err) {
    const pid_t child = ::fork();
    if (child == 0) {
        [[maybe_unused]] const rlimit seconds{kProcessorSeconds, kProcessorSeconds}, bytes{uint64_t{1} << 30, uint64_t{1} << 30};
        ::setrlimit(RLIMIT_CPU, &seconds);
#ifndef __SANITIZE_ADDRESS__
        ::setrlimit(RLIMIT_AS, &bytes);  // the sanitizer reserves terabytes
#endif
        const int nowhere = ::open("/dev/null", O_WRONLY), log = ::open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
        ::dup2(nowhere, 1);
        ::dup2(log, 2);
        ::execl(program_path().c_str(), "trocar", "check", file.c_str(), nullptr);
        ::_exit(127);
    }
    Outcome outcome;
    ::waitpid(child, &outcome.status, 0);
    std::ifstream stream(err);
    outcome.err.assign(std::istreambuf_iterator<char>(stream), {});
    return outcome;
}

// Checks all hostile files, either VRML or the others. Returns their number.
int check_hostile_files(bool vrml) {
    const fs::path err = fs::path(testing::TempDir()) / ("trocar_reading_" + std::to_string(::getpid()));
    int files = 0;
    for (const auto& entry : fs::directory_iterator(shared_data_folder() / "hostile")) {
        if ((entry.path().extension() == ".wrl") != vrml) continue;
        SCOPED_TRACE(entry.path().filename());
        ++files;
        const Outcome outcome = check_within_limits(entry.path(), err);
        EXPECT_TRUE(WIFEXITED(outcome.status)) << "signal " << WTERMSIG(outcome.status);
        if (!WIFEXITED(outcome.status)) continue;
        EXPECT_LE(WEXITSTATUS(outcome.status), 2) << outcome.err;
        // an error is one line with the file's name
        const bool named = outcome.err.find("trocar: " + entry.path().string()) != std::string::npos;
        EXPECT_TRUE(WEXITSTATUS(outcome.status) != 2 || named) << outcome.err;
    }
    fs::remove(err);
    return files;
}

TEST(ReadingProgram, hostile_vrml_ends_within_limits_in_an_answer_or_an_error) {
    if (shared_data_folder().empty()) GTEST_SKIP() << "the folder of real surfaces is absent";
    EXPECT_GT(check_hostile_files(true), 20);
}

TEST(ReadingProgram, hostile_x3d_and_ply_end_within_limits_in_an_answer_or_an_error) {
    if (shared_data_folder().empty()) GTEST_SKIP() << "the folder of real surfaces is absent";
    EXPECT_GT(check_hostile_files(false), 20);
}

std::string sheet_in_vrml(int side) {
    std::string text = "#VRML V2.0 utf8\nShape { geometry IndexedFaceSet { coord Coordinate { point [\n";
    char line[96];
    for (int y = 0; y < side; ++y) {
        for (int x = 0; x < side; ++x) {
            std::snprintf(line, sizeof line, "%.5f %.5f %.5f,\n", x * 1e-3, y * 1e-3, 1e-7 * ((x * 7919 + y * 104729) % 1000));
            text += line;
        }
    }
    text += "] }\ncoordIndex [\n";
    for (int y = 0; y + 1 < side; ++y) {
        for (int x = 0; x + 1 < side; ++x) {
            const int a = y * side + x;
            std::snprintf(line, sizeof line, "%d, %d, %d, -1,\n%d, %d, %d, -1,\n", a, a + 1, a + side + 1, a, a + side + 1, a + side);
            text += line;
        }
    }
    return text + "] } }\n";
}

struct ReadingFile : testing::Test {
    fs::path path;
    void SetUp() override {
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        path = fs::path(testing::TempDir()) / ("trocar_" + std::to_string(::getpid()) + "_" + info->name() + ".wrl");
    }
    void TearDown() override { fs::remove(path); }
};

// Breaks when a terminal shows no progress while a long file is read, or a log file contains progress.
TEST_F(ReadingFile, shows_progress_on_a_terminal_only) {
    std::ofstream(path, std::ios::binary) << sheet_in_vrml(270);
    ASSERT_GT(fs::file_size(path), 5'000'000u);
    int terminal = -1;
    const pid_t child = ::forkpty(&terminal, nullptr, nullptr, nullptr);
    ASSERT_GE(child, 0);
    if (child == 0) {
        ::execl(program_path().c_str(), "trocar", "convert", path.c_str(), (path.string() + ".stl").c_str(), nullptr);
        ::_exit(127);
    }
    std::string seen;
    char bytes[4096];
    for (ssize_t got; (got = ::read(terminal, bytes, sizeof bytes)) > 0;) seen.append(bytes, static_cast<size_t>(got));
    ::close(terminal);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << seen;
    EXPECT_NE(seen.find("reading " + path.filename().string()), std::string::npos) << seen;
    fs::remove(path.string() + ".stl");
    const fs::path err = path.string() + ".err";
    check_within_limits(path, err);
    EXPECT_EQ(fs::file_size(err), 0u);
    fs::remove(err);
}

// 180 MB, 4.5 million triangles: at most three times the file size in memory. Prints the speed, which a test
// cannot judge.
TEST_F(ReadingFile, LongOneTakesLessThanThreeTimesItsSize) {
    std::ofstream(path, std::ios::binary) << sheet_in_vrml(1500);
    const double size = static_cast<double>(fs::file_size(path));
    ASSERT_GT(size, 180e6);
    const pid_t child = ::fork();
    if (child == 0) {
        const Mesh mesh = load_mesh(path).mesh;
        ::_exit(mesh.triangle.size() == 2u * 1499 * 1499 && mesh.position.size() == 1500u * 1500 ? 0 : 1);
    }
    int status = 0;
    rusage used{};
    ::wait4(child, &status, 0, &used);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    const double seconds = static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
                           1e-6 * static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
    std::printf("%.0f MB in %.2f s of processor time: %.0f MB/s, %.2f times the file in memory\n", 1e-6 * size, seconds,
                1e-6 * size / seconds, 1024.0 * static_cast<double>(used.ru_maxrss) / size);
#ifndef __SANITIZE_ADDRESS__
    EXPECT_LE(1024.0 * static_cast<double>(used.ru_maxrss), 3 * size);
#endif
}

}  // namespace
}  // namespace trocar
