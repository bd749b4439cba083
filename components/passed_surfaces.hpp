#pragma once
#include <cstdint>
#include <vector>

#include "components/fields.hpp"
namespace trocar {

// Surfaces of deformable bodies that tools went through instead of being held by them, since the start; one element per tool.
struct PassedSurfaces {
    std::vector<uint32_t> body;   // the last one; kNone: none yet
    std::vector<uint64_t> times;  // how often
    TROCAR_FIELDS(body, "index of bodies or none", times);
};

}  // namespace trocar
