#pragma once
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "engine/parallel.hpp"
#include "systems/advance.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

struct ImplicitStep;

// Below this cosine between a row's normal and its triangle's, the foot along the normal is too far away to be used.
constexpr double kLeastCosine = 0.2;
// Two rows press a node from both sides when the cosine of their ways is below this.
constexpr double kOpposed = -0.5;
// Overlap left alone (m): far below anything seen or felt, above what rounding makes of a resting contact.
constexpr double kRestingOverlap = 1e-6;

// One call of advance_island as its parts see it.
struct AdvanceIsland {
    const AdvanceParams& params;
    const AdvanceInputs& inputs;
    AdvanceScratch& scratch;
    Particles& particles;
    Poses& poses;
    ContactRows& rows;
    std::span<ToolState> tools;
    AdvanceResult& result;
    double dt;             // s
    uint32_t substep = 0;  // that runs now
};

// How much of the substep a hand or free body moves for, s.
inline double moving_time(const AdvanceIsland& island, uint32_t body) {
    if (island.inputs.stop.empty()) return island.dt;
    return std::clamp(island.inputs.stop[body] - island.substep * island.dt, 0.0, island.dt);
}

// A new node: at rest at the origin, without particle or mass.
inline ContactNode add_node(AdvanceScratch& s) {
    const size_t row = s.node.size();
    s.node.resize(row + 1);
    s.change.resize(row + 1);
    s.node.clear_row(row);
    s.change.clear_row(row);
    return s.node[row];
}

// Calls visit(node, share) for a node, or for the nodes of a skin point.
template <typename Visit>
void visit_nodes(const AdvanceScratch& s, uint32_t point, const Visit& visit) {
    if (!(point & kSkinPoint)) return visit(point, 1.0);
    const ContactSkinPoint& skin = s.skin_point[point & ~kSkinPoint];
    for (int k = 0; k < 4; ++k) visit(skin.node[k], skin.weight[k]);
}
// Place, after or velocity of a node or of a skin point.
inline Vec4d field_at(const AdvanceScratch& s, uint32_t point, RawVector<Vec4d> ContactNodes::*field) {
    if (!(point & kSkinPoint)) return (s.node.*field)[point];
    Vec4d sum = {};
    visit_nodes(s, point, [&](uint32_t node, double share) { sum += share * (s.node.*field)[node]; });
    return sum;
}

// Time at the start of a substep, s: a quotient of integers, so that it does not depend on how calls are cut.
double substep_time(const AdvanceParams& params, uint32_t substep);

// ---- forces on deformable bodies (advance_forces.cpp) ----

// Whether a body has forces besides springs and anchors that a step takes as they are at its start: pressure, bending, and of
// bodies stepped by leapfrog tetrahedra.
bool has_forces(const AdvanceInputs& inputs, uint32_t body);
// Gives bodies that has_forces their rows of scratch.force. `particles`: of the whole island.
void give_forces(AdvanceIsland& island, uint32_t particles);
// Sets the forces (N) of a body that has_forces to those at the start of a substep, where body.step.offset is. Does nothing to
// others.
void find_forces(AdvanceIsland& island, AdvanceBody& body);

// ---- links between bodies (advance_links.cpp) ----

// Fills scratch.link with the island's links. Its bodies must have been gathered.
void gather_links(AdvanceIsland& island);
// Sets the force (N) of every link to that at the start of a substep.
void find_link_forces(AdvanceIsland& island);
// Adds the link forces (N) on the nodes of a row of scratch.body. axis: x, y and z, one float per node.
void add_link_forces(const AdvanceScratch& s, uint32_t body, float* const axis[3]);
// Gives hands and free bodies the impulses of their ends of the links, after they were kicked themselves.
void pull_linked_rigids(AdvanceIsland& island);
// What the energy of links, pressure and bending changes by (J) when nodes of measured bodies are moved: by the impulses of
// rows, or by pushes (`pushed`). Impulses act beside the forces as the step has taken them, pushes against links as they are
// by then.
double energy_of_others(const AdvanceIsland& island, bool pushed);
// Notes stretch and works of the links at the end of a substep, and breaks those that are too long.
void finish_links(AdvanceIsland& island);

