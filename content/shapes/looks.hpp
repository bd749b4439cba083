#pragma once
#include <cstdint>
namespace trocar {

// Whether generated shapes get textures. Painting dominates the build time of many scenes, and scenes that
// are never drawn do not need it.
enum class Looks : uint8_t { kPainted, kPlain };

}  // namespace trocar
