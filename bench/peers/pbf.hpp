#pragma once
#include <cstdint>
#include <vector>

#include "components/math.hpp"
namespace trocar::bench {

// Position-based fluid (Macklin & Mueller, ACM Transactions on Graphics 32(4), 2013) on the plane z = 0, as blood is simulated by
// particles: poly6 densities, spiky gradients, constraint relaxation, cells of one support radius, particles sorted by cell.
struct Pbf {
    float spacing = 1e-3f;  // m, at rest; the support radius is twice that
    float relaxation = 1e4f;
    uint32_t iterations = 4;
    std::vector<Vec3> position, velocity;  // m, m/s
    // work
    std::vector<Vec3> predicted, moved;
    std::vector<float> lambda;
    std::vector<uint32_t> neighbour, first, cell_first, order;
};

// A layer of nx x ny x layers particles.
Pbf pbf_layer(uint32_t nx, uint32_t ny, uint32_t layers);
void step_pbf(float seconds, const Vec3& gravity, Pbf& fluid);

}  // namespace trocar::bench
