#pragma once
#include <vector>

#include "components/device.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
#include "engine/haptics/local_contact_model.hpp"
#include "engine/haptics/surface_tree.hpp"
#include "systems/haptics/contact/point_shell_solve.hpp"
namespace trocar {

// A point of a shell that may be near a surface.
struct ShellNear {
    uint32_t tree = 0;
    uint32_t point = 0;
    uint32_t index = 0;  // of tree and point
    double known = 0;    // m, lower bound on the distance to the surface
    bool taken = false;  // it became a plane, or its separation direction was rejected
};

// Result of a search around a point of a shell, and its time.
struct ShellAround {
    TrianglesAround found;           // `others`: plus what surfaces may have moved up to then
    Vec3d position = Vec3d::Zero();  // m, where the point was
    uint64_t models = 0;             // models that the scratch had received by then
};

// Working memory of a point shell's tick. Distances are remembered only to skip points that cannot have come
// near since: forces do not depend on it.
struct PointShellScratch {
    bool all_points = false;  // skips none: for tests and benches
    PlacedSurface surface;
    std::vector<Vec3d> position;          // m, per point: world, in the present iteration
    std::vector<double> clear;            // m, per tree and point: measured distance, plus what surfaces may have moved up to then ...
    std::vector<Vec3d> asked_at;          // m, ... and the position of the point then
    std::vector<double> bound;            // m, likewise: clear plus what the point may have moved up to then
    std::vector<double> radius;           // m, per point: length of its arm
    std::vector<uint32_t> nearest;        // per tree and point: triangle, as a hint
    std::vector<ShellAround> around;      // received in total
    uint64_t models = 0;                  // ever
    std::vector<ShellNear> near, listed;  // of the present iteration, and while more are listed
    double within = 0;                    // m, distance up to which points are listed
    std::vector<ShellPlane> plane;
    uint64_t sequence = 0;  // of the model that these members refer to
    double model_time = 0;  // s
    SurfaceMoment moment;
    Vec3d tip = Vec3d::Zero();
    Quat turn;
    double grip = 0;                 // rad
    double shifted = 0, turned = 0;  // since the model was made: path of the tip and of jaws (m), of rotation (rad)
    double followed = 0, aged = 0;   // since the model was made: path (m) of a surface that yields, extrapolation time (s) of the others
    // of a tool with jaws
    std::vector<ShellPoint> open, opened;  // its points at the present grip and at that of the last tick
    uint64_t looked_at = 0;                // points whose distance was measured, in total ...
    uint64_t searched = 0;                 // ... and those that needed a tree search
};

// One tick of one tool with a point shell at `time` (s). Accepts or rejects the device's sample, finds the
// shell points near surfaces, moves the instrument to the balance of the coupling to the device (translation
// and rotation about the tip) with the contact springs of the points inside (solve_shell), and sets force and
// torque on the hand: exactly the sums of state.contact[i].force and of arm x force.
// Distances are exact and signed, of points against the triangles of the model, extrapolated to the present
// time including model.give. Around each point that the step brings to a surface the surface is approximated
// by a plane; where planes are wrong by a hundredth of the force on them, or the step was cut, there is one
// more iteration.
// A point moves at most 0.5 mm beyond its distance from the surface, or as far as a surface that moved in
// pushes it: a farther device is followed over several ticks, with the force of the balance.
// Zero after a rejected sample, fading when model or device stop coming; a change that the motion of the
// device does not explain ramps in. A shell inside tissue is pushed out (push_out.hpp).
// Same code in lockstep and live; depends on its arguments alone; no allocation once warm.
void point_shell_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool,
                      const DeviceState& sample, PointShellScratch& scratch, ToolState& state);

}  // namespace trocar
