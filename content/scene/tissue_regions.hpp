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

// Tissue factors per node of a body: vertices, then inner nodes of a solid.
struct NodeTissue {
    std::vector<double> stiffness;  // factor of Young's modulus
    std::vector<double> density;    // factor
    std::vector<uint8_t> fixed;
};

// Gives every node of a deformable body the values of the last region that contains it; the body must not
// share its prototype. Springs, hinges and tetrahedra get the mean of their nodes, anchors and masses the
// value of their node. Recomputes the stable step from every spring.
void vary_tissue(const NodeTissue& nodes, const Meshes& meshes, uint32_t body, Springs& springs, Solids& solids, Bodies& bodies,
                 Particles& particles, Anchors& anchors);

// A sampled field: positions and values from a PLY file whose vertices carry the property `property`.
struct PaintedField {
    std::vector<Vec3d> position;  // file units
    std::vector<double> value;
};
// Throws InputError "file: reason" if a vertex lacks the property or a value is not finite.
PaintedField read_painted_field(const std::filesystem::path& path, const std::string& property);
// Value at the vertex nearest to a position.
double value_at(const PaintedField& field, const Vec3d& position);

}  // namespace trocar
