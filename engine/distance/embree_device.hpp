#pragma once
#include <embree3/rtcore.h>
namespace trocar {

// The only Embree device of the process: a second one would cost further threads and memory. Created by the first
// call, before which the float mode (set_float_mode) must be set.
RTCDevice embree_device();

}  // namespace trocar
