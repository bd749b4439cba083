#include "engine/real_time.hpp"

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

#include "engine/check.hpp"
#include "engine/thread_pool.hpp"
namespace trocar {
namespace {

constexpr uint32_t kSubBits = 6;  // 64 bins an octave

// values below 64 have a bin each; above, the leading bit names the octave and the next six the bin in it
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
    // a signal may end the sleep early; the deadline is absolute, so asking again costs nothing
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
    }
}

RealTimeGrant request_real_time(int priority, bool lock_memory) {
    RealTimeGrant grant;
    sched_param wanted{};
    wanted.sched_priority =
        std::clamp(priority, sched_get_priority_min(SCHED_FIFO), sched_get_priority_max(SCHED_FIFO));
    grant.fifo = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted) == 0;
    if (grant.fifo)
        grant.priority = wanted.sched_priority;
    else
        set_nice(-20);
    // on fault: bringing in every page of the process at once would hold up all its threads for a third of a second
    if (lock_memory) grant.locked = mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0;
    return grant;
}

void request_low_priority() {
    sched_param none{};
    pthread_setschedparam(pthread_self(), SCHED_BATCH, &none);
    set_nice(19);
}

int set_nice(int nice) {
    // on Linux a nice value belongs to the thread that asks
    const int before = getpriority(PRIO_PROCESS, 0);
    setpriority(PRIO_PROCESS, 0, nice);
    return before;
}

std::string kernel_name() {
    utsname name{};
    if (uname(&name) != 0) return "unknown kernel";
    return std::string(name.sysname) + " " + name.release;
}

std::string describe(const RealTimeGrant& grant) {
    const std::string policy = grant.fifo ? "SCHED_FIFO " + std::to_string(grant.priority) : "SCHED_OTHER";
    return policy + (grant.locked ? ", memory locked, " : ", memory not locked, ") + kernel_name();
}

void PeriodicThread::start(const PeriodicOptions& options, int64_t start, std::function<void(uint64_t, int64_t)> work) {
    TROCAR_ASSERT(!running() && options.period > 0);
    stop_.store(false, std::memory_order_relaxed);
    figures_ = {};
    thread_ = std::thread([this, options, start, work = std::move(work)] {
        set_float_mode();
        loop(options, start, work);
    });
}

void PeriodicThread::stop() {
    stop_.store(true, std::memory_order_relaxed);
    if (thread_.joinable()) thread_.join();
}

void PeriodicThread::loop(const PeriodicOptions& options, int64_t start,
                          const std::function<void(uint64_t, int64_t)>& work) {
    if (options.real_time) figures_.grant = request_real_time(options.priority, true);
    int64_t last_begin = 0;
    for (uint64_t index = 0; !stop_.load(std::memory_order_relaxed);) {
        const int64_t deadline = start + static_cast<int64_t>(index) * options.period;
        sleep_until_ns(deadline);
        const int64_t begin = monotonic_ns();
        work(index, begin);
        const int64_t end = monotonic_ns();
        if (last_begin > 0) {
            figures_.period.add(begin - last_begin);
            figures_.doubled += begin - last_begin > 2 * options.period;
        }
        figures_.late.add(begin - deadline);
        figures_.compute.add(end - begin);
        last_begin = begin;
        // the next deadline that has not passed: catching up by running twice in a row would only add jitter
        const int64_t elapsed = end - start;
        const int64_t reached = elapsed > 0 ? (elapsed + options.period - 1) / options.period : 0;
        const uint64_t next = std::max(index + 1, static_cast<uint64_t>(reached));
        figures_.missed += next - (index + 1);
        index = next;
    }
    // locked memory is the process's: it does not outlast the thread that needed it
    if (figures_.grant.locked) munlockall();
}

}  // namespace trocar
