#pragma once
#include <cstdint>
#include <memory>
#include <string>
namespace trocar {

// Decides how many threads Mesa starts for drawing, unless the user's environment already says so (LP_NUM_THREADS).
// 0 draws on the calling thread alone, so a picture costs no core but its caller's and has its caller's priority: the
// policy wherever a haptic thread runs. Call it before the first OffscreenContext and before any other thread starts.
void set_offscreen_threads(uint32_t threads);

// An OpenGL 3.3 core context in memory, without window or display. Current only between make_current and release; any
// thread may do so, one at a time. Throws InputError when the library gives no context.
class OffscreenContext {
 public:
    OffscreenContext();
    ~OffscreenContext();
    OffscreenContext(const OffscreenContext&) = delete;
    OffscreenContext& operator=(const OffscreenContext&) = delete;
    void make_current();
    void release();

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

// Name and version of the library that draws, e.g. "llvmpipe (LLVM 15.0.6, 256 bits), 4.5 (Core Profile) Mesa 22.3.6".
std::string offscreen_library(OffscreenContext& context);

}  // namespace trocar
