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
    double work = 0;                                      // J, of all loads on the displacement: twice the energy; 0 = by quadrature
    std::function<Vec3d(const Vec3d&)> push = {};         // N, on a vertex of the shape at this place, beside the stress
    double held_below = -1e9;                             // m: nodes at this z or below do not move
};

inline constexpr double kCaseModulus = 1e4;  // Pa
// Boxes of `size` (m) with their middle at 0, turned by `turn` about (1, 2, 3); `edges`: of the surface along the longest side.
ElasticCase pulled_bar(const Vec3d& size, double nu, double turn, int edges);          // along z
ElasticCase bent_bar(const Vec3d& size, double nu, double turn, int edges);            // by moments about y at both ends
ElasticCase block_under_weight(const Vec3d& size, double nu, double turn, int edges);  // along -z, on an even pressure
ElasticCase twisted_cylinder(double radius, double length, double nu, double turn, int edges);
// A thick-walled sphere under inner pressure (Lame 1852; Timoshenko, Goodier, "Theory of elasticity", art. 136).
ElasticCase blown_sphere(double inner, double outer, double nu, int edges);
// A cylinder of `extent` (m) in radius and height, cut from a half-space z < 0 that is pressed without friction in a circle of `contact`
// (m) around 0: by a flat punch (Boussinesq 1885), or by a ball that is large against it (Hertz 1882; its stresses: Huber 1904).
ElasticCase punched_half_space(double contact, double extent, double nu, int edges);
ElasticCase half_space_under_ball(double contact, double extent, double nu, int edges);
// Cook's membrane, 44 and 16 mm high at its ends, 48 mm long (Cook, "Improved two-dimensional finite element", J Struct Div ASCE 100(9),
// 1974), as a body of 16 mm thickness: held at its high end (z = 0), sheared along y at the low one. No closed form: nodes of 27-node
// elements, converged to 0.2 %, give its displacement.
ElasticCase cooks_membrane(double nu, int edges);

struct StaticsOutcome {
    double compliance = 0;  // work of the loads on what they move / that of the exact solution - 1: positive is too soft
    double off =
        0;  // RMS distance of the surface's displacement from the exact one / RMS of the latter, both without rigid motion; 0 = none
    double volume = 0;             // m^3, lumped to the nodes
    Vec3d centre = Vec3d::Zero();  // m, of that volume
    double loads = 0;              // factor on the loads that makes them do the exact work on the exact displacement: the surface's error
    int iterations = 0;
};
StaticsOutcome load_surface(const Meshes& meshes, const Springs& springs, const Solids& solids, uint32_t prototype, TissueLaw law,
                            double nu, const ElasticCase& what);

}  // namespace trocar::reference
