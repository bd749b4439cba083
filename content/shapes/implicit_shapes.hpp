#pragma once
#include <functional>
#include <string>

#include "components/math.hpp"
#include "content/volume/marching_cubes.hpp"
namespace trocar {

// A solid given by a function that is negative inside and a first-order distance (m) near the surface.
struct ImplicitShape {
    std::string name;
    Box box;                                       // m, encloses the surface
    double steepness = 3;                          // upper bound on the gradient's magnitude
    std::function<double(const Vec3d&)> distance;  // m, of a point in m; called from several threads
};

// Distance to the surface of an ellipsoid with the given semi-axes, accurate to first order at the surface.
double ellipsoid_distance(const Vec3d& point, const Vec3d& centre, const Vec3d& radii);

// Distance to the surface of a capsule whose radius changes linearly from radius_a to radius_b.
double capsule_distance(const Vec3d& point, const Vec3d& a, const Vec3d& b, double radius_a, double radius_b);

// Union, intersection and difference (a without b) of two solids, blended over a band of `blend` metres with
// continuous curvature. The gradient does not exceed those of a and b.
double smooth_union(double a, double b, double blend);
double smooth_subtraction(double a, double b, double blend);

// Smooth noise in [-1, 1] from a hash of the lattice points around `point` (lattice constant 1).
// Bit-identical on every machine for the same seed.
double lattice_noise(const Vec3d& point, uint64_t seed);

// A well-mixed 64-bit hash of a key.
uint64_t mix_bits(uint64_t key);

// Samples a shape on cubic cells over its box plus a border of at least one outside sample. Blocks that the
// steepness proves free of surface are filled with one value; the contour is the same as from full sampling.
// Throws InputError if the grid would exceed 2^31 samples.
ScalarGrid sample_shape(const ImplicitShape& shape, double spacing);

// Moves a point to the surface along the gradient (Newton's method, up to `steps` steps up to `reach`).
Vec3d project_to_shape(const ImplicitShape& shape, const Vec3d& point, double reach, int steps);

// A human liver, supine, about 0.21 x 0.15 x 0.12 m: right lobe towards -x, head towards +y, belly towards
// +z. Large right lobe, tapering left lobe, hollow underside, rounded inferior edge. The seed changes small
// details.
ImplicitShape liver_shape(uint64_t seed);

// A human kidney, about 0.11 x 0.06 x 0.045 m: poles along x, hilum towards -y. The seed changes details.
ImplicitShape kidney_shape(uint64_t seed);

// A human stomach, moderately filled, about 0.15 x 0.21 x 0.07 m: frame as the liver's. A J from the dome of
// the fundus (+x, left) down to the antrum and the pylorus (-x), with the stumps of oesophagus and duodenum
// closed. The greater curvature is about 0.4 m long, the volume about 0.7 l, between the size of the empty
// organ and the 1 to 1.5 l it can hold (Gray's Anatomy). The seed changes its small irregularities.
ImplicitShape stomach_shape(uint64_t seed);

}  // namespace trocar
