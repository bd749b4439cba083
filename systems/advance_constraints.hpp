#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "components/bodies.hpp"
#include "engine/geometry/four_points.hpp"
#include "engine/parallel.hpp"
#include "engine/raw_vector.hpp"
#include "systems/advance_nodes.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// ---- the three shapes of a contact constraint ----
//
// detected: a row of ContactRows (components/contacts.hpp), in numbers of bodies and vertices. Lives from contact pass to contact pass.
// prepared: PreparedConstraint, one for every detected constraint that is solved by itself. Lives for one call of advance_island.
// wide: ContactBlock, four detected constraints that share no node, in the lanes of registers. Likewise.
//
// In a call each detected constraint is either prepared or in one lane of a wide one. Both solve the same equations: the normal impulse
// n >= 0 brings the velocity of the point relative to the plane along the normal to at least `least_velocity`; Coulomb friction f with
// |f| <= friction * n takes the velocity across the normal away. Where friction is taken differs, and so do the last bits:
//   solve_nodes (advance_contact.cpp) and solve_block (advance_blocks.cpp) read the relative velocity once, before both impulses, and
//       give them together: one pass over the nodes
//   solve_turning_row (advance_free.cpp), where a free rigid body has a side, gives the normal impulse first and reads the velocity
//       again for friction: through the arms an impulse along the normal changes the velocity across it
//   judge_held_rows (advance_hold.cpp), within an implicit step, lowers the viscous friction `grip` until it is within the limit

// A prepared constraint. First what sweeps read and write, in as few cache lines as it takes; then what is known for the call.
struct alignas(64) PreparedConstraint {
    static constexpr uint32_t kMostNodes = 24;  // a face against a triangle, both of skins

    // For a substep in which it acts: what sweeps read and write.
    Vec4d normal;               // world
    Vec4d rigid_velocity;       // m/s, what rigid sides add to the relative velocity besides their nodes
    Vec4d friction_impulse;     // N s
    double normal_impulse = 0;  // N s
    double least_velocity = 0;  // m/s, along the normal
    double inv_sum = 0;         // kg, 1 / sum of weight^2 * inverse mass
    double friction = 0;        // its coefficient; more if an implicit step has given more
    uint32_t nodes = 0;         // with the weights of node[0, nodes), of the point first
    uint32_t point_nodes = 0;   // how many of them are on the side of the point

    // The angular part, if a free rigid body has a side: index 0 the point's, 1 the plane's.
    struct Angular {
        std::array<uint32_t, 2> free{kNone, kNone};     // rows of free
        Vec4d arm[2] = {};                              // m, from the centre of mass to where the impulse acts
        Vec4d friction_before = {}, friction_way = {};  // N s, before the last sweep; of the conjugate direction (advance_settle.cpp)
        double normal_before = 0, normal_way = 0;       // the same of the normal
        double friction_mass = 0;                       // kg, inverse of the largest response across the normal
    } angular;
    bool turns() const { return angular.free[0] != kNone || angular.free[1] != kNone; }

    // Its nodes.
    std::array<uint32_t, kMostNodes> node;
    std::array<double, kMostNodes> weight;  // of the relative velocity: + for the point, - for the plane

    // For the call. Side a is the point (of a vertex, an edge or a face), side b the plane (of a triangle).
    Vec4d point_a;  // m, body frame, if rigid
    Vec4d point_b;  // m, body frame, if rigid
    Vec4d plane;    // its normal: body frame if b is rigid, else world
    Vec4d impulse;  // N s, given so far in the call
    Vec4d warm;     // N s, that the next substep starts from: of the last in which nothing bounced; zero if the constraint did not act
    std::array<double, 3> weight_a;
    std::array<double, 3> weight_b;
    double offset = 0;  // m, half the thickness of a sheet
    double friction_coefficient = 0;
    double restitution = 0;
    std::array<uint32_t, 3> node_a;  // if deformable; equal for a vertex; the third is the first but for a face; node or skin point
    std::array<uint32_t, 3> node_b;  // if deformable; node or skin point
    uint32_t rigid_a = kNone, rigid_b = kNone;  // rows of rigid, or kNone
    uint32_t row = kNone;                       // of ContactRows
    bool ended = false;

    // For position corrections.
    std::array<double, kMostNodes> push_weight;  // as weight; the point on the plane stays on its triangle
    double push_gap = 0;  // m, from the plane point to where pushes act, along the normal, at the start of the substep

