#pragma once
#include <array>
#include <vector>

#include "components/haptics.hpp"
#include "engine/closest_point.hpp"
#include "systems/haptic_shell.hpp"
namespace trocar {

// Disc around a triangle of the model near the proxy, at the time of the tick: what is asked first, so it lies apart.
struct NearDisc {
    Vec3d centre = Vec3d::Zero();  // m
    Vec3d normal = Vec3d::Zero();  // unit, outward; zero for a triangle without area
    double radius = 0;             // m
    double offset = 0;             // m, tip radius + half thickness: how near the centre of the tip may come
};

struct NearTriangle {
    Triangle vertex;              // of the model
    uint32_t body = kNone;
    std::array<Vec3d, 3> corner;  // m
    bool sheet = false;
    bool held = false;  // its plane is among the planes of the present step
};

// Part of a near triangle that the tip touches.
struct TouchedFeature {
    uint32_t near = 0;  // row of HapticScratch::near
    Feature feature = Feature::kFace;
    Vec3d offset = Vec3d::Zero();  // m, from the tip's centre to the closest point
    double distance = 0;           // m
    bool shadowed = false;         // a neighbour is touched nearer
};

// Triangle that the tip may touch along a step.
struct SweptTriangle {
    double from = 0;    // share of the step before which it cannot
    uint32_t near = 0;  // row of HapticScratch::near
};

struct HapticScratch {
    std::vector<NearTriangle> near;  // in the order of the model
    std::vector<NearDisc> disc;      // one per row of near
    std::vector<TouchedFeature> touched;
    std::vector<SweptTriangle> ahead;
    ShellScratch shell;  // of a tool that has one
};

// One tick of one tool at `time` (s): takes the device's sample (or refuses it), carries the proxy with the surface and
// moves it towards the device without letting the tip sphere pass a surface, and sets the force on the hand.
// Proxy: the constraint-based god-object (Zilles & Salisbury, IROS 1995) with the finite radius of Ruspini, Kolarov &
// Khatib (SIGGRAPH 1997): the point nearest to the device that the planes of the touched features allow, reached along
// a swept path; friction by the cone of Harwin & Melder (Eurohaptics 2002). Surface positions are those of the model
// plus velocity * age, and what model.give says of how they go with the device; forces are never extrapolated. Force = coupling_stiffness * (proxy - device) - the normal part
// of coupling_damping * velocity (relative to the surface, never pulling, never more than the spring), at most
// tool.max_force; zero without contact. Zero at once after a refused sample, fading when model or device stop coming,
// back over params.rise_time. A sphere that starts inside tissue gets no force until it was clear once. Same code in
// lockstep and live; depends on its arguments alone; no allocation once warm.
void haptic_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
                 const DeviceState& sample, HapticScratch& scratch, ToolState& state);

// Parameters for a simulation of `contact_rate` (Hz): a surface is advanced for two of its periods and a little, which
// is how old it gets when every pass takes its whole period.
HapticParams haptic_params(uint32_t contact_rate);

// Adds up what the ticks of all tools counted.
void sum_tool_counters(Haptics& haptics);

}  // namespace trocar
