#include "tests/reference/hexahedra.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <vector>
namespace trocar::reference {
namespace {

using HexMatrix = Eigen::Matrix<double, 81, 81>;
constexpr double kGauss[3] = {-0.774596669241483377, 0, 0.774596669241483377}, kGaussWeight[3] = {5.0 / 9, 8.0 / 9, 5.0 / 9};

// Quadratic functions of a line from -1 to 1 with their nodes at -1, 0, 1, and their slopes.
double quadratic(int node, double x) { return node == 0 ? x * (x - 1) / 2 : node == 1 ? 1 - x * x : x * (x + 1) / 2; }
double quadratic_slope(int node, double x) { return node == 0 ? x - 0.5 : node == 1 ? -2 * x : x + 0.5; }

struct HexGrid {
    std::array<Vec3d, 8> corner;
    std::array<int, 3> elements;

    // A place of the body, and its derivatives by xi, eta, zeta (0 to 1) as columns.
    Vec3d place(const Vec3d& at, Eigen::Matrix3d& slope) const {
        Vec3d sum = Vec3d::Zero();
        slope.setZero();
        for (int i = 0; i < 8; ++i) {
            double f[3], d[3];
            for (int k = 0; k < 3; ++k) f[k] = (i >> k & 1) != 0 ? at[k] : 1 - at[k], d[k] = (i >> k & 1) != 0 ? 1 : -1;
            sum += f[0] * f[1] * f[2] * corner[i];
            slope.col(0) += d[0] * f[1] * f[2] * corner[i];
            slope.col(1) += f[0] * d[1] * f[2] * corner[i];
            slope.col(2) += f[0] * f[1] * d[2] * corner[i];
        }
        return sum;
    }
    int along(int k) const { return 2 * elements[k] + 1; }
    int nodes() const { return along(0) * along(1) * along(2); }
    // Node i of an element.
    int node(const std::array<int, 3>& element, int i) const {
        return ((2 * element[2] + i / 9) * along(1) + 2 * element[1] + i / 3 % 3) * along(0) + 2 * element[0] + i % 3;
    }
    // Where element i along an axis begins, 0 to 1: dense at the edges of the held face, where stresses are singular.
    double line(int axis, int i) const {
        const double t = double(i) / elements[axis];
        return axis == 2 ? t * t : 0.5 - 0.5 * std::cos(std::numbers::pi * t);
    }
    double half(const std::array<int, 3>& element, int axis) const {
        return 0.5 * (line(axis, element[axis] + 1) - line(axis, element[axis]));
    }
    // Of a point from -1 to 1 in an element.
    Vec3d local(const std::array<int, 3>& element, const Vec3d& x) const {
        Vec3d at;
        for (int k = 0; k < 3; ++k) at[k] = line(k, element[k]) + (x[k] + 1) * half(element, k);
        return at;
    }
    template <typename Visit>
    void for_elements(const Visit& visit) const {
        for (int z = 0; z < elements[2]; ++z)
            for (int y = 0; y < elements[1]; ++y)
                for (int x = 0; x < elements[0]; ++x) visit(std::array<int, 3>{x, y, z});
    }
};

HexMatrix stiffness(const HexGrid& grid, const std::array<int, 3>& element, double lambda, double mu) {
    HexMatrix sum = HexMatrix::Zero();
    for (int q = 0; q < 27; ++q) {
        const Vec3d x(kGauss[q % 3], kGauss[q / 3 % 3], kGauss[q / 9]);
        Eigen::Matrix3d slope;
        grid.place(grid.local(element, x), slope);
        for (int k = 0; k < 3; ++k) slope.col(k) *= grid.half(element, k);
        const double weight = kGaussWeight[q % 3] * kGaussWeight[q / 3 % 3] * kGaussWeight[q / 9] * slope.determinant();
        const Eigen::Matrix3d inverse = slope.inverse().transpose();
        Vec3d g[27];
        for (int i = 0; i < 27; ++i) {
            const int a = i % 3, b = i / 3 % 3, c = i / 9;
            g[i] = inverse * Vec3d(quadratic_slope(a, x[0]) * quadratic(b, x[1]) * quadratic(c, x[2]),
                                   quadratic(a, x[0]) * quadratic_slope(b, x[1]) * quadratic(c, x[2]),
                                   quadratic(a, x[0]) * quadratic(b, x[1]) * quadratic_slope(c, x[2]));
        }
        for (int i = 0; i < 27; ++i)
            for (int j = 0; j < 27; ++j)
                sum.block<3, 3>(3 * i, 3 * j) += weight * (lambda * g[i] * g[j].transpose() + mu * g[j] * g[i].transpose() +
                                                           mu * g[i].dot(g[j]) * Eigen::Matrix3d::Identity());
    }
    return sum;
}

// An even traction on the face zeta = 1.
Eigen::VectorXd end_load(const HexGrid& grid, const Vec3d& traction, double& area) {
    Eigen::VectorXd load = Eigen::VectorXd::Zero(3 * grid.nodes());
    area = 0;
    grid.for_elements([&](const std::array<int, 3>& element) {
        if (element[2] + 1 < grid.elements[2]) return;
        for (int q = 0; q < 9; ++q) {
            Eigen::Matrix3d slope;
            grid.place(grid.local(element, Vec3d(kGauss[q % 3], kGauss[q / 3], 1)), slope);
            const double piece = kGaussWeight[q % 3] * kGaussWeight[q / 3] * slope.col(0).cross(slope.col(1)).norm() *
                                 grid.half(element, 0) * grid.half(element, 1);
            area += piece;
            for (int i = 0; i < 9; ++i)
                load.segment<3>(3 * grid.node(element, 18 + i)) +=
                    piece * quadratic(i % 3, kGauss[q % 3]) * quadratic(i / 3, kGauss[q / 3]) * traction;
        }
    });
    return load;
}

}  // namespace

double push_hexahedron(const std::array<Vec3d, 8>& corner, const std::array<int, 3>& elements, double youngs_modulus, double poisson,
                       const Vec3d& traction) {
    const HexGrid grid{corner, elements};
    const double mu = youngs_modulus / (2 * (1 + poisson)), lambda = 2 * mu * poisson / (1 - 2 * poisson);
    std::vector<HexMatrix> matrix;
    std::vector<std::array<int, 27>> node;
    const int held = 3 * grid.along(0) * grid.along(1);  // the first plane of nodes
    Eigen::VectorXd diagonal = Eigen::VectorXd::Zero(3 * grid.nodes());
    grid.for_elements([&](const std::array<int, 3>& element) {
        matrix.push_back(stiffness(grid, element, lambda, mu));
        node.emplace_back();
        for (int i = 0; i < 27; ++i) {
            node.back()[i] = grid.node(element, i);
            diagonal.segment<3>(3 * node.back()[i]) += matrix.back().diagonal().segment<3>(3 * i);
        }
    });
    const auto times = [&](const Eigen::VectorXd& x) {
        Eigen::VectorXd y = Eigen::VectorXd::Zero(x.size());
        Eigen::Matrix<double, 81, 1> part, response;
        for (size_t e = 0; e < matrix.size(); ++e) {
            for (int i = 0; i < 27; ++i) part.segment<3>(3 * i) = x.segment<3>(3 * node[e][i]);
            response.noalias() = matrix[e] * part;
            for (int i = 0; i < 27; ++i) y.segment<3>(3 * node[e][i]) += response.segment<3>(3 * i);
        }
        y.head(held).setZero();
        return y;
    };
    double area = 0;
    const Eigen::VectorXd load = end_load(grid, traction, area);
    // conjugate gradients
    Eigen::VectorXd x = Eigen::VectorXd::Zero(load.size()), r = load, z = r.cwiseQuotient(diagonal), p = z;
    r.head(held).setZero();
    double rz = r.dot(z);
    for (const double enough = 1e-16 * rz; rz > enough;) {
        const Eigen::VectorXd y = times(p);
        const double step = rz / p.dot(y);
        x += step * p, r -= step * y;
        z = r.cwiseQuotient(diagonal);
        const double next = r.dot(z);
        p = z + next / rz * p;
        rz = next;
    }
    return load.dot(x) / (area * traction.norm());
}

}  // namespace trocar::reference
