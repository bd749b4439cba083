#pragma once
#include <cstdint>
namespace trocar {

// Name of a body that stays valid, or is recognised as stale, when bodies are spawned and removed.
struct Entity {
    uint32_t index = UINT32_MAX;
    uint32_t generation = 0;
    friend bool operator==(const Entity&, const Entity&) = default;
};

}  // namespace trocar
