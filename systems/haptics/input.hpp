#pragma once
#include <span>
#include <vector>

#include "components/clock.hpp"
#include "components/device.hpp"
#include "components/haptics.hpp"
#include "components/paths.hpp"
#include "engine/devices/device.hpp"
namespace trocar {

// Reads every device at each of `ticks` + 1 milliseconds from `first_tick` (ms since the start): the state of device
// d at millisecond first_tick + k goes to sample[d * (ticks + 1) + k]. Samples are unchecked; haptic_tick checks them.
void read_devices(std::span<const Device> devices, uint64_t first_tick, uint32_t ticks, std::vector<DeviceState>& sample);

// Predicts every device's pose at each millisecond of the pass, the first at present, and clears the contact impulses
// of the preceding pass.
// In lockstep: the intended poses, and for hands that yield the predicted ones under constant forces.
void sample_devices(const Clock& clock, const Paths& paths, Haptics& haptics, DeviceSamples& samples);
// In a live run: moves evenly from the end of the preceding pass's prediction, extrapolated from `last`, to that
// extrapolated from the haptic thread's newest sample, which is stored in `last`.
void follow_devices(const Clock& clock, Haptics& haptics, std::vector<DeviceState>& last, DeviceSamples& samples);

// At the end of a pass or of a round of it: computes the grip torques of tools and, with `ticked`, sums their tick counters.
void end_hand_pass(const Clock& clock, bool ticked, Haptics& haptics);

}  // namespace trocar
