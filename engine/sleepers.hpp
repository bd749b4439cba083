#pragma once
#include <cstdint>
#include <span>

#include "components/particles.hpp"
namespace trocar {

// Which sleepers a stage need not look at again: nothing of a body changes while it sleeps. `sleep` names per body the
// sleep that it is in, 0 = awake; `seen` is the stage's own memory of the sleep in which it looked at the body last. Both
// are empty where nobody is left out.
struct Sleepers {
    std::span<const uint64_t> sleep;
    std::span<uint64_t> seen;
};

// Whether the stage has looked at the body in this sleep before; from now on it has.
inline bool was_seen(const Sleepers& s, uint32_t body) {
    if (body >= s.sleep.size()) return false;
    const bool seen = s.sleep[body] != 0 && s.seen[body] == s.sleep[body];
    s.seen[body] = s.sleep[body];
    return seen;
}

inline bool is_asleep(const Sleep& sleep, uint32_t body) { return body < sleep.group.size() && sleep.group[body] != kNone; }

// Whether a body sleeps and nothing has asked for it to be woken.
inline bool lies_asleep(const Sleep& sleep, uint32_t body) {
    return is_asleep(sleep, body) && sleep.still[body] != 0;
}

}  // namespace trocar
