#pragma once
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

// A solid as tetrahedra.
struct TetMesh {
    std::vector<Vec3d> position;
    std::vector<std::array<uint32_t, 4>> tetrahedron;  // positive volume: corner 3 lies where 0, 1, 2 run counter-clockwise
};

// Signed distance of points to the surface wanted, negative inside; exact distances are not needed, but no slope may be
// larger than StuffingParams::steepness. Must answer the same whatever the batch.
using DistanceField = std::function<void(std::span<const Vec3d> points, std::span<double> distance)>;

struct StuffingParams {
    double spacing = 0;    // long edge of the lattice; short edges are sqrt(3) / 2 of it
    double steepness = 1;  // 1 for a true distance
};

// The dihedral angles of isosurface stuffing are proven to lie within these (the paper's abstract). Degrees.
inline constexpr double kStuffingMinDihedral = 10.7;
inline constexpr double kStuffingMaxDihedral = 164.8;

// Fills the solid where `distance` is negative with tetrahedra of one size. Labelle and Shewchuk, "Isosurface stuffing:
// fast tetrahedral meshes with good dihedral angles" (2007), uniform form: a body-centred cubic lattice; cut points
// where its edges cross the surface; lattice points nearer than alpha of an edge to a cut point move onto it
// (about 0.285 of long edges, 0.399 of short ones); what is left of each lattice tetrahedron is filled from a few
// stencils, their diagonals chosen by the parity rule. The angles hold for any field, rough or smooth. Cut points lie on the surface of the
// field (regula falsi, to a ten-thousandth of an edge); parts thinner than an edge may be lost. Surfaces of neighbours agree: the boundary
// is watertight. `box` holds the surface. Vertices are in order of first use. Throws InputError when the lattice would have more than 2^27
// points; an empty mesh when nothing is inside.
TetMesh stuff_isosurface(const StuffingParams& params, const Box& box, const DistanceField& distance);

// Faces that one tetrahedron has alone, outward; indices of vertices are kept.
std::vector<Triangle> boundary_of(const TetMesh& mesh);

// What a tetrahedral mesh is like. Degrees, units^3.
struct TetFacts {
    double min_dihedral = 180, max_dihedral = 0;
    double min_volume = 0, max_volume = 0;  // signed
    double volume = 0;
    uint64_t inverted = 0;  // of no volume or less
    uint64_t boundary_faces = 0;
    uint64_t bad_faces = 0;   // of three tetrahedra or more, or of two on the same side
    uint64_t open_edges = 0;  // of the boundary, not crossed equally often in both directions
};
TetFacts judge_tets(const TetMesh& mesh);

}  // namespace trocar
