#pragma once
#include <cstdint>
#include <span>

#include "components/particles.hpp"
namespace trocar {

// Sleeping bodies that a stage need not process again: nothing of a body changes while it sleeps. `sleep`
// holds per body the number of its present sleep, 0 = awake; `seen` is the stage's own record of the sleep in
// which it last processed the body. Both are empty if no body may be skipped.
struct SleepingBodies {
    std::span<const uint64_t> sleep;
    std::span<uint64_t> seen;
};

// Whether the stage has processed the body in this sleep already; records that it now has.
inline bool was_seen(const SleepingBodies& s, uint32_t body) {
    if (body >= s.sleep.size()) return false;
    const bool seen = s.sleep[body] != 0 && s.seen[body] == s.sleep[body];
    s.seen[body] = s.sleep[body];
    return seen;
}

inline bool is_asleep(const Sleep& sleep, uint32_t body) { return body < sleep.group.size() && sleep.group[body] != kNone; }

// Whether a body sleeps without a request to wake it.
inline bool lies_asleep(const Sleep& sleep, uint32_t body) { return is_asleep(sleep, body) && sleep.still[body] != 0; }

}  // namespace trocar
