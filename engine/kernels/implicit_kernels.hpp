#pragma once
#include "engine/kernels/spring_kernels.hpp"
#include "engine/kernels/tet_kernels.hpp"
namespace trocar {

// One linearised implicit step of one body, of midpoint with t = theta = 1/2: (M + t^2 h^2 K) dv = h f(x + t
// h v), v' = v + dv, x' = x + h v + t h dv, solved by conjugate gradients with the inverse 3 x 3 diagonal
// blocks as preconditioner. K = sum over springs of k (a I + (1 - a) d d^T) with a = max(0, 1 - rest /
// length): the Hessian without the negative part of compressed springs, so that the matrix stays positive
// definite (Teran et al., SCA 2005). Forces, goals and K are evaluated at x + t h v: then the error of the
// linearisation is of second order in h.
// Tetrahedra add V psi'' g g^T with g the gradient of J (tet_kernels.hpp): zero for constant pressure. The
// rest of their Hessian, V psi' times that of J, is indefinite; it is replaced by springs that bound it for
// every motion. 6 V J is d1 . (d2 x c) + d2 . (d3 x a) + d3 . (d1 x b) in second order, d of corners 1, 2, 3
// from corner 0, a, b, c the edges there: at most |c| (d1^2 + d2^2) / 2 + |a| (d2^2 + d3^2) / 2 + ...; so
// |psi'| / 6 (|b| + |c|) from corner 0 to 1, and cyclically. (Without it crushed bodies become unstable at
// long steps. A bounded error of the matrix leaves the step of second order.)
// Plain C types, as in spring_kernels.hpp.
struct ImplicitStep {
    const SpringStep* spring;       // offset: at the start; new_offset, new_velocity: at the end; force_*: unchanged
    float* position;                // 4 per particle: x + theta h v, m; w = inverse mass
    float* direction;               // 4 per particle, m/s
    float* spring_direction;        // 64 per column: direction * sqrt(1 - a) in x, y, z, then a
    float* block;                   // 6 fields: inverse of the diagonal block, xx yy zz xy xz yz
    float* residual;                // 3 fields, N s
    float* applied;                 // 3 fields
    float* change;                  // 3 fields: dv, m/s
    unsigned padded_count;          // length of a field: particles, padded to 16
    float theta;                    // 1/2: midpoint; 1: backward Euler
    float keep_before, keep_after;  // fractions of the velocity relative to the drag that damping leaves before and after the step
    float rigid_velocity[3];        // of the goals of a free body under `direction`: rigid_velocity + rigid_turn x position
    float rigid_turn[3];
    const float* volume_force;  // 3 fields, N, of tetrahedra at `position`; null = none
    const float* volume_block;  // 6 fields as block, N/m, of their stiffness
    const float* volume_pull;   // 3 fields, N s/m, their stiffness times `direction`
};

// Tetrahedra of a body in an implicit step; groups of 16 as in TetStep, with results in its corner_force.
struct ImplicitTets {
    const TetStep* tets;     // offset: the positions of the step
    const float* direction;  // 4 per node
    float* slope;            // 12 fields of `tets->tetrahedra`: sqrt(V psi'') g at corners 1, 2 and 3; springs from corner 0 to them
};

// Same bits from both instruction sets. `sums` (16 doubles) is incremented lane by lane.
struct ImplicitKernels {
    // Damping before the step, and the positions after a fraction theta of it. Adds the work of damping, J.
    void (*predict)(const ImplicitStep* step, unsigned first, unsigned last, double* sums);
    // Springs at `position`, right-hand side, blocks, first direction. Adds residual . (block residual).
    void (*begin)(const ImplicitStep* step, unsigned first, unsigned last, double* sums);
    // applied = matrix direction. Adds direction . applied.
    void (*apply)(const ImplicitStep* step, unsigned first, unsigned last, double* sums);
    // change += a direction, residual -= a applied. Adds residual . (block residual).
    void (*move)(const ImplicitStep* step, float a, unsigned first, unsigned last, double* sums);
    // direction = block residual + b direction.
    void (*turn)(const ImplicitStep* step, float b, unsigned first, unsigned last);
    // New velocities and positions, damping after the step. Adds its work, J.
    void (*finish)(const ImplicitStep* step, unsigned first, unsigned last, double* sums);

    // Slopes at the positions and, in corner_force, the diagonal of the corners' stiffness: xx yy zz; then
    // the rest: xy xz yz.
    void (*tet_slopes)(const ImplicitTets* step, unsigned first, unsigned last);
    void (*tet_blocks)(const ImplicitTets* step, unsigned first, unsigned last);
    // In corner_force: stiffness times direction.
    void (*tet_pull)(const ImplicitTets* step, unsigned first, unsigned last);
};

extern const ImplicitKernels kImplicitKernelsAvx2;
extern const ImplicitKernels kImplicitKernelsAvx512;
const ImplicitKernels& implicit_kernels();

}  // namespace trocar