    // How it acts within the implicit step of its body (advance_hold.cpp).
    struct Implicit {
        uint32_t owner = 0;                      // row of body
        bool on = false;                         // it presses
        double stiffness = 0, grip = 0;          // kg, impulse per velocity along the normal and across
        Vec4d velocity = {}, end_velocity = {};  // m/s, of the point relative to the plane, before and after the step
    } implicit;
    Vec4d held;  // N s, what the implicit step of this substep gave to the point
};

// Shortens an impulse across the normal to the most that Coulomb friction may give.
inline Vec4d limit_friction(Vec4d friction, double most) {
    const double size2 = norm2(friction);
    return size2 > most * most ? Vec4d(friction * (most / std::sqrt(size2))) : friction;
}
// The normal impulse that brings the velocity along the normal to the one wanted, N s.
inline double corrected_normal_impulse(const PreparedConstraint& c, double approach) {
    return std::max(0.0, c.normal_impulse - (approach - c.least_velocity) * c.inv_sum);
}

// Four contact rows of deformable bodies, between each other or with static ones, that share no node, in the lanes of
// registers: what PreparedConstraint says of one. Parts of a row: 0 the point, 1 the second end of its edge, 2-4 the
// corners of the triangle. A lane without a row points to the node of no mass and is never open.
// What is asked for together is together: from along to rest what gaps after the substep need, from node to friction_impulse what sweeps
// do. Sweeps wait for memory: what is a float or a bit is kept as one.
struct ContactBlock {
    static constexpr uint32_t kParts = 5;
    Vec4d offset = {};                                 // m, half the thickness of a sheet
    std::array<FourFloats, 3> weight;                  // of the corners of the triangle
    FourFloats along = {};                             // part of the way to the second end
    std::array<std::array<uint32_t, 4>, kParts> node;  // part, lane
    uint32_t fixed = kNone;                            // row of ContactSolver::fixed, if the planes are static: parts 2-4 have no nodes
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

// What a sweep changed of rows with a free side.
struct SweepChange {
    double velocity = 0;         // m/s, the largest of a relative velocity
    double squared_impulse = 0;  // (N s)^2, the sum over all impulses
};

// Rows that are worked on one after the other. Where an island has more than one group, groups of a phase share no node
// and may be worked on at the same time.
struct RowGroup {
    Range prepared, block;               // rows of ContactSolver::prepared, block
    std::vector<uint32_t> active;        // rows of prepared that act in this substep, ascending
    std::vector<uint32_t> active_block;  // rows of block that do
    Range fixed;                         // rows of ContactSolver::fixed: of its last blocks
    uint32_t idle = 0;                   // node of no mass, for its blocks
    uint32_t turning_rows = 0;           // of active, that have a free side
    uint32_t active_lanes = 0;           // constraints that act in active_block
    SweepChange change;                  // by the last sweep, of them
    Range strips;                        // whose bodies its rows may touch; groups without a strip in common share no node
    uint8_t pushed_in = 0;               // last sweep of push_out, from 1, that moved a node of it; 0: none
    double deepest = 0;                  // m, overlap left by the last substep
};

// The contact constraints of an island during a call.
struct ContactSolver {
    std::vector<PreparedConstraint> prepared;
    RawVector<ContactBlock> block;
    RawVector<FixedTriangles> fixed;  // of the blocks with static planes
    std::vector<RowGroup> group;      // the first of them are in use, see phase
    std::array<uint32_t, 5> phase{};  // first group of each phase, and their number
    std::vector<uint32_t> held;       // rows of prepared that may act within implicit steps, as a substep starts
    bool starts_warm = false;         // constraints start from their impulses of the substep before
    bool bounces = false;             // one bounces in this substep: the next does not start from its impulses
};

// Calls run for all groups, phase by phase: those of a phase share no node and run at the same time.
template <typename Run>  // Run: void(RowGroup&)
void for_each_group(ContactSolver& solver, const Run& run) {
    for (int phase = 0; phase < 4; ++phase) {
        const uint32_t first = solver.phase[phase];
        parallel_for(solver.phase[phase + 1] - first, 1, [&](uint32_t begin, uint32_t end) {
            for (uint32_t i = begin; i < end; ++i) run(solver.group[first + i]);
        });
    }
}
// Whether an active row has a free side.
inline bool any_turns(const ContactSolver& solver) {
    return std::any_of(solver.group.begin(), solver.group.begin() + solver.phase[4],
                       [](const RowGroup& group) { return group.turning_rows > 0; });
}

}  // namespace trocar
#pragma GCC diagnostic pop
