#pragma once
#include <vector>

#include "components/haptics.hpp"
#include "engine/surface_tree.hpp"
#include "systems/haptic_shell_solve.hpp"
namespace trocar {

// What a shell's tick works with. It remembers how near surfaces were only to pass over points that cannot have come
// near since: forces do not depend on it.
struct ShellScratch {
    bool all_points = false;  // pass over none: for tests and benches
    PlacedSurface surface;
    std::vector<double> radius;     // m, per point: of its arm
    std::vector<double> clear;      // m, per tree and point: how near a surface may be, plus the ways below up to then
    std::vector<uint32_t> nearest;  // per tree and point: triangle, as a hint
    std::vector<ShellPlane> plane;
    uint64_t sequence = 0;  // of the model that the above is about
    double model_time = 0;  // s
    Vec3d tip = Vec3d::Zero();
    Quat turn;
    SurfaceMoment moment;
    // ways gone since the model was made: of the tip (m), of turning (rad), of the fastest surface (m)
    double shifted = 0, turned = 0, surface_way = 0;
    uint64_t looked_at = 0;  // points asked for their distance, ever
};

// One tick of one tool with a shell at `time` (s): takes the device's sample (or refuses it), finds the points of the
// shell near surfaces, moves the instrument to where the coupling to the device (translation and turn about the tip)
// balances with the springs of the points inside (solve_shell), and sets force and torque on the hand: the sums of
// state.contact[i].force and of arm x force, exactly. Distances are exact and signed, of points against the triangles of
// the model as the age of the model and model.give put them. Points move at most 0.25 mm and twice what the device moved
// in a tick, and as far as a surface pushes them: a farther device is followed over several. Zero after a refused sample,
// fading when model or device stop coming; a change that the motion of the device does not explain ramps in. A shell that
// starts inside tissue gets no force until all of it was outside once. Same code in lockstep and live; depends on its
// arguments alone; no allocation once warm.
void shell_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
                const DeviceState& sample, ShellScratch& scratch, ToolState& state);

}  // namespace trocar
