#pragma once
#include <array>
#include <vector>

#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// Groups of at most 16 triangles over at most 32 vertices, compact in space.
struct MeshletGroups {
    std::vector<uint32_t> order;                  // triangles, group by group
    std::vector<std::array<uint32_t, 2>> groups;  // [begin, end) of order
};

// Halves by the surface-area heuristic at multiples of 16, so that groups are full; in the frame (x - centre) * scale.
MeshletGroups cut_meshlets(const MeshView& mesh, const Vec3d& centre, double scale);

}  // namespace trocar
