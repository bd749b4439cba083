#pragma once
#include <cstdint>
namespace trocar {

// A point of a thread may lie on one body while another one pushes it: ThreadState::touching has this many places per row, for the bodies
// that the point would meet first.
inline constexpr uint32_t kTouchesPerPoint = 2;

}  // namespace trocar
