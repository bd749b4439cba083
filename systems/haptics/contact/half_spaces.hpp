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

// Half-spaces that constrain the proxy in one step.
struct HalfSpaces {
    static constexpr uint32_t kCapacity = 32;
    std::array<HalfSpace, kCapacity> half_space;
    uint32_t count = 0;
    // Skips a duplicate; false when full.
    bool add(const HalfSpace& plane);
};

struct Projection {
    Vec3d point = Vec3d::Zero();
    std::array<uint32_t, 3> active{};  // half-spaces whose boundary contains the point
    uint32_t count = 0;
    bool feasible = true;
};

// The point of an intersection of half-spaces nearest to `goal`, found incrementally (a
// linear-programming-type problem: de Berg et al., Computational Geometry, chapter 4.3): if the present
// solution violates a half-space, the new one is on its boundary. Exact to rounding; infeasible if the
// intersection is empty.
Projection project_on_half_spaces(const Vec3d& goal, const HalfSpaces& planes);

}  // namespace trocar
