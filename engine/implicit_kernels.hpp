#pragma once
#include "engine/spring_kernels.hpp"
#include "engine/tet_kernels.hpp"
namespace trocar {

// One linearised implicit step of one body, of midpoint with t = theta = 1/2: (M + t^2 h^2 K) dv = h f(x + t h v), v' =
// v + dv, x' = x + h v + t h dv, solved by conjugate gradients with the inverse 3 x 3 diagonal blocks before it. K = sum over springs of
// k (a I + (1 - a) d d^T) with a = max(0, 1 - rest / length): the Hessian without what squeezed springs take from it,
// so that the matrix stays positive (Teran et al., SCA 2005). Forces, goals and K are taken at x + t h v: then what the
// linearisation leaves out is of second order in h. Tetrahedra add V psi'' g g^T with g the gradient of J (tet_kernels.hpp):
// nothing where pressure stays as it is. The rest of their Hessian, V psi' times that of J, has both signs: springs take its
// place that are at least as large whatever moves. 6 V J is d1 . (d2 x c) + d2 . (d3 x a) + d3 . (d1 x b) in second order,
// d of corners 1, 2, 3 from corner 0, a, b, c the edges there: at most |c| (d1^2 + d2^2) / 2 + |a| (d2^2 + d3^2) / 2 + ...;
// so |psi'| / 6 (|b| + |c|) from corner 0 to 1, and round. (Without it crushed bodies run away at long steps. A matrix that
// is off by any bounded amount leaves the step of second order.) Plain C types, as in spring_kernels.hpp.
struct ImplicitStep {
    const SpringStep* spring;       // offset: the start; new_offset, new_velocity: the end; force_*: taken as they are
    float* place;                   // 4 per particle: x + theta h v, m; w = inverse mass
    float* direction;               // 4 per particle, m/s
    float* spoke;                   // 64 per column: direction * sqrt(1 - a) in x, y, z, then a
    float* block;                   // 6 fields of `rows`: inverse of the diagonal block, xx yy zz xy xz yz
    float* residual;                // 3 fields of `rows`, N s
    float* applied;                 // 3 fields
    float* change;                  // 3 fields: dv, m/s
    unsigned rows;                  // particles, padded to 16
    float theta;                    // 1/2: midpoint; 1: backward Euler
    float keep_before, keep_after;  // shares of the velocity relative to the drag left by damping before and after
    float rigid_velocity[3];        // of the goals of a free body under `direction`: rigid_velocity + rigid_turn x place
    float rigid_turn[3];
    const float* volume_force;  // 3 fields, N, of tetrahedra at `place`; null = none
    const float* volume_block;  // 6 fields as block, N/m, of their stiffness
    const float* volume_pull;   // 3 fields, N s/m, their stiffness times `direction`
};

// Tetrahedra of a body in an implicit step; groups of 16 as in TetStep, results in its corner_force, to be gathered.
struct ImplicitTets {
    const TetStep* tets;     // offset: the places of the step
    const float* direction;  // 4 per node
    float* slope;            // 12 fields of `tets->tetrahedra`: sqrt(V psi'') g at corners 1, 2 and 3; springs from corner 0 to them
};

// Same bits from both instruction sets. `sums` (16 doubles) is added to lane by lane.
struct ImplicitKernels {
    // Damping before, and the places theta of a step on. Adds the work of damping, J.
    void (*predict)(const ImplicitStep* step, unsigned first, unsigned last, double* sums);
    // Springs at `place`, right-hand side, blocks, first direction. Adds residual . (block residual).
    void (*begin)(const ImplicitStep* step, unsigned first, unsigned last, double* sums);
    // applied = matrix direction. Adds direction . applied.
    void (*apply)(const ImplicitStep* step, unsigned first, unsigned last, double* sums);
    // change += a direction, residual -= a applied. Adds residual . (block residual).
    void (*move)(const ImplicitStep* step, float a, unsigned first, unsigned last, double* sums);
    // direction = block residual + b direction.
    void (*turn)(const ImplicitStep* step, float b, unsigned first, unsigned last);
    // New velocities and places, damping after. Adds its work, J.
    void (*finish)(const ImplicitStep* step, unsigned first, unsigned last, double* sums);

    // Slopes at the places and, in corner_force, the diagonal of the corners' stiffness: xx yy zz; then the rest: xy xz yz.
    void (*tet_slopes)(const ImplicitTets* step, unsigned first, unsigned last);
    void (*tet_blocks)(const ImplicitTets* step, unsigned first, unsigned last);
    // In corner_force: stiffness times direction.
    void (*tet_pull)(const ImplicitTets* step, unsigned first, unsigned last);
};

extern const ImplicitKernels kImplicitKernelsAvx2;
extern const ImplicitKernels kImplicitKernelsAvx512;
const ImplicitKernels& implicit_kernels();

}  // namespace trocar
