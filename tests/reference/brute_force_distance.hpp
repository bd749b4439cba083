#pragma once
#include <span>

#include "components/mesh.hpp"
namespace trocar {

// The closest surface point, by brute force, for tests.
struct BruteForceAnswer {
    double distance = 0;  // m, unsigned
    uint32_t triangle = kNone;
    double winding = 0;  // generalised winding number
};

// Distance of p to triangle abc in 113-bit arithmetic, rounded once: normal equations for the projection,
// otherwise the nearest of three segments. Relative error 1e-16 down to aspect ratios of 1e-12.
double exact_triangle_distance(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c);

// Tests every triangle in 113-bit arithmetic, except those whose bounding sphere is farther than the best so
// far.
BruteForceAnswer brute_force_distance(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p);

// Sum of solid angles in double by the arctangent formula, independent of the engine's.
double brute_force_winding(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& p);

}  // namespace trocar
