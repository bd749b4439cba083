#pragma once
#include <array>
#include <cstdint>

#include "components/math.hpp"
namespace trocar {

// Points x with normal . x >= bound.
struct HalfSpace {
    Vec3d normal = Vec3d::Zero();  // unit
    double bound = 0;              // m
};

// Half-spaces that hold the proxy in one step.
struct HalfSpaces {
    static constexpr uint32_t kCapacity = 32;
    std::array<HalfSpace, kCapacity> row;
    uint32_t count = 0;
    // Leaves out what is there already; false when full.
    bool add(const HalfSpace& plane);
};

struct Projection {
    Vec3d point = Vec3d::Zero();
    std::array<uint32_t, 3> active{};  // half-spaces whose boundary holds the point
    uint32_t count = 0;
    bool feasible = true;
};

// The point of an intersection of half-spaces that is nearest to `goal`, by taking them in one by one (a linear-
// programming-type problem: de Berg et al., Computational Geometry, chapter 4.3): a half-space that the answer so far
// breaks must hold the new one on its boundary. Exact to rounding; infeasible when nothing is left.
Projection project_on_half_spaces(const Vec3d& goal, const HalfSpaces& planes);

}  // namespace trocar
