#pragma once
#include <span>
#include <vector>

#include "engine/device.hpp"
namespace trocar {

// Reads every device at each of `ticks` + 1 milliseconds from `first_tick` (ms since the start): state of device d at
// millisecond first_tick + k into sample[d * (ticks + 1) + k]. The samples are as the devices gave them; haptic_tick
// judges them.
void read_devices(std::span<const Device> devices, uint64_t first_tick, uint32_t ticks, std::vector<DeviceState>& sample);

}  // namespace trocar