// ---- tearing (advance_tears.cpp) ----

// Row of Tears::body of a body whose springs may break, or kNone.
uint32_t tear_of(const Tears* tears, uint32_t body);
// Breaks the springs that are too long at the end of a substep: from the next one on they do not pull.
void break_springs(AdvanceIsland& island);

// ---- the step of a body by midpoint (advance_midpoint.cpp) ----

// One step of a body, and its books. b.step is bound to this substep. `work`: 16 lanes to which the work of damping (J) is
// added; null when nobody asks.
void step_midpoint(AdvanceIsland& island, AdvanceBody& b, double* work);

// ---- rows within a step by midpoint (advance_hold.cpp) ----
//
// Rows between a body stepped by midpoint and one whose motion is given (static or scripted) act within the step. The step
// alone lets what a row pressed in the step before spring back as if nobody held it; rows then catch its surface, and at steps
// beyond the explicit limit the inside runs through it. So a row that closes gives, within the step, the impulse
// -c (n . v - least) along its normal n, v the velocity of its point against its plane at the end of the step, and at most
// friction times that across: linear in v, so that it is part of the matrix (Baraff and Witkin, "Large steps in cloth
// simulation", 1998, hold points by filtering instead, which rows of several nodes cannot). c is kHold times what the block of
// the point's nodes resists with. Rows that would pull let go, rows that the step closes join, and the system is solved
// again. What is left, 1/kHold of the way, apply_impulses takes.

// Finds the rows that may act so, at the start of a substep (advance_contact.cpp, beside the other rows).
void find_held_rows(AdvanceIsland& island);
// Makes those of a body ready for its step; its blocks must be there. Returns whether there are any.
bool bind_held_rows(AdvanceIsland& island, const AdvanceBody& b);
// Before each solve: adds their share of the right-hand side and of the blocks. Returns residual . (block * residual).
double start_held_rows(AdvanceIsland& island, const AdvanceBody& b, ImplicitStep& step);
// In each iteration: adds their share of matrix * direction to `applied`. Returns their part of direction . applied.
double apply_held_rows(AdvanceIsland& island, const AdvanceBody& b);
// After each solve: rows let go, and join if `may_add`. Returns whether the system is another one now.
bool judge_held_rows(AdvanceIsland& island, const AdvanceBody& b, bool may_add);
// At the end: returns their work on the body, J.
double settle_held_rows(AdvanceIsland& island, const AdvanceBody& b);

// ---- books ----

// Adds to `work` (J) what the energy of measured bodies, and of what pulls at them from outside, has changed by since it was
// measured last: by the rows' impulses, or by pushes (`pushed`).
void book_measured(AdvanceIsland& island, bool pushed, double& work);
// Energy of the velocities of a body as the particles have them now, J.
double kinetic_energy(const AdvanceIsland& island, const AdvanceBody& b);
// Whether a body's energy has grown over the call by far more than a stable step can show, with nothing to give it any:
// an explicit step above its limit doubles its energy in a few steps. Bodies with rows or with forces of others are left
// out: those may give energy. After the last substep, before the state is written.
bool has_run_away(const AdvanceIsland& island, const AdvanceBody& b);

// ---- contact rows of the call (advance_contact.cpp) ----

// What stays the same about a row during the call; its nodes have their places.
ContactPlan make_plan(AdvanceIsland& island, uint32_t row);
// Whether some body of the island has a skin that rides on its nodes: then plans are made one after the other.
inline bool any_rides(const AdvanceScratch& s) {
    return std::any_of(s.body.begin(), s.body.end(), [](const AdvanceBody& b) { return b.skin_node != nullptr; });
}
// Finds the nodes, rigid sides and plans of the island's rows; rows that have ended are left out.
void plan_contacts(AdvanceIsland& island, std::span<const uint32_t> island_rows);
// Empties the look-up tables that plan_contacts filled.
void forget_contacts(AdvanceIsland& island);

// ---- rigid bodies (advance_rigid.cpp) ----

