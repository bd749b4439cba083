#pragma once
#include <array>
#include <utility>
#include <vector>

#include "engine/tissue/implicit_factor.hpp"
#include "systems/advance/island/constraints.hpp"
#include "systems/advance/island/island.hpp"
#include "systems/advance/island/swept.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

// Scratch of an implicit step of one body; one element per particle.
struct ImplicitScratch {
    static constexpr uint32_t kHistory = 6;  // iterates of a step that are combined
    // Anderson's acceleration: differences of consecutive iterates, changes and forces. products: of changes with forces.
    struct Acceleration {
        uint32_t iteration = 0, kept = 0;
        double products[kHistory][kHistory] = {};
    };
    using Symmetric = std::array<float, 6>;                              // xx yy zz xy xz yz
    std::vector<Float4> position, inertia, displacement;                 // m, of an iterate
    std::vector<Float4> force, change;                                   // N; m, by the next plain iteration
    std::vector<Float4> volume_gradient, volume_response;                // m^2; m^3/N: of the enclosed volume
    std::array<std::vector<Float4>, kHistory> iterate, changes, forces;  // differences of consecutive ones
    std::vector<float> rate, still;                                      // 3 fields, m/s^2; zeros
    std::vector<float> volume_force;                                     // 3 fields, N, of tetrahedra in finer steps
    std::vector<double> sums;                                            // 16 per chunk, likewise
    // Of a body in contact, from the start of its step to the end.
    Acceleration acceleration;
    std::vector<Symmetric> metric, response;  // N/m; m/N, its inverse: of each particle alone
    double energy = 0, damped = 0;            // J, before the step; work of damping in it
    double contact = 0, work = 0;             // J, of contact in the step; energy that nothing accounts for
    double volume_share = 0;                  // 1/J: of the pressure's part of the inverse; 0 = no pressure
};

// Memory of steps of deformable bodies.
struct TissueScratch {
    RawVector<Float4> offset_a, offset_b;              // the two buffers of a substep, bodies of the island one after the other
    std::vector<float> remainder;                      // 3 fields, indexed as the buffers; for bodies that carry_remainder
    std::vector<float> force;                          // N, 3 fields, indexed as the buffers; only if a body has_forces
    std::vector<float> velocity_before;                // m/s, 3 fields, indexed as the buffers; only in scenes where instruments act
    std::vector<double> force_sums;                    // per chunk, of one family at a time
    std::vector<Float4> corner_force;                  // N, of the tetrahedra of one body
    std::vector<Float4> hinge_force;                   // of one body with bending
    std::vector<double> sums;                          // per chunk of slices: 16 lanes of damping work
    std::vector<double> shape_sums;                    // per chunk of slices: kShapeSums * 16
    std::vector<std::vector<double>> body_shape_sums;  // as shape_sums, per chunk of bodies
    std::vector<ImplicitFactor> factor;                // of the bodies met so far
    ImplicitScratch implicit;                          // of the body being stepped, if nothing touches it
    std::vector<ImplicitScratch> touched;              // of the others
    std::vector<uint8_t> overstretched;                // per chunk of slices of one body: it has an overlong spring
};

// Where a detected constraint is put while wide constraints are formed: four that share no node.
struct ConstraintKey {
    std::array<uint32_t, 6>
        node;           // point, second end of its edge, corners of the triangle, third corner of a face; kNone: no particle, or embedded
    uint32_t wide = 0;  // if in a wide constraint: its index in the group,
    uint8_t lane = 0;   // and its lane
    uint8_t kind = 0;   // wide constraints hold one kind; kSingle: scalar
    static constexpr uint8_t kSingle = 255;
};

// Memory for the order in which constraints are solved: groups, and wide constraints.
struct ContactSorting {
    std::vector<uint32_t> order,
        ungrouped;  // indices in ContactConstraints, in the order of ContactSolver::prepared before wide constraints are formed
    std::vector<uint32_t> slab;                      // per element of body and then of free
    std::vector<std::pair<double, uint32_t>> along;  // m, index of slab: bodies in the order of slabs
    std::vector<uint32_t> group_of_constraint, next_of_group;
    RawVector<ConstraintKey> key;             // as ordered, while wide constraints are filled
    std::vector<uint8_t> may_conflict;        // per node: constraints may press it from opposite sides, so none of them is in a wide one
    std::vector<uint16_t> open_wide_of_node;  // while packing: the open wide constraints that contain it; per node
    bool static_planes = false;               // constraints with static bodies may be wide
};

// Equations of a few stacked free bodies: six unknowns per body, velocity and then spin; stores the lower
// half from the body's first neighbour on.
struct DirectSolve {
    static constexpr uint32_t kMostBodies = 64;
    std::vector<uint32_t> body, ordered;  // indices in free
    std::vector<uint32_t> first;          // per body: its first neighbour
    std::vector<uint32_t> begin;          // per body: offset of its rows in matrix
    std::vector<double> matrix;           // kg, kg m, kg m^2
    std::vector<double> solution;         // of the right-hand side, N s and N m s, then velocity changes, m/s and rad/s
    std::vector<Vec4d> impulse;           // N s, per constraint
    struct Motion {
        Vec4d velocity, spin;  // m/s, rad/s
    };
    struct Impulse {
        Vec4d friction;  // N s
        double normal;   // N s
    };
    std::vector<Motion> before;           // the last solution, per body
    std::vector<Impulse> impulse_before;  // and per constraint

    uint32_t first_column(uint32_t row) const { return 6 * first[row / 6]; }
    // Indexed by column, from first_column on.
    double* row(uint32_t r) {
        const uint32_t b = r / 6;
        return matrix.data() + begin[b] + (r % 6) * 6 * (b - first[b] + 1) - 6 * first[b];
    }
};

// Memory of solve_to_convergence: the active constraints, component by component.
struct ContactComponents {
    std::vector<PreparedConstraint*> sorted_active;
    std::vector<Range> component;        // ranges of sorted_active
    std::vector<uint32_t> component_of;  // per node: its component, or during that one's solve its index in DirectSolve::body
    std::vector<DirectSolve> direct;     // per chunk of components
    RigidSweeps sweeps;
};

// Reused memory of advance_island, one per thread that may run it. Contents are meaningless between calls.
struct AdvanceScratch {
    AdvanceIsland island;
    ContactSolver solver;
    ContactSorting sorting;
    ContactComponents components;
    TissueScratch tissue;
};

// Reserves n elements; if more are needed, twice as many: passes differ by a few constraints, and fresh pages
// cost more than the work on them.
template <typename Array>
void make_room(Array& array, size_t n) {
    if (array.capacity() < n) array.reserve(2 * n);
}
// The same if all elements are written before they are read: none is cleared or moved.
template <typename Element>
void resize_raw(RawVector<Element>& array, size_t n) {
    array.clear();
    make_room(array, n);
    array.resize(n);
}

}  // namespace trocar
#pragma GCC diagnostic pop
