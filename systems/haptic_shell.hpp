#pragma once
#include <vector>

#include "components/haptics.hpp"
#include "engine/surface_tree.hpp"
#include "systems/haptic_shell_solve.hpp"
namespace trocar {

// A point of a shell that may be near a surface.
struct ShellNear {
    uint32_t tree = 0;
    uint32_t point = 0;
    uint32_t row = 0;    // of tree and point
    double known = 0;    // m, the surface is not nearer
    bool taken = false;  // it became a plane, or would pull the wrong way
};

// What was found around a point of a shell, and when.
struct ShellAround {
    TrianglesAround found;        // `others`: plus what surfaces may have gone up to then
    Vec3d place = Vec3d::Zero();  // m, where the point was
    uint64_t models = 0;          // that the scratch had seen by then
};

// What a shell's tick works with. It remembers how near surfaces were only to pass over points that cannot have come
// near since: forces do not depend on it.
struct ShellScratch {
    bool all_points = false;  // pass over none: for tests and benches
    PlacedSurface surface;
    std::vector<Vec3d> place;             // m, per point: world, in the present look
    std::vector<double> clear;            // m, per tree and point: how near a surface was, plus what surfaces may have gone up to then ...
    std::vector<Vec3d> asked_at;          // m, ... and where the point was
    std::vector<double> bound;            // m, likewise: clear plus what the point may have gone up to then
    std::vector<double> radius;           // m, per point: of its arm
    std::vector<uint32_t> nearest;        // per tree and point: triangle, as a hint
    std::vector<ShellAround> around;      // per tree and point
    uint64_t models = 0;                  // ever
    std::vector<ShellNear> near, listed;  // of the present look, and while more are listed
    double within = 0;                    // m, as near as these
    std::vector<ShellPlane> plane;
    uint64_t sequence = 0;  // of the model that the above is about
    double model_time = 0;  // s
    SurfaceMoment moment;
    Vec3d tip = Vec3d::Zero();
    Quat turn;
    double grip = 0;                 // rad
    double shifted = 0, turned = 0;  // since the model was made: ways of the tip and of jaws (m), of turning (rad)
    double followed = 0, aged = 0;   // since the model was made: way (m) of a surface that follows, time (s) that others were moved on by
    // of a tool with jaws
    std::vector<ShellPoint> open, opened;  // its points at the grip now and at the tick before
    uint64_t looked_at = 0;                // points asked for their distance, ever ...
    uint64_t searched = 0;                 // ... and those of them that a tree was searched for
};

// One tick of one tool with a shell at `time` (s): takes the device's sample (or refuses it), finds the points of the
// shell near surfaces, moves the instrument to where the coupling to the device (translation and turn about the tip)
// balances with the springs of the points inside (solve_shell), and sets force and torque on the hand: the sums of
// state.contact[i].force and of arm x force, exactly. Distances are exact and signed, of points against the triangles of
// the model as the age of the model and model.give put them. Surfaces are taken for planes around the points
// that the step brings to one; where planes are wrong by a hundredth of what they bear, or the tool was cut short, it looks
// again once. A point goes at most 0.5 mm beyond its distance from the surface, or as far as one that came in pushes it: a
// farther device is followed over several ticks, with the force of where the planes balance. Zero after a refused sample,
// fading when model or device stop coming; a change that the motion of the device does not explain ramps in. A shell that
// starts inside tissue gets no force until all of it was outside once. Same code in lockstep and live; depends on its
// arguments alone; no allocation once warm.
void shell_tick(const HapticParams& params, const LocalContactModel& model, double time, const HandTool& tool, const DeviceState& sample,
                ShellScratch& scratch, ToolState& state);

}  // namespace trocar
