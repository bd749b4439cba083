#pragma once
#include <vector>

#include "components/device.hpp"
#include "components/fields.hpp"
#include "components/haptic_effect.hpp"
#include "components/haptic_surface.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
namespace trocar {

struct Haptics {
    std::vector<HandTool> tool;          // constant
    std::vector<DeviceTrace> trace;      // constant
    std::vector<HapticEffect> effect;    // constant
    std::vector<ToolJaw> jaw;            // constant
    std::vector<HapticSurface> surface;  // constant; one per body with surface properties other than its tool's
    std::vector<ToolState> state;        // one per tool
    uint64_t ticks = 0;
    double max_force = 0;           // N, largest commanded, within the limits
    double max_force_wanted = 0;    // N, before the limits
    uint64_t rejected_samples = 0;  // device samples refused (not finite, jump)
    TROCAR_FIELDS(tool, trace, effect, surface, jaw, state, ticks, max_force, "N", max_force_wanted, "N", rejected_samples);
    static constexpr size_t kConstantFields = 5;  // the first of the list
};

}  // namespace trocar
