#pragma once
#include <array>
#include <vector>

#include "components/thread.hpp"
#include "engine/thread/rod.hpp"
#include "systems/prepare/thread_contacts.hpp"
#include "systems/prepare/tool_actions.hpp"
namespace trocar {

// Begins a pass of the threads: forgets the last pass' impulses, and bites that the end of a thread has left; keeps the
// bodies that they hold awake. Where the trigger of a suture is pulled and its point (the needle's) passes through a surface that it
// sews, that leaves a hole; a point that comes back within kWithdrawn of the hole takes it with it. Once the needle's blunt end, `edge`,
// has passed through the plane of the hole beside it, the thread that hangs on the needle goes through it: a bite, joined to the three
// vertices around the hole, or to the nodes of the nearest one where the surface is embedded. Holes and bites beyond those reserved are
// misfires. While the needle is in a hole, the tissue there holds it (engine/thread/needle_grip.hpp). Once round the strand between the
// first bite and the first end, if something holds that end, the needle makes a throw: the two strands are tied beside their bites, by a
// knot that slips as grip_of_knot says. A throw round the other way than the one before is squared.
struct SewScratch {
    ThreadContactScratch contacts;
    std::vector<double> limits;
};
void sew(const ActionPass& pass, const Vec3d& gravity, const Threads& threads, SewScratch& scratch, ActionState& actions,
         ThreadState& state, Sleep& sleep, Energy& energy);
inline constexpr double kWithdrawn = 1.5e-3;  // m
// m, of the strand that is wound about, and of the needle from it: a hand that ties keeps within an instrument's jaws, which are 20 mm
inline constexpr double kLeastStrand = 5e-3, kWindingReach = 20e-3;

// Joins the bodies that hold or touch the same thread, to be stepped together: first those that hold it; the last count_touch_joins pairs
// are of bodies that only touch it. A pair may be twice the same body, which only a thread moves.
void join_threaded_bodies(const Bodies& bodies, const ThreadState& state, std::vector<std::array<uint32_t, 2>>& joined);
size_t count_touch_joins(const Bodies& bodies, const ThreadState& state);

// Sets the longest step of each body that the springs of its holds and contacts allow; of a needle's body, with those of its grips.
void update_thread_limits(const ActionPass& pass, const Threads& threads, std::vector<double>& scratch, ThreadState& state);

// Adds the mean forces of threads in the pass (of `seconds`) to the hands that hold them. first: no links have set these forces.
void note_thread_forces(double seconds, const Threads& threads, bool first, const ThreadState& state, std::span<ToolState> tools);

// Steps the threads that no island has stepped in this pass: those that only static and scripted bodies hold, or none.
struct ThreadsAlone {
    double seconds = 0;  // of the pass
    Vec3d gravity = Vec3d::Zero();
    const Bodies& bodies;
    const Poses& poses;
};
struct LoneThreadScratch {
    RodScratch rod;
    std::vector<Vec3d> place;     // m, per hold
    std::vector<RodPlane> plane;  // per touch
};
void step_lone_threads(const ThreadsAlone& in, const Threads& threads, LoneThreadScratch& scratch, ThreadState& state, Energy& energy);

}  // namespace trocar
