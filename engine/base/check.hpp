#pragma once
#include <cstdio>
#include <cstdlib>
namespace trocar {

[[noreturn]] inline void fail_check(const char* text, const char* file, int line) {
    std::fprintf(stderr, "%s:%d: check failed: %s\n", file, line, text);
    std::abort();
}

}  // namespace trocar

// Checks for misuse by the programmer; on in every preset.
#define TROCAR_ASSERT(condition)                                                \
    do {                                                                        \
        if (!(condition)) ::trocar::fail_check(#condition, __FILE__, __LINE__); \
    } while (false)