// Row of scratch.rigid of a rigid body, added when it is new.
uint32_t rigid_slot(AdvanceIsland& island, uint32_t body);
// Places the rigid bodies at both ends of a substep: scripted ones and jaws; hands turn with the device, free ones stay.
void place_rigid_bodies(AdvanceIsland& island, uint32_t substep);
// Lets the couplings pull the hands, before the rows.
void pull_hands(AdvanceIsland& island, uint32_t substep);
// Puts the hands where their velocities took them, after the rows.
void move_hands(AdvanceIsland& island);
// Velocities of a tool's points, and of its jaws', from its spin now.
void note_spin(AdvanceScratch& s, const AdvanceFree& f);
// Puts the jaws of tools that turn where these and the grip have them at the start of a substep, as the end of the one before.
void carry_jaws(AdvanceIsland& island, uint32_t substep);
// Adds to ToolState what an impulse (N s) at a place (m, world) on a jaw does to the grip; nothing for other bodies.
void add_grip_moment(AdvanceIsland& island, uint32_t rigid_row, Vec4d at, Vec4d impulse);
// Where the body frame of a tool would be if it were in the hand, at the start of a substep.
struct HandPose {
    Vec3d origin;  // m, world
    Quat orientation;
    double grip = 0;  // rad
};
HandPose hand_pose(const AdvanceIsland& island, uint32_t tool, uint32_t substep);

// ---- free rigid bodies (advance_free.cpp) ----

// Makes the row of scratch.free and the node of one.
void add_free_body(AdvanceIsland& island, uint32_t rigid_row);
// Gravity and damping, before the rows.
void kick_free_bodies(AdvanceIsland& island);
// Place and orientation at the end of the substep, after the rows.
void move_free_bodies(AdvanceIsland& island);
// Writes their state back into the poses. A body that is not finite keeps the one from the start of the call, at rest, counted.
void finish_free_bodies(AdvanceIsland& island);
// Puts the end of the substep where the node of a free body is at `centre` (m, world) under an orientation.
void place_end(AdvanceRigid& rigid, const AdvanceFree& f, Vec4d centre, const Quat& orientation);

// Work of the rows on free bodies, J.
double contact_work_on_free(const AdvanceIsland& island);
// Gives an active row its free sides, where the impulse acts at `at` (m, world), and what they add to inv_sum.
void add_turning_sides(AdvanceIsland& island, const ContactPlan& plan, Vec4d at, ContactActive& active);
// As solve_row for a row with a free side.
double solve_turning_row(AdvanceScratch& s, ContactActive& row);
// Gives a row with a free side an impulse, N s.
void give_impulse(AdvanceScratch& s, const ContactActive& row, const ContactTurning& turning, Vec4d impulse);
// Velocity of the point relative to the plane, m/s, of a row with a free side.
Vec4d turning_velocity(const AdvanceScratch& s, const ContactActive& row, const ContactTurning& turning);
// Moves the points of a row's free sides by their share of a push, which like an impulse is shared by inverse masses: kg m.
void push_free_sides(AdvanceScratch& s, const ContactTurning& turning, Vec4d push);
// Then the bodies follow: all pushes of one at once, none farther than `most` (m).
void finish_free_pushes(AdvanceIsland& island, double most);

// ---- rows between free bodies (advance_settle.cpp, advance_direct.cpp) ----

// Gives a row the impulse that its bodies' velocities ask for now. Returns by how much the relative velocity changed, m/s, of a
// row without a free side 0.
double solve_row(AdvanceScratch& s, ContactActive& row);
// Sweeps over the rows of an island with free bodies until they agree (advance_settle.cpp).
void settle_rows(AdvanceIsland& island);
// Whether the rows of a component are between few enough free bodies, in chains rather than heaps, to be solved at once
// (advance_direct.cpp), and makes ready for it.
bool prepare_direct(AdvanceScratch& s, std::span<ContactActive* const> rows, DirectSolve& d);
// Solves the rows that rest and carry something as if they could pull too and friction had no limit unless it slides already: then
// a sweep must follow, which takes back what is too much (the subspace step of Silcowitz, Niebe, Erleben 2010, "Projected
// Gauss-Seidel subspace minimization method for interactive rigid body dynamics"). False if there is no answer;
bool solve_directly(AdvanceScratch& s, std::span<ContactActive* const> rows, DirectSolve& d);
// takes the last answer back, and what sweeps have made of it since.
void undo_solution(AdvanceScratch& s, std::span<ContactActive* const> rows, const DirectSolve& d);
// What impulses that do as their rows ask make least, J: kinetic energy minus what rows that must move apart are given.
double potential(const AdvanceScratch& s, std::span<ContactActive* const> rows, const DirectSolve& d);
// Slower approach than this (m/s) does not bounce, whatever the restitution: bodies come to rest.
constexpr double kLeastBounce = 0.05;

