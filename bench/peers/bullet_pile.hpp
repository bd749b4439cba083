#pragma once
#include "bench/peers/pile_engine.hpp"
namespace trocar::bench {

PileEngine bullet_pile_engine();  // with TROCAR_WITH_BULLET

}  // namespace trocar::bench
