#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>
namespace trocar {

// Limits of a child process; 0 = none.
struct ChildLimits {
    double cpu_seconds = 0;            // rounded up to whole seconds
    double wall_seconds = 0;           // from its start
    uint64_t address_space_bytes = 0;  // allocations beyond it fail; the child reacts in its own manner, see ChildResult
    uint64_t output_bytes = 0;         // on its standard output
    bool (*stop)() = nullptr;          // called every few milliseconds: true ends the child
};

enum class ChildEnd {
    kExited,    // by itself, with exit_code
    kSignal,    // died of `signal`: a crash
    kCpuLimit,  // the rest: stopped at a limit
    kWallLimit,
    kOutputLimit,
    kStopped,
};

// How a child ended. The system does not report refused memory, and programs react to it differently (an exit
// code, a crash, a message). Helpers of this project exit with kChildOutOfMemory.
struct ChildResult {
    ChildEnd end = ChildEnd::kExited;
    int exit_code = 0;
    int signal = 0;
    std::string output;       // its standard output, at most output_bytes
    std::string last_errors;  // the last lines of its standard error, at most 4 KiB
    double cpu_seconds = 0;
    uint64_t peak_resident_bytes = 0;
};

constexpr int kChildOutOfMemory = 75;

// Runs a program to its end: arguments[0] is its path (no search, no shell). Its standard input is a file in
// memory with the content `input`; it inherits no other descriptor and leads its own process group, which is
// gone when this returns. It dies with this process. Throws InputError "program: cannot start: reason".
ChildResult run_child(const std::vector<std::string>& arguments, const ChildLimits& limits, std::string_view input = {});

// The last line of its standard error, with control characters replaced by blanks, cut to 300 bytes.
std::string last_error_line(const ChildResult& result);

// The end in words that follow the program's name: "ended with code 3: last line of its errors", "crashed
// (Segmentation fault)", "was stopped after 10 s of processor time", "ran out of its 1.0 GiB of memory".
// Empty if it exited with 0.
std::string describe_child_end(const ChildResult& result, const ChildLimits& limits);

// A program installed with this one: in the folder $TROCAR_LIBEXEC, next to the running program, in
// ../libexec/trocar from there, or in the configured libexec. Empty if not found.
std::filesystem::path find_helper_program(const std::string& name);

// A program in one of the folders of $PATH; empty when it is in none.
std::string find_on_path(const std::string& name);

// The address-space limit for a helper of this build: `bytes`, or none if the build has the address
// sanitizer, whose programs reserve terabytes.
uint64_t helper_address_space(uint64_t bytes);

}  // namespace trocar
