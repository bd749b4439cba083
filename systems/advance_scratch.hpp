#pragma once
#include <array>
#include <limits>
#include <vector>

#include "components/bodies.hpp"
#include "components/math.hpp"
#include "components/nodes.hpp"
#include "engine/geometry/four_points.hpp"
#include "engine/geometry/vec4.hpp"
#include "engine/raw_vector.hpp"
#include "engine/spring_kernels.hpp"
#include "engine/tet_forces.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// A deformable body of the island during a call.
struct AdvanceBody {
    uint32_t body = kNone;
    Range particles;
    uint32_t slices = 0;
    uint32_t buffer = 0;       // row of its first particle in the offset buffers
    uint32_t first_chunk = 0;  // of its slices in sums
    bool shape = false;        // anchors are the best-fit rigid copy
    double damping = 0;        // 1/s
    double impulse_left = 1;   // what the damping after a kick leaves of an impulse
    double last_dt = 0;        // s
    double kinetic = 0;        // J, at the start of the call
    Stepping stepping;
    Vec4d origin;                    // m
    Vec4d drag_velocity, drag_turn;  // m/s, rad/s, as in step
    Quat orientation;                // at the start of the call
    const Float4* now = nullptr;     // offsets at the start of the substep
    Float4* next = nullptr;          // and at its end
    SpringStep step;

    // Places and velocities belong to the same time; else velocities are half a substep behind.
    bool synchronous() const { return stepping.integrator == Integrator::kMidpoint; }
    // Works are differences of the whole energy: steps beyond the explicit limit move places against stiffer forces than
    // the node's own books know. Leapfrog's works are summed up where they are done.
    bool measured() const { return stepping.integrator != Integrator::kLeapfrog; }
    double energy = std::numeric_limits<double>::quiet_NaN();  // J, if measured: at its last measurement of the call
    bool touched = false;                                      // a row of the call acts on it
    // Under a skin: nodes and weights of the vertices of its surface; else null.
    const std::array<uint32_t, 4>* skin_node = nullptr;
    const std::array<double, 4>* skin_weight = nullptr;
    bool linked = false;    // a link of the call pulls at it
    Range link_ends;        // rows of AdvanceScratch::link_end: those of its links
    uint32_t tear = kNone;  // row of Tears::body
};

// A link of the island during a call.
struct AdvanceLink {
    uint32_t group = 0, row = 0;  // of Links
    uint32_t body = 0, node = 0;  // row of AdvanceScratch::body
    uint32_t far_body = kNone, far_node = kNone;
    uint32_t rigid = kNone;      // row of AdvanceScratch::rigid, if the holder is
    Vec4d point = {};            // m, body frame of that
    double stiffness = 0;        // N/m
    double rest = 0, gauge = 0;  // m
    double break_strain = 0;
    Vec4d force = {};    // N, on the node, at the start of the substep
    double kick = 0;     // s, for which it acts
    Vec4d far = {};      // m, rigid end at the time of the velocities, of the substep before
    bool known = false;  // it is
};

// Memory of implicit steps of the body that is stepped now.
struct ImplicitScratch {
    std::vector<Float4> place, direction;                  // one per particle
    std::vector<float> spoke;                              // 64 per column
    std::vector<float> block, residual, applied, change;   // 6, 3, 3, 3 fields
    std::vector<double> sums;                              // 16 a chunk
    std::vector<float> slope, volume_force, volume_block;  // midpoint, tetrahedra: 9, 3 and 6 fields
    std::vector<float> free_residual, free_block;          // midpoint: residual and block without held rows
    TetEnergyScratch tet_energy;                           // where a body's works are differences of its energy
};

// A rotation and a shift, or a rotation's rate and a velocity: x -> shift + x[0] column[0] + x[1] column[1] + ...
struct RigidMap {
    Vec4d shift = {};
    Vec4d column[3] = {};

    Vec4d turn(Vec4d v) const { return v[0] * column[0] + v[1] * column[1] + v[2] * column[2]; }
    Vec4d operator()(Vec4d v) const { return shift + turn(v); }
    Vec4d turn_back(Vec4d v) const { return make_vec4(dot(column[0], v), dot(column[1], v), dot(column[2], v)); }
};

