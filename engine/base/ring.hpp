#pragma once
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>
namespace trocar {

// Queue of fixed capacity from one writer thread to one reader thread: neither side ever waits or allocates.
// Values pushed while it is full are dropped and counted.
template <typename T>
class Ring {
 public:
    // Capacity for `capacity` values, rounded up to a power of two.
    explicit Ring(size_t capacity) : slot_(std::bit_ceil(capacity < 1 ? size_t{1} : capacity)) {}
    Ring(const Ring&) = delete;
    Ring& operator=(const Ring&) = delete;

    // Writer: false if the value was dropped.
    bool push(const T& value) {
        const uint64_t end = end_.load(std::memory_order_relaxed);
        if (end - begin_.load(std::memory_order_acquire) == slot_.size()) {
            lost_.fetch_add(1, std::memory_order_relaxed);
            return false;
        }
        slot_[end & (slot_.size() - 1)] = value;
        end_.store(end + 1, std::memory_order_release);
        return true;
    }
    // Reader: false if empty; oldest first.
    bool pop(T& value) {
        const uint64_t begin = begin_.load(std::memory_order_relaxed);
        if (begin == end_.load(std::memory_order_acquire)) return false;
        value = slot_[begin & (slot_.size() - 1)];
        begin_.store(begin + 1, std::memory_order_release);
        return true;
    }
    // Values dropped so far.
    uint64_t lost() const { return lost_.load(std::memory_order_relaxed); }

 private:
    std::vector<T> slot_;
    alignas(64) std::atomic<uint64_t> begin_{0};  // moved by the reader
    alignas(64) std::atomic<uint64_t> end_{0};    // moved by the writer
    std::atomic<uint64_t> lost_{0};
};

}  // namespace trocar
