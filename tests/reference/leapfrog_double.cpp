#include "tests/reference/leapfrog_double.hpp"

#include <cmath>

#include "tests/reference/dense.hpp"
namespace trocar::reference {
namespace {

using Eigen::Matrix3d;

// Current goals of the anchors: R (r - rest centroid) + centroid, R from the singular vectors of the moment
// matrix.
std::vector<Vec3d> goals(const DoubleBody& b) {
    if (!b.shape) return b.goal;
    Vec3d centre = Vec3d::Zero(), rest = Vec3d::Zero();
    double weight = 0;
    for (size_t i = 0; i < b.position.size(); ++i) {
        centre += b.anchor[i] * b.position[i];
        rest += b.anchor[i] * b.goal[i];
        weight += b.anchor[i];
    }
    centre /= weight;
    rest /= weight;
    Matrix3d moment = Matrix3d::Zero();
    for (size_t i = 0; i < b.position.size(); ++i) {
        moment += b.anchor[i] * (b.position[i] - centre) * (b.goal[i] - rest).transpose();
    }
    const Matrix3d turn = nearest_rotation(moment);
    std::vector<Vec3d> out;
    for (const Vec3d& r : b.goal) out.push_back(turn * (r - rest) + centre);
    return out;
}

// The rigid motion with the body's momentum.
void rigid_motion(const DoubleBody& b, Vec3d& centre, Vec3d& velocity, Vec3d& turning) {
    double mass = 0;
    centre = velocity = Vec3d::Zero();
    for (size_t i = 0; i < b.position.size(); ++i) {
        if (b.inv_mass[i] <= 0) continue;
        mass += 1 / b.inv_mass[i];
        centre += b.position[i] / b.inv_mass[i];
        velocity += b.velocity[i] / b.inv_mass[i];
    }
    centre /= mass;
    velocity /= mass;
    Matrix3d inertia = Matrix3d::Zero();
    Vec3d angular = Vec3d::Zero();
    for (size_t i = 0; i < b.position.size(); ++i) {
        if (b.inv_mass[i] <= 0) continue;
        const Vec3d r = b.position[i] - centre;
        inertia += (r.squaredNorm() * Matrix3d::Identity() - r * r.transpose()) / b.inv_mass[i];
        angular += r.cross(b.velocity[i] - velocity) / b.inv_mass[i];
    }
    Eigen::VectorXd right(3);  // not from `angular`: g++ 12 -O3 reports an out-of-bounds read
    for (int k = 0; k < 3; ++k) right[k] = angular[k];
    turning = solve_symmetric(inertia, right);
}

}  // namespace

std::vector<Vec3d> forces(const DoubleBody& b) {
    std::vector<Vec3d> f(b.position.size(), Vec3d::Zero());
    for (size_t e = 0; e < b.spring.size(); ++e) {
        const auto [i, j] = b.spring[e];
        const Vec3d d = b.position[j] - b.position[i];
        const double length = d.norm();
        if (length == 0) continue;
        const Vec3d pull = b.stiffness * (1 - b.rest_length[e] / length) * d;
        f[i] += pull;
        f[j] -= pull;
    }
    const std::vector<Vec3d> goal = goals(b);
    for (size_t i = 0; i < f.size(); ++i) f[i] += b.anchor[i] * (goal[i] - b.position[i]);
    return f;
}

void step(DoubleBody& b, double dt) {
    const double kick = 0.5 * (b.last_dt + dt), keep = std::exp(-b.damping * kick);
    b.last_dt = dt;
    Vec3d centre = Vec3d::Zero(), velocity = Vec3d::Zero(), turning = Vec3d::Zero();
    if (b.shape) rigid_motion(b, centre, velocity, turning);
    const std::vector<Vec3d> f = forces(b);
    for (size_t i = 0; i < b.position.size(); ++i) {
        if (b.inv_mass[i] <= 0) {
            b.velocity[i].setZero();
            continue;
        }
        const Vec3d drag = velocity + turning.cross(b.position[i] - centre);
        b.velocity[i] =
            drag + keep * (b.velocity[i] - drag) + (b.shape ? kick : kick * std::sqrt(keep)) * (f[i] * b.inv_mass[i] + b.gravity);
    }
    for (size_t i = 0; i < b.position.size(); ++i) b.position[i] += dt * b.velocity[i];
}

double potential_energy(const DoubleBody& b) {
    double energy = 0;
    for (size_t e = 0; e < b.spring.size(); ++e) {
        const double stretch = (b.position[b.spring[e][1]] - b.position[b.spring[e][0]]).norm() - b.rest_length[e];
        energy += 0.5 * b.stiffness * stretch * stretch;
    }
    const std::vector<Vec3d> goal = goals(b);
    for (size_t i = 0; i < b.position.size(); ++i) {
        energy += 0.5 * b.anchor[i] * (goal[i] - b.position[i]).squaredNorm();
        if (b.inv_mass[i] > 0) energy -= b.gravity.dot(b.position[i]) / b.inv_mass[i];
    }
    return energy;
}

double stiffest_mode(DoubleBody b) {
    const int n = 3 * static_cast<int>(b.position.size());
    Eigen::MatrixXd h(n, n);
    const double step = 1e-6;
    for (int c = 0; c < n; ++c) {
        b.position[c / 3][c % 3] += step;
        const auto up = forces(b);
        b.position[c / 3][c % 3] -= 2 * step;
        const auto down = forces(b);
        b.position[c / 3][c % 3] += step;
        for (int r = 0; r < n; ++r) h(r, c) = -(up[r / 3][r % 3] - down[r / 3][r % 3]) / (2 * step);
    }
    for (int r = 0; r < n; ++r)
        for (int c = 0; c < n; ++c) h(r, c) *= std::sqrt(b.inv_mass[r / 3] * b.inv_mass[c / 3]);
    return largest_eigenvalue(0.5 * (h + h.transpose()));
}

}  // namespace trocar::reference
