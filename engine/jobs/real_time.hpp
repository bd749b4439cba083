#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <thread>
#include <vector>
namespace trocar {

// Durations counted in bins of 1/64 of their power of two: percentiles are exact to 1.6 %, counting costs a few
// nanoseconds and never allocates.
struct TimeHistogram {
    static constexpr uint32_t kBins = 64 * 42;  // up to 2^47 ns
    std::array<uint64_t, kBins> bin{};
    uint64_t count = 0;
    int64_t smallest = INT64_MAX;  // ns
    int64_t largest = 0;           // ns
    double sum = 0;                // ns

    void add(int64_t ns);  // below zero counts as zero
    // Value (ns) that a fraction q in [0, 1] of the durations does not exceed (nearest rank, upper end of its
    // bin, never above the largest); 0 if empty.
    int64_t percentile(double q) const;
    double mean() const { return count ? sum / static_cast<double>(count) : 0; }
};

// ns on the monotonic clock.
int64_t monotonic_ns();
// Sleeps until a time on that clock; returns at once if it has passed.
void sleep_until_ns(int64_t deadline);

// Real-time properties that the operating system granted the calling thread.
struct RealTimeGrant {
    bool fifo = false;    // SCHED_FIFO
    bool locked = false;  // all memory of the process stays resident once touched
    int priority = 0;     // of SCHED_FIFO
    int processors = 1;   // number with a thread of their own for the same deadlines
};

// Requests SCHED_FIFO at `priority` for the calling thread, else nice -20, and, with `lock_memory`, mlockall.
// Continues without what is refused.
RealTimeGrant request_real_time(int priority, bool lock_memory);
// Sets the nice value of the calling thread as far as permitted; returns the previous one.
int set_nice(int nice);
// Processors that the calling thread may run on, ascending; empty if the kernel does not report them.
std::vector<int> allowed_processors();
// Binds the calling thread to these processors; continues without if refused.
void allow_processors(std::span<const int> processors);
// Gives the calling thread a priority below all others (nice 19, SCHED_BATCH); for drawing in live mode.
void request_low_priority();
// "SCHED_FIFO 80 on 2 processors, memory locked, Linux 6.1.0-18-amd64".
std::string describe(const RealTimeGrant& grant);
std::string kernel_name();

struct PeriodicOptions {
    int64_t period = 1'000'000;  // ns
    bool real_time = true;       // request SCHED_FIFO and locked memory
    int priority = 80;
    // Number of threads, each bound to its own processor, the first to the first one allowed. A run that its
    // thread has not begun a quarter of a period after the deadline is taken by the next thread, so that a
    // processor stopped by a virtual machine's host or by firmware costs no run. At most as many as allowed.
    int processors = 1;
};

// Measurements of a periodic thread. Read them after stop.
struct PeriodicFigures {
    TimeHistogram period;   // between the starts of successive runs
    TimeHistogram late;     // start minus deadline
    TimeHistogram compute;  // of the work
    uint64_t missed = 0;    // deadlines that passed while the threads were stopped; their runs are omitted
    uint64_t doubled = 0;   // periods longer than two nominal ones: one each time the threads were stopped, however long
    uint64_t relieved = 0;  // runs that the first thread had not begun in time and another took
    RealTimeGrant grant;
};

// A thread that runs `work(deadline_index, start_ns)` at start + index * period. Deadlines are absolute, so
// lateness does not accumulate; a skipped index is a missed deadline. With several processors runs change
// threads, but each begins only after the preceding one has ended and sees all it wrote.
class PeriodicThread {
 public:
    PeriodicThread() = default;
    ~PeriodicThread() { stop(); }
    PeriodicThread(const PeriodicThread&) = delete;
    PeriodicThread& operator=(const PeriodicThread&) = delete;

    // First run at `start` (ns, monotonic clock). Must not be called while it runs.
    void start(const PeriodicOptions& options, int64_t start, std::function<void(uint64_t, int64_t)> work);
    // Ends after the run in progress and joins.
    void stop();
    bool running() const { return !thread_.empty(); }
    const PeriodicFigures& figures() const { return figures_; }

 private:
    void loop(int thread);
    void run(int thread, uint64_t index);
    PeriodicOptions options_;
    int64_t start_ = 0;
    std::function<void(uint64_t, int64_t)> work_;
    std::vector<std::thread> thread_;
    std::atomic<bool> stop_{false};
    std::atomic<bool> busy_{false};  // a thread is at the run and owns the members below meanwhile
    uint64_t next_ = 0;              // first deadline that has no run yet
    int64_t last_begin_ = 0;
    PeriodicFigures figures_;
};

}  // namespace trocar
