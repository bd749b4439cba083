#pragma once
#include <cstdint>
#include <functional>
#include <memory>
namespace trocar {

// Rounding to nearest, flush-to-zero and denormals-are-zero, no trapping exceptions, for the calling thread.
// First statement of every main and of every thread we start: Embree sets it inside a commit and the
// scheduler remembers the mode of its first user.
void set_float_mode();

// That mode for the calling thread during its lifetime; then the previous one.
class FloatModeScope {
 public:
    FloatModeScope();
    ~FloatModeScope();
    FloatModeScope(const FloatModeScope&) = delete;
    FloatModeScope& operator=(const FloatModeScope&) = delete;

 private:
    uint32_t before_;
};

// Makes the allocator keep freed memory, and request it in large pieces. Otherwise arrays that grow would
// consist of new pages each time, and those cost more than the work on them (a third of the pass in which a
// thousand bodies hit the ground).
void keep_freed_memory();

// The process's worker threads. Made once, before the first parallel loop. If the system refuses threads
// (address space, process limits), it uses those it gets, at least the caller's.
class ThreadPool {
 public:
    explicit ThreadPool(uint32_t threads);  // 0 = all cores
    ~ThreadPool();
    // Runs work inside the pool, in that float mode; parallel_for and run_parallel in it use its threads.
    void run(const std::function<void()>& work);
    uint32_t threads() const;
    // Threads requested but refused.
    uint32_t refused() const;

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

// Threads of the caller's pool; 1 outside any pool.
uint32_t thread_count();

}  // namespace trocar
