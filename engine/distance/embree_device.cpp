#include "engine/distance/embree_device.hpp"

#include <memory>
#include <new>
namespace trocar {

RTCDevice embree_device() {
    // no "threads=1" or the like: it would cap the scheduler for the whole process
    static const std::unique_ptr<RTCDeviceTy, void (*)(RTCDevice)> device(
        [] {
            const RTCDevice made = rtcNewDevice(nullptr);
            if (made == nullptr) throw std::bad_alloc();  // the only reason without options
            return made;
        }(),
        rtcReleaseDevice);
    return device.get();
}

}  // namespace trocar
