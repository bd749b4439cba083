#pragma once
#include "components/mesh.hpp"
namespace trocar {

inline Box box_of_points(const std::vector<Vec3d>& points) {
    Box box;
    for (const Vec3d& p : points) grow(box, p);
    return box;
}

// Box of the vertices used by faces; empty without a face.
inline Box box_of_faces(const Mesh& mesh, const std::vector<Triangle>& faces) {
    Box box;
    for (const Triangle& t : faces) {
        for (const uint32_t v : t) grow(box, mesh.position[v]);
    }
    return box;
}

}  // namespace trocar
