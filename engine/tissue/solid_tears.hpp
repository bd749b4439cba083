#pragma once
#include <span>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
namespace trocar {

// Solids that lose tetrahedra while they run. All nodes of such a solid are vertices of its surface, inner
// ones without a triangle, so that newly exposed faces find their corners. Without an embedded surface the
// inner nodes are the last vertices; with one all nodes are vertices, embedded in themselves. Elements for
// all its faces are reserved at load.

// Upper bounds on the triangles and edges of the surface of a prototype and of any part of its tetrahedra
// (nodes of a TetMesh).
struct SurfaceRoom {
    uint32_t triangles = 0, edges = 0;
};
SurfaceRoom room_for_tears(const Mesh& surface, std::span<const std::array<uint32_t, 4>> tetrahedra, bool skin);
// Reserves that many elements for the prototype that was added last; its vertices without a triangle belong
// to its first piece.
void keep_room(const SurfaceRoom& room, Meshes& meshes);

// Numbers the possible surface triangles of a solid whose prototype has reserved room: tears.face and order,
// tear.outer, faces and order.
void add_tear_faces(const Meshes& meshes, const Solids& solids, uint32_t prototype, Tears& tears, TearBody& tear);
inline bool tears_as_solid(const TearBody& tear) { return tear.faces.count > 0; }

// Whether a face is surface now; if so, its corners as seen from outside.
bool is_surface(const TearFace& face, const uint8_t* gone, Triangle& corner);

// Copies the tables of a solid's springs and tetrahedra without what it has lost: see TornSprings. Recomputed
// only where torn.tetrahedron has changed. An edge that has lost some of its tetrahedra keeps the others'
// share of its stiffness.
void copy_torn_solid(const Springs& springs, const Solids& solids, uint32_t prototype, const Torn& torn, TornSprings& torn_springs);

// Removes tetrahedra: their elastic forces end now, their mass is removed by lose_mass. The last one stays;
// removed ones are ignored. position: m, of every node. Returns their elastic energy, J. Counts springs without
// a tetrahedron left.
double drop_tetrahedra(const Springs& springs, const Solids& solids, const Bodies& bodies, uint32_t body,
                       std::span<const uint32_t> tetrahedra, std::span<const Vec3d> position, Torn& torn, TornSprings& torn_springs,
                       uint64_t& broken_springs);

// Positions of the nodes of a solid at the time of the velocities, m from the body's origin.
std::vector<Vec3d> positions_of_nodes(const Solids& solids, const Bodies& bodies, const Particles& particles, uint32_t body);

// Removes the mass of removed tetrahedra from their nodes, which keep their velocities. A node without a
// tetrahedron is fixed and stays at its goal: its rest position; in a free body, that of the best-fit rigid
// copy. Returns the removed kinetic and gravity energy, J.
double lose_mass(const Solids& solids, const Bodies& bodies, const Poses& poses, const Anchors& anchors, const Vec3d& gravity,
                 uint32_t body, Torn& torn, Particles& particles);

}  // namespace trocar
