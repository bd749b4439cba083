#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "engine/draw/render_mesh.hpp"
namespace trocar {

// Shape drawn beside the surfaces. Lit like plastic, linear colour with opacity.
struct Marker {
    enum class Kind : uint8_t { kSphere, kArrow, kRod } kind = Kind::kSphere;
    Vec3d from = Vec3d::Zero();  // m, world: centre, or tail
    Vec3d to = Vec3d::Zero();    // m, world: tip of an arrow, other end of a rod
    double radius = 0;           // m, of the sphere or the shaft
    std::array<float, 4> colour{1, 1, 1, 1};
};

// Triangles of all markers in one buffer: one OpenGL call for each would take longer than all their pixels.
struct MarkerMesh {
    std::vector<RenderVertex> vertex;  // positions relative to the eye
    std::vector<uint32_t> index;
};

// Appends a marker's triangles, counterclockwise from outside. One that is not finite or of zero size adds
// nothing.
void append_marker(const Marker& marker, const Vec3d& eye, MarkerMesh& out);

}  // namespace trocar
