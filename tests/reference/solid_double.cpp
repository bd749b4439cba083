#include "tests/reference/solid_double.hpp"

#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <random>

#include "tests/reference/dense.hpp"
namespace trocar::reference {
namespace {

using Eigen::Matrix3d;
using Matrix12 = Eigen::Matrix<double, 12, 12>;
using Vector12 = Eigen::Matrix<double, 12, 1>;

double six_volume(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) { return (b - a).dot((c - a).cross(d - a)); }

// Gradient of the volume with respect to the corners.
Vector12 volume_gradient(const std::array<Vec3d, 4>& p) {
    const Vec3d a = p[1] - p[0], b = p[2] - p[0], c = p[3] - p[0];
    Vector12 g;
    g.segment<3>(3) = b.cross(c) / 6;
    g.segment<3>(6) = c.cross(a) / 6;
    g.segment<3>(9) = a.cross(b) / 6;
    g.segment<3>(0) = -g.segment<3>(3) - g.segment<3>(6) - g.segment<3>(9);
    return g;
}

struct Element {
    Vector12 gradient = Vector12::Zero();
    Matrix12 hessian = Matrix12::Zero();
    double energy = 0;
};

Element spring_element(const DoubleSolid& s, const std::array<Vec3d, 4>& rest, const std::array<Vec3d, 4>& p) {
    const double mu = s.youngs_modulus / (2 * (1 + s.poisson)), lambda = 2 * mu * s.poisson / (1 - 2 * s.poisson);
    const double volume = six_volume(rest[0], rest[1], rest[2], rest[3]) / 6;
    Element e;
    double squared = 0;
    for (int i = 0; i < 4; ++i)
        for (int j = i + 1; j < 4; ++j) squared += (rest[i] - rest[j]).squaredNorm();
    const double k = 15 * mu * volume / squared;
    for (int i = 0; i < 4; ++i) {
        for (int j = i + 1; j < 4; ++j) {
            const Vec3d d = p[j] - p[i], n = d.normalized();
            const double length = d.norm(), natural = (rest[i] - rest[j]).norm();
            e.energy += 0.5 * k * (length - natural) * (length - natural);
            const Vec3d pull = k * (length - natural) * n;
            e.gradient.segment<3>(3 * j) += pull;
            e.gradient.segment<3>(3 * i) -= pull;
            const Matrix3d h = k * (Matrix3d::Identity() - natural / length * (Matrix3d::Identity() - n * n.transpose()));
            e.hessian.block<3, 3>(3 * i, 3 * i) += h;
            e.hessian.block<3, 3>(3 * j, 3 * j) += h;
            e.hessian.block<3, 3>(3 * i, 3 * j) -= h;
            e.hessian.block<3, 3>(3 * j, 3 * i) -= h;
        }
    }
    const double bulk = std::max(0.0, lambda - mu);
    const double crush = 5.0 / 3 * std::clamp(bulk, 8 * mu, 24 * mu), squeeze = std::max(0.0, 4 * mu - bulk);
    const double ratio = six_volume(p[0], p[1], p[2], p[3]) / 6 / volume, swelling = ratio - 1;
    const double held = std::clamp(swelling, -1.0, 0.25), crushed = std::min(held + 0.5, 0.0);
    const double squeezed = std::min(held, 0.0), yielding = std::max(held, -24 * mu / bulk);
    const double pressure = bulk * yielding + crush * crushed - squeeze * squeezed * squeezed;
    e.energy += volume * (bulk * yielding * (held - yielding / 2) + crush * crushed * crushed / 2 -
                          squeeze * squeezed * squeezed * squeezed / 3 + pressure * (swelling - held));
    const double slope = held != swelling ? 0 : (yielding == held ? bulk : 0) + (crushed < 0 ? crush : 0) - 2 * squeeze * squeezed;
    const Vector12 g = volume_gradient(p);
    e.gradient += pressure * g;
    e.hessian += slope / volume * g * g.transpose();
    // pressure times the second derivative of the volume, which is bilinear in pairs of corners
    for (int i = 0; i < 4; ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            std::array<Vec3d, 4> up = p, down = p;
            up[i][axis] += 1, down[i][axis] -= 1;
            e.hessian.col(3 * i + axis) += pressure * 0.5 * (volume_gradient(up) - volume_gradient(down));
        }
    }
    return e;
}

Matrix3d edges_of(const std::array<Vec3d, 4>& p) {
    Matrix3d m;
    for (int i = 0; i < 3; ++i) m.col(i) = p[i + 1] - p[0];
    return m;
}

Element corotational_element(const DoubleSolid& s, const std::array<Vec3d, 4>& rest, const std::array<Vec3d, 4>& p) {
    const double mu = s.youngs_modulus / (2 * (1 + s.poisson)), lambda = 2 * mu * s.poisson / (1 - 2 * s.poisson);
    const Matrix3d from = edges_of(rest), deformation = edges_of(p) * from.inverse();
    const Matrix3d turn = nearest_rotation(deformation);
    const double volume = from.determinant() / 6;
    Eigen::Matrix<double, 4, 3> shape;  // gradients of the four hat functions
    shape.bottomRows<3>() = from.inverse();
    shape.row(0) = -shape.bottomRows<3>().colwise().sum();
    Eigen::Matrix<double, 6, 12> strain = Eigen::Matrix<double, 6, 12>::Zero();
    for (int i = 0; i < 4; ++i) {
        const double x = shape(i, 0), y = shape(i, 1), z = shape(i, 2);
        strain.block<6, 3>(0, 3 * i) << x, 0, 0, 0, y, 0, 0, 0, z, y, x, 0, 0, z, y, z, 0, x;
    }
    Eigen::Matrix<double, 6, 6> law = Eigen::Matrix<double, 6, 6>::Zero();
    law.topLeftCorner<3, 3>().setConstant(lambda);
    for (int i = 0; i < 6; ++i) law(i, i) += i < 3 ? 2 * mu : mu;
    Matrix12 turns = Matrix12::Zero();
    Vector12 shift;
    for (int i = 0; i < 4; ++i) {
        turns.block<3, 3>(3 * i, 3 * i) = turn;
        shift.segment<3>(3 * i) = turn.transpose() * p[i] - rest[i];
    }
    const Matrix12 stiffness = volume * strain.transpose() * law * strain;
    Element e;
    e.gradient = turns * stiffness * shift;
    e.hessian = turns * stiffness * turns.transpose();
    e.energy = 0.5 * shift.dot(stiffness * shift);
    return e;
}

template <typename Use>
void for_each_element(const DoubleSolid& s, SolidModel model, Use&& use) {
    for (const auto& t : s.tetrahedron) {
        std::array<Vec3d, 4> rest, p;
        for (int i = 0; i < 4; ++i) rest[i] = s.rest[t[i]], p[i] = s.position[t[i]];
        use(t, model == SolidModel::kSprings ? spring_element(s, rest, p) : corotational_element(s, rest, p));
    }
}

// Index of each free axis, -1 if held.
std::vector<int> number_free(const DoubleSolid& s, int& count) {
    std::vector<int> row(3 * s.rest.size(), -1);
    count = 0;
    for (size_t i = 0; i < row.size(); ++i)
        if (!s.held[i / 3][i % 3]) row[i] = count++;
    return row;
}

}  // namespace

