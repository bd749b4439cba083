#pragma once
#include <array>
#include <atomic>
#include <cstdint>
namespace trocar {

// Newest-value mailbox from one writer thread to one reader thread: three slots exchanged atomically, so
// neither side ever waits, copies or allocates, and a value is seen whole or not at all. Values not read in
// time are lost. Slots keep the capacity of their values.
template <typename T>
class Latest {
 public:
    Latest() = default;
    Latest(const Latest&) = delete;
    Latest& operator=(const Latest&) = delete;

    // Writer: the slot to fill; it contains an older value, whose capacity may be reused.
    T& back() { return slot_[back_].value; }
    // Writer: publishes the slot; back() is another one afterwards.
    void publish() { back_ = middle_.exchange(back_ | kFresh, std::memory_order_acq_rel) & kIndex; }
    // Reader: takes the newest value if one was published since the last call; front() changes only here.
    bool update() {
        // a plain load first: the exchange would take the cache line from the writer every time
        if (!(middle_.load(std::memory_order_relaxed) & kFresh)) return false;
        front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
        return true;
    }
    // Reader: the value taken last; default-constructed before the first.
    const T& front() const { return slot_[front_].value; }

 private:
    static constexpr uint32_t kFresh = 4, kIndex = 3;
    struct alignas(64) Slot {
        T value{};
    };
    std::array<Slot, 3> slot_;
    alignas(64) uint32_t back_ = 0;                // writer's
    alignas(64) uint32_t front_ = 1;               // reader's
    alignas(64) std::atomic<uint32_t> middle_{2};  // slot between the two, and whether it contains a new value
};

}  // namespace trocar
