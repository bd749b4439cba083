#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "components/spawning.hpp"
#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Reused memory.
struct PartingPairsScratch {
    PairMemory before;
    std::vector<Vec3d> normals;  // directions to be tried
};

// Pairs that start inside each other, in the first pass (tick 0), or in that in which one of them enters the scene: by more than an
// eighth of the smaller body; or by more than a thousandth, if one of them can be moved as a whole and a translation of at most twice
// the depth parts them. Only pairs with a deformable body, without tools, and without DeepResponse::kLastFree. Until they are
// apart they are in `memory` with four times the travel that needs, minus what was used (part_bodies leaves 1 nm), count as saturated
// with one separation direction, and are not `still` (ms, Sleep::still; may be empty) unless push_speed is 0 or the travel is used up. The
// direction is that of shortest_separation. Where two nearly coincide the depth is that of the less deep middle. What moves such bodies as
// a whole: part_bodies.
void find_parting_pairs(const ContactInputs& in, const Contacts& contacts, uint64_t tick, const SpawnState& spawning,
                        PartingPairsScratch& scratch, PairMemory& memory, Penetrations& penetrations, std::span<uint32_t> still);

}  // namespace trocar
