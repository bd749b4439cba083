#include "tests/reference/solid_cases.hpp"

#include <cmath>
#include <numbers>
namespace trocar::reference::cases {

DoubleSolid box_solid(int nx, int ny, int nz, double h, double nu, double jitter) {
    std::vector<Vec3d> position;
    std::vector<std::array<uint32_t, 4>> tetrahedron;
    lattice_box(nx, ny, nz, h, jitter, position, tetrahedron);
    DoubleSolid s = make_double_solid(position, tetrahedron);
    s.youngs_modulus = kE;
    s.poisson = nu;
    return s;
}

Uniaxial pull_bar(SolidModel model, int n, double nu) {
    const double side = 0.04, length = 0.08, h = side / n, strain = 1e-4;
    DoubleSolid s = box_solid(n, n, 2 * n, h, nu);
    for (size_t i = 0; i < s.rest.size(); ++i) {
        const Vec3d& r = s.rest[i];
        if (r.z() < 1e-9) s.held[i][2] = true;
        if (r.z() > length - 1e-9) s.held[i][2] = true, s.position[i].z() += strain * length;
        if ((r - Vec3d(0, 0, 0)).norm() < 1e-9) s.held[i] = {true, true, true};
        if ((r - Vec3d(side, 0, 0)).norm() < 1e-9) s.held[i][1] = true;
    }
    solve_statics(s, model);
    const std::vector<Vec3d> force = solid_forces(s, model);
    double pull = 0;
    std::array<double, 2> sum{}, count{};
    for (size_t i = 0; i < s.rest.size(); ++i) {
        if (s.rest[i].z() > length - 1e-9) pull -= force[i].z();
        // lateral displacement of the faces x = 0 and x = side in the middle of the bar
        if (std::abs(s.rest[i].z() - length / 2) > 0.3 * length) continue;
        const int face = s.rest[i].x() < 1e-9 ? 0 : s.rest[i].x() > side - 1e-9 ? 1 : -1;
        if (face >= 0) sum[face] += s.position[i].x() - s.rest[i].x(), ++count[face];
    }
    return {pull / (side * side * strain), -(sum[1] / count[1] - sum[0] / count[0]) / (side * strain)};
}

double hang_bar(SolidModel model, int n, double nu) {
    const double side = 0.02, length = 0.08, weight = 1000 * 9.81;
    DoubleSolid s = box_solid(n, n, 4 * n, side / n, nu);
    s.youngs_modulus = 100 * kE;
    add_weight(s, Vec3d(0, 0, -weight));
    for (size_t i = 0; i < s.rest.size(); ++i) {
        if (s.rest[i].z() > length - 1e-9) s.held[i][2] = true;
        if ((s.rest[i] - Vec3d(0, 0, length)).norm() < 1e-9) s.held[i] = {true, true, true};
        if ((s.rest[i] - Vec3d(side, 0, length)).norm() < 1e-9) s.held[i][1] = true;
    }
    solve_statics(s, model);
    double end = 0, ends = 0;
    for (size_t i = 0; i < s.rest.size(); ++i)
        if (s.rest[i].z() < 1e-9) end += s.rest[i].z() - s.position[i].z(), ++ends;
    return end / ends / (weight * length * length / (2 * s.youngs_modulus));
}

double sag_cantilever(SolidModel model, int n, double nu) {
    const double depth = 0.02, length = 0.1, weight = 1000 * 9.81, modulus = 1000 * kE;
    DoubleSolid s = box_solid(5 * n, n, n, depth / n, nu);
    s.youngs_modulus = modulus;
    add_weight(s, Vec3d(0, 0, -weight));
    for (size_t i = 0; i < s.rest.size(); ++i) {
        if (s.rest[i].x() < 1e-9) s.held[i] = {true, true, true};
    }
    solve_statics(s, model);
    double tip = 0, count = 0;
    for (size_t i = 0; i < s.rest.size(); ++i) {
        if (s.rest[i].x() > length - 1e-9) tip += s.rest[i].z() - s.position[i].z(), ++count;
    }
    const double bending = 3 * weight * std::pow(length, 4) / (2 * modulus * depth * depth);
    const double shear = weight * length * length / (2 * (5.0 / 6) * modulus / (2 * (1 + nu)));
    return tip / count / (bending + shear);
}

double press_sphere(SolidModel model, int cells, int contact_cells, double nu) {
    const double h = 1e-3, size = cells * h, a = contact_cells * h, radius = 20 * a, depth = a * a / radius;
    const double force = 4.0 / 3 * kE / (1 - nu * nu) * a * depth;
    DoubleSolid s = box_solid(cells, cells, cells, h, nu);
    const auto pressed = [&](const Vec3d& r) { return r.z() < 1e-9 && std::hypot(r.x(), r.y()) < a + 1e-9; };
    for (size_t i = 0; i < s.rest.size(); ++i) {
        const Vec3d r = s.rest[i];  // z points into the body
        const double across = std::hypot(r.x(), r.y()), far = r.norm();
        if (r.maxCoeff() > size - 1e-9) {
            const double scale = force * (1 + nu) / (2 * std::numbers::pi * kE * far);
            const double along_z = scale * (2 * (1 - nu) + r.z() * r.z() / (far * far));
            const double outward = scale * (across * r.z() / (far * far) - (1 - 2 * nu) * across / (far + r.z()));
            s.held[i] = {true, true, true};
            s.position[i].z() += along_z;
            if (across > 0) s.position[i] += outward / across * Vec3d(r.x(), r.y(), 0);
            continue;
        }
        if (r.x() < 1e-9) s.held[i][0] = true;
        if (r.y() < 1e-9) s.held[i][1] = true;
        if (pressed(r)) s.held[i][2] = true, s.position[i].z() += depth - across * across / (2 * radius);
    }
    solve_statics(s, model, 20);
    const std::vector<Vec3d> inner = solid_forces(s, model);
    double sum = 0;
    for (size_t i = 0; i < s.rest.size(); ++i)
        if (pressed(s.rest[i])) sum -= 4 * inner[i].z();
    return sum / force;
}

}  // namespace trocar::reference::cases
