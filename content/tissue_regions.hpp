#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
namespace trocar {

// How the nodes of a body differ from its tissue: vertices, then inner nodes of a solid.
struct NodeTissue {
    std::vector<double> stiffness;  // factor of Young's modulus
    std::vector<double> density;    // factor
    std::vector<uint8_t> fixed;
};

// Gives every node of a deformable body the values of the last region that holds it; the prototype must be the body's own.
// A spring, a hinge or a tetrahedron has the mean of its ends; anchors and masses that of their node. Works the stable step
// out again: it knows every spring by itself.
void vary_tissue(const NodeTissue& nodes, const Meshes& meshes, uint32_t body, Springs& springs, Solids& solids, Bodies& bodies,
                 Particles& particles, Anchors& anchors);

// Values at given places, from a painted field: a PLY file whose vertices carry the numbers `property`.
struct PaintedField {
    std::vector<Vec3d> place;  // file units
    std::vector<double> value;
};
// Throws InputError "file: reason" when the file has no such number for every vertex, or one is not finite.
PaintedField read_painted_field(const std::filesystem::path& path, const std::string& property);
// Of the vertex nearest to a place.
double value_at(const PaintedField& field, const Vec3d& place);

}  // namespace trocar