// A rigid body that the island's rows touch, or a hand of the island: where it is at both ends of a substep.
struct AdvanceRigid {
    uint32_t body = kNone;
    uint32_t path = kNone;    // row of Paths, if scripted
    uint32_t tool = kNone;    // row of tools, if a hand with a device
    uint32_t node = kNone;    // of the translation, of a hand or a free body
    uint32_t free = kNone;    // row of free, if free or a tool that its contacts turn, or a jaw of one
    uint32_t jaw = kNone;     // row of jaws, if a jaw: it has its tool's node
    uint32_t holder = kNone;  // row of rigid: of a jaw's tool, before its own
    Quat orientation[2];
    RigidMap place[2];              // m, body frame to world
    RigidMap velocity;              // m/s, of a point of the body frame, less that of the node if there is one
    RigidMap grip_velocity;         // m/s, of a jaw: the part of it that the grip makes
    Vec3d target, target_velocity;  // m, m/s: where a hand's origin would be if it were in the hand, at the end
};

// A free rigid body of the island, or a tool that turns freely in the hand. Its node is the centre of mass.
struct AdvanceFree {
    RigidMass mass;
    uint32_t rigid = 0;           // row of rigid
    double damping = 0;           // 1/s
    double last_dt = 0;           // s
    double keep = 1;              // what damping leaves of the velocity in the kick of this substep
    Vec4d centre = {};            // m, of mass, body frame
    Vec4d spin = {};              // rad/s, world axes
    Vec4d spin_before = {};       // rad/s, before the rows of this substep
    Vec4d inv_inertia[3] = {};    // 1/(kg m^2), world axes, columns
    Vec4d shift = {}, turn = {};  // m, rad: pushed so far in this substep
    Vec4d slide = {};             // of what slides along an axis: the axis over the root of its mass, 1/sqrt(kg)
    // of a body with one coordinate; its node has no mass, and lies on the axis of what turns
    uint32_t drive = kNone;  // row of Nodes::drive
    bool slides = false;
    Vec4d axis = {};                          // unit, world
    double inertia = 0;                       // kg or kg m^2
    double hold = 0;                          // N or N m, Coulomb friction
    double arm = 0;                           // m per rad, or 1: what turns a change of the rate into one of a velocity
    double rate_before = 0, rate_kicked = 0;  // m/s or rad/s, before and after the kick of this substep
    double least_rate = 0, most_rate = 0;     // that reach the limits in this substep
    double most_friction = 0;                 // N s or N m s
    double friction_impulse = 0, stop_impulse = 0, damping_impulse = 0;  // of this substep
    DriveState before;                                                   // at the start of the call
    // of a tool that its contacts turn (advance_held.cpp): in the hand, its centre of mass at the tip
    bool held = false;
    Quat target;        // where the hand would turn it to by the end
    Vec3d target_spin;  // rad/s

    // Velocity that an impulse adds to what slides, m/s.
    Vec4d yield(Vec4d j) const { return dot(slide, j) * slide; }
    // Angular velocity that an angular impulse about the centre adds, rad/s.
    Vec4d respond(Vec4d j) const { return j[0] * inv_inertia[0] + j[1] * inv_inertia[1] + j[2] * inv_inertia[2]; }
};

// One row of ContactNodes.
template <typename Vector, typename Number, typename Row>
struct ContactNodeRow {
    Vector& place;
    Vector& after;
    Vector& velocity;
    Number& inv_mass;
    Number& particle_inv_mass;
    Row& particle;
    Row& owner;
};
using ContactNode = ContactNodeRow<Vec4d, double, uint32_t>;
using ConstContactNode = ContactNodeRow<const Vec4d, const double, const uint32_t>;

// Particles, hands and free bodies that contact rows act on. Field by field: a sweep over rows asks for one field of many
// nodes, here and there, and a cache holds four times as many of them so.
struct ContactNodes {
    RawVector<Vec4d> place;               // m, world, at the start of the substep
    RawVector<Vec4d> after;               // m, world, at its end
    RawVector<Vec4d> velocity;            // m/s
    RawVector<double> inv_mass;           // 1/kg: m/s that an impulse of 1 N s gives
    RawVector<double> particle_inv_mass;  // 1/kg, of a particle: without what damping takes of an impulse
    std::vector<uint32_t> particle;       // row of Particles; kNone for a rigid body
    std::vector<uint32_t> owner;          // row of body, or of rigid

