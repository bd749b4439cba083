#pragma once
#include <cstdint>
namespace trocar {

// Whether generated shapes get their textures. To paint one takes longer than much else that a scene is made of; what is never drawn
// needs none.
enum class Looks : uint8_t { kPainted, kPlain };

}  // namespace trocar
