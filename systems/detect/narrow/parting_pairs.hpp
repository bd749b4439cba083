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

// Pairs that start inside each other, by more than an eighth of the smaller body: in the first pass (tick 0), or in that in which
// one of them enters the scene. Only pairs with a deformable body, without tools, and without DeepResponse::kLastFree. Until they are
// apart, or were moved by four times as much as that needs, they are in `memory`, count as saturated with one separation direction,
// and are not `still` (ms, Sleep::still; may be empty) unless push_speed is 0. The direction is that of shortest_separation. Where two
// nearly coincide the depth is that of the less deep middle. What moves such bodies as a whole: part_bodies.
void find_parting_pairs(const ContactInputs& in, const Contacts& contacts, uint64_t tick, const SpawnState& spawning,
                        PartingPairsScratch& scratch, PairMemory& memory, Penetrations& penetrations, std::span<uint32_t> still);

}  // namespace trocar
