#pragma once
#include "components/haptics.hpp"
#include "systems/haptics/contact/proxy.hpp"
namespace trocar {

// One tick of one tool at `time` (s): accepts or rejects the device's sample, carries the proxy with the
// surface, moves it towards the device without letting the tip sphere pass through a surface, and sets the
// contact force on the hand.
// Proxy: the constraint-based god-object (Zilles & Salisbury, IROS 1995) with the finite radius of Ruspini,
// Kolarov & Khatib (SIGGRAPH 1997): the point nearest to the device that satisfies the planes of the features
// in contact, reached along a swept path; friction by the cone of Harwin & Melder (Eurohaptics 2002).
// Surface positions are those of the model plus velocity * age, plus the compliance prediction model.give;
// forces are never extrapolated. Force = coupling_stiffness * (proxy - device) - the normal part of
// coupling_damping * velocity (relative to the surface, never pulling, never more than the spring), at most
// tool.max_force; zero without contact.
// Zero at once after a rejected sample, fading when model or device stop coming, restored over
// params.rise_time. A sphere inside tissue is pushed out (push_out.hpp).
// Same code in lockstep and live; depends on its arguments alone; no allocation once warm.
void haptic_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool, const DeviceState& sample,
                 HapticScratch& scratch, ToolState& state);

// Parameters for a simulation of `contact_rate` (Hz): a surface is extrapolated for slightly more than two
// contact periods, its age when every pass takes its whole period.
HapticParams haptic_params(uint32_t contact_rate);

// Sums the counters of the ticks of all tools.
void sum_tool_counters(Haptics& haptics);

}  // namespace trocar