// ---- free bodies in the hand (advance_held.cpp) ----
//
// Tools whose coupling to the hand gives way in turning too are free bodies without weight.

// Makes the row of scratch.free and the node of one.
void add_held_body(AdvanceIsland& island, uint32_t rigid_row);
// The coupling, in place of gravity and damping. It resists the rows' impulses too.
void pull_held_body(AdvanceIsland& island, AdvanceFree& f);
// Notes in ToolState what the coupling does at the end of the substep.
void note_coupling(AdvanceIsland& island, const AdvanceFree& f);

// ---- free bodies with one coordinate (advance_drive.cpp) ----
//
// Bodies that a node drives. In place of what is done with other free ones:

// Finds the drive of a row of scratch.free, if it has one.
void bind_drive(AdvanceIsland& island, uint32_t free_row);
void kick_driven(AdvanceIsland& island, AdvanceFree& f);
void move_driven(AdvanceIsland& island, AdvanceFree& f);
// Moves it by `share` of the pushes of its free sides.
void push_driven(AdvanceIsland& island, AdvanceFree& f, double share);
void restore_drive(AdvanceIsland& island, const AdvanceFree& f);
// Friction and limits of all drives, once: part of a sweep. Returns the largest change of a velocity, m/s.
double solve_drives(AdvanceScratch& s);
// The same once more after the rows, then state and books.
void settle_drives(AdvanceIsland& island);

// ---- impulses of the rows (advance_contact.cpp) and pushes (advance_push.cpp) ----

// Velocities of all particles that are nodes before the kick of the first substep; those of later ones are known.
void note_velocities(AdvanceIsland& island);
// A point has left its plane behind: the row rests from now on. Its distance keeps the sign, so that a call cut into
// shorter ones still finds the same rows inside.
inline void end_row(AdvanceIsland& island, uint32_t row) {
    double& distance = island.rows.distance[row];
    distance = std::copysign(std::numeric_limits<double>::infinity(), distance);
    std::atomic_ref(island.result.ended_rows).fetch_add(1, std::memory_order_relaxed);
}
// Finds the rows that are crossed or would be in this substep and gives them impulses; after kick and drift. Projected
// Gauss-Seidel over the active rows in their order, accumulated impulses clamped (Moreau 1988; Catto 2005): one sweep
// leaves less for push_out than sixteen Jacobi passes with mass splitting (Tonge et al. 2012) did, and where many
// points of a fine tool press few tissue triangles Jacobi lost a factor of 20 in depth. Every impulse acts on both
// sides with their inverse masses. Coulomb friction on the accumulated impulse. With free bodies: settle_rows.
void apply_impulses(AdvanceIsland& island);
// Whether rows start from what they carried in the substep before. Not where a substep has one sweep: that cannot take
// back what another row has made superfluous (one that did made a pressing tool's tissue chatter).
inline bool starts_warm(const AdvanceIsland& island) { return island.params.contact.iterations > 1 || !island.scratch.free.empty(); }
// What a row carried in the last substep before the call, N s.
inline Vec4d start_impulse(const AdvanceIsland& island, uint32_t row) {
    return island.rows.carried.empty() ? Vec4d{} : island.dt * to_vec4(island.rows.carried[row]);
}
// Moves remaining overlap of the active rows out without touching velocities, in substeps in which a millisecond begins;
// after move_hands. One sweep; where bodies share pushes by mass and no hand leads one as many as ContactParams::iterations while any
// row is left, and with more than one of these up to fifteen times as many more while one is deeper than ContactParams::tolerance and no
// deeper than push_speed removes in the substep.
void push_out(AdvanceIsland& island, uint32_t substep);
// Share of the way of a push that the side of the point goes, unless bodies share it by mass.
double share_of_point(const AdvanceIsland& island, uint32_t row);

