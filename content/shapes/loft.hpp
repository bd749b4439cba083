#pragma once
#include <functional>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// A closed surface swept by a closed section: point(u, v), u in [0, 1) once around the section, v from 0 to
// `pieces` along the sweep. For thin or sharp-edged shapes, which would need too fine a grid to contour.
struct Loft {
    std::function<Vec3d(double u, double v)> point;  // m, continuous
    uint32_t pieces = 1;                             // ring of vertices at every integer v: put creases there
    std::vector<double> corner;                      // u of the section's corners, ascending from 0; empty =
                                                     // smooth
    bool ring = false;                               // closed sweep; false: the first and last sections are
                                                     // points
    uint32_t fewest = 6;                             // minimum segments around a section
    std::function<double(double v)> size;            // relative edge length, smooth; empty = uniform
    double tile = 0.03;                              // m, length of one texture repeat
    uint32_t samples = 64;                           // positions along a piece at which lengths are measured
};

// Triangulates a loft with about `triangles` nearly equilateral triangles, oriented outward. Texture: u runs
// around, v along the sweep, each an integer number of repeats over the largest section and the mean length.
Mesh loft_surface(const Loft& loft, uint32_t triangles);

}  // namespace trocar
