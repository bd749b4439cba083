#pragma once
#include "components/springs.hpp"
#include "components/tears.hpp"
namespace trocar {

// Springs of all prototypes as what has torn left them: worked out anew from the state in every pass.
void copy_torn_springs(const Springs& springs, const Torn& torn, TornSprings& torn_springs);

}  // namespace trocar
