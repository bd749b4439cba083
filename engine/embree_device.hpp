#pragma once
#include <embree3/rtcore.h>
namespace trocar {

// The one device of the process: it holds worker state, and a second one would be paid for in threads and memory. Made when
// it is first asked for; the float mode (set_float_mode) must be set by then.
RTCDevice embree_device();

}  // namespace trocar