    size_t size() const { return place.size(); }
    size_t capacity() const { return place.capacity(); }
    ContactNode operator[](size_t i) { return {place[i], after[i], velocity[i], inv_mass[i], particle_inv_mass[i], particle[i], owner[i]}; }
    ConstContactNode operator[](size_t i) const {
        return {place[i], after[i], velocity[i], inv_mass[i], particle_inv_mass[i], particle[i], owner[i]};
    }
    // New nodes are without particle; numbers are written by who adds them.
    void resize(size_t n) {
        for (auto* field : {&place, &after, &velocity}) field->resize(n);
        for (auto* field : {&inv_mass, &particle_inv_mass}) field->resize(n);
        particle.resize(n, kNone);
        owner.resize(n, 0);
    }
    // At rest at the origin, without mass.
    void clear_row(size_t i) {
        place[i] = after[i] = velocity[i] = Vec4d{};
        inv_mass[i] = particle_inv_mass[i] = 0;
    }
    void reserve(size_t n) {
        for (auto* field : {&place, &after, &velocity}) field->reserve(n);
        for (auto* field : {&inv_mass, &particle_inv_mass}) field->reserve(n);
        for (auto* field : {&particle, &owner}) field->reserve(n);
    }
};

// One row of ContactNodeChanges.
template <typename Vector, typename Row, typename Flag>
struct ContactNodeChangeRow {
    Vector& before;
    Vector& kicked;
    Vector& damped;
    Vector& acceleration;
    Vector& change;
    Vector& way;
    Row& rows;
    Row& pushes;
    Flag& opposed;
    Flag& pushed;
};
using ContactNodeChange = ContactNodeChangeRow<Vec4d, uint32_t, uint8_t>;
using ConstContactNodeChange = ContactNodeChangeRow<const Vec4d, const uint32_t, const uint8_t>;

// What a substep does to each row of ContactNodes.
struct ContactNodeChanges {
    RawVector<Vec4d> before;        // m/s, before the kick of this substep
    RawVector<Vec4d> kicked;        // m/s, after it
    RawVector<Vec4d> damped;        // m/s, before it and what damping takes off; of a particle, while energy is accounted
    RawVector<Vec4d> acceleration;  // m/s^2, of everything else in the kick; likewise
    RawVector<Vec4d> change;        // m, of the place by push-out
    RawVector<Vec4d> way;           // of the first active row that is not in a block; then, if opposed, m, what a push-out sweep moves it
    std::vector<uint32_t> rows;     // active rows that are not in a block; then, if opposed, the most that have pushed it in a sweep
    std::vector<uint32_t> pushes;   // if opposed: rows that push it in this sweep
    std::vector<uint8_t> opposed;   // two of them press it from both sides
    std::vector<uint8_t> pushed;    // its change is booked from the springs

    size_t size() const { return before.size(); }
    size_t capacity() const { return before.capacity(); }
    ContactNodeChange operator[](size_t i) {
        return {before[i], kicked[i], damped[i], acceleration[i], change[i], way[i], rows[i], pushes[i], opposed[i], pushed[i]};
    }
    ConstContactNodeChange operator[](size_t i) const {
        return {before[i], kicked[i], damped[i], acceleration[i], change[i], way[i], rows[i], pushes[i], opposed[i], pushed[i]};
    }
    void resize(size_t n) {
        for (auto* field : {&before, &kicked, &damped, &acceleration, &change, &way}) field->resize(n);
        for (auto* field : {&rows, &pushes}) field->resize(n, 0);
        for (auto* field : {&opposed, &pushed}) field->resize(n, 0);
    }
    void clear_row(size_t i) { before[i] = kicked[i] = damped[i] = acceleration[i] = change[i] = way[i] = Vec4d{}; }
    void reserve(size_t n) {
        for (auto* field : {&before, &kicked, &damped, &acceleration, &change, &way}) field->reserve(n);
        for (auto* field : {&rows, &pushes}) field->reserve(n);
        for (auto* field : {&opposed, &pushed}) field->reserve(n);
    }
};

