#include "engine/files/child_process.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <fstream>
#include <thread>

#include "engine/base/error.hpp"
#include "engine/files/whole_file.hpp"
namespace trocar {
namespace {

namespace fs = std::filesystem;

ChildResult shell(const std::string& script, const ChildLimits& limits = {}) { return run_child({"/bin/sh", "-c", script}, limits); }

size_t open_descriptors() { return static_cast<size_t>(std::distance(fs::directory_iterator("/proc/self/fd"), fs::directory_iterator{})); }

// After every test no child is left and no descriptor is open.
struct ChildProcess : testing::Test {
    size_t before = open_descriptors();
    void TearDown() override {
        EXPECT_EQ(open_descriptors(), before);
        EXPECT_EQ(::waitpid(-1, nullptr, WNOHANG), -1);
        EXPECT_EQ(errno, ECHILD);
    }
};

TEST_F(ChildProcess, hands_over_arguments_output_errors_and_code) {
    const ChildResult result = run_child({"/bin/sh", "-c", "printf '%s|' \"$@\"; echo no >&2; exit 3", "sh", "a b", "", "$HOME;*"}, {});
    EXPECT_EQ(result.output, "a b||$HOME;*|");
    EXPECT_EQ(result.last_errors, "no\n");
    EXPECT_EQ(result.end, ChildEnd::kExited);
    EXPECT_EQ(result.exit_code, 3);
    EXPECT_EQ(describe_child_end(result, {}), "ended with code 3: no");
    EXPECT_EQ(describe_child_end(shell("exit 0"), {}), "");
}

TEST_F(ChildProcess, long_streams_on_both_sides_arrive_whole) {
    const ChildResult result = shell("head -c 5000000 /dev/zero & head -c 3000000 /dev/zero >&2; echo last >&2; wait");
    EXPECT_EQ(result.output, std::string(5000000, '\0'));
    EXPECT_LE(result.last_errors.size(), 8192u);
    EXPECT_TRUE(result.last_errors.ends_with("last\n"));
}

TEST_F(ChildProcess, gets_its_input_whole_also_while_it_answers) {
    std::string input;
    for (uint32_t k = 0; k < 1000000; ++k) input.append(reinterpret_cast<const char*>(&k), sizeof k);
    EXPECT_TRUE(run_child({"/bin/cat"}, {}, input).output == input);
    EXPECT_TRUE(run_child({"/bin/cat", "/dev/stdin"}, {}, input).output == input);
}

TEST_F(ChildProcess, sees_no_input_and_no_descriptor_of_ours) {
    int leak[2];
    ASSERT_EQ(::pipe(leak), 0);  // not close-on-exec
    const ChildResult result = shell("cat; n=3; while [ $n -lt 64 ]; do [ -e /proc/$$/fd/$n ] && echo $n; n=$((n + 1)); done; true");
    ::close(leak[0]);
    ::close(leak[1]);
    EXPECT_LT(leak[1], 64);
    EXPECT_EQ(result.output, "");
}

TEST_F(ChildProcess, is_stopped_with_all_of_its_group_when_asked) {
    const auto begin = std::chrono::steady_clock::now();
    const ChildResult result = run_child({"/bin/sh", "-c", "echo here; sleep 60 & wait"}, {.stop = [] { return true; }});
    EXPECT_EQ(result.end, ChildEnd::kStopped);
    EXPECT_EQ(describe_child_end(result, {}), "was stopped");
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
}

TEST_F(ChildProcess, a_child_that_hangs_is_stopped_by_the_clock) {
    const ChildLimits limits{.wall_seconds = 0.1};
    const ChildResult result = shell("sleep 1000", limits);
    EXPECT_EQ(result.end, ChildEnd::kWallLimit);
    EXPECT_EQ(describe_child_end(result, limits), "was stopped after 0.1 s");
    EXPECT_EQ(shell("exec >&- 2>&-; sleep 1000", limits).end, ChildEnd::kWallLimit);
}

TEST_F(ChildProcess, a_child_that_spins_is_stopped_by_its_processor_time) {
    const ChildLimits limits{.cpu_seconds = 0.5, .wall_seconds = 120};
    const ChildResult result = shell("while :; do :; done", limits);
    EXPECT_EQ(result.end, ChildEnd::kCpuLimit);
    EXPECT_GE(result.cpu_seconds, 0.9);
    EXPECT_EQ(describe_child_end(result, limits), "was stopped after 1 s of processor time");
}

TEST_F(ChildProcess, a_child_that_crashes_is_told_by_its_signal) {
    const ChildResult result = shell("echo before; echo deep >&2; kill -SEGV $$");
    EXPECT_EQ(result.end, ChildEnd::kSignal);
    EXPECT_EQ(result.signal, SIGSEGV);
    EXPECT_EQ(result.output, "before\n");
    EXPECT_EQ(describe_child_end(result, {}), "crashed (Segmentation fault): deep");
    // killed from outside before its time is up: not a limit
    EXPECT_EQ(shell("kill -KILL $$", {.cpu_seconds = 50}).end, ChildEnd::kSignal);
}

TEST_F(ChildProcess, a_child_that_writes_too_much_is_stopped) {
    const ChildLimits limits{.wall_seconds = 60, .output_bytes = 100000};
    const ChildResult result = shell("cat /dev/zero", limits);
    EXPECT_EQ(result.end, ChildEnd::kOutputLimit);
    EXPECT_EQ(result.output.size(), 100000u);
    EXPECT_EQ(describe_child_end(result, limits), "was stopped after an answer of 0.1 MiB");
    EXPECT_EQ(shell("head -c 100000 /dev/zero", limits).end, ChildEnd::kExited);
}

TEST_F(ChildProcess, a_child_that_wants_too_much_memory_is_refused_it) {
    const std::vector<std::string> program{"/bin/dd", "if=/dev/zero", "of=/dev/null", "bs=300M", "count=1"};
    EXPECT_EQ(run_child(program, {}).exit_code, 0);
    const ChildResult result = run_child(program, {.address_space_bytes = 200 << 20});
    EXPECT_NE(result.exit_code, 0);
    EXPECT_NE(result.last_errors.find("memory exhausted"), std::string::npos);
    EXPECT_LT(result.peak_resident_bytes, 200u << 20);
    ChildResult own;
    own.exit_code = kChildOutOfMemory;
    EXPECT_EQ(describe_child_end(own, {.address_space_bytes = 1u << 30}), "ran out of its 1.0 GiB of memory");
}

// A grandchild keeps the pipes open; the call must neither wait for it nor leave it running.
TEST_F(ChildProcess, nothing_of_the_group_outlives_the_call) {
    const ChildResult result = shell("sleep 1000 & echo $!", {.wall_seconds = 60});
    EXPECT_EQ(result.end, ChildEnd::kExited);
    const fs::path stat = fs::path("/proc") / result.output.substr(0, result.output.size() - 1) / "stat";
    bool gone = false;
    for (int i = 0; i < 1000 && !gone; ++i) {
        std::ifstream stream(stat);
        std::string pid, name, state;
        gone = !(stream >> pid >> name >> state) || state == "Z" || state == "X";
        if (!gone) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    EXPECT_TRUE(gone);
}

TEST_F(ChildProcess, a_program_that_cannot_start_is_an_error) {
    const auto error_of = [](const std::string& program) -> std::string {
        try {
            run_child({program}, {});
        } catch (const InputError& error) {
            return error.what();
        }
        return "no error";
    };
    EXPECT_EQ(error_of("/nowhere/at-all"), "/nowhere/at-all: cannot start: No such file or directory");
    EXPECT_EQ(error_of("/tmp"), "/tmp: cannot start: Permission denied");
    EXPECT_THROW(run_child({}, {}), InputError);
}

TEST_F(ChildProcess, helpers_are_found_in_the_named_folder_and_beside_us) {
    const fs::path folder = fs::temp_directory_path() / ("trocar_helper_" + std::to_string(::getpid()));
    fs::create_directories(folder);
    const char* set = std::getenv("TROCAR_LIBEXEC");
    const std::string old = set ? set : "";
    ::setenv("TROCAR_LIBEXEC", folder.c_str(), 1);
    write_whole_file(folder / "a-helper", "#!/bin/sh\n");
    EXPECT_EQ(find_helper_program("a-helper"), "");  // not executable
    ::chmod((folder / "a-helper").c_str(), 0755);
    EXPECT_EQ(find_helper_program("a-helper"), folder / "a-helper");
    const fs::path self = fs::read_symlink("/proc/self/exe");
    EXPECT_EQ(find_helper_program(self.filename()), self);
    EXPECT_EQ(find_helper_program("no-such-helper"), "");
    old.empty() ? ::unsetenv("TROCAR_LIBEXEC") : ::setenv("TROCAR_LIBEXEC", old.c_str(), 1);
    fs::remove_all(folder);
}

}  // namespace
}  // namespace trocar
