#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// A thread: a line of points with stretch and bending stiffness, without twist. Its needle end, if it has one, hangs on a tool.
// Properties as of a monofilament of polypropylene, USP 3-0: diameter 0.2 to 0.249 mm (United States Pharmacopeia <861>),
// density 910 kg/m^3 and Young's modulus of drawn polypropylene (1 to 3 GPa; Mark, Polymer Data Handbook, 1999).
struct Thread {
    std::string name;
    double radius = 0.112e-3;                        // m
    double youngs_modulus = 1.5e9;                   // Pa
    double density = 910;                            // kg/m^3
    double damping = 20;                             // 1/s, decay rate of the velocity: drag of what surrounds it
    double friction = 0.15;                          // Coulomb coefficient against tissue at a bite
    double spacing = 2e-3;                           // m, of its points; between half and 1.75 times that beside a bite
    bool contact = true;                             // with all bodies but that of its needle
    bool knot = true;                                // its first end bears a knot that no bite lets through
    uint32_t tool = kNone;                           // that holds the needle
    Range rows;                                      // of ThreadState's columns: those reserved
    uint32_t most_bites = 0;                         // for which there is room
    std::array<double, 3> colour{0.03, 0.07, 0.35};  // linear
    TROCAR_FIELDS(name, radius, "m", youngs_modulus, "Pa", density, "kg/m^3", damping, "1/s", friction, spacing, "m", contact, knot, tool,
                  "index of tools or none", rows, "range of thread rows", most_bites, colour);
};

// A deformable body that a needle sews.
struct SewnBody {
    uint32_t action = 0;
    uint32_t body = kNone;
    uint32_t thread = 0;
    double stiffness = 0;  // N/m, of a bite: what gives between the thread and the nodes around it
    Range vertices;        // of ThreadState::before
    TROCAR_FIELDS(action, "index of actions", body, "index of bodies", thread, "index of threads", stiffness, "N/m", vertices,
                  "range of sewn vertices");
};

// Constant after load. Absent threads: all empty.
struct Threads {
    std::vector<Thread> thread;
    std::vector<SewnBody> sewn;
    uint32_t most_holds = 0, most_holes = 0;  // that there may be at once
    TROCAR_FIELDS(thread, sewn, most_holds, most_holes);
};

// Where a body holds a thread: at its needle end, at a fixed end, or at a bite, through which the thread slides. The point of the
// thread there is joined to a point of the body by a spring without rest length. A hold of an action that does not slide holds the needle
// instead: engine/thread/needle_grip.hpp.
struct ThreadHold {
    uint32_t thread = 0;
    uint32_t body = kNone;    // kNone = a place in the world
    uint32_t action = kNone;  // that made a bite
    bool slides = false;
    bool left = false;                                         // the end of the thread has slid through: to be removed
    std::array<uint32_t, 4> node{kNone, kNone, kNone, kNone};  // of a deformable body, then kNone
    std::array<double, 4> weight{};                            // of the nodes
    Vec3d point = Vec3d::Zero();    // m, of a rigid body: in its frame; of no body: in the world; of a bite or a knot: what is still open
    double stiffness = 0;           // N/m
    double stored = 0;              // J, of the spring, at the time of the velocities
    Vec3d before = Vec3d::Zero();   // m, world: the body's point at the end of the last substep
    Vec3d impulse = Vec3d::Zero();  // N s, of the thread on the body, summed over the pass
    double passed = 0;              // m, of thread towards the needle, net
    double lower = 0, upper = 0;    // N, tension on both sides of a bite: towards the first end and the needle
    // A knot is two holds without a body, each `tied` to the other: the point near the first end stays, the other one slides.
    uint32_t tied = kNone;  // index of the other hold; with it, on the one that slides:
    uint32_t throws = 0;
    uint32_t squared = 0;  // of the throws, those wound against the one before
    double way = 0;        // of the last throw: 1 or -1
    TROCAR_FIELDS(thread, "index of threads", body, "index of bodies or none", action, "index of actions or none", slides, left, node,
                  weight, point, "m", stiffness, "N/m", stored, "J", before, "m", impulse, "N s", passed, "m", lower, "N", upper, "N", tied,
                  "index of holds or none", throws, squared, way);
};

// Where a needle's point has gone through a surface, while its blunt end has not.
struct NeedleHole {
    uint32_t sewn = 0;                                         // index into Threads::sewn
    std::array<uint32_t, 4> node{kNone, kNone, kNone, kNone};  // as of a ThreadHold
    std::array<double, 4> weight{};
    std::array<uint32_t, 3> corner{};  // vertices of the triangle
    double side = 1;                   // to which side of it the point went: 1 = that of its normal, or -1
    TROCAR_FIELDS(sewn, "index of sewn bodies", node, weight, corner, side);
};

// A surface near a point of a thread, in one pass: a plane that goes with a point of the body.
struct ThreadTouch {
    uint32_t thread = 0;
    uint32_t body = kNone;
    std::array<uint32_t, 4> node{kNone, kNone, kNone, kNone};  // as of a ThreadHold
    std::array<double, 4> weight{};
    Vec3d point = Vec3d::Zero();   // m, of a rigid body: in its frame
    Vec3d normal{0, 0, 1};         // unit, world, to the thread's side
    double gap = 0;                // m, that the thread's point keeps from the body's
    double friction = 0;           // Coulomb coefficient
    Vec3d before = Vec3d::Zero();  // m, world: the body's point at the end of the last substep
    double stored = 0;             // J, of what presses them apart, at the time of the velocities
    TROCAR_FIELDS(thread, "index of threads", body, "index of bodies", node, weight, point, "m", normal, gap, "m", friction, before, "m",
                  stored, "J");
};

// A point of a thread may lie on one body while another one pushes it: ThreadState::touching has this many places per row, for the bodies
// that the point would meet first.
inline constexpr uint32_t kTouchesPerPoint = 2;

// What has happened to one thread so far.
struct ThreadProgress {
    bool stepped = false;        // with the bodies of an island, in this pass
    double friction_work = 0;    // J, of bites, <= 0
    double largest_tension = 0;  // N
    uint64_t slipped_off = 0;    // bites that its end has left
    double wound = 0;            // rad, by which the needle has gone about the first end's strand since the last throw
    uint64_t throws = 0;         // of knots, tied so far
    TROCAR_FIELDS(stepped, friction_work, "J", largest_tension, "N", slipped_off, wound, "rad", throws);
};

// Points of all threads, each in its rows from its first end to the needle; only the first `count` of a thread are in use.
struct ThreadState {
    std::vector<uint32_t> count;           // one per thread
    std::vector<double> material;          // m, unstretched, from the first end: ascending
    std::vector<Vec3d> position;           // m, world
    std::vector<Vec3d> velocity;           // m/s
    std::vector<uint32_t> held;            // index into hold, or kNone
    std::vector<ThreadHold> hold;          // in the order in which they were made
    std::vector<NeedleHole> hole;          // likewise
    std::vector<Vec3d> before;             // m, world: vertices of the sewn bodies when their needles were last looked at
    std::vector<uint32_t> touching;        // kTouchesPerPoint per row: indices into touch, or kNone
    std::vector<ThreadTouch> touch;        // of this pass
    std::vector<double> stable_dt;         // s, per body: longest step that its holds allow; empty without any
    std::vector<ThreadProgress> progress;  // one per thread
    TROCAR_FIELDS(count, material, "m", position, "m", velocity, "m/s", held, hold, hole, before, "m", touching, touch, stable_dt, "s",
                  progress);
};

}  // namespace trocar
