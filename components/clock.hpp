#pragma once
#include <cstdint>

#include "components/fields.hpp"
namespace trocar {

// Simulated time in whole milliseconds. Contact pass k starts at tick floor(k * 1000 / contact_rate), picture k is
// taken at tick floor(k * 1000 / display_rate): integers, so nothing drifts however long a run lasts.
struct Clock {
    uint64_t tick = 0;           // ms since the start, of the present contact pass
    uint64_t pass = 0;           // contact passes begun
    uint64_t picture = 0;        // pictures taken
    uint32_t contact_rate = 60;  // Hz
    uint32_t display_rate = 30;  // Hz
    uint32_t period = 16;        // ms, of the present pass
    TROCAR_FIELDS(tick, "ms", pass, picture, contact_rate, "Hz", display_rate, "Hz", period, "ms");
};

// Highest contact rate; a picture takes a whole number of contact passes.
inline constexpr uint32_t kHighestContactRate = 240;  // Hz
inline bool is_contact_rate(uint32_t rate) { return rate > 0 && rate % 30 == 0 && rate <= kHighestContactRate; }

inline uint64_t pass_tick(uint64_t pass, uint32_t rate) { return pass * 1000 / rate; }

}  // namespace trocar
