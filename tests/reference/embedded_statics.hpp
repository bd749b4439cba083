#pragma once
#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "engine/mesh/mesh_topology.hpp"

// Solids as the engine stores them, loaded at their surface, in linear statics, in double: what their mesh and the way in which the
// surface rides on it miss exact solutions of elasticity by.
namespace trocar::reference {

// An exact solution: a body of its shape is in equilibrium under the tractions of `stress` on its surface and under `weight`.
struct ElasticCase {
    std::string name;
    Mesh shape;                                           // m, fine
    std::function<Vec3d(const Vec3d&)> displacement;      // m
    std::function<Eigen::Matrix3d(const Vec3d&)> stress;  // Pa
    Vec3d weight = Vec3d::Zero();                         // N/m^3
    double work = 0;                                      // J, of all loads on the displacement: twice the energy
};

inline constexpr double kCaseModulus = 1e4;  // Pa
// Boxes of `size` (m) with their middle at 0, turned by `turn` about (1, 2, 3); `edges`: of the surface along the longest side.
ElasticCase pulled_bar(const Vec3d& size, double nu, double turn, int edges);          // along z
ElasticCase bent_bar(const Vec3d& size, double nu, double turn, int edges);            // by moments about y at both ends
ElasticCase block_under_weight(const Vec3d& size, double nu, double turn, int edges);  // along -z, on an even pressure
ElasticCase twisted_cylinder(double radius, double length, double nu, double turn, int edges);

struct StaticsOutcome {
    double compliance = 0;  // work of the loads on what they move / that of the exact solution - 1: positive is too soft
    double off = 0;         // RMS distance of the surface's displacement from the exact one / RMS of the latter, both without rigid motion
    double volume = 0;      // m^3, lumped to the nodes
    Vec3d centre = Vec3d::Zero();  // m, of that volume
    double loads = 0;              // factor on the loads that makes them do the exact work on the exact displacement: the surface's error
    int iterations = 0;
};
StaticsOutcome load_surface(const Meshes& meshes, const Springs& springs, const Solids& solids, uint32_t prototype, TissueLaw law,
                            double nu, const ElasticCase& what);

}  // namespace trocar::reference
