#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Cuts of a triangulated surface along the path that a straight edge sweeps. Where the sweep crosses an edge of the
// surface, that edge is split there, or the path goes through the nearer end if it is within kSnap of an edge length;
// the triangles on both sides are split so that the path runs along edges. Those edges are slits. A vertex whose
// triangles no longer hang together around it, but across slits, is duplicated: behind the tip of a cut the surface
// opens, at the tip it stays closed.

// Fraction of the longer of an edge and the mean edge within which a crossing goes through a vertex. So no new edge is
// shorter than that of a mean edge.
inline constexpr double kSnap = 0.2;

// Motion of a straight edge, from a0 b0 to a1 b1, m. The surface moves too: an edge of the surface is met where it comes to lie
// in the sweep as seen from it, which moves with the mean of its ends.
struct EdgeSweep {
    Vec3d a0, b0, a1, b1;
};

// Where the quadrilateral of a sweep crosses a segment: fraction of its length from p; NaN if it does not. An end in the plane of the
// sweep is on one side of it, so that of the edges of a closed surface an even number is crossed.
double crossing_of(const EdgeSweep& sweep, const Vec3d& p, const Vec3d& q);

// The present surface. Arrays have elements for all vertices and triangles that it may get.
struct CutMesh {
    uint32_t vertices = 0, triangles = 0;  // present numbers
    std::span<Vec3d> rest;                 // m, at rest
    std::span<Vec3d> place;                // m, now, in the frame of the sweep
    std::span<Triangle> triangle;
    std::span<std::array<Vec2, 3>> uv;
    std::span<uint16_t> material;
    std::vector<std::array<uint32_t, 2>> slit;  // edges that are cut, but still closed: lower vertex first, ascending
    std::vector<uint32_t> front;                // vertices at which a cut ended in a triangle that the edge is in, ascending
    double mean_edge = 0;                       // m, at load
    std::span<Vec3d> before = {};               // m, of `place`, at the start of the sweep; empty: the surface has not moved
};

// How a vertex was made: at a + along (b - a).
struct CutVertex {
    uint32_t a = 0, b = 0;
    double along = 0;
};

struct CutResult {
    double length = 0;                            // m, at rest, of the edges that became slits
    std::vector<std::array<uint32_t, 2>> opened;  // edges along which the surface opened, as they are on one side of the cut
    bool refused = false;                         // there was not enough room for all of the cut: nothing was changed
};

// Makes the cut of one sweep. made: one element per new vertex, in their order. Triangles keep their numbers, their
// first part if they are split.
CutResult cut_surface(const EdgeSweep& sweep, CutMesh& mesh, std::vector<CutVertex>& made);

}  // namespace trocar
