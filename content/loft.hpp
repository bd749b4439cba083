#pragma once
#include <functional>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// A closed surface swept by a closed section: point(u, v), u in [0, 1) once around the section, v from 0 to `pieces`
// along the sweep. For what is thin or has sharp edges, where contouring a volume would need too fine a grid.
struct Loft {
    std::function<Vec3d(double u, double v)> point;  // m, continuous
    uint32_t pieces = 1;                             // there is a ring of vertices at every whole v: put creases across the sweep there
    std::vector<double> corner;                      // u of the section's corners, ascending from 0: edges along the sweep; empty = smooth
    bool ring = false;                               // the last section is the first; else the first and the last are points
    uint32_t fewest = 6;                             // segments around a section
    std::function<double(double v)> size;            // relative edge length, smooth; empty = even
    double tile = 0.03;                              // m, of one repeat of the texture
    uint32_t samples = 64;                           // places along a piece at which lengths are measured
};

// Triangulates a loft with about `triangles` nearly even triangles, oriented outward. Texture: u runs around, v along
// the sweep, both a whole number of times over the largest section and the mean length.
Mesh loft_surface(const Loft& loft, uint32_t triangles);

}  // namespace trocar