// ---- rows in blocks of four (advance_blocks.cpp) ----
//
// Long lists of rows between deformable bodies are worked on four at a time, and where there are several groups those with
// static bodies too; each function does what its namesake for one row does. A row any of whose nodes may be pressed from both
// sides is in no block.

// Makes blocks of the rows of scratch.dealt, and plans of those that are in none.
void plan_blocks(AdvanceIsland& island);
void forget_blocks(AdvanceIsland& island);
// reach: m, infinite unless all velocities are finite.
void activate_blocks(AdvanceIsland& island, double reach, RowGroup& group);
void start_blocks(AdvanceScratch& s, const RowGroup& group);  // see start_rows
void solve_blocks(AdvanceScratch& s, const RowGroup& group);
void add_block_impulses(AdvanceScratch& s, const RowGroup& group);
// One sweep of push_out over a group.
struct PushSweep {
    double least, most;  // m: rows with less overlap stay; none is pushed farther, and after the first sweep none that is deeper
    uint8_t stamp;       // from 1, ascending: see AdvanceScratch::moved_in
    uint8_t since;       // rows and blocks none of whose nodes has moved in this sweep or a later one are passed over; 0: none is
};
// Returns whether any row was pushed.
bool push_blocks(AdvanceIsland& island, const PushSweep& sweep, const RowGroup& group);
// Deepest overlap of the active rows after the pushes, m.
double deepest_in_blocks(AdvanceScratch& s, const RowGroup& group);

// ---- groups of rows (advance_groups.cpp) ----

// Bodies are put into strips across the way they spread most; rows inside a strip are a group, rows between a strip and the
// next are another, and the few others a last one. Phases: strips; even borders; odd borders; the rest. Orders dealt by group.
// Short lists, skins, and islands with hands or driven bodies have one group.
void group_rows(AdvanceIsland& island);
// Calls run for all groups, phase by phase: those of a phase share no node and run at the same time.
template <typename Run>  // Run: void(RowGroup&)
void for_each_group(AdvanceScratch& s, const Run& run) {
    for (int phase = 0; phase < 4; ++phase) {
        const uint32_t first = s.phase[phase];
        parallel_for(s.phase[phase + 1] - first, 1, [&](uint32_t begin, uint32_t end) {
            for (uint32_t i = begin; i < end; ++i) run(s.group[first + i]);
        });
    }
}
// Whether an active row has a free side.
inline bool any_turns(const AdvanceScratch& s) {
    return std::any_of(s.group.begin(), s.group.begin() + s.phase[4], [](const RowGroup& group) { return group.turning_rows > 0; });
}
constexpr uint32_t kNodesPerChunk = 4096;

inline bool has_rows(const AdvanceScratch& s) { return !s.dealt.empty(); }

// Room for n rows; when more is needed, for twice as many: passes differ by a few rows, and fresh pages cost more than
// what is done with them.
template <typename Rows>
void make_room(Rows& rows, size_t n) {
    if (rows.capacity() < n) rows.reserve(2 * n);
}
// The same for rows that are all written before they are read: none is cleared, or moved to where there is room.
template <typename Row>
void have_rows(RawVector<Row>& rows, size_t n) {
    rows.clear();
    make_room(rows, n);
    rows.resize(n);
}

// Adds to the place of a node's particle at the end of the substep.
inline void move_particle(AdvanceBody& body, const ContactNode& node, Vec4d way) {
    float* offset = &body.next[node.particle - body.particles.first].x;
    const __m128 old = _mm_load_ps(offset);
    const __m128 moved = _mm256_cvtpd_ps((__m256d)(float_vec4(old) + way));
    _mm_store_ps(offset, _mm_blend_ps(moved, old, 8));  // w is the inverse mass
    node.after = body.origin + float_vec4(moved);
}

}  // namespace trocar
#pragma GCC diagnostic pop
