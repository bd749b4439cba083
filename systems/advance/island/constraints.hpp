#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "components/bodies.hpp"
#include "engine/base/raw_vector.hpp"
#include "engine/geometry/four_points.hpp"
#include "engine/jobs/parallel.hpp"
#include "systems/advance/island/nodes.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// ---- the three shapes of a contact constraint ----
//
// detected: an element of ContactConstraints (components/contacts.hpp), in terms of bodies and vertices.
// Lives from contact pass to contact pass.
// prepared: PreparedConstraint, of a detected constraint that is solved by itself. Lives for one call of
// advance_island.
// wide: WideConstraint, four detected constraints that share no node, in the lanes of SIMD registers. Lives
// as long.
//
// In a call each detected constraint is either prepared or a lane of a wide one. Both solve the same
// equations: the normal impulse n >= 0 brings the velocity of the point relative to the plane along the
// normal to at least `target_velocity`; Coulomb friction f with |f| <= friction * n reduces the tangential
// velocity to zero (without free bodies, with n averaged: most_friction). They differ in where friction is
// computed, and hence in the last bits:
//   solve_nodes (contact_impulses.cpp) and solve_wide_constraint (wide_constraints.cpp) read the relative
//     velocity once and apply both impulses together: one pass over the nodes;
//   solve_angular_constraint (free_bodies.cpp), for sides on free rigid bodies, applies the normal impulse and
//     reads the velocity again for friction: through the lever arms it changes the tangential velocity.

// A prepared constraint. First what sweeps read and write, in as few cache lines as possible; then what is
// constant during the call.
struct alignas(64) PreparedConstraint {
    static constexpr uint32_t kMostNodes = 24;  // a face against a triangle, both on embedded surfaces

    // For a substep in which it acts: read and written by sweeps.
    Vec4d normal;                // world
    Vec4d rigid_velocity;        // m/s, velocity of rigid sides relative to their nodes, as part of the relative velocity
    Vec4d friction_impulse;      // N s
    double normal_impulse = 0;   // N s
    double target_velocity = 0;  // m/s, along the normal
    double effective_mass = 0;   // kg, 1 / sum of weight^2 * inverse mass
    double friction = 0;         // friction coefficient
    double load = 0;             // N s, normal impulse averaged over kFrictionLag: of the preceding substeps, times 1 - load_share
    double load_share = 1;       // of this substep's normal impulse in the average
    bool averaged = true;        // the contact is older than kFrictionLag: its friction follows the average
    uint32_t nodes = 0;          // in the order of node[0, nodes): those of the point first
    uint32_t point_nodes = 0;    // how many of them are on the side of the point

    // The angular part, if a free rigid body has a side: index 0 the point's, 1 the plane's.
    struct Angular {
        std::array<uint32_t, 2> free{kNone, kNone};           // index in free
        Vec4d arm[2] = {};                                    // m, from the centre of mass to where the impulse acts
        Vec4d friction_before = {}, friction_direction = {};  // N s, before the last sweep; of the conjugate direction (nncg.cpp)
        double normal_before = 0, normal_direction = 0;       // the same for the normal
        double friction_mass = 0;                             // kg, inverse of the largest tangential response
    } angular;
    bool turns() const { return angular.free[0] != kNone || angular.free[1] != kNone; }

    // Its nodes.
    std::array<uint32_t, kMostNodes> node;
    std::array<double, kMostNodes> weight;  // of the relative velocity: + for the point, - for the plane

    // For the call. Side a is the point (on a vertex, an edge or a face), side b the plane (of a triangle).
    Vec4d point_a;  // m, body frame, if rigid
    Vec4d point_b;  // m, body frame, if rigid
    Vec4d plane;    // its normal: body frame if b is rigid, else world
    Vec4d impulse;  // N s, sum over the call
    Vec4d warm;     // N s, the warm start of the next substep: from the last substep without a bounce; zero if the constraint did not act
    std::array<double, 3> weight_a;
    std::array<double, 3> weight_b;
    double offset = 0;  // m, half the thickness of a sheet
    double friction_coefficient = 0;
    double restitution = 0;
    std::array<uint32_t, 3> node_a;  // if deformable; equal for a vertex; the third is the first except for a face; node or embedded point
    std::array<uint32_t, 3> node_b;  // if deformable; node or embedded point
    uint32_t rigid_a = kNone, rigid_b = kNone;  // index in rigid, or kNone
    uint32_t constraint = kNone;                // index in ContactConstraints
    bool ended = false;
    bool moved_plane = false;  // the plane is where the point has slid to on the rigid body

    // For position corrections.
    std::array<double, kMostNodes> correction_weight;  // as weight; the point on the plane is clamped to its triangle
    double allowed_overlap = 0;    // m, left by the corrections of this substep: sides of free bodies that are too deep for one
    double correction_offset = 0;  // m, from the plane point to where corrections act, along the normal, at the start of the substep
};

// Limits a tangential impulse to Coulomb friction.
inline Vec4d limit_friction(Vec4d friction, double most) {
    const double size2 = norm2(friction);
    return size2 > most * most ? Vec4d(friction * (most / std::sqrt(size2))) : friction;
}
// Coulomb's limit on the friction impulse. With the load averaged over time (Prakash and Clifton 1993; Ranjith and
// Rice 2001, "Slip dynamics at an interface between dissimilar materials"): with the instantaneous load, steady
// sliding of an elastic body is unstable, the finer the mesh the more, and nodes that flutter backwards take
// some of the friction away.
inline double most_friction(const PreparedConstraint& c, double normal_impulse) {
    return normal_impulse > 0 ? c.friction * (c.averaged ? c.load + c.load_share * normal_impulse : normal_impulse) : 0;
}
// The share of the next substep in that average: 1, 1/2, 1/3 ... of a new contact, whose friction follows the load itself
// until the share is down to `least`.
inline double next_load_share(double share, double least) { return std::max(least, share / (1 + share)); }
// The normal impulse that brings the normal velocity to its target, N s.
inline double corrected_normal_impulse(const PreparedConstraint& c, double approach) {
    return std::max(0.0, c.normal_impulse - (approach - c.target_velocity) * c.effective_mass);
}

