#pragma once
#include <algorithm>
#include <limits>

#include "components/bodies.hpp"
#include "components/nodes.hpp"
#include "engine/kernels/spring_kernels.hpp"
#include "engine/thread/rod.hpp"
#include "systems/advance/island/nodes.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// A deformable body of the island during a call.
struct AdvanceBody {
    uint32_t body = kNone;
    Range particles;
    uint32_t slices = 0;
    uint32_t buffer = 0;       // index of its first particle in the offset buffers
    uint32_t first_chunk = 0;  // of its slices in sums
    bool shape = false;        // anchors are the best-fit rigid copy
    double damping = 0;        // 1/s
    double impulse_left = 1;   // factor on an impulse by the damping after a kick
    double last_dt = 0;        // s
    double kinetic = 0;        // J, at the start of the call
    Stepping stepping;
    Vec4d origin;                    // m
    Vec4d drag_velocity, drag_turn;  // m/s, rad/s, as in step
    Quat orientation;                // at the start of the call
    const Float4* now = nullptr;     // offsets at the start of the substep
    Float4* next = nullptr;          // and at its end
    SpringStep step;
    float* velocity_before = nullptr;  // m/s, 3 fields: memory to account for a change of the step; null if nothing is to be accounted
    double changed_step = 0;           // J, that leapfrog gained when the step changed in this substep
    double* damping_work = nullptr;    // J, 16 lanes to which a step adds the work of damping; null if energy is not accounted

    // Positions and velocities belong to the same time; else velocities are half a substep behind.
    bool synchronous() const { return stepping.integrator == Integrator::kBackwardEuler; }
    double energy = std::numeric_limits<double>::quiet_NaN();  // J, of a synchronous body after its last step of the call
    bool touched = false;                                      // a constraint of the call acts on it
    uint32_t implicit_slot = kNone;                            // of a touched synchronous body: index in TissueScratch::touched
    // With an embedded surface: nodes and weights of its vertices; else null.
    const std::array<uint32_t, 4>* embedding_node = nullptr;
    const std::array<double, 4>* embedding_weight = nullptr;
    bool linked = false;    // it has a link in the call
    bool threaded = false;  // a thread goes through it
    Range link_ends;        // range of IslandLinks::link_end
    uint32_t tear = kNone;  // index in Tears::body
};

// A link of the island during a call.
struct AdvanceLink {
    uint32_t group = 0, index = 0;  // of Links
    uint32_t body = 0, node = 0;    // index in AdvanceIsland::body
    uint32_t far_body = kNone, far_node = kNone;
    uint32_t rigid = kNone;      // index in AdvanceIsland::rigid, if the holder is
    Vec4d point = {};            // m, body frame of the holder
    double stiffness = 0;        // N/m
    double rest = 0, gauge = 0;  // m
    double break_strain = 0;
    Vec4d force = {};    // N, on the node, at the start of the substep
    double kick = 0;     // s, time for which it acts
    Vec4d far = {};      // m, rigid end at the time of the velocities, in the preceding substep
    bool known = false;  // `far` is known
};

// A rotation and a translation, or a rotation's rate and a velocity: x -> shift + x[0] column[0] + x[1]
// column[1] + ...
struct RigidMap {
    Vec4d shift = {};
    Vec4d column[3] = {};

    Vec4d turn(Vec4d v) const { return v[0] * column[0] + v[1] * column[1] + v[2] * column[2]; }
    Vec4d operator()(Vec4d v) const { return shift + turn(v); }
    Vec4d turn_back(Vec4d v) const { return make_vec4(dot(column[0], v), dot(column[1], v), dot(column[2], v)); }
};

// A rigid body that the island's constraints touch, or a hand of the island: its poses at both ends of a
// substep.
struct AdvanceRigid {
    uint32_t body = kNone;
    uint32_t path = kNone;    // index in Paths, if scripted
    uint32_t tool = kNone;    // index in tools, if a hand with a device
    uint32_t node = kNone;    // of the translation, for a hand or a free body
    uint32_t free = kNone;    // index in free, if free, a tool that contacts rotate, or a jaw of one
    uint32_t jaw = kNone;     // index in jaws, if a jaw; it shares its tool's node
    uint32_t holder = kNone;  // index in rigid: of a jaw's tool, which comes first
    Quat orientation[2];
    RigidMap pose[2];               // m, body frame to world
    RigidMap velocity;              // m/s, of a point of the body frame, relative to the node if there is one
    RigidMap grip_velocity;         // m/s, of a jaw: the part due to the grip
    Vec3d target, target_velocity;  // m, m/s: pose of the tool's origin in the hand, at the end
};

