#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
namespace trocar {

// Particles of a body before its nodes: the vertices of an embedded surface, padded to 16.
inline uint32_t embedded_count(const SolidInfo& info) { return (info.skin.count + 15) / 16 * 16; }
inline uint32_t embedded_count(const Solids& solids, uint32_t prototype) {
    return prototype < solids.info.size() ? embedded_count(solids.info[prototype]) : 0;
}
// Number of a solid's nodes that are vertices of its surface: all, or none with an embedded surface.
inline uint32_t surface_nodes(const Meshes& meshes, const SolidInfo& info, uint32_t prototype) {
    return info.skin.count > 0 ? 0 : meshes.info[prototype].vertices.count;
}

// A surface embedded in a coarser solid. Every vertex belongs to one tetrahedron: position = sum of weight *
// corner, velocity likewise; a force on it is distributed to the corners by the same weights (virtual work),
// which preserves force and moment. Linear motion of the nodes is followed exactly; for a motion with second
// derivatives up to c, a vertex at distance d outside its tetrahedron of longest edge h has an error of at
// most c (h + d)^2 / 2 (the remainder of linear interpolation).
struct SurfaceEmbedding {
    std::vector<std::array<uint32_t, 4>> node;
    std::vector<std::array<double, 4>> weight;  // sum 1; below 0 outside
    double outside = 0;                         // m, upper bound on the distance of any vertex from its tetrahedron
};

// Binds points (m) to the tetrahedra (positive volume) of nodes: to one that contains the point, else to the
// one nearby in which its least weight is largest. Ties: the lower index. Throws InputError if a point is
// farther outside than the longest edge around: a part that the tetrahedra do not fill.
SurfaceEmbedding bind_skin(std::span<const Vec3d> point, std::span<const Vec3d> node, std::span<const std::array<uint32_t, 4>> tetrahedra);

// Binds points (m) to a surface of triangles between nodes: to three nodes of the nearest triangle and, for
// the offset from it, to an apex, the node farthest from that triangle's plane. Linear motion is followed
// exactly, and force and moment are preserved, as in tetrahedra; the weight of the apex is the ratio of the
// two distances from the plane. Throws InputError if that is more than half: the surface is too coarse.
SurfaceEmbedding bind_to_surface(std::span<const Vec3d> point, std::span<const Vec3d> node, std::span<const Triangle> triangle);

// Whether bodies of a prototype have nodes of their own: a solid, or a shell under an embedded surface.
inline bool has_own_nodes(const Solids& solids, uint32_t prototype) {
    return prototype < solids.info.size() && solids.info[prototype].nodes.count > 0;
}

// Computes offsets and velocities of a body's embedded surface from those of its nodes; nothing for a body
// without one. Same bits for any number of threads.
void drape_skin(const Solids& solids, const Bodies& bodies, uint32_t body, Particles& particles);

}  // namespace trocar
