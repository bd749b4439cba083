#pragma once
#include <span>
#include <vector>

#include "components/haptics.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

struct LocalContactScratch {
    std::vector<uint32_t> vertex_row;    // local vertex of the body at hand -> row of the model; kNone between bodies
    std::vector<uint32_t> triangle_row;  // the same for triangles
    std::vector<uint32_t> triangle_source;  // row of the model -> local triangle
};

// Copies every triangle that a tool may touch before the next passes: those of all bodies but its own that come nearer
// to the segment from the device to the proxy than the tool can travel in params.greatest_age (by box, so a few more),
// with their vertex velocities. `time` (s) and `sequence` name the contact pass. Bodies ascend, triangles ascend within
// a body, vertices in the order of first use. No allocation once warm.
void publish_local_contact(const HapticParams& params, const Surfaces& surfaces, const HandTool& tool,
                           const ToolState& state, double time, uint64_t sequence, LocalContactScratch& scratch,
                           LocalContactModel& out);

}  // namespace trocar
