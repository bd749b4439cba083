#pragma once
#include <vector>

#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "components/springs.hpp"
namespace trocar {

// The matrix A of the backward Euler steps of one shell or sheet, factored once: M / h^2 + Laplacian of its springs +
// bending + anchors. One number per pair of particles, for x, y and z alike: it bounds the Hessian of the step's
// energy from above, whatever the shape (the Hessian of a spring, k (a I + (1 - a) d d^T) with a <= 1, is at most
// k I; Liu, Bargteil, O'Brien, Kavan, ACM TOG 32(6), 2013), so that x + A^-1 force never overshoots. h is the step
// rounded down to a power of the root of two, which only raises the bound: passes of 8 and 9 ms share a factor.
struct ImplicitFactor {
    uint32_t body = kNone;
    double step = 0;              // s, h
    float stiffness = 0;          // N/m, of the body's springs
    std::vector<uint32_t> order;  // particle of every column of L
    std::vector<uint32_t> first;  // of the column's entries below the diagonal; one more
    std::vector<uint32_t> row;    // of every entry
    std::vector<float> value;     // of every entry
    std::vector<float> inverse;   // 1 / D, m/N
    std::vector<float> bending;   // N/m, per particle: bound of its own part of twice the hinges' Hessian; empty = none
    std::vector<Float4> work;     // one per column, while solving
};

// Step of the factor that serves steps of dt.
double factored_step(double dt);
// Factors A of a body. Sparse L D L^T in double, approximate minimum degree ordering; the same bits on every machine.
void make_factor(const Springs& springs, const Bodies& bodies, const Particles& particles, const Anchors& anchors, uint32_t body,
                 double step, ImplicitFactor& factor);
// solution = A^-1 right, x, y and z of every particle; fixed particles get 0.
void solve_factor(ImplicitFactor& factor, const Float4* right, Float4* solution, uint32_t particles);

}  // namespace trocar