// A vertex of a skin that rows act on: they name it by kSkinPoint | its row of skin_point, and give to its nodes.
inline constexpr uint32_t kSkinPoint = 1u << 31;
struct ContactSkinPoint {
    std::array<uint32_t, 4> node;  // rows of node
    std::array<double, 4> weight;
};

// What stays the same about a contact row during a call.
struct ContactPlan {
    Vec4d point_a;  // m, body frame, if rigid
    Vec4d point_b;  // m, body frame, if rigid
    Vec4d normal;   // body frame if b is rigid, else world
    Vec4d impulse;  // N s, given so far in the call
    Vec4d held;     // N s, of it what the implicit step of this substep gave
    std::array<double, 3> weight_a;
    std::array<double, 3> weight_b;
    double offset = 0;  // m, half the thickness of a sheet
    double friction = 0;
    double restitution = 0;
    std::array<uint32_t, 3> node_a;  // if deformable; equal for a vertex; the third is the first but for a face; node or skin point
    std::array<uint32_t, 3> node_b;  // if deformable; node or skin point
    uint32_t rigid_a = kNone, rigid_b = kNone;  // rows of rigid, or kNone
    uint32_t row = kNone;
    bool ended = false;
};

// What is asked of a row while it is decided where it is worked on: a tenth of its plan.
struct RowSketch {
    std::array<uint32_t, 6>
        node;            // point, second end of its edge, corners of the triangle, third corner of a face; kNone: no particle, or a skin's
    uint32_t block = 0;  // if in a block: which of its group,
    uint8_t lane = 0;    // and where in it
    uint8_t kind = 0;    // rows of a kind share blocks; kSingle: none
    static constexpr uint8_t kSingle = 255;
};

// A row that acts in this substep.
struct ContactActive {
    Vec4d normal;
    Vec4d rigid_velocity;       // m/s, what rigid sides add to the relative velocity besides their nodes
    Vec4d friction_impulse;     // N s
    Vec4d warm;                 // N s, that it started from
    double normal_impulse = 0;  // N s
    double least_velocity = 0;  // m/s, along the normal
    double inv_sum = 0;         // kg, 1 / sum of weight^2 * inverse mass
    double friction = 0;
    double push_gap = 0;  // m, from the plane point to where pushes act, along the normal, at the start of the substep
    static constexpr uint32_t kMostNodes = 24;   // a face against a triangle, both of skins
    std::array<double, kMostNodes> weight;       // of the relative velocity: + for the point, - for the plane
    std::array<double, kMostNodes> push_weight;  // of pushes: the foot stays on its triangle
    std::array<uint32_t, kMostNodes> node;
    uint32_t nodes = 0;
    uint32_t point_nodes = 0;  // how many of them, the first, are on the side of the point
    uint32_t plan = 0;
    uint32_t turning = kNone;  // row of turning: that of its plan, if a free body has a side
};

// How a row holds a body in its implicit step: see advance_hold.cpp.
struct HeldRow {
    uint32_t owner = 0;                      // row of body
    bool on = false;                         // it presses
    double stiffness = 0, grip = 0;          // kg, impulse per velocity along the normal and across
    Vec4d velocity = {}, end_velocity = {};  // m/s, of the point against its plane, before and after the step
    Vec4d impulse = {};                      // N s, on the point
};

// What an active row needs to know of its free sides: of the point, of the plane.
struct ContactTurning {
    std::array<uint32_t, 2> free{kNone, kNone};     // rows of free
    Vec4d arm[2] = {};                              // m, from the centre of mass to where the impulse acts
    Vec4d friction_before = {}, friction_way = {};  // N s, before the last sweep; of the conjugate direction
    double normal_before = 0, normal_way = 0;       // the same of the normal
    double friction_mass = 0;                       // kg, inverse of the largest response across the normal
};

