#pragma once
#include "components/mesh.hpp"
namespace trocar {

// Box of the vertices used by faces; empty without a face.
inline Box box_of_faces(const Mesh& mesh, const std::vector<Triangle>& faces) {
    Box box;
    for (const Triangle& t : faces) {
        for (const uint32_t v : t) {
            box.min = box.min.cwiseMin(mesh.position[v]);
            box.max = box.max.cwiseMax(mesh.position[v]);
        }
    }
    return box;
}

}  // namespace trocar
