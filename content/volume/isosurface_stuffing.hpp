#pragma once
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "components/math.hpp"
#include "components/mesh.hpp"
namespace trocar {

// A solid as a tetrahedral mesh.
struct TetMesh {
    std::vector<Vec3d> position;
    std::vector<std::array<uint32_t, 4>> tetrahedron;  // positive volume: 0, 1, 2 counter-clockwise from 3
};

// Signed distance of points to the desired surface, negative inside. It need not be exact, but its gradient
// must not exceed StuffingParams::steepness, and the values must not depend on the batching.
using DistanceField = std::function<void(std::span<const Vec3d> points, std::span<double> distance)>;

struct StuffingParams {
    double spacing = 0;    // long edge of the lattice; short edges are sqrt(3) / 2 times as long
    double steepness = 1;  // 1 for an exact distance
};

// Degrees, proven bounds on all dihedral angles of isosurface stuffing (abstract of the paper).
inline constexpr double kStuffingMinDihedral = 10.7;
inline constexpr double kStuffingMaxDihedral = 164.8;

// Fills the region where `distance` is negative with tetrahedra of uniform size. Labelle and Shewchuk,
// "Isosurface stuffing: fast tetrahedral meshes with good dihedral angles" (2007), uniform form: a
// body-centred cubic lattice; cut points where its edges cross the surface; lattice points closer than alpha
// of an edge to a cut point move to it (about 0.285 of long edges, 0.399 of short ones); the rest of each
// lattice tetrahedron is filled with stencils whose diagonals follow the parity rule. The angle bounds hold
// for any field, rough or smooth. Cut points are on the surface (regula falsi, to 1e-4 of an edge); parts
// thinner than an edge may be lost. Neighbouring cells agree: the boundary is watertight. `box` encloses the
// surface. Vertices are in order of first use. Throws InputError if the lattice would exceed 2^27 points;
// returns an empty mesh if nothing is inside.
TetMesh stuff_isosurface(const StuffingParams& params, const Box& box, const DistanceField& distance);

// Faces that belong to a single tetrahedron, outward; vertex indices are kept.
std::vector<Triangle> boundary_of(const TetMesh& mesh);

// Quality of a tetrahedral mesh. Degrees, units^3.
struct TetFacts {
    double min_dihedral = 180, max_dihedral = 0;
    double min_volume = 0, max_volume = 0;  // signed
    double volume = 0;
    uint64_t inverted = 0;  // tetrahedra with volume <= 0
    uint64_t boundary_faces = 0;
    uint64_t bad_faces = 0;   // faces used by three tetrahedra or more, or by two on the same side
    uint64_t open_edges = 0;  // boundary edges not used equally often in both directions
};
TetFacts judge_tets(const TetMesh& mesh);

}  // namespace trocar
