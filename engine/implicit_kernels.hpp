#pragma once
#include "engine/spring_kernels.hpp"
namespace trocar {

// One linearised implicit step of one body, of midpoint with t = theta = 1/2: (M + t^2 h^2 K) dv = h f(x + t h v), v' =
// v + dv, x' = x + h v + t h dv, solved by conjugate gradients with the inverse 3 x 3 diagonal blocks before it. K = sum over springs of
// k (a I + (1 - a) d d^T) with a = max(0, 1 - rest / length): the Hessian without what squeezed springs take from it,
// so that the matrix stays positive (Teran et al., SCA 2005). Forces, goals and K are taken at x + t h v: then what the
// linearisation leaves out is of second order in h. Plain C types, as in spring_kernels.hpp.
struct ImplicitStep {
    const SpringStep* spring;  // offset: the start; new_offset, new_velocity: the end; force_*: taken as they are
    float* place;              // 4 per particle: x + theta h v, m; w = inverse mass
    float* direction;          // 4 per particle, m/s
    float* spoke;              // 64 per column: direction * sqrt(1 - a) in x, y, z, then a
    float* block;              // 6 fields of `rows`: inverse of the diagonal block, xx yy zz xy xz yz
    float* residual;           // 3 fields of `rows`, N s
    float* applied;            // 3 fields
    float* change;             // 3 fields: dv, m/s
    unsigned rows;             // particles, padded to 16
    float theta;               // 1/2: midpoint; 1: backward Euler
    float keep_before, keep_after;  // shares of the velocity relative to the drag left by damping before and after
    float rigid_velocity[3];        // of the goals of a free body under `direction`: rigid_velocity + rigid_turn x place
    float rigid_turn[3];
};

// One step of extended position based dynamics (Macklin, Mueller, Chentanez, MIG 2016) of one body. The increments of
// the step are kept apart from the places: their sum is rounded once, at the end, and steps of 0.1 ms keep their digits.
struct XpbdStep {
    const SpringStep* spring;   // offset: the start; new_offset, new_velocity: the end; kick_dt, keep, drag, force_*
    float* place;               // 4 per particle and 32 rows of padding: the start, m; w = inverse mass
    float* increment;           // as place, m
    const unsigned* ends;       // 32 per batch
    const float* rest;          // 16 per batch, m
    float* lambda;              // 16 per batch, N s^2; null with one sweep
    float* anchor_lambda;       // 3 fields of `rows`; null with one sweep
    unsigned rows;              // particles, padded to 16
    float compliance;           // 1 / (stiffness dt^2), m/(N s^2)
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

    // Xpbd: damping, gravity and other forces, first increments of slices, and the places they lead to in new_offset;
    // adds the work of damping, J.
    void (*xpbd_predict)(const XpbdStep* step, unsigned first, unsigned last, double* sums);
    // Springs of batches of one colour; anchors of slices.
    void (*xpbd_springs)(const XpbdStep* step, unsigned first, unsigned last);
    void (*xpbd_anchors)(const XpbdStep* step, unsigned first, unsigned last);
    // Velocities and places of slices.
    void (*xpbd_finish)(const XpbdStep* step, unsigned first, unsigned last);
};

extern const ImplicitKernels kImplicitKernelsAvx2;
extern const ImplicitKernels kImplicitKernelsAvx512;
const ImplicitKernels& implicit_kernels();

}  // namespace trocar