// Four contact rows of deformable bodies, between each other or with static ones, that share no node, in the lanes of
// registers: what ContactPlan and ContactActive say of a row. Parts of a row: 0 the point, 1 the second end of its edge, 2-4 the
// corners of the triangle. A lane without a row points to the node of no mass and is never open.
// What is asked for together is together: from along to rest what gaps after the substep need, from node to friction_impulse what sweeps
// do. Sweeps wait for memory: what is a float or a bit is kept as one.
struct ContactBlock {
    static constexpr uint32_t kParts = 5;
    Vec4d offset = {};                                 // m, half the thickness of a sheet
    std::array<FourFloats, 3> weight;                  // of the corners of the triangle
    FourFloats along = {};                             // part of the way to the second end
    std::array<std::array<uint32_t, 4>, kParts> node;  // part, lane
    uint32_t fixed = kNone;                            // row of AdvanceScratch::fixed, if the planes are static: parts 2-4 have no nodes
    bool edges = false;                                // some row has a second end
    uint8_t open = 0;                                  // bits of lanes: rows that have not ended
    uint8_t active = 0;                                // those that act in this substep, as what follows
    FourPoints normal;                                 // world
    std::array<Vec4d, 3> foot;                         // weights of the corners in the relative velocity, negative; 0 if not active
    Vec4d rest = {};                                   // m, what the gap is besides the way from the foot to the point
    Vec4d inv_sum = {};                                // kg, 1 / sum of weight^2 * inverse mass, as foot; 0 if not active
    Vec4d least_velocity = {};                         // m/s, along the normal
    Vec4d normal_impulse = {};                         // N s
    FourFloats friction = {};                          // of the call
    std::array<uint32_t, 4> row;                       // of ContactRows, or kNone
    FourPoints friction_impulse;                       // N s
    FourPoints impulse;                                // N s, given so far in the call
};

// Corners of the triangles of four static planes, m, world.
struct FixedTriangles {
    std::array<FourPoints, 3> corner;
};

// The equations of a few free bodies that stand on each other: six rows a body, velocity and then spin, of which the lower
// half is kept from the first neighbour of the body on.
struct DirectSolve {
    static constexpr uint32_t kMostBodies = 64;
    std::vector<uint32_t> body, ordered;  // rows of free
    std::vector<uint32_t> first;          // per body: the first body that it meets
    std::vector<uint32_t> begin;          // per body: where its rows of matrix begin
    std::vector<double> matrix;           // kg, kg m, kg m^2
    std::vector<double> solution;         // of the right side, N s and N m s, then the change of velocities, m/s and rad/s
    std::vector<Vec4d> impulse;           // N s, per row
    struct Motion {
        Vec4d velocity, spin;  // m/s, rad/s
    };
    struct Impulse {
        Vec4d friction;  // N s
        double normal;   // N s
    };
    std::vector<Motion> before;           // the last solution, per body
    std::vector<Impulse> impulse_before;  // and per row

    uint32_t first_column(uint32_t row) const { return 6 * first[row / 6]; }
    // Indexed by column, from first_column on.
    double* row(uint32_t r) {
        const uint32_t b = r / 6;
        return matrix.data() + begin[b] + (r % 6) * 6 * (b - first[b] + 1) - 6 * first[b];
    }
};

// What a sweep changed of rows with a free side.
struct SweepChange {
    double velocity = 0;         // m/s, the largest of a relative velocity
    double squared_impulse = 0;  // (N s)^2, the sum over all impulses
};

// Rows that are worked on one after the other. Where an island has more than one group, groups of a phase share no node
// and may be worked on at the same time.
struct RowGroup {
    Range plan, block;                   // rows of AdvanceScratch::plan, block
    std::vector<ContactActive> active;   // rows of plan that act in this substep
    std::vector<uint32_t> active_block;  // rows of block that do
    Range fixed;                         // rows of AdvanceScratch::fixed: of its last blocks
    uint32_t idle = 0;                   // node of no mass, for its blocks
    uint32_t turning_rows = 0;           // of active, that have a free side
    SweepChange change;                  // by the last sweep, of them
    Range strips;                        // whose bodies its rows may touch; groups without a strip in common share no node
    uint8_t pushed_in = 0;               // last sweep of push_out, from 1, that moved a node of it; 0: none
    double deepest = 0;                  // m, overlap left by the last substep
};

