#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/math.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
namespace trocar {

// Corners of two faces that are to be on either side of a plane.
struct PartedCorners {
    std::array<uint32_t, 6> vertex = {};  // those of the first side, then those of the second
    std::array<uint32_t, 2> count = {};   // of each side
    Vec3d normal = Vec3d::Zero();         // unit, from the second side to the first
};

// A surface at the start of a pass and where its vertices are to go.
struct PartedSurface {
    std::span<const Triangle> triangle;
    std::span<const Float4> start;  // m; w: inverse mass, 1/kg
    std::vector<Vec3d>& place;      // m, of the vertices
    double clearance;               // m, left between what is parted
};

// Appends how two faces are parted which did not cross at the start of the pass: all corners of the one that the other does not
// have, from all of the other. Of the directions along which the start, turned with the corners, shows no overlap - normals of
// faces and of edges, in their faces and across two, and between corners - that in which they overlap least. Degenerate faces add nothing.
void add_parted(const PartedSurface& surface, const std::array<uint32_t, 2>& faces, std::vector<PartedCorners>& parted);

// Moves what is to be parted apart along its normal, as little as leaves the clearance and the centre of mass, one after the other,
// `sweeps` times or until nothing overlaps by a tenth of it. Fixed corners stay.
void part_corners(const PartedSurface& surface, std::span<const PartedCorners> parted, uint32_t sweeps);

// Ends the approach of what is parted and touches: the sides get their common velocity along the normal, as in an inelastic impact, which
// keeps momentum and adds no energy. velocity: m/s, of the vertices.
void stop_approach(const PartedSurface& surface, std::span<const PartedCorners> parted, std::vector<Vec3d>& velocity);

}  // namespace trocar
