#pragma once
#include "systems/haptic_proxy.hpp"
namespace trocar {

// One tick of one tool at `time` (s): takes the device's sample (or refuses it), carries the proxy with the surface and
// moves it towards the device without letting the tip sphere pass a surface, and sets the force on the hand.
// Proxy: the constraint-based god-object (Zilles & Salisbury, IROS 1995) with the finite radius of Ruspini, Kolarov &
// Khatib (SIGGRAPH 1997): the point nearest to the device that the planes of the touched features allow, reached along
// a swept path; friction by the cone of Harwin & Melder (Eurohaptics 2002). Surface positions are those of the model
// plus velocity * age, and what model.give says of how they go with the device; forces are never extrapolated.
// Force = coupling_stiffness * (proxy - device) - the normal part of coupling_damping * velocity (relative to the surface,
// never pulling, never more than the spring), at most tool.max_force; zero without contact. Zero at once after a refused
// sample, fading when model or device stop coming, back over params.rise_time. A sphere that starts inside tissue gets no
// force until it was clear once. Same code in lockstep and live; depends on its arguments alone; no allocation once warm.
void haptic_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool, const DeviceState& sample,
                 HapticScratch& scratch, ToolState& state);

// Parameters for a simulation of `contact_rate` (Hz): a surface is advanced for two of its periods and a little, which
// is how old it gets when every pass takes its whole period.
HapticParams haptic_params(uint32_t contact_rate);

// Adds up what the ticks of all tools counted.
void sum_tool_counters(Haptics& haptics);

}  // namespace trocar
