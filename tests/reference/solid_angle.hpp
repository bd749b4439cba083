#pragma once
#include <Eigen/Geometry>
#include <cmath>

#include "components/mesh.hpp"
namespace trocar::reference {

// Generalised winding number by direct sum of solid angles in double: 1 inside a closed outward surface.
// Van Oosterom, Strackee, IEEE Trans. Biomed. Eng. 30(2), 1983.
inline double winding_at(const Mesh& mesh, const Vec3d& point) {
    double sum = 0;
    for (const Triangle& t : mesh.triangle) {
        const Vec3d a = mesh.position[t[0]] - point, b = mesh.position[t[1]] - point, c = mesh.position[t[2]] - point;
        const double la = a.norm(), lb = b.norm(), lc = c.norm();
        sum += std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
    }
    return sum / (2 * M_PI);
}

}  // namespace trocar::reference
