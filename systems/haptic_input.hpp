#pragma once
#include <span>
#include <vector>

#include "components/clock.hpp"
#include "components/haptics.hpp"
#include "components/paths.hpp"
#include "engine/device.hpp"
namespace trocar {

// Reads every device at each of `ticks` + 1 milliseconds from `first_tick` (ms since the start): state of device d at
// millisecond first_tick + k into sample[d * (ticks + 1) + k]. The samples are as the devices gave them; haptic_tick
// judges them.
void read_devices(std::span<const Device> devices, uint64_t first_tick, uint32_t ticks, std::vector<DeviceState>& sample);

// Where every device will be at each millisecond of the pass; the first is now. What contacts did to the tools in the pass
// before is forgotten.
// In lockstep: as the devices mean to be, and where hands that give way will be under forces that stay as they are.
void sample_devices(const Clock& clock, const Paths& paths, Haptics& haptics, DeviceSamples& samples);
// In a live run: what the haptic thread saw last, gone on with, reached evenly over the pass from where that led in the pass
// before: `last`, which becomes that of this pass.
void follow_devices(const Clock& clock, Haptics& haptics, std::vector<DeviceState>& last, DeviceSamples& samples);

// Tools at the end of a pass of `seconds`: the torque in their grips, and with `ticked` what their ticks counted.
void end_hand_pass(double seconds, bool ticked, Haptics& haptics);

}  // namespace trocar
