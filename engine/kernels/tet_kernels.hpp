#pragma once
namespace trocar {

// The tetrahedra of one body, plain C types only (see spring_kernels.hpp). Volume energy of a tetrahedron of
// rest volume V and J = signed volume / V:
//   V psi(J), psi' = bulk * max(j - 1, -yield) + crush * min(j - kCrushed, 0) - squeeze * min(j - 1, 0)^2,
// j = J clamped to [0, 1 + kStretchCap].
// A penalty on the volume itself (Teschner, Heidelberger, Mueller, Gross, "A versatile and robust model for
// geometrically complex deformable solids", CGI 2004, section 3.2) with a second, stiffer branch below
// kCrushed, and one for materials of little bulk (solid_moduli). The force on a corner, -psi' * (area vector of the opposite face) / 3, is
// a polynomial, so it is finite everywhere, and while the signed volume is below the rest volume - flat or inverted too - it drives the
// corner back to its own side.
// With a metric, instead the stable neo-Hookean energy (Smith, de Goes, Kim, "Stable neo-Hookean flesh simulation", ACM TOG 37(2),
// 2018, equation 14), without its value at rest:
//   V (shear / 2 (I - 3 - log((I + 1) / 4)) + bulk / 2 (J - 1)^2 - 3/4 shear (J - 1)),
// I = the squared deformation gradient = metric : products of the present edges; inside out, J < 0, the pressure of bulk is that of J = 0.
// It is finite everywhere, and its force vanishes only at rest up to rotation.
struct TetStep {
    const float* offset;                                    // 4 per node, m
    const unsigned *corner0, *corner1, *corner2, *corner3;  // nodes, one per tetrahedron, padded to 16
    const float *rest, *per_rest;                           // m^3, 6 V and 1 / (6 V); padding 0
    const float* factor;                                    // of the moduli, one per tetrahedron; null = 1
    float bulk, crush, squeeze;                             // Pa
    const float* metric;                                    // 1/m^2, 6 rows of 16 per group (Solids::metric); null = not neo-Hookean
    float shear;                                            // Pa, with a metric
    float yield;                                            // 1 - J from which the pressure of bulk is constant; at most 1
    unsigned tetrahedra;                                    // padded
    float* corner_force;                                    // 4 per (corner * tetrahedra + tetrahedron), N; then one element of zeros
    const unsigned* slot_column;                            // node slices + 1
    const unsigned* slot;                                   // 16 per column: index of corner_force
    float *force_x, *force_y, *force_z;                     // N, one per node
};

inline constexpr float kStretchCap = 0.25f;  // J - 1 beyond which pressure stops growing: tissue, mostly water, never swells that far
inline constexpr float kCrushed = 0.5f;      // J below which the stiffer branch acts

// One instruction set's versions; all give the same bits.
struct TetKernels {
    // Forces of groups [first, last) of 16 tetrahedra into corner_force; least (16 floats) = the least J of each lane.
    void (*press)(const TetStep* body, unsigned first, unsigned last, float* least);
    // The same for tetrahedra with a metric.
    void (*press_neo_hookean)(const TetStep* body, unsigned first, unsigned last, float* least);
    // The same without forces: least J only.
    void (*measure)(const TetStep* body, unsigned first, unsigned last, float* least);
    // Adds to the nodes of slices [first, last) the forces of their corners, in the order of the columns.
    void (*gather)(const TetStep* body, unsigned first, unsigned last);
};

extern const TetKernels kTetKernelsAvx2;
extern const TetKernels kTetKernelsAvx512;

// The kernels this process runs with; follows isa() of engine/base/cpu.hpp.
const TetKernels& tet_kernels();

}  // namespace trocar
