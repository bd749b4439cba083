#pragma once
#include <utility>
#include <vector>

#include "engine/tet_forces.hpp"
#include "systems/advance_constraints.hpp"
#include "systems/advance_island.hpp"
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"
namespace trocar {

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

// Memory of steps of deformable bodies.
struct TissueScratch {
    RawVector<Float4> offset_a, offset_b;              // the two buffers of a substep, bodies of the island one after the other
    std::vector<float> remainder;                      // 3 fields, rows as the buffers; for bodies that carry_remainder
    std::vector<float> force;                          // N, 3 fields, rows as the buffers; only if a body has_forces
    std::vector<double> force_sums;                    // per chunk, of one family at a time
    std::vector<Float4> corner_force;                  // N, of the tetrahedra of one body
    std::vector<Float4> hinge_force;                   // of one body that bends
    std::vector<double> sums;                          // per chunk of slices: 16 lanes of damping work
    std::vector<double> shape_sums;                    // per chunk of slices: kShapeSums * 16
    std::vector<std::vector<double>> body_shape_sums;  // as shape_sums, per chunk of bodies
    ImplicitScratch implicit;
    std::vector<uint8_t> touched;        // per body of the world: finer_steps; only if the island has solids
    std::vector<uint8_t> overstretched;  // per chunk of slices of one body: some spring is
};

// Where a detected constraint goes, while wide constraints are formed (graph colouring: four that share no node).
struct RowSketch {
    std::array<uint32_t, 6>
        node;            // point, second end of its edge, corners of the triangle, third corner of a face; kNone: no particle, or a skin's
    uint32_t block = 0;  // if in a block: which of its group,
    uint8_t lane = 0;    // and where in it
    uint8_t kind = 0;    // rows of a kind share blocks; kSingle: none
    static constexpr uint8_t kSingle = 255;
};

// Memory of the order in which constraints are solved: groups, and blocks of four.
struct ContactSorting {
    std::vector<uint32_t> dealt, ungrouped;          // rows of ContactRows, in the order of prepared before blocks are made
    std::vector<uint32_t> strip;                     // per row of body and then of free
    std::vector<std::pair<double, uint32_t>> along;  // m, row of strip: bodies in the order of strips
    std::vector<uint32_t> group_of_row, next_of_group;
    RawVector<RowSketch> sketch;                // as dealt, while blocks are filled
    std::vector<uint8_t> may_oppose;            // per node: constraints may press it from both sides: none of them is in a block
    std::vector<uint16_t> open_blocks_of_node;  // while blocks are filled: which of those open have it; as node
    bool static_planes = false;                 // constraints with static bodies may be in blocks
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

// Memory of settle_rows: the active constraints, component by component.
struct ContactComponents {
    std::vector<PreparedConstraint*> settling;
    std::vector<Range> component;        // rows of settling
    std::vector<uint32_t> component_of;  // per node: of its component, while that is solved its row of DirectSolve::body
    std::vector<DirectSolve> direct;     // per chunk of components
};

// Reused memory of advance_island, one per thread that may run it. Its content means nothing between calls.
struct AdvanceScratch {
    AdvanceIsland island;
    ContactSolver solver;
    ContactSorting sorting;
    ContactComponents components;
    TissueScratch tissue;
};

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

}  // namespace trocar
#pragma GCC diagnostic pop