DoubleSolid make_double_solid(std::vector<Vec3d> rest, std::vector<std::array<uint32_t, 4>> tetrahedron) {
    DoubleSolid s;
    s.position = rest;
    s.held.assign(rest.size(), {});
    s.load.assign(rest.size(), Vec3d::Zero());
    s.rest = std::move(rest);
    s.tetrahedron = std::move(tetrahedron);
    return s;
}

void add_weight(DoubleSolid& s, const Vec3d& weight_density) {
    for (const auto& t : s.tetrahedron) {
        const double volume = six_volume(s.rest[t[0]], s.rest[t[1]], s.rest[t[2]], s.rest[t[3]]) / 6;
        for (const uint32_t node : t) s.load[node] += volume / 4 * weight_density;
    }
}

std::vector<Vec3d> solid_forces(const DoubleSolid& s, SolidModel model) {
    std::vector<Vec3d> force(s.rest.size(), Vec3d::Zero());
    for_each_element(s, model, [&](const auto& t, const Element& e) {
        for (int i = 0; i < 4; ++i) force[t[i]] -= e.gradient.template segment<3>(3 * i);
    });
    return force;
}

double spring_energy(const DoubleSolid& s) {
    double sum = 0;
    for_each_element(s, SolidModel::kSprings, [&](const auto&, const Element& e) { sum += e.energy; });
    return sum;
}

double solve_statics(DoubleSolid& s, SolidModel model, int most_rounds) {
    int count = 0;
    const std::vector<int> row = number_free(s, count);
    double left = 0;
    for (int round = 0; round < most_rounds; ++round) {
        Eigen::VectorXd residual = Eigen::VectorXd::Zero(count);
        for (size_t i = 0; i < row.size(); ++i)
            if (row[i] >= 0) residual[row[i]] = s.load[i / 3][i % 3];
        std::vector<Eigen::Triplet<double>> entries;
        double scale = 0;
        for_each_element(s, model, [&](const auto& t, const Element& e) {
            for (int i = 0; i < 12; ++i) {
                const int r = row[3 * t[i / 3] + i % 3];
                if (r < 0) continue;
                residual[r] -= e.gradient[i];
                scale = std::max(scale, std::abs(e.gradient[i]));
                for (int j = 0; j < 12; ++j) {
                    const int c = row[3 * t[j / 3] + j % 3];
                    if (c >= 0) entries.emplace_back(r, c, e.hessian(i, j));
                }
            }
        });
        left = residual.cwiseAbs().maxCoeff();
        if (round > 0 && left <= 1e-13 * scale) break;
        Eigen::SparseMatrix<double> matrix(count, count);
        matrix.setFromTriplets(entries.begin(), entries.end());
        const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(matrix);
        const Eigen::VectorXd step = solver.solve(residual);
        for (size_t i = 0; i < row.size(); ++i)
            if (row[i] >= 0) s.position[i / 3][i % 3] += step[row[i]];
        if (step.cwiseAbs().maxCoeff() < 1e-15) break;
    }
    return left;
}

