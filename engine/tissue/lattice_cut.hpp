#pragma once
#include <array>
#include <span>
#include <utility>
#include <vector>

#include "components/actions.hpp"
#include "engine/mesh/surface_cut.hpp"
namespace trocar {

// Cuts of a solid along the path that a straight edge sweeps, by virtual nodes (Molino, Bao, Fedkiw, "A virtual node
// algorithm for changing mesh topology during simulation", ACM TOG 23(3), 2004). An edge of the lattice that the sweep
// crosses is cut there, once and for all; its ends keep kSnap of its length. Corners of a tetrahedron that no whole edges join
// belong to different parts: a tetrahedron is copied once per part, and a part has its share of the volume. Parts of
// neighbours hang together across their face if they own a corner of it both. Copies of a node whose parts do not hang
// together around it are nodes of their own: one of them owns the node and keeps its number, the others are virtual.
// The new surface passes through the cut points of the edges: a triangle or a quadrilateral in a tetrahedron that is parted
// once, and pieces that meet in the middle of faces and of the tetrahedron in one that is parted again. Behind the tip of
// a cut both sides of it are surface, at the tip they are joined: the surface stays closed and manifold.

// Constant after load.
struct Lattice {
    std::span<const std::array<uint32_t, 4>> tetrahedron;  // nodes, positive volume
    std::span<const std::array<uint32_t, 4>> neighbour;    // tetrahedron across the face that lacks a corner, or kNone
    std::span<const std::array<uint32_t, 2>> edge;         // nodes, lower first, ascending
    std::span<const LatticeFace> face;
    std::span<const std::array<Vec2, 3>> uv;  // as face
    std::span<const uint16_t> material;
    uint32_t nodes = 0;
    uint16_t wall = 0;  // material of the new surface
};

struct LatticePieces {
    std::vector<double> cut_at;     // as Lattice::edge: fraction from the lower node, 0 = whole
    std::vector<CutPart> part;      // the first are those of Lattice::tetrahedron in their order
    std::vector<uint32_t> node_of;  // the first are the nodes of the lattice
    std::vector<CutSolidVertex> vertex;
    std::vector<Triangle> triangle;
    std::vector<std::array<Vec2, 3>> uv;
    std::vector<uint16_t> material;
};

// Neighbours, edges and faces of tetrahedra.
void find_lattice(std::span<const std::array<uint32_t, 4>> tetrahedron, std::vector<std::array<uint32_t, 4>>& neighbour,
                  std::vector<std::array<uint32_t, 2>>& edge, std::vector<LatticeFace>& face);

// A lattice that is whole. Its vertices are the nodes of its faces, ascending.
LatticePieces whole_pieces(const Lattice& lattice);

// The whole edges that a sweep crosses, each with the fraction from its lower node. place, before: m, of the nodes now and at
// the start of the sweep, in its frame.
std::vector<std::pair<uint32_t, double>> crossed_edges(const EdgeSweep& sweep, const Lattice& lattice, std::span<const Vec3d> place,
                                                       std::span<const Vec3d> before, std::span<const double> cut_at);

// Cuts edges and what that parts. made: per new node, the one that it was copied from. Returns whether anything was parted: the
// surface has changed then.
bool cut_lattice(const Lattice& lattice, std::span<const std::pair<uint32_t, double>> crossed, LatticePieces& pieces,
                 std::vector<uint32_t>& made);

// Area of the new surface on one side, of nodes at `rest`, m^2.
double wall_area(const Lattice& lattice, const LatticePieces& pieces, std::span<const Vec3d> rest);

}  // namespace trocar
