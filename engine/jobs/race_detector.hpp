#pragma once
namespace trocar {

// Announce to the thread sanitizer hand-overs between threads inside uninstrumented libraries (the
// scheduler): what was written before hand_over(token) is seen after take_over(token). No-ops in other
// builds.
#if defined(__SANITIZE_THREAD__)
extern "C" void __tsan_release(void* address);
extern "C" void __tsan_acquire(void* address);
inline void hand_over(const void* token) { __tsan_release(const_cast<void*>(token)); }
inline void take_over(const void* token) { __tsan_acquire(const_cast<void*>(token)); }
#define TROCAR_NO_RACE_DETECTION __attribute__((no_sanitize("thread")))
#else
inline void hand_over(const void*) {}
inline void take_over(const void*) {}
#define TROCAR_NO_RACE_DETECTION
#endif

}  // namespace trocar
