#pragma once
#include "systems/advance/island/call.hpp"
#include "systems/advance/island/scratch.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Sweeps over the constraints of an island with free bodies until they converge or kMostWork is spent; counts the latter.
void solve_to_convergence(const AdvanceCall& call, ContactComponents& components, ContactSolver& solver, AdvanceIsland& island,
                          AdvanceResult& result);

}  // namespace trocar
#pragma GCC diagnostic pop
