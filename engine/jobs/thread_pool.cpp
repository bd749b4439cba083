#include "engine/jobs/thread_pool.hpp"

#include <malloc.h>
#include <pthread.h>
#include <sys/mman.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <tbb/task_scheduler_observer.h>
#include <xmmintrin.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <limits>
#include <thread>
#include <vector>

#include "engine/base/check.hpp"
#include "engine/jobs/parallel.hpp"
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
// the scheduler's workers inherit the float mode of their first user, so it is set explicitly
struct FloatModeObserver : tbb::task_scheduler_observer {
    explicit FloatModeObserver(tbb::task_arena& arena) : tbb::task_scheduler_observer(arena) { observe(true); }
    ~FloatModeObserver() override { observe(false); }
    void on_scheduler_entry(bool) override { set_float_mode(); }
};

// If memory ran out in the first call of observe, the observer's destructor would crash (oneTBB 2021.8).
tbb::task_arena& initialised(tbb::task_arena& arena) {
    arena.initialize();
    return arena;
}

size_t stack_size() { return tbb::global_control::active_value(tbb::global_control::thread_stack_size); }

// Threads whose stacks the C library keeps after their end for reuse: 40 MiB, guard pages included.
uint32_t kept_threads() { return static_cast<uint32_t>((40u << 20) / (stack_size() + (64u << 10))); }

// How many of `wanted` threads, with the scheduler's stack size, can exist at the same time.
uint32_t threads_at_once(uint32_t wanted) {
    pthread_attr_t attributes;
    if (pthread_attr_init(&attributes) != 0) return 0;
    pthread_attr_setstacksize(&attributes, stack_size());
    std::atomic<bool> leave = false;
    const auto wait = [](void* flag) -> void* {
        static_cast<const std::atomic<bool>*>(flag)->wait(false);
        return nullptr;
    };
    std::vector<pthread_t> started;
    started.reserve(wanted);
    for (pthread_t one; started.size() < wanted && pthread_create(&one, &attributes, wait, &leave) == 0;) started.push_back(one);
    leave = true;
    leave.notify_all();
    for (const pthread_t one : started) pthread_join(one, nullptr);
    pthread_attr_destroy(&attributes);
    return static_cast<uint32_t>(started.size());
}

// The same, counting only resources certain to be still available when the scheduler starts its threads, at
// its first loops. The program ends if one is refused (oneTBB 2021.8 throws inside noexcept). Kept stacks are
// certain; further threads count only if address space also allows the heaps that threads create (128 MiB
// each, up to eight per core).
uint32_t threads_to_be_had(uint32_t wanted) {
    const uint32_t kept = kept_threads();
    if (wanted > kept) {
        const size_t heaps = std::min(wanted, 8 * std::max(1u, std::thread::hardware_concurrency()));
        const size_t bytes = heaps * (size_t{128} << 20);
        void* const room = mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        const bool all = room != MAP_FAILED && threads_at_once(wanted) == wanted;
        if (room != MAP_FAILED) munmap(room, bytes);
        if (all) return wanted;
    }
    return threads_at_once(std::min(wanted, kept));
}

// Threads beyond the number of kept stacks are started at once, while the space found for them exists.
void start_workers(tbb::task_arena& arena, uint32_t threads) {
    if (threads <= 1 + kept_threads()) return;
    std::atomic<uint32_t> here = 0;
    const auto late = std::chrono::steady_clock::now() + std::chrono::seconds(1);
    arena.execute([&] {
        tbb::parallel_for(
            0u, threads,
            [&](uint32_t) {
                ++here;
                while (here < threads && std::chrono::steady_clock::now() < late)
                    std::this_thread::sleep_for(std::chrono::microseconds(100));
            },
            tbb::simple_partitioner());
    });
}

uint32_t wanted_threads(uint32_t threads) { return threads == 0 ? std::max(1u, std::thread::hardware_concurrency()) : threads; }
}  // namespace

struct ThreadPool::Impl {
    explicit Impl(uint32_t wanted) : Impl(wanted, 1 + threads_to_be_had(wanted - 1)) {}
    Impl(uint32_t wanted, uint32_t threads)
        : refused(wanted - threads),
          limit(tbb::global_control::max_allowed_parallelism, threads),
          arena(static_cast<int>(threads), 1),
          observer(initialised(arena)) {
        start_workers(arena, threads);
    }
    uint32_t refused;
    tbb::global_control limit;
    tbb::task_arena arena;
    FloatModeObserver observer;
};

ThreadPool::ThreadPool(uint32_t threads) : impl_(new Impl(wanted_threads(threads))) {}
ThreadPool::~ThreadPool() = default;
void ThreadPool::run(const std::function<void()>& work) {
    const FloatModeScope ours;  // entering the pool sets the float mode of this thread permanently
    impl_->arena.execute(work);
}
uint32_t ThreadPool::threads() const { return static_cast<uint32_t>(impl_->arena.max_concurrency()); }
uint32_t ThreadPool::refused() const { return impl_->refused; }

uint32_t thread_count() {
    const int index = tbb::this_task_arena::current_thread_index();
    return index == tbb::task_arena::not_initialized ? 1u : static_cast<uint32_t>(tbb::this_task_arena::max_concurrency());
}

uint32_t thread_index() {
    const int index = tbb::this_task_arena::current_thread_index();
    return index < 0 ? 0u : static_cast<uint32_t>(index);
}

}  // namespace trocar
