#include "systems/device_input.hpp"
namespace trocar {

void read_devices(std::span<const Device> devices, uint64_t first_tick, uint32_t ticks, std::vector<DeviceState>& sample) {
    const size_t per_device = size_t{ticks} + 1;
    sample.resize(devices.size() * per_device);
    for (size_t d = 0; d < devices.size(); ++d)
        for (size_t k = 0; k < per_device; ++k)
            sample[d * per_device + k] = read_device(devices[d], static_cast<double>(first_tick + k) * 1e-3);
}

}  // namespace trocar
