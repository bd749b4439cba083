#pragma once
#include "components/solids.hpp"
namespace trocar {

// Tables of the forces besides springs and anchors, one per family; null where there are none.
struct OtherForces {
    const Solids* solids = nullptr;
};

}  // namespace trocar