double stiffest_mode(const DoubleSolid& s, double density) {
    int count = 0;
    const std::vector<int> row = number_free(s, count);
    std::vector<double> mass(s.rest.size(), 0.0);
    for (const auto& t : s.tetrahedron) {
        const double volume = six_volume(s.rest[t[0]], s.rest[t[1]], s.rest[t[2]], s.rest[t[3]]) / 6;
        for (const uint32_t node : t) mass[node] += density * volume / 4;
    }
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(count, count);
    for_each_element(s, SolidModel::kSprings, [&](const auto& t, const Element& e) {
        for (int i = 0; i < 12; ++i) {
            for (int j = 0; j < 12; ++j) {
                const int r = row[3 * t[i / 3] + i % 3], c = row[3 * t[j / 3] + j % 3];
                if (r >= 0 && c >= 0) h(r, c) += e.hessian(i, j) / std::sqrt(mass[t[i / 3]] * mass[t[j / 3]]);
            }
        }
    });
    return largest_eigenvalue(h);
}

void lattice_box(int nx, int ny, int nz, double h, double jitter, std::vector<Vec3d>& position,
                 std::vector<std::array<uint32_t, 4>>& tetrahedron) {
    const std::array<int, 3> n{nx, ny, nz};
    std::mt19937 random(1);
    std::uniform_real_distribution<double> shake(-jitter * h, jitter * h);
    position.clear();
    tetrahedron.clear();
    const auto corner = [&](int x, int y, int z) { return static_cast<uint32_t>(x + (nx + 1) * (y + (ny + 1) * z)); };
    for (int z = 0; z <= nz; ++z)
        for (int y = 0; y <= ny; ++y)
            for (int x = 0; x <= nx; ++x) {
                Vec3d p = h * Vec3d(x, y, z);
                const bool inside = x > 0 && x < nx && y > 0 && y < ny && z > 0 && z < nz;
                if (inside) p += Vec3d(shake(random), shake(random), shake(random));
                position.push_back(p);
            }
    const uint32_t middles = static_cast<uint32_t>(position.size());
    const auto middle = [&](int x, int y, int z) { return middles + static_cast<uint32_t>(x + nx * (y + ny * z)); };
    for (int z = 0; z < nz; ++z)
        for (int y = 0; y < ny; ++y)
            for (int x = 0; x < nx; ++x)
                position.push_back(h * Vec3d(x + 0.5, y + 0.5, z + 0.5) + Vec3d(shake(random), shake(random), shake(random)));
    const auto add = [&](std::array<uint32_t, 4> t) {
        if (six_volume(position[t[0]], position[t[1]], position[t[2]], position[t[3]]) < 0) std::swap(t[2], t[3]);
        tetrahedron.push_back(t);
    };
    // across every square face: an octahedron of four tetrahedra between two cell centres, or half of one at
    // the boundary
    for (int axis = 0; axis < 3; ++axis) {
        std::array<int, 3> i{};
        const int u = (axis + 1) % 3, v = (axis + 2) % 3;
        for (i[axis] = 0; i[axis] <= n[axis]; ++i[axis])
            for (i[u] = 0; i[u] < n[u]; ++i[u])
                for (i[v] = 0; i[v] < n[v]; ++i[v]) {
                    std::array<uint32_t, 4> ring;
                    for (int k = 0; k < 4; ++k) {
                        std::array<int, 3> c = i;
                        c[u] += k == 1 || k == 2, c[v] += k >= 2;
                        ring[k] = corner(c[0], c[1], c[2]);
                    }
                    std::array<int, 3> before = i;
                    --before[axis];
                    const bool first = i[axis] == 0, last = i[axis] == n[axis];
                    if (first || last) {
                        const uint32_t apex = first ? middle(i[0], i[1], i[2]) : middle(before[0], before[1], before[2]);
                        // alternate diagonals: no direction of the face is preferred
                        const int d = (i[0] + i[1] + i[2]) % 2;
                        add({apex, ring[d], ring[d + 1], ring[(d + 2) % 4]});
                        add({apex, ring[d], ring[(d + 2) % 4], ring[(d + 3) % 4]});
                        continue;
                    }
                    for (int k = 0; k < 4; ++k)
                        add({middle(before[0], before[1], before[2]), middle(i[0], i[1], i[2]), ring[k], ring[(k + 1) % 4]});
                }
    }
}

}  // namespace trocar::reference
