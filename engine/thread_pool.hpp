#pragma once
#include <cstdint>
#include <functional>
#include <memory>
namespace trocar {

// Rounding to nearest, flush-to-zero and denormals-are-zero, no exception that traps, for the calling thread. First
// statement of every main and of every thread we start: Embree sets it inside a commit and the scheduler remembers the mode
// of its first user.
void set_float_mode();

// That mode for the calling thread while it lives; then the one before.
class FloatModeScope {
 public:
    FloatModeScope();
    ~FloatModeScope();
    FloatModeScope(const FloatModeScope&) = delete;
    FloatModeScope& operator=(const FloatModeScope&) = delete;

 private:
    uint32_t before_;
};

// Lets the process keep memory that was given back, and take it in large pieces: arrays that grow would else be made of new
// pages each time, and those cost more than what is done with them (a third of the pass in which a thousand bodies hit the
// ground).
void keep_freed_memory();

// The process's worker threads. Made once, before the first parallel loop. Where the system refuses threads (address space,
// process limits) it has those that it gets, the caller's alone at least.
class ThreadPool {
 public:
    explicit ThreadPool(uint32_t threads);  // 0 = all cores
    ~ThreadPool();
    // Runs work inside the pool, in that float mode; parallel_for and run_parallel called by it use its threads.
    void run(const std::function<void()>& work);
    uint32_t threads() const;
    // That were asked for and refused.
    uint32_t refused() const;

 private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

// Threads of the pool the caller runs in; 1 outside any pool.
uint32_t thread_count();

}  // namespace trocar
