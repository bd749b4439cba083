#pragma once
#include <span>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "components/tears.hpp"
namespace trocar {

// Solids that lose tetrahedra while they run. All nodes of such a solid are vertices of its surface, those inside without a
// triangle, so that the faces behind what is lost find their corners: without a skin the inner nodes are the last vertices,
// under a skin all nodes are, and ride on themselves. Rows for all its faces are kept from load on.

// How many triangles and edges the surface of a prototype and of any part of its tetrahedra (nodes of a TetMesh) may have.
struct SurfaceRoom {
    uint32_t triangles = 0, edges = 0;
};
SurfaceRoom room_for_tears(const Mesh& surface, std::span<const std::array<uint32_t, 4>> tetrahedra, bool skin);
// Keeps that many rows for the prototype that was added last; its vertices without a triangle belong to its first piece.
void keep_room(const SurfaceRoom& room, Meshes& meshes);

// Numbers what may be surface of a solid whose prototype has kept room: tears.face and order, tear.outer, faces and order.
void add_tear_faces(const Meshes& meshes, const Solids& solids, uint32_t prototype, Tears& tears, TearBody& tear);
inline bool tears_as_solid(const TearBody& tear) { return tear.faces.count > 0; }

// Whether a face is surface now; then its corners as seen from outside.
bool is_surface(const TearFace& face, const uint8_t* gone, Triangle& corner);

// As tables of a solid's springs and tetrahedra with what is left of them: see TornSprings. Worked out again only where
// torn.tetrahedron says other than they do. An edge that some of its tetrahedra have left keeps the others' share of its
// stiffness.
void copy_torn_solid(const Springs& springs, const Solids& solids, uint32_t prototype, const Torn& torn, TornSprings& torn_springs);

// Lets tetrahedra go: from now on they pull no more; their mass goes with lose_mass. The last one stays; those that are gone
// change nothing. place: m, of every node. Returns what they held, J. Counts springs without a tetrahedron left.
double drop_tetrahedra(const Springs& springs, const Solids& solids, const Bodies& bodies, uint32_t body,
                       std::span<const uint32_t> tetrahedra, std::span<const Vec3d> place, Torn& torn, TornSprings& torn_springs,
                       uint64_t& broken_springs);

// Where the nodes of a solid are at the time of the velocities, m from the body's origin.
std::vector<Vec3d> places_of_nodes(const Solids& solids, const Bodies& bodies, const Particles& particles, uint32_t body);

// Takes the mass of tetrahedra that have been let go from their nodes, which keep their velocities. A node without a
// tetrahedron left is fixed; it waits at its goal: its rest place, of a free body that of the best-fit rigid copy. Returns
// the kinetic and gravity energy that left, J.
double lose_mass(const Solids& solids, const Bodies& bodies, const Poses& poses, const Anchors& anchors, const Vec3d& gravity,
                 uint32_t body, Torn& torn, Particles& particles);

}  // namespace trocar
