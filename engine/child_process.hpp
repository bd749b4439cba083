#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>
namespace trocar {

// What a child may use; 0 = no limit.
struct ChildLimits {
    double cpu_seconds = 0;            // rounded up to whole seconds
    double wall_seconds = 0;           // from its start
    uint64_t address_space_bytes = 0;  // more is refused to it: it fails in its own way, see ChildResult
    uint64_t output_bytes = 0;         // on its standard output
    bool (*stop)() = nullptr;          // asked every few milliseconds: true ends the child
};

enum class ChildEnd {
    kExited,    // by itself, with exit_code
    kSignal,    // died of `signal`: a crash
    kCpuLimit,  // the rest: stopped at a limit
    kWallLimit,
    kOutputLimit,
    kStopped,
};

// How a child ended. What it does when memory is refused is its own affair (an exit code, a crash, a message): the
// system does not tell. Helpers of this project exit with kChildOutOfMemory.
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

// Runs a program to its end: arguments[0] is its path (no search, no shell). Its standard input is a file in memory
// that holds `input`; no other descriptor is inherited, and it leads a process group of its own, of which nothing is
// left when this returns. It dies with this process. Throws InputError "program: cannot start: reason".
ChildResult run_child(const std::vector<std::string>& arguments, const ChildLimits& limits, std::string_view input = {});

// The last line of its standard error, control characters made blanks, cut to 300 bytes.
std::string last_error_line(const ChildResult& result);

// The end as words that follow the program's name: "ended with code 3: last line of its errors", "crashed (Segmentation
// fault)", "was stopped after 10 s of processor time", "ran out of its 1.0 GiB of memory". Empty when it exited with 0.
std::string describe_child_end(const ChildResult& result, const ChildLimits& limits);

// A program that came with this one: in the folder $TROCAR_LIBEXEC, beside the running program, in ../libexec/trocar
// from there, or where libexec was configured to be installed. Empty when it is nowhere.
std::filesystem::path find_helper_program(const std::string& name);

// A program in one of the folders of $PATH; empty when it is in none.
std::string find_on_path(const std::string& name);

// The address-space limit for a helper of this build: `bytes`, or none when the build has the address sanitizer, whose
// programs reserve terabytes.
uint64_t helper_address_space(uint64_t bytes);

}  // namespace trocar
