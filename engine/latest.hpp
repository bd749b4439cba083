#pragma once
#include <array>
#include <atomic>
#include <cstdint>
namespace trocar {

// Newest-value mailbox from one writer thread to one reader thread: three slots that change hands by one atomic
// exchange, so neither side ever waits, copies or allocates, and a value is seen whole or not at all. Values that the
// reader was too slow for are lost. Slots keep the capacity of what they hold.
template <typename T>
class Latest {
 public:
    Latest() = default;
    Latest(const Latest&) = delete;
    Latest& operator=(const Latest&) = delete;

    // Writer: the slot to fill; it holds some older value, whose capacity may be reused.
    T& back() { return slot_[back_].value; }
    // Writer: hands the slot over; back() is another one from then on.
    void publish() { back_ = middle_.exchange(back_ | kFresh, std::memory_order_acq_rel) & kIndex; }
    // Reader: takes the newest value if one was published since the last call; front() changes only here.
    bool update() {
        // a plain look first: the exchange would take the cache line from the writer every time
        if (!(middle_.load(std::memory_order_relaxed) & kFresh)) return false;
        front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
        return true;
    }
    // Reader: the value taken last; default-made before the first.
    const T& front() const { return slot_[front_].value; }

 private:
    static constexpr uint32_t kFresh = 4, kIndex = 3;
    struct alignas(64) Slot {
        T value{};
    };
    std::array<Slot, 3> slot_;
    alignas(64) uint32_t back_ = 0;                // writer's
    alignas(64) uint32_t front_ = 1;               // reader's
    alignas(64) std::atomic<uint32_t> middle_{2};  // slot between the two, and whether it holds news
};

}  // namespace trocar
