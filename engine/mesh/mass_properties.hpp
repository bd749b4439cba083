#pragma once
#include <array>

#include "components/bodies.hpp"
#include "components/particles.hpp"
#include "engine/mesh/mesh_view.hpp"
namespace trocar {

// Volume integrals of a closed surface filled with density 1 kg/m^3.
struct SolidMoments {
    double volume = 0;                // m^3, negative if the triangles face inward
    Vec3d centre = Vec3d::Zero();     // m, frame of the mesh
    std::array<double, 6> inertia{};  // kg m^2 about the centre: xx, yy, zz, xy, xz, yz of the tensor
};

// Exact for the polyhedron: sums over the tetrahedra between a point and each triangle (Tonon 2004, "Explicit
// exact formulas for the 3-D tetrahedron inertia tensor in terms of its vertex coordinates"; the same
// integrals as Mirtich 1996). Overlapping parts count with their multiplicity.
SolidMoments solid_moments(const MeshView& mesh);

// Makes the body `body` of motion kFree from its closed mesh and a mass in kg, or its tissue's density if
// mass is 0. Fills its elements of Bodies and Particles::last_dt. False, without effect, if the surface is
// open or encloses no volume and thus has no mass.
bool set_rigid_mass(const Meshes& meshes, uint32_t body, double mass, Bodies& bodies, Particles& particles);

// Element of a free body, or null.
const RigidMass* find_rigid_mass(const Bodies& bodies, uint32_t body);

}  // namespace trocar
