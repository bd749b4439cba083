#include "engine/embree_device.hpp"

#include <memory>

#include "engine/check.hpp"
namespace trocar {

RTCDevice embree_device() {
    // no "threads=1" or the like: it would cap the scheduler for the whole process
    static const std::unique_ptr<RTCDeviceTy, void (*)(RTCDevice)> device(rtcNewDevice(nullptr), rtcReleaseDevice);
    TROCAR_ASSERT(device);
    return device.get();
}

}  // namespace trocar