// A free rigid body of the island, or a tool that rotates freely in the hand. Its node is the centre of mass.
struct AdvanceFree {
    RigidMass mass;
    uint32_t rigid = 0;           // index in rigid
    double damping = 0;           // 1/s
    double last_dt = 0;           // s
    double keep = 1;              // factor on the velocity by damping in this substep's kick
    Vec4d centre = {};            // m, of mass, body frame
    Vec4d spin = {};              // rad/s, world axes
    Vec4d spin_before = {};       // rad/s, before this substep's constraints
    Vec4d inv_inertia[3] = {};    // 1/(kg m^2), world axes, columns
    Vec4d shift = {}, turn = {};  // m, rad: position correction so far in this substep
    Vec4d slide = {};             // if it slides along an axis: the axis over the root of its mass, 1/sqrt(kg)
    // of a body with one coordinate; its node has no mass, and lies on the axis if it rotates
    uint32_t drive = kNone;  // index in Nodes::drive
    bool slides = false;
    Vec4d axis = {};                                                     // unit, world
    double inertia = 0;                                                  // kg or kg m^2
    double hold = 0;                                                     // N or N m, Coulomb friction
    double arm = 0;                                                      // m per rad, or 1: velocity per change of the rate
    double rate_before = 0, rate_kicked = 0;                             // m/s or rad/s, before and after the kick of this substep
    double least_rate = 0, most_rate = 0;                                // rates that reach the limits in this substep
    double most_friction = 0;                                            // N s or N m s
    double friction_impulse = 0, stop_impulse = 0, damping_impulse = 0;  // of this substep
    DriveState before;                                                   // at the start of the call
    // of a tool that contacts rotate (held_tools.cpp): in the hand, with its centre of mass at the tip
    bool held = false;
    Quat target;        // orientation in the hand at the end
    Vec3d target_spin;  // rad/s

    // Velocity that an impulse adds to a sliding body, m/s.
    Vec4d yield(Vec4d j) const { return dot(slide, j) * slide; }
    // Angular velocity that an angular impulse about the centre adds, rad/s.
    Vec4d respond(Vec4d j) const { return j[0] * inv_inertia[0] + j[1] * inv_inertia[1] + j[2] * inv_inertia[2]; }
};

// The links of an island.
struct IslandLinks {
    std::vector<AdvanceLink> link;
    std::vector<uint32_t> link_end;    // 2 * index of link, + 1 for its far end; body by body
    std::vector<uint32_t> link_group;  // indices in Links::group of the island's groups
};

// The threads of an island.
struct IslandThreads {
    std::vector<uint32_t> thread;    // indices into Threads::thread
    std::vector<uint32_t> row;       // per hold of the world: row of its point in ThreadState, or kNone: not of the island
    std::vector<uint32_t> rigid;     // per hold of the world: index in AdvanceIsland::rigid of what holds it, or kNone
    std::vector<Vec3d> place;        // m, per hold of the world: the body's point when forces are found
    std::vector<Vec3d> force;        // N, likewise: on the body
    std::vector<double> kick;        // s, likewise: time for which it acts
    // the same per touch of the world
    std::vector<uint32_t> touch_row, touch_rigid;
    std::vector<Vec3d> touch_force, touch_friction;  // N, on the body: all, and of it friction
    std::vector<RodPlane> plane;
    RodScratch rod;
};

// A grasp of a free rigid body during a substep: see grasped_bodies.hpp. World axes.
struct AdvanceGrasp {
    uint32_t index = 0;                   // of ActionState::grasp
    uint32_t tool = kNone, body = kNone;  // index in AdvanceIsland::rigid
    Vec3d point = Vec3d::Zero();          // m, frame of the tool's body
    Vec3d at = Vec3d::Zero();             // m, of the held point, and from the centres
    Vec3d tool_arm = Vec3d::Zero(), body_arm = Vec3d::Zero();
    Vec3d stretch = Vec3d::Zero(), turn = Vec3d::Zero();                                // m, rad, from the body to where the jaws hold it
    double soft = 0, turn_soft = 0;                                                     // 1/kg, 1/(kg m^2)
    Vec3d pull = Vec3d::Zero(), twist = Vec3d::Zero();                                  // m/s, rad/s, that the springs ask for
    Eigen::Matrix3d mass = Eigen::Matrix3d::Zero(), inertia = Eigen::Matrix3d::Zero();  // kg, kg m^2
    Vec3d impulse = Vec3d::Zero(), moment = Vec3d::Zero();                              // N s, N m s, on the body
    // before the impulses, rad/s and m/s
    Vec3d spin_before = Vec3d::Zero(), tool_spin = Vec3d::Zero(), tool_velocity = Vec3d::Zero();
};

// Bodies that move during a call, or are in contact with those.
struct AdvanceIsland {
    std::vector<AdvanceBody> body;
    std::vector<AdvanceRigid> rigid;
    std::vector<AdvanceFree> free;
    std::vector<uint32_t> slot_of_body;  // index in body or in rigid, or kNone; one per body of the world
    ContactNodeSet nodes;
    IslandLinks links;
    std::vector<AdvanceGrasp> grasp;
    IslandThreads threads;
};

// Whether some body of the island has an embedded surface: then constraints are prepared one after the other.
inline bool has_embedded_surface(const AdvanceIsland& island) {
    return std::any_of(island.body.begin(), island.body.end(), [](const AdvanceBody& b) { return b.embedding_node != nullptr; });
}

// Displaces a node's particle at the end of the substep.
inline void move_particle(AdvanceBody& body, const ContactNode& node, Vec4d displacement) {
    float* offset = &body.next[node.particle - body.particles.first].x;
    const __m128 old = _mm_load_ps(offset);
    const __m128 moved = _mm256_cvtpd_ps((__m256d)(float_vec4(old) + displacement));
    _mm_store_ps(offset, _mm_blend_ps(moved, old, 8));  // w is the inverse mass
    node.after = body.origin + float_vec4(moved);
}

}  // namespace trocar
#pragma GCC diagnostic pop
