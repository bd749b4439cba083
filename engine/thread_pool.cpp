#include "engine/thread_pool.hpp"

#include <malloc.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <tbb/task_scheduler_observer.h>
#include <xmmintrin.h>

#include <algorithm>
#include <limits>
#include <thread>

#include "engine/check.hpp"
#include "engine/parallel.hpp"
namespace trocar {

void set_float_mode() {
    constexpr unsigned kFlush = 0x8040, kMasks = 0x1f80, kRounding = 0x6000;  // FTZ | DAZ; no traps; rounding control, 0 = to nearest
    _mm_setcsr((_mm_getcsr() | kFlush | kMasks) & ~kRounding);
}

FloatModeScope::FloatModeScope() : before_(_mm_getcsr()) { set_float_mode(); }
FloatModeScope::~FloatModeScope() { _mm_setcsr(before_); }

void keep_freed_memory() {
    constexpr int kPiece = 16 << 20, kNeverGiveBack = std::numeric_limits<int>::max();
    mallopt(M_MMAP_THRESHOLD, kNeverGiveBack);
    mallopt(M_TRIM_THRESHOLD, kNeverGiveBack);
    mallopt(M_TOP_PAD, kPiece);
}

namespace {
// the scheduler's workers take the float mode of whoever used it first; make sure of ours
struct FloatModeObserver : tbb::task_scheduler_observer {
    explicit FloatModeObserver(tbb::task_arena& arena) : tbb::task_scheduler_observer(arena) { observe(true); }
    ~FloatModeObserver() override { observe(false); }
    void on_scheduler_entry(bool) override { set_float_mode(); }
};

// Where memory ran out in the first call of observe, it would crash in the observer's destructor (oneTBB 2021.8).
tbb::task_arena& initialised(tbb::task_arena& arena) {
    arena.initialize();
    return arena;
}
}  // namespace

struct ThreadPool::Impl {
    explicit Impl(uint32_t threads)
        : limit(tbb::global_control::max_allowed_parallelism, std::max(threads, 1u)),
          arena(static_cast<int>(threads), 1),
          observer(initialised(arena)) {}
    tbb::global_control limit;
    tbb::task_arena arena;
    FloatModeObserver observer;
};

ThreadPool::ThreadPool(uint32_t threads) : impl_(new Impl(threads == 0 ? std::max(1u, std::thread::hardware_concurrency()) : threads)) {}
ThreadPool::~ThreadPool() = default;
void ThreadPool::run(const std::function<void()>& work) {
    const FloatModeScope ours;  // entering the pool sets it on this thread for good
    impl_->arena.execute(work);
}
uint32_t ThreadPool::threads() const { return static_cast<uint32_t>(impl_->arena.max_concurrency()); }

uint32_t thread_count() {
    const int index = tbb::this_task_arena::current_thread_index();
    return index == tbb::task_arena::not_initialized ? 1u : static_cast<uint32_t>(tbb::this_task_arena::max_concurrency());
}

uint32_t thread_index() {
    const int index = tbb::this_task_arena::current_thread_index();
    return index < 0 ? 0u : static_cast<uint32_t>(index);
}

}  // namespace trocar
