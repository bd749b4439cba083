#pragma once
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <string_view>
#include <vector>
namespace trocar {

// Monotonic clock, nanoseconds.
uint64_t now_ns();

// One finished span of work.
struct TraceEvent {
    std::string_view name;  // refers to a string that outlives the trace
    uint64_t begin_ns = 0;
    uint64_t duration_ns = 0;
    uint32_t thread = 0;
    uint32_t pass = 0;
};

// Spans of a run in a buffer of fixed capacity: further events are only counted. Threads may add
// concurrently.
class Trace {
 public:
    explicit Trace(size_t capacity) : events_(std::allocator<TraceEvent>().allocate(capacity)), capacity_(capacity) {}
    ~Trace() { std::allocator<TraceEvent>().deallocate(events_, capacity_); }
    Trace(const Trace&) = delete;
    Trace& operator=(const Trace&) = delete;
    void add(const TraceEvent& event) {
        const size_t index = count_.fetch_add(1, std::memory_order_relaxed);
        if (index < capacity_) std::construct_at(events_ + index, event);
    }
    // Copies a name, for the lifetime of the trace. One thread at a time.
    std::string_view keep(std::string name) { return names_.emplace_back(std::move(name)); }
    // Forgets the spans.
    void clear() { count_ = 0; }
    size_t size() const { return std::min(count_.load(), capacity_); }
    size_t dropped() const { return count_.load() - size(); }
    const TraceEvent& operator[](size_t index) const { return events_[index]; }
    // Chrome trace format (X events without arguments, so that profilers merge spans of one name). Opens in Perfetto,
    // chrome://tracing and speedscope.
    std::string to_json(const std::vector<std::string>& thread_names) const;

 private:
    TraceEvent* events_;  // capacity for all; constructed one by one, so that an unused part takes no memory pages
    size_t capacity_;
    std::deque<std::string> names_;
    std::atomic<size_t> count_{0};
};

}  // namespace trocar
