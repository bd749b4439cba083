#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
namespace trocar {

// Rows of a body before its nodes: a skin's vertices, padded to 16.
inline uint32_t skin_rows(const SolidInfo& info) { return (info.skin.count + 15) / 16 * 16; }
inline uint32_t skin_rows(const Solids& solids, uint32_t prototype) {
    return prototype < solids.info.size() ? skin_rows(solids.info[prototype]) : 0;
}
// How many nodes of a solid are vertices of its surface: all vertices, or none under a skin.
inline uint32_t surface_nodes(const Meshes& meshes, const SolidInfo& info, uint32_t prototype) {
    return info.skin.count > 0 ? 0 : meshes.info[prototype].vertices.count;
}

// A surface on a coarser solid. Every vertex rides on one tetrahedron: place = sum of weight * corner, velocity likewise;
// a force on it goes to the corners by the same weights (virtual work), so that force and moment are kept. Any linear
// motion of the nodes is followed exactly; of a curved one with second derivatives up to c a vertex at distance d outside
// its tetrahedron of longest edge h misses at most c (h + d)^2 / 2 (the remainder of linear interpolation).
struct SkinBinding {
    std::vector<std::array<uint32_t, 4>> node;
    std::vector<std::array<double, 4>> weight;  // sum 1; below 0 outside
    double outside = 0;                         // m, farthest vertex from its tetrahedron, at most
};

// Binds points (m) to the tetrahedra (positive volume) of nodes: to one that holds it, else to the one of those nearby in
// which its least weight is largest. Ties: the lower tetrahedron. Throws InputError when a point is farther outside than
// the longest edge around: a part that the tetrahedra do not fill.
SkinBinding bind_skin(std::span<const Vec3d> point, std::span<const Vec3d> node, std::span<const std::array<uint32_t, 4>> tetrahedra);

// Binds points (m) to a surface of triangles between nodes: to three nodes of the nearest triangle and, for how far a point
// lies off it, to an apex, the node farthest from that triangle's plane. So linear motions are followed exactly and force and
// moment are kept, as in tetrahedra; what an apex gets is a share of how far the point lies off over how far the apex does.
// Throws InputError when that is more than half: the surface is too coarse for the points.
SkinBinding bind_to_surface(std::span<const Vec3d> point, std::span<const Vec3d> node, std::span<const Triangle> triangle);

// Whether bodies of a prototype have nodes of their own: a solid, or a shell under a skin.
inline bool has_own_nodes(const Solids& solids, uint32_t prototype) {
    return prototype < solids.info.size() && solids.info[prototype].nodes.count > 0;
}

// Writes offsets and velocities of the skin of a body from those of its nodes; nothing for a body without. Same bits for
// any number of threads.
void drape_skin(const Solids& solids, const Bodies& bodies, uint32_t body, Particles& particles);

}  // namespace trocar
