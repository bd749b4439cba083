#pragma once
#include <cstdint>
#include <memory>
#include <string>
namespace trocar {

// Sets the number of threads that Mesa starts for drawing, unless the user's environment sets it
// (LP_NUM_THREADS). With 0 the calling thread draws alone: a picture then takes only its caller's core, at
// its caller's priority, as required next to a haptic thread. Call it before the first OffscreenContext and
// before any other thread starts.
void set_offscreen_threads(uint32_t threads);

// An OpenGL 3.3 core context in memory, without window or display. Current only between make_current and
// release; any thread may do so, one at a time. Throws InputError if the library gives no context.
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

// Name and version of the OpenGL library, e.g. "llvmpipe (LLVM 15.0.6, 256 bits), 4.5 (Core Profile) Mesa
// 22.3.6".
std::string offscreen_library(OffscreenContext& context);

}  // namespace trocar
