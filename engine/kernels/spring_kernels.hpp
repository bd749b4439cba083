#pragma once
namespace trocar {

// One leapfrog substep of slices of one body. Plain C types only: the kernels are compiled for their own
// instruction set, and inline code in them would replace the copy of all other files. All arrays are those of
// one body, 16 elements per slice.
struct SpringStep {
    const float* offset;                                      // 4 per particle, m; w = inverse mass 1/kg
    float* new_offset;                                        // 4 per particle
    const float *velocity_x, *velocity_y, *velocity_z;        // m/s, half a step behind
    float *new_velocity_x, *new_velocity_y, *new_velocity_z;  // may be the same arrays
    float *remainder_x, *remainder_y, *remainder_z;           // m, rounding errors of the positions (compensated summation); may be null
    const unsigned* slice_column;                             // slices + 1
    const unsigned* neighbour;                                // 16 per column: particle at the far end, itself = padding
    const float* rest_length;                                 // 16 per column, m
    const unsigned short* packed;                 // 32 per column from first_column on, see Springs::packed; null = use the two above
    const float* spring_factor;                   // 16 per column: stiffness of a spring / `stiffness`; null = 1
    const float* anchor_stiffness;                // N/m
    const float *anchor_x, *anchor_y, *anchor_z;  // rest position, m
    const float *force_x, *force_y, *force_z;     // N, all forces except springs and anchors; may be null
    float turn[9];                                // row-major: anchor goal = centre + turn * rest
    float turn_rest[9];                           // rounding error of turn in float: without it the goals would rotate the body
    float centre[3];                              // m, high part of the goal of a rest position of zero
    float centre_rest[3];                         // m, rounding error of centre in float
    float stiffness;                              // N/m, of every spring, times its factor
    float dt;                                     // s, of the drift
    long remainder_step;                          // from a remainder to its place after the step; not 0 = stiff: forces see remainders
    unsigned first_column;
    float rest_unit;         // m, of packed
    float kick_dt;           // s, mean of this and the preceding substep, times the mean fraction of an impulse that damping leaves
    float kick_less;         // s, kick_dt - that mean: damping's share of the kick, for damping_work
    float gravity[3];        // m/s^2
    float keep;              // remaining fraction of the velocity relative to the drag velocity, exp(-damping kick_dt)
    float drag_velocity[3];  // m/s, drag velocity = drag_velocity + drag_turn x offset
    float back;              // s, shape_sums and energy_sums use offset - back * velocity
    float drag_turn[3];      // rad/s
    unsigned other_law;      // 1: springs exert no elastic force, another law does
    // Maxwell elements next to the springs, see Relaxation; none if branches is 0. From the evaluation before to this one, d being the
    // change of the stretch: q = q - lost q + gain d.
    unsigned branches;   // at most 4
    float* stretch;      // m, one per half-edge from first_column on
    float* overstretch;  // m, likewise; branch by branch
    long branch_stride;  // elements from one branch to the next
    float lost[4];       // 1 - exp(-s), s = time between / relaxation time
    float gain[4];       // share of the stiffness * lost / s
    float stored[4];     // 1 / (2 share): energy / (stiffness q^2)
    float heat[4][3];    // energy lost in between / stiffness: heat[0] q^2 + heat[1] q q' + heat[2] q'^2
};

// Sums over the particles of a body for its best-fit rigid copy, per lane, double; m = mass, x = offset, v =
// velocity, r = rest position of the anchor, k = anchor stiffness. Fixed particles count with k only.
enum ShapeSum {
    kSumK,
    kSumKx,
    kSumKr = kSumKx + 3,
    kSumKxr = kSumKr + 3,
    kSumM = kSumKxr + 9,
    kSumMx,
    kSumMv = kSumMx + 3,
    kSumL = kSumMv + 3,
    kSumMxx = kSumL + 3,
    kShapeSums = kSumMxx + 6  // xx yy zz xy xz yz
};

// Sums for the energy of a body, per lane, double, all half a substep earlier (offset - back * velocity):
// squared stretches of all half-edges times their factors (each spring twice), anchor stiffness times squared
// distance to the goal, mass times squared velocity, mass, mass times position. Fixed particles count with
// springs and anchors only.
enum EnergySum { kSumStretch, kSumAnchor, kSumMvv, kSumMass, kSumMPosition, kEnergySums = kSumMPosition + 3 };

// One instruction set's versions. All give the same bits: same operations in the same order in every lane,
// exact square root and division, fused multiply-add only where written.
struct SpringKernels {
    // Springs, anchors, other forces, gravity and damping, then kick and drift of slices [first, last). A
    // spring of length zero and padding exert no force; a particle of inverse mass zero keeps its position
    // and gets velocity zero. With remainders the drift is a compensated sum (Kahan, CACM 8(1), 1965): steps
    // far smaller than the ulp of a position accumulate. damping_work (16 doubles, J) is incremented lane by
    // lane: damping impulse times mean velocity, and what Maxwell elements lost; may be null.
    void (*step)(const SpringStep* body, unsigned first, unsigned last, double* damping_work);
    // Adds the sums of slices [first, last) to sums[kShapeSums][16], or to sums[kEnergySums][16].
    void (*shape_sums)(const SpringStep* body, unsigned first, unsigned last, double* sums);
    void (*energy_sums)(const SpringStep* body, unsigned first, unsigned last, double* sums);
    // Adds to sums[16] what the Maxwell elements of slices [first, last) store, and lost since the evaluation before, over the
    // stiffness (m^2), at offset - back * velocity; each spring twice.
    void (*relaxing_sums)(const SpringStep* body, unsigned first, unsigned last, double* sums);
};

extern const SpringKernels kSpringKernelsAvx2;
extern const SpringKernels kSpringKernelsAvx512;

// The kernels this process runs with; follows isa() of engine/base/cpu.hpp.
const SpringKernels& spring_kernels();

}  // namespace trocar
