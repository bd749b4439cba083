#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/lives.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
namespace trocar {

// Bodies whose life is over at `tick` (ms), ascending.
void find_leaving(const Pools& pools, const Lives& lives, uint64_t tick, std::vector<uint32_t>& leaving);

// Fills slots with those due at `tick` (ms): the lowest free slot first; who finds none comes when one is free. Their
// generation is that of the slot, which rose when the last one left.
void let_come(const Pools& pools, uint64_t tick, Lives& lives, Sleep& sleep);

// Takes bodies away: their slots lie at their places at rest, asleep, until somebody comes.
void send_away(const Meshes& meshes, const Solids& solids, const Bodies& bodies, const Pools& pools, const std::vector<uint32_t>& leaving,
               Lives& lives, Poses& poses, Particles& particles, Sleep& sleep);

}  // namespace trocar
