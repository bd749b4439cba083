#pragma once
#include <functional>

#include "engine/devices/link.hpp"
#include "engine/jobs/real_time.hpp"
namespace trocar {

// Waits until another thread has made `done` true; asserts nothing about the duration.
inline bool wait_until(const std::function<bool()>& done) {
    const int64_t end = monotonic_ns() + 20'000'000'000;
    while (monotonic_ns() < end) {
        if (done()) return true;
        sleep_until_ns(monotonic_ns() + 500'000);
    }
    return false;
}

inline uint64_t count_of(const DeviceLink& link, DeviceCount what) { return link.counts()[static_cast<size_t>(what)]; }

}  // namespace trocar
