#pragma once
#include "systems/advance_call.hpp"
#include "systems/advance_scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Sweeps over the rows of an island with free bodies until they agree (advance_settle.cpp).
void settle_rows(const AdvanceCall& call, ContactComponents& components, ContactSolver& solver, AdvanceIsland& island);

}  // namespace trocar
#pragma GCC diagnostic pop
