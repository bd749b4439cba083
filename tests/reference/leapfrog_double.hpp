#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "components/math.hpp"
namespace trocar::reference {

// The simplest possible mass-spring body, in double: one edge list, one loop, goals from Eigen's SVD.
struct DoubleBody {
    std::vector<Vec3d> position;  // m
    std::vector<Vec3d> velocity;  // m/s, half a step behind after the first step
    std::vector<double> inv_mass;
    std::vector<std::array<uint32_t, 2>> spring;
    std::vector<double> rest_length;
    double stiffness = 0;
    std::vector<Vec3d> goal;  // rest positions
    std::vector<double> anchor;
    bool shape = false;  // goals follow the best-fit rigid transform
    double damping = 0;  // 1/s; with shape, of the deviation from the rigid motion
    Vec3d gravity = Vec3d::Zero();
    double last_dt = 0;
};

// Springs and anchors, N.
std::vector<Vec3d> forces(const DoubleBody& body);
// One kick and drift; the first kick is a half kick.
void step(DoubleBody& body, double dt);
// Springs, anchors and gravity, J.
double potential_energy(const DoubleBody& body);
// Largest eigenvalue (1/s^2) of the mass-scaled Hessian of springs and anchors, from force differences, with
// Eigen.
double stiffest_mode(DoubleBody body);

}  // namespace trocar::reference