// Four detected constraints between deformable bodies, or with static ones, that share no node, in the lanes
// of registers; fields as in PreparedConstraint. Parts of a constraint: 0 the point, 1 the second end of its
// edge, 2-4 the corners of the triangle. A lane without a constraint refers to the massless node and is never
// open. Fields that are used together are adjacent: from along to rest for separations after the substep,
// from node to friction_impulse for sweeps. Sweeps are limited by memory, hence floats and bits.
struct WideConstraint {
    static constexpr uint32_t kParts = 5;
    Vec4d offset = {};                                 // m, half the thickness of a sheet
    std::array<FourFloats, 3> weight;                  // of the corners of the triangle
    FourFloats along = {};                             // fraction of the edge towards its second end
    std::array<std::array<uint32_t, 4>, kParts> node;  // [part][lane]
    uint32_t fixed = kNone;                            // index in ContactSolver::fixed, if the planes are static: parts 2-4 have no nodes
    bool edges = false;                                // some constraint has a second end
    uint8_t open = 0;                                  // bits of lanes: constraints that have not expired
    uint8_t active = 0;                                // those that act in this substep, as do the fields below
    FourPoints normal;                                 // world
    std::array<Vec4d, 3> plane_weight;                 // weights of the corners in the relative velocity, negative; 0 if not active
    std::array<Vec4d, 3> correction_weight;            // likewise in position corrections
    Vec4d rest = {};                                   // m, part of the separation besides the displacement from closest point to point
    Vec4d effective_mass = {};                         // kg, 1 / sum of weight^2 * inverse mass; 0 if not active
    Vec4d target_velocity = {};                        // m/s, along the normal
    std::array<Vec4d, kParts> response;                // 1/kg, change of a part's velocity by an impulse
    Vec4d normal_impulse = {};                         // N s
    FourFloats friction = {};                          // coefficient, of the call
    FourFloats load = {}, load_share = {};             // N s; as in PreparedConstraint
    std::array<uint32_t, 4> constraint;                // index in ContactConstraints, or kNone
    FourPoints friction_impulse;                       // N s
    FourPoints impulse;                                // N s, sum over the call
};

// Corners of the triangles of four static planes, m, world.
struct FixedTriangles {
    std::array<FourPoints, 3> corner;
};

// Change of the constraints with a free side in a sweep.
struct SweepChange {
    double velocity = 0;         // m/s, the largest change of a relative velocity
    double squared_impulse = 0;  // (N s)^2, sum over all impulses
};

// Where a constraint presses the nodes of its point; those of its plane the other way.
struct PressingDirection {
    Vec4d direction;  // unit, world
    uint32_t constraint;
};

// Constraints that are solved one after the other. Groups of one colour share no node and may be solved in
// parallel.
struct ConstraintGroup {
    Range prepared, wide_constraint;          // indices in ContactSolver::prepared and wide_constraint
    std::vector<uint32_t> active;             // indices in prepared: those that act in this substep, ascending
    std::vector<uint32_t> active_wide;        // indices in wide_constraint: likewise
    Range fixed;                              // indices in ContactSolver::fixed: for its last wide constraints
    uint32_t massless_node = 0;               // of its wide constraints' unused lanes
    uint32_t angular_count = 0;               // of active: those with a free side
    uint32_t active_lanes = 0;                // acting constraints in active_wide
    SweepChange change;                       // by the last sweep
    std::vector<PressingDirection> pressing;  // of find_tangled_nodes
    Range slabs;                              // of the bodies that its constraints may touch; groups without a common slab share no node
    uint8_t corrected_in = 0;                 // last sweep of correct_positions, from 1, that moved one of its nodes; 0: none
    double deepest = 0;                       // m, overlap after the last substep
};

// The contact constraints of an island during a call.
struct ContactSolver {
    std::vector<PreparedConstraint> prepared;
    RawVector<WideConstraint> wide_constraint;
    RawVector<FixedTriangles> fixed;     // of the wide constraints with static planes
    std::vector<ConstraintGroup> group;  // the first ones are in use, see colour
    std::array<uint32_t, 5> colour{};    // first group of each colour, and the number of groups
    bool starts_warm = false;            // constraints start from their impulses of the preceding substep
    double load_share = 1;               // the least one of constraints
    bool bounces = false;                // a constraint bounces in this substep: the next does not start from its impulses
};

// Calls run for all groups, colour by colour: groups of one colour share no node and run in parallel.
template <typename Run>  // Run: void(ConstraintGroup&)
void for_each_group(ContactSolver& solver, const Run& run) {
    for (int colour = 0; colour < 4; ++colour) {
        const uint32_t first = solver.colour[colour];
        parallel_for(solver.colour[colour + 1] - first, 1, [&](uint32_t begin, uint32_t end) {
            for (uint32_t i = begin; i < end; ++i) run(solver.group[first + i]);
        });
    }
}
// Whether an active constraint has a free side.
inline bool any_angular(const ContactSolver& solver) {
    return std::any_of(solver.group.begin(), solver.group.begin() + solver.colour[4],
                       [](const ConstraintGroup& group) { return group.angular_count > 0; });
}

}  // namespace trocar
#pragma GCC diagnostic pop
