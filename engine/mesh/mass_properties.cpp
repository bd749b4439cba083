#include "engine/mesh/mass_properties.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace trocar {
namespace {

// Rotation of a right-handed frame, its axes the columns.
Quat quaternion_of(const Eigen::Matrix3d& m) {
    // selects the largest of the four squares first: Shepperd 1978
    const double trace = m.trace();
    const double square[4] = {trace, m(0, 0), m(1, 1), m(2, 2)};
    const int k = static_cast<int>(std::max_element(square, square + 4) - square);
    if (k == 0) {
        const double w = 0.5 * std::sqrt(1 + trace), f = 0.25 / w;
        return {w, f * (m(2, 1) - m(1, 2)), f * (m(0, 2) - m(2, 0)), f * (m(1, 0) - m(0, 1))};
    }
    const int x = k - 1, y = (x + 1) % 3, z = (x + 2) % 3;
    double v[3];
    v[x] = 0.5 * std::sqrt(1 + 2 * m(x, x) - trace);
    const double f = 0.25 / v[x];
    v[y] = f * (m(x, y) + m(y, x));
    v[z] = f * (m(x, z) + m(z, x));
    return {f * (m(z, y) - m(y, z)), v[0], v[1], v[2]};
}

}  // namespace

SolidMoments solid_moments(const MeshView& mesh) {
    SolidMoments sum;
    if (mesh.position.empty()) return sum;
    Vec3d near = Vec3d::Zero();  // reference point near the body: sums about it keep their precision far from the origin
    for (const Vec3d& p : mesh.position) near += p / static_cast<double>(mesh.position.size());
    double volume6 = 0;
    Vec3d first = Vec3d::Zero();
    Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
    for (const Triangle& t : mesh.triangle) {
        const Vec3d a = mesh.position[t[0]] - near, b = mesh.position[t[1]] - near, c = mesh.position[t[2]] - near;
        const Vec3d total = a + b + c;
        const double det = a.dot(b.cross(c));
        volume6 += det;
        first += det * total;
        second += det * (total * total.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose());
    }
    sum.volume = volume6 / 6;
    if (!(std::abs(volume6) > 0)) return sum;
    const Vec3d shift = first / (4 * volume6);
    sum.centre = near + shift;
    const Eigen::Matrix3d spread = second / 120 - sum.volume * (shift * shift.transpose());
    const double trace = spread.trace();
    sum.inertia = {trace - spread(0, 0), trace - spread(1, 1), trace - spread(2, 2), -spread(0, 1), -spread(0, 2), -spread(1, 2)};
    return sum;
}

bool set_rigid_mass(const Meshes& meshes, uint32_t body, double mass, Bodies& bodies, Particles& particles) {
    const MeshView view = mesh_view(meshes, bodies.mesh[body]);
    if (!has_inside(view.info->admission)) return false;
    const SolidMoments unit = solid_moments(view);
    if (!(unit.volume > 0) || !std::isfinite(unit.volume)) return false;
    const auto& i = unit.inertia;
    Eigen::Matrix3d tensor;
    tensor << i[0], i[3], i[4], i[3], i[1], i[5], i[4], i[5], i[2];
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(tensor);
    const Vec3d moments = solver.eigenvalues();
    // a real body's moments are positive and the largest is at most the sum of the other two
    if (!(moments[0] > 0) || !(moments[2] <= (1 + 1e-9) * (moments[0] + moments[1]))) return false;
    Eigen::Matrix3d axes = solver.eigenvectors();
    axes.col(2) = axes.col(0).cross(axes.col(1));

    RigidMass entry;
    entry.body = body;
    entry.mass = mass > 0 ? mass : bodies.tissue[body].density * unit.volume;
    entry.centre = unit.centre;
    entry.moments = moments * (entry.mass / unit.volume);
    entry.axes = quaternion_of(axes);
    const auto less = [](const RigidMass& r, uint64_t b) { return r.body < b; };
    const auto at = std::lower_bound(bodies.rigid_mass.begin(), bodies.rigid_mass.end(), uint64_t{body}, less);
    if (at != bodies.rigid_mass.end() && at->body == body) {
        *at = entry;
    } else {
        bodies.rigid_mass.insert(at, entry);
    }
    bodies.inv_mass[body] = 1 / entry.mass;
    if (particles.last_dt.size() <= body) particles.last_dt.resize(body + 1, 0.0);
    return true;
}

const RigidMass* find_rigid_mass(const Bodies& bodies, uint32_t body) {
    const auto less = [](const RigidMass& r, uint64_t b) { return r.body < b; };
    const auto at = std::lower_bound(bodies.rigid_mass.begin(), bodies.rigid_mass.end(), uint64_t{body}, less);
    return at != bodies.rigid_mass.end() && at->body == body ? &*at : nullptr;
}

}  // namespace trocar
