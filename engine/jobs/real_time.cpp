#include "engine/jobs/real_time.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <time.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/jobs/thread_pool.hpp"
namespace trocar {
namespace {

constexpr uint32_t kSubBits = 6;  // 64 bins per octave

// values below 64 have a bin each; above, the leading bit gives the octave and the next six the bin in it
uint32_t bin_of(uint64_t ns) {
    if (ns < 64) return static_cast<uint32_t>(ns);
    const uint32_t octave = 63 - static_cast<uint32_t>(std::countl_zero(ns)) - kSubBits;
    const uint32_t bin = (octave + 1) * 64 + static_cast<uint32_t>((ns >> octave) & 63);
    return std::min(bin, TimeHistogram::kBins - 1);
}
int64_t bin_upper_end(uint32_t bin) {
    if (bin < 64) return bin;
    const uint32_t octave = bin / 64 - 1;
    return (int64_t{64 + bin % 64 + 1} << octave) - 1;
}

}  // namespace

void TimeHistogram::add(int64_t ns) {
    ns = std::max<int64_t>(ns, 0);
    ++bin[bin_of(static_cast<uint64_t>(ns))];
    ++count;
    smallest = std::min(smallest, ns);
    largest = std::max(largest, ns);
    sum += static_cast<double>(ns);
}

int64_t TimeHistogram::percentile(double q) const {
    if (count == 0) return 0;
    const double wanted = std::ceil(std::clamp(q, 0.0, 1.0) * static_cast<double>(count));
    const uint64_t rank = std::max<uint64_t>(1, static_cast<uint64_t>(wanted));
    uint64_t below = 0;
    for (uint32_t b = 0; b < kBins; ++b) {
        below += bin[b];
        if (below >= rank) return std::clamp(bin_upper_end(b), smallest, largest);
    }
    return largest;
}

int64_t monotonic_ns() {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

void sleep_until_ns(int64_t deadline) {
    const timespec until{deadline / 1'000'000'000, deadline % 1'000'000'000};
    // a signal may end the sleep early; the deadline is absolute, so the call is repeated
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
    }
}

RealTimeGrant request_real_time(int priority, bool lock_memory) {
    RealTimeGrant grant;
    sched_param wanted{};
    wanted.sched_priority = std::clamp(priority, sched_get_priority_min(SCHED_FIFO), sched_get_priority_max(SCHED_FIFO));
    grant.fifo = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted) == 0;
    if (grant.fifo)
        grant.priority = wanted.sched_priority;
    else
        set_nice(-20);
    // on fault: loading every page of the process at once would stop all its threads for a third of a second
    if (lock_memory) grant.locked = mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0;
    return grant;
}

void request_low_priority() {
    sched_param none{};
    pthread_setschedparam(pthread_self(), SCHED_BATCH, &none);
    set_nice(19);
}

int set_nice(int nice) {
    // on Linux a nice value belongs to the calling thread
    const int before = getpriority(PRIO_PROCESS, 0);
    setpriority(PRIO_PROCESS, 0, nice);
    return before;
}

std::vector<int> allowed_processors() {
    cpu_set_t set;
    CPU_ZERO(&set);
    std::vector<int> allowed;
    if (sched_getaffinity(0, sizeof set, &set) != 0) return allowed;  // more processors than a set of this size holds
    for (int k = 0; k < CPU_SETSIZE; ++k)
        if (CPU_ISSET(k, &set)) allowed.push_back(k);
    return allowed;
}

void allow_processors(std::span<const int> processors) {
    cpu_set_t set;
    CPU_ZERO(&set);
    for (const int processor : processors) CPU_SET(processor, &set);
    pthread_setaffinity_np(pthread_self(), sizeof set, &set);
}

std::string kernel_name() {
    utsname name{};
    if (uname(&name) != 0) return "unknown kernel";
    return std::string(name.sysname) + " " + name.release;
}

std::string describe(const RealTimeGrant& grant) {
    std::string policy = grant.fifo ? "SCHED_FIFO " + std::to_string(grant.priority) : "SCHED_OTHER";
    if (grant.processors > 1) policy += " on " + std::to_string(grant.processors) + " processors";
    return policy + (grant.locked ? ", memory locked, " : ", memory not locked, ") + kernel_name();
}

void PeriodicThread::start(const PeriodicOptions& options, int64_t start, std::function<void(uint64_t, int64_t)> work) {
    TROCAR_ASSERT(!running() && options.period > 0 && options.processors > 0);
    options_ = options;
    start_ = start;
    work_ = std::move(work);
    stop_.store(false, std::memory_order_relaxed);
    next_ = 0;
    last_begin_ = 0;
    figures_ = {};
    const std::vector<int> allowed = allowed_processors();
    const int threads = std::clamp(static_cast<int>(allowed.size()), 1, options.processors);
    options_.processors = figures_.grant.processors = threads;
    for (int k = 0; k < threads; ++k) {
        // spread over the range: neighbours may be two halves of one core
        const size_t slot = threads > 1 ? static_cast<size_t>(k) * (allowed.size() - 1) / static_cast<size_t>(threads - 1) : 0;
        thread_.emplace_back([this, k, bound = threads > 1, processor = allowed.empty() ? 0 : allowed[slot]] {
            set_float_mode();
            if (bound) allow_processors({&processor, 1});
            loop(k);
        });
    }
}

void PeriodicThread::stop() {
    stop_.store(true, std::memory_order_relaxed);
    if (!running()) return;
    for (std::thread& thread : thread_) thread.join();
    thread_.clear();
    // locked memory belongs to the process: release it with the threads that needed it
    if (figures_.grant.locked) munlockall();
}

void PeriodicThread::run(int thread, uint64_t index) {
    const int64_t begin = monotonic_ns();
    figures_.missed += index - next_;
    work_(index, begin);
    const int64_t end = monotonic_ns();
    if (last_begin_ > 0) {
        figures_.period.add(begin - last_begin_);
        figures_.doubled += begin - last_begin_ > 2 * options_.period;
    }
    figures_.relieved += thread > 0;
    figures_.late.add(begin - (start_ + static_cast<int64_t>(index) * options_.period));
    figures_.compute.add(end - begin);
    last_begin_ = begin;
    // the next deadline that has not passed: two runs in succession to catch up would only add jitter
    const int64_t elapsed = end - start_;
    const int64_t reached = elapsed > 0 ? (elapsed + options_.period - 1) / options_.period : 0;
    next_ = std::max(index + 1, static_cast<uint64_t>(reached));
    figures_.missed += next_ - (index + 1);
}

void PeriodicThread::loop(int thread) {
    if (options_.real_time) {
        RealTimeGrant grant = request_real_time(options_.priority, true);
        grant.processors = options_.processors;
        if (thread == 0) figures_.grant = grant;
    }
    // later than the wake-up time of a running first thread; otherwise both would share the runs and evict
    // each other's caches
    const int64_t first = start_ + thread * options_.period / 4;
    for (uint64_t index = 0; !stop_.load(std::memory_order_relaxed);) {
        sleep_until_ns(first + static_cast<int64_t>(index) * options_.period);
        // a thread that finds another at a run does not wait but sleeps until the next
        if (busy_.exchange(true, std::memory_order_acquire)) {
            ++index;
            continue;
        }
        if (index >= next_) run(thread, index);
        index = next_;
        busy_.store(false, std::memory_order_release);
    }
}

}  // namespace trocar