// What the nodes of a chunk add up to.
struct NodeSums {
    Vec4d fastest = {}, total = {};  // (m/s)^2, largest of each axis; m/s
    Vec4d work = {}, damped = {};    // J
};

// Reused memory of advance_island, one per thread that may run it. Its content means nothing between calls.
struct AdvanceScratch {
    RawVector<Float4> offset_a, offset_b;  // the two buffers of a substep, bodies of the island one after the other
    std::vector<float> remainder;          // 3 fields, rows as the buffers; for bodies that carry_remainder
    std::vector<float> force;              // N, 3 fields, rows as the buffers; only if a body has_forces
    std::vector<double> force_sums;        // per chunk, of one family at a time
    std::vector<Float4> corner_force;      // N, of the tetrahedra of one body
    std::vector<Float4> hinge_force;       // of one body that bends
    std::vector<AdvanceBody> body;
    std::vector<AdvanceRigid> rigid;
    std::vector<double> sums;        // per chunk of slices: 16 lanes of damping work
    std::vector<double> shape_sums;  // per chunk of slices: kShapeSums * 16
    ContactNodes node;
    ContactNodeChanges change;               // as node
    std::vector<uint8_t> moved_in;           // as node: sweep of push_out, from 1, that moved it last in this substep; 0: none
    std::vector<uint32_t> node_of_particle;  // row of node or kNone, one per particle of the world
    std::vector<uint32_t> slot_of_body;      // row of body or of rigid or kNone, one per body of the world
    std::vector<ContactSkinPoint> skin_point;
    RawVector<RowSketch> sketch;      // of all rows of the call, as dealt, while blocks are filled
    std::vector<uint8_t> may_oppose;  // per node: rows of the call may press it from both sides: none of them is in a block; likewise
    std::vector<ContactPlan> plan;    // of rows that are not in a block
    std::vector<AdvanceFree> free;
    std::vector<ContactTurning> turning;     // as plan, of the active rows with a free side; empty without free bodies
    std::vector<ContactActive*> settling;    // active rows, component by component: see advance_settle.cpp
    std::vector<Range> component;            // rows of settling
    std::vector<uint32_t> component_of;      // per node: of its component, while that is solved its row of DirectSolve::body
    std::vector<DirectSolve> direct;         // per chunk of components
    std::vector<ContactActive> held_active;  // rows as a substep starts, of bodies that are stepped by midpoint
    std::vector<HeldRow> held;               // as held_active
    std::vector<Vec4d> warm;                 // N s, of the last substep in which nothing bounced; as plan, or empty: starts_warm
    bool bounces = false;                    // a row bounces in this substep: the next does not start from its impulses
    RawVector<ContactBlock> block;
    RawVector<FixedTriangles> fixed;                    // of the blocks with static planes
    std::vector<RowGroup> group;                        // the first of them are in use, see phase
    std::array<uint32_t, 5> phase{};                    // first group of each phase, and their number
    std::vector<uint32_t> strip;                        // per row of body and then of free, while rows are grouped
    std::vector<std::pair<double, uint32_t>> along;     // m, row of strip: bodies in the order of strips
    std::vector<uint32_t> group_of_row, next_of_group;  // while rows are grouped
    std::vector<uint32_t> dealt, ungrouped;             // rows of ContactRows, in the order of plan before blocks are made
    std::vector<NodeSums> node_sums;                    // per chunk of nodes
    std::vector<std::vector<double>> body_shape_sums;   // as shape_sums, per chunk of bodies
    std::vector<uint16_t> open_blocks_of_node;          // while blocks are filled: which of those open have it; as node
    ImplicitScratch implicit;
    std::vector<AdvanceLink> link;
    std::vector<uint32_t> link_end;      // 2 * row of link, + 1 for its far end; body by body
    std::vector<uint32_t> link_group;    // rows of Links::group that the island has
    std::vector<uint8_t> touched;        // per body of the world: finer_steps; only if the island has solids
    std::vector<uint8_t> overstretched;  // per chunk of slices of one body: some spring is
};

}  // namespace trocar
#pragma GCC diagnostic pop
