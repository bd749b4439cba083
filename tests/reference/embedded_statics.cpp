#include "tests/reference/embedded_statics.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "engine/mesh/mesh_view.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "tests/reference/hexahedra.hpp"
namespace trocar::reference {
namespace {

using Eigen::Matrix3d;

// A grid of quads over (u, v) in [0, 1]^2.
template <typename Place>
void add_patch(Mesh& mesh, int nu, int nv, const Place& place) {
    const uint32_t first = static_cast<uint32_t>(mesh.position.size()), row = static_cast<uint32_t>(nu) + 1;
    for (int j = 0; j <= nv; ++j)
        for (int i = 0; i <= nu; ++i) mesh.position.push_back(place(double(i) / nu, double(j) / nv));
    for (uint32_t j = 0; j < static_cast<uint32_t>(nv); ++j)
        for (uint32_t i = 0; i < static_cast<uint32_t>(nu); ++i) {
            const uint32_t a = first + j * row + i, b = a + 1, c = b + row, d = a + row;
            mesh.triangle.push_back({a, b, c});
            mesh.triangle.push_back({a, c, d});
        }
}

// Joins vertices at the same place.
void weld(Mesh& mesh, double scale) {
    std::vector<std::pair<std::array<int64_t, 3>, uint32_t>> key;
    for (uint32_t v = 0; v < mesh.position.size(); ++v) {
        const Vec3d p = mesh.position[v] / scale;
        key.push_back({{std::llround(p.x()), std::llround(p.y()), std::llround(p.z())}, v});
    }
    std::sort(key.begin(), key.end());
    std::vector<uint32_t> to(key.size());
    std::vector<Vec3d> position;
    for (size_t i = 0; i < key.size(); ++i) {
        if (i == 0 || key[i].first != key[i - 1].first) position.push_back(mesh.position[key[i].second]);
        to[key[i].second] = static_cast<uint32_t>(position.size() - 1);
    }
    mesh.position.swap(position);
    std::vector<Triangle> triangle;
    for (Triangle& t : mesh.triangle) {
        t = {to[t[0]], to[t[1]], to[t[2]]};
        if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) triangle.push_back(t);
    }
    mesh.triangle.swap(triangle);
}

Mesh box_of_size(const Vec3d& size, int edges) {
    Mesh mesh;
    const double longest = size.maxCoeff();
    for (int axis = 0; axis < 3; ++axis) {
        for (const int side : {-1, 1}) {
            const int u = (axis + 1) % 3, v = (axis + 2) % 3;
            const auto count = [&](int k) { return std::max(1, int(std::ceil(edges * size[k] / longest))); };
            add_patch(mesh, count(side > 0 ? u : v), count(side > 0 ? v : u), [&](double s, double t) {
                Vec3d p;
                p[axis] = 0.5 * side * size[axis];
                p[side > 0 ? u : v] = (s - 0.5) * size[side > 0 ? u : v];
                p[side > 0 ? v : u] = (t - 0.5) * size[side > 0 ? v : u];
                return p;
            });
        }
    }
    weld(mesh, 1e-7 * longest);
    return mesh;
}

Mesh cylinder_of_size(double radius, double length, int edges) {
    Mesh mesh;
    const int around = 4 * edges, rings = std::max(2, edges / 4);
    const auto at = [&](double r, double turns, double z) {
        const double angle = 2 * std::numbers::pi * turns;
        return Vec3d(r * std::cos(angle), r * std::sin(angle), z);
    };
    add_patch(mesh, around, edges, [&](double s, double t) { return at(radius, s, (t - 0.5) * length); });
    add_patch(mesh, rings, around, [&](double s, double t) { return at(radius * s, t, 0.5 * length); });
    add_patch(mesh, around, rings, [&](double s, double t) { return at(radius * t, s, -0.5 * length); });
    weld(mesh, 1e-7 * length);
    return mesh;
}

// Turns a case about (1, 2, 3).
ElasticCase turned(ElasticCase c, double angle) {
    const Matrix3d turn = Eigen::AngleAxisd(angle, Vec3d(1, 2, 3).normalized()).toRotationMatrix();
    for (Vec3d& p : c.shape.position) p = turn * p;
    c.displacement = [turn, f = c.displacement](const Vec3d& x) -> Vec3d { return turn * f(turn.transpose() * x); };
    c.stress = [turn, f = c.stress](const Vec3d& x) -> Matrix3d { return turn * f(turn.transpose() * x) * turn.transpose(); };
    c.weight = turn * c.weight;
    return c;
}

Matrix3d along_z(double stress) { return Vec3d(0, 0, stress).asDiagonal(); }

// A half-space z < 0 pressed in a circle by superposed flat punches: Barber, "Elasticity", solution F with the potential strength *
// Im(zeta log(R + zeta) - R), zeta = depth + i radius, R^2 = r^2 + zeta^2.
struct Punch {
    double radius, strength;  // m, N/m
};
struct HalfSpaceField {
    Vec3d displacement = Vec3d::Zero();
    Matrix3d stress = Matrix3d::Zero();
};
HalfSpaceField half_space(const std::vector<Punch>& punches, double nu, const Vec3d& at) {
    using Complex = std::complex<double>;
    const double mu = kCaseModulus / (2 * (1 + nu)), x = at.x(), y = at.y();
    HalfSpaceField sum;
    for (const Punch& p : punches) {
        const double depth = std::max(-at.z(), 1e-9 * p.radius);  // off the edge, where stresses are infinite
        const Complex zeta(depth, p.radius), root = std::sqrt(x * x + y * y + zeta * zeta), both = root + zeta, q = 1.0 / (root * both),
                                             slope = -q * q * (2.0 + zeta / root), cube = root * root * root;
        const auto part = [&](const Complex& c) { return p.strength * c.imag(); };
        const double fx = part(-x / both), fy = part(-y / both), fz = part(std::log(both)), fzz = part(1.0 / root),
                     fzzz = part(-zeta / cube);
        const double fxx = part(-1.0 / both + x * x * q / both), fyy = part(-1.0 / both + y * y * q / both), fxy = part(x * y * q / both);
        const double fxz = part(x * q), fyz = part(y * q), fxxz = part(q + x * x * slope), fyyz = part(q + y * y * slope);
        const double fxyz = part(x * y * slope), fxzz = part(-x / cube), fyzz = part(-y / cube);
        sum.displacement +=
            Vec3d(depth * fxz + (1 - 2 * nu) * fx, depth * fyz + (1 - 2 * nu) * fy, -depth * fzz + 2 * (1 - nu) * fz) / (2 * mu);
        Matrix3d s;
        s(0, 0) = depth * fxxz + fxx + 2 * nu * fyy, s(1, 1) = depth * fyyz + fyy + 2 * nu * fxx, s(2, 2) = depth * fzzz - fzz;
        s(0, 1) = s(1, 0) = depth * fxyz + (1 - 2 * nu) * fxy;
        s(0, 2) = s(2, 0) = -depth * fxzz, s(1, 2) = s(2, 1) = -depth * fyzz;
        sum.stress += s;
    }
    return sum;
}

// A cylinder below z = 0 whose upper face has rings that are dense at the edge of a contact; ring i of `rings` inside it lies at contact *
// sin(i / rings * pi / 2).
Mesh pressed_cylinder(double contact, double extent, int rings, int around) {
    Mesh mesh;
    const auto at = [&](double r, double turns, double z) {
        const double angle = 2 * std::numbers::pi * turns;
        return Vec3d(r * std::cos(angle), r * std::sin(angle), z);
    };
    const auto ring = [&](double s) {  // 0 to 2
        return s < 1 ? contact * std::sin(s * std::numbers::pi / 2) : contact * std::pow(extent / contact, s - 1);
    };
    add_patch(mesh, 2 * rings, around, [&](double s, double t) { return at(ring(2 * s), t, 0); });
    add_patch(mesh, around, rings, [&](double s, double t) { return at(extent, s, (t - 1) * extent); });
    add_patch(mesh, around, rings, [&](double s, double t) { return at(extent * t, s, -extent); });
    weld(mesh, 1e-7 * extent);
    return mesh;
}

// Force on a vertex of pressed_cylinder from a pressure whose share beyond the radius contact * sin(angle) is cos(angle)^power.
Vec3d force_on_ring(const Vec3d& at, double contact, int rings, int around, double force, int power) {
    const double share = std::hypot(at.x(), at.y()) / contact;
    if (at.z() < -1e-9 || share > 1 + 1e-9) return Vec3d::Zero();
    const double ring = std::round(std::asin(std::min(share, 1.0)) * 2 / std::numbers::pi * rings), step = std::numbers::pi / 2 / rings;
    const auto beyond = [&](double r) { return std::pow(std::cos(std::clamp(r, 0.0, double(rings)) * step), power); };
    return Vec3d(0, 0, -force * (beyond(ring - 0.5) - (ring < rings ? beyond(ring + 0.5) : 0)) / (ring > 0 ? around : 1));
}

// Stiffness at rest: springs and volumes, or an isotropic element.
struct Stiffness {
    struct Rod {
        uint32_t a, b;
        Vec3d along;
        double k;
    };
    struct Cell {
        std::array<uint32_t, 4> node;
        std::array<Vec3d, 4> slope;
        double lambda, mu;  // times volume
    };
    std::vector<Rod> rod;
    std::vector<Cell> cell;
    std::vector<double> diagonal;

    std::vector<Vec3d> operator()(const std::vector<Vec3d>& x) const {
        std::vector<Vec3d> y(x.size(), Vec3d::Zero());
        for (const Rod& r : rod) {
            const Vec3d f = r.k * r.along.dot(x[r.b] - x[r.a]) * r.along;
            y[r.a] -= f, y[r.b] += f;
        }
        for (const Cell& c : cell) {
            Matrix3d gradient = Matrix3d::Zero();
            for (int k = 0; k < 4; ++k) gradient += x[c.node[k]] * c.slope[k].transpose();
            const Matrix3d stress = c.lambda * gradient.trace() * Matrix3d::Identity() + c.mu * (gradient + gradient.transpose());
            for (int k = 0; k < 4; ++k) y[c.node[k]] += stress * c.slope[k];
        }
        return y;
    }
};

Stiffness stiffness_of(const Springs& springs, const Solids& solids, uint32_t prototype, const std::vector<Vec3d>& rest,
                       const Tissue& tissue, TissueLaw law) {
    Stiffness s;
    s.diagonal.assign(rest.size(), 0.0);
    const SolidInfo& info = solids.info[prototype];
    const SolidModuli moduli = solid_moduli(tissue);
    const double mu = tissue.youngs_modulus / (2 * (1 + tissue.poisson)), lambda = 2 * mu * tissue.poisson / (1 - 2 * tissue.poisson);
    const uint32_t* column = springs.slice_column.data() + springs.info[prototype].slices.first + prototype;
    for (uint32_t v = 0; v < rest.size() && law == TissueLaw::kSprings; ++v) {
        for (uint32_t c = column[v / 16]; c < column[v / 16 + 1]; ++c) {
            const uint32_t index = 16 * c + v % 16, other = springs.neighbour[index];
            if (other == v) continue;
            const double k = moduli.springs * springs.info[prototype].mean_geometry * double{springs.factor[index]};
            s.diagonal[v] += k;
            if (other > v) s.rod.push_back({v, other, (rest[other] - rest[v]).normalized(), k});
        }
    }
    for (uint32_t t = info.tetrahedra.first; t < info.tetrahedra.first + info.count; ++t) {
        Stiffness::Cell& c = s.cell.emplace_back();
        for (int k = 0; k < 4; ++k) c.node[k] = solids.corner[k][t];
        const Vec3d &o = rest[c.node[0]], a = rest[c.node[1]] - o, b = rest[c.node[2]] - o, d = rest[c.node[3]] - o;
        const double six = a.dot(b.cross(d)), volume = six / 6 * (info.varied ? double{solids.factor[t]} : 1.0);
        c.slope = {Vec3d::Zero(), b.cross(d) / six, d.cross(a) / six, a.cross(b) / six};
        c.slope[0] = -c.slope[1] - c.slope[2] - c.slope[3];
        c.lambda = volume * (law == TissueLaw::kSprings ? moduli.bulk : lambda), c.mu = law == TissueLaw::kSprings ? 0 : volume * mu;
        for (int k = 0; k < 4; ++k) s.diagonal[c.node[k]] += (c.lambda + 2 * c.mu) * c.slope[k].squaredNorm();
    }
    return s;
}

// Removes from `field` its least-squares rigid motion about the points.
void take_rigid_away(const std::vector<Vec3d>& point, std::vector<Vec3d>& field) {
    Eigen::Matrix<double, 6, 6> m = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> r = Eigen::Matrix<double, 6, 1>::Zero();
    const auto modes = [&](size_t i) {
        Eigen::Matrix<double, 3, 6> w;
        for (int k = 0; k < 3; ++k) w.col(k) = Vec3d::Unit(k), w.col(3 + k) = Vec3d::Unit(k).cross(point[i]) * 10;
        return w;
    };
    for (size_t i = 0; i < point.size(); ++i) m += modes(i).transpose() * modes(i), r += modes(i).transpose() * field[i];
    const Eigen::Matrix<double, 6, 1> q = m.ldlt().solve(r);
    for (size_t i = 0; i < point.size(); ++i) field[i] -= modes(i) * q;
}

double product(const std::vector<Vec3d>& a, const std::vector<Vec3d>& b) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) sum += a[i].dot(b[i]);
    return sum;
}

// Conjugate gradients; the load is in equilibrium.
std::vector<Vec3d> solve(const Stiffness& s, const std::vector<Vec3d>& load, int& iterations) {
    std::vector<Vec3d> x(load.size(), Vec3d::Zero()), r = load, z(load.size()), p;
    const auto precondition = [&] {
        for (size_t i = 0; i < r.size(); ++i) z[i] = s.diagonal[i] > 0 ? Vec3d(r[i] / s.diagonal[i]) : Vec3d::Zero();
    };
    precondition();
    p = z;
    double rz = product(r, z);
    const double enough = 1e-16 * rz;
    for (iterations = 0; iterations < 20000 && rz > enough; ++iterations) {
        const std::vector<Vec3d> y = s(p);
        const double step = rz / product(p, y);
        for (size_t i = 0; i < x.size(); ++i) x[i] += step * p[i], r[i] -= step * y[i];
        precondition();
        const double next = product(r, z);
        for (size_t i = 0; i < p.size(); ++i) p[i] = z[i] + next / rz * p[i];
        rz = next;
    }
    return x;
}

}  // namespace

ElasticCase pulled_bar(const Vec3d& size, double nu, double turn, int edges) {
    const double strain = 1e-3;
    return turned(
        {"bar in tension", box_of_size(size, edges),
         [=](const Vec3d& x) { return Vec3d(-nu * strain * x.x(), -nu * strain * x.y(), strain * x.z()); },
         [=](const Vec3d&) { return along_z(kCaseModulus * strain); }, Vec3d::Zero(), kCaseModulus * strain * strain * size.prod()},
        turn);
}

ElasticCase bent_bar(const Vec3d& size, double nu, double turn, int edges) {
    const double curvature = 1e-2;  // 1/m
    return turned({"bar in pure bending", box_of_size(size, edges),
                   [=](const Vec3d& x) {
                       return Vec3d(curvature / 2 * (x.z() * x.z() + nu * (x.x() * x.x() - x.y() * x.y())), curvature * nu * x.x() * x.y(),
                                    -curvature * x.x() * x.z());
                   },
                   [=](const Vec3d& x) { return along_z(-kCaseModulus * curvature * x.x()); }, Vec3d::Zero(),
                   kCaseModulus * curvature * curvature * size.prod() * size.x() * size.x() / 12},
                  turn);
}

ElasticCase block_under_weight(const Vec3d& size, double nu, double turn, int edges) {
    const double weight = 10, length = size.z();  // N/m^3
    return turned({"block under its own weight", box_of_size(size, edges),
                   [=](const Vec3d& x) {
                       const double c = weight / kCaseModulus, z = x.z() + length / 2;
                       return Vec3d(nu * c * (length - z) * x.x(), nu * c * (length - z) * x.y(),
                                    -c * (length * z - z * z / 2) + nu * c / 2 * (x.x() * x.x() + x.y() * x.y()));
                   },
                   [=](const Vec3d& x) { return along_z(-weight * (length / 2 - x.z())); }, Vec3d(0, 0, -weight),
                   weight * weight / kCaseModulus * size.x() * size.y() * length * length * length / 3},
                  turn);
}

ElasticCase twisted_cylinder(double radius, double length, double nu, double turn, int edges) {
    const double twist = 1e-2, shear = kCaseModulus / (2 * (1 + nu));  // 1/m, Pa
    return turned({"cylinder in torsion", cylinder_of_size(radius, length, edges),
                   [=](const Vec3d& x) { return Vec3d(-twist * x.y() * x.z(), twist * x.x() * x.z(), 0); },
                   [=](const Vec3d& x) {
                       Matrix3d s = Matrix3d::Zero();
                       s(0, 2) = s(2, 0) = -shear * twist * x.y(), s(1, 2) = s(2, 1) = shear * twist * x.x();
                       return s;
                   },
                   Vec3d::Zero(), shear * twist * twist * std::numbers::pi / 2 * std::pow(radius, 4) * length},
                  turn);
}

ElasticCase blown_sphere(double inner, double outer, double nu, int edges) {
    const double pressure = 1, a3 = std::pow(inner, 3), b3 = std::pow(outer, 3), mean = pressure * a3 / (b3 - a3);
    const double even = mean * (1 - 2 * nu) / kCaseModulus, around = mean * b3 * (1 + nu) / (2 * kCaseModulus);
    Mesh shape;
    for (const double radius : {outer, inner}) {
        Mesh ball = box_of_size(Vec3d::Ones(), edges);
        const uint32_t first = static_cast<uint32_t>(shape.position.size());
        for (const Vec3d& p : ball.position) {
            const Vec3d even_angles = (p * std::numbers::pi / 2).unaryExpr([](double x) { return std::tan(x); });
            shape.position.push_back(radius * even_angles.normalized());
        }
        for (Triangle t : ball.triangle) {
            if (radius == inner) std::swap(t[1], t[2]);
            shape.triangle.push_back({first + t[0], first + t[1], first + t[2]});
        }
    }
    return {"thick-walled sphere under inner pressure (Lame)",
            shape,
            [=](const Vec3d& x) -> Vec3d { return (even + around / std::pow(x.norm(), 3)) * x; },
            [=](const Vec3d& x) -> Matrix3d {
                const double cube = b3 / std::pow(x.norm(), 3);
                const Vec3d out = x.normalized();
                return mean * ((1 + cube / 2) * Matrix3d::Identity() - 1.5 * cube * out * out.transpose());
            },
            Vec3d::Zero(),
            pressure * 4 * std::numbers::pi* inner* inner*(even * inner + around / (inner * inner))};
}

namespace {

ElasticCase pressed_half_space(const std::string& name, const std::vector<Punch>& punches, double contact, double extent, double nu,
                               int edges, double force, int power) {
    const int around = 4 * edges;
    return {name,
            pressed_cylinder(contact, extent, edges, around),
            [=](const Vec3d& x) { return half_space(punches, nu, x).displacement; },
            [=](const Vec3d& x) -> Matrix3d { return x.z() > -1e-9 ? Matrix3d::Zero() : half_space(punches, nu, x).stress; },
            Vec3d::Zero(),
            0,
            [=](const Vec3d& x) { return force_on_ring(x, contact, edges, around, force, power); }};
}

}  // namespace

ElasticCase punched_half_space(double contact, double extent, double nu, int edges) {
    const double force = 1e-3;  // N
    return pressed_half_space("half-space under a flat punch", {{contact, -force / (2 * std::numbers::pi * contact)}}, contact, extent, nu,
                              edges, force, 1);
}

ElasticCase half_space_under_ball(double contact, double extent, double nu, int edges) {
    const double most = 1, force = 2 * std::numbers::pi / 3 * contact * contact * most;  // Pa, N
    constexpr int kPunches = 64;
    std::vector<Punch> punches;
    for (int i = 0; i < kPunches; ++i) {  // force in proportion to the square of the radius
        const double radius = contact * (i + 0.5) / kPunches, part = 3 * (i + 0.5) * (i + 0.5) / (std::pow(kPunches, 3) - 0.25 * kPunches);
        punches.push_back({radius, -force * part / (2 * std::numbers::pi * radius)});
    }
    ElasticCase ball = pressed_half_space("half-space under a ball (Hertz)", punches, contact, extent, nu, edges, force, 3);
    const double depth = (1 - nu * nu) / kCaseModulus * std::numbers::pi * most / (4 * contact);
    ball.displacement = [=, beside = ball.displacement](const Vec3d& x) {
        const double r2 = x.x() * x.x() + x.y() * x.y();
        if (x.z() < -1e-9 || r2 > contact * contact) return beside(x);
        const double inward = r2 > 0 ? most * (1 - 2 * nu) * (1 + nu) / (3 * kCaseModulus) * contact * contact / r2 *
                                           (1 - std::pow(1 - r2 / (contact * contact), 1.5))
                                     : 0;
        return Vec3d(-inward * x.x(), -inward * x.y(), -depth * (2 * contact * contact - r2));
    };
    return ball;
}

ElasticCase cooks_membrane(double nu, int edges) {
    const double length = 0.048, high = 0.044, low = 0.016, rise = 0.044, thick = 0.016, shear = 1;  // m, Pa
    std::array<Vec3d, 8> corner;
    for (int i = 0; i < 8; ++i) {
        const bool end = i >= 4, top = (i & 2) != 0;
        corner[i] = Vec3d((i & 1 ? 0.5 : -0.5) * thick, end ? rise + (top ? low : 0) : (top ? high : 0), end ? length : 0);
    }
    Mesh shape = box_of_size(Vec3d::Ones(), edges);
    for (Vec3d& p : shape.position) {
        const Vec3d at = p + Vec3d::Constant(0.5);
        p.setZero();
        for (int i = 0; i < 8; ++i)
            p += (i & 1 ? at.x() : 1 - at.x()) * (i & 2 ? at.y() : 1 - at.y()) * (i & 4 ? at.z() : 1 - at.z()) * corner[i];
    }
    const double area = thick * low, tip = push_hexahedron(corner, {3, 9, 9}, kCaseModulus, nu, Vec3d(0, shear, 0));
    const auto push = [=](const Vec3d& x) -> Vec3d {
        if (x.z() < length - 1e-9) return Vec3d::Zero();
        const bool side = std::abs(std::abs(x.x()) - thick / 2) < 1e-9, edge = std::abs(std::abs(x.y() - rise - low / 2) - low / 2) < 1e-9;
        return Vec3d(0, shear * area / (edges * edges) * (side ? 0.5 : 1) * (edge ? 0.5 : 1), 0);
    };
    return {"Cook's membrane", shape, {},  [](const Vec3d&) -> Matrix3d { return Matrix3d::Zero(); }, Vec3d::Zero(),
            shear* area* tip,  push,  1e-9};
}

StaticsOutcome load_surface(const Meshes& meshes, const Springs& springs, const Solids& solids, uint32_t prototype, TissueLaw law,
                            double nu, const ElasticCase& what) {
    const MeshView surface = mesh_view(meshes, prototype);
    const SolidInfo& info = solids.info[prototype];
    std::vector<Vec3d> rest;
    if (info.skin.count == 0) rest.assign(surface.position.begin(), surface.position.end());
    for (uint32_t i = 0; i < info.inner.count; ++i) rest.push_back(solids.position[info.inner.first + i]);
    // load on a vertex of the surface, or its displacement, from the nodes
    const auto bind = [&](uint32_t v) {
        std::vector<std::pair<uint32_t, double>> to;
        if (info.skin.count == 0) return to.push_back({v, 1.0}), to;
        for (int k = 0; k < 4; ++k)
            to.push_back({solids.embedding_node[info.skin.first + v][k], solids.embedding_weight[info.skin.first + v][k]});
        return to;
    };
    StaticsOutcome out;
    std::vector<Vec3d> load(rest.size(), Vec3d::Zero());
    double work = 0;
    const auto add_load = [&](uint32_t v, const Vec3d& force) {
        for (const auto& [node, weight] : bind(v)) load[node] += weight * force;
    };
    for (const Triangle& t : surface.triangle) {
        const std::array<Vec3d, 3> p{surface.position[t[0]], surface.position[t[1]], surface.position[t[2]]};
        const Vec3d area = (p[1] - p[0]).cross(p[2] - p[0]) / 2;
        for (int k = 0; k < 3; ++k) {  // exact for polynomials of degree 2
            const Vec3d middle = (p[k] + p[(k + 1) % 3]) / 2, force = what.stress(middle) * area / 3;
            if (what.displacement) work += force.dot(what.displacement(middle));
            for (const int corner : {k, (k + 1) % 3}) add_load(t[corner], force / 2);
        }
    }
    for (uint32_t v = 0; what.push && v < surface.position.size(); ++v) {
        const Vec3d force = what.push(surface.position[v]);
        add_load(v, force);
        if (what.displacement && force != Vec3d::Zero()) work += force.dot(what.displacement(surface.position[v]));
    }
    for (uint32_t v = 0; v < rest.size(); ++v) {
        const double volume = solids.node_volume[info.nodes.first + v];
        out.volume += volume, out.centre += volume * rest[v];
        load[v] += volume * what.weight;
        if (what.displacement) work += volume * what.weight.dot(what.displacement(rest[v]));
    }
    out.centre /= out.volume;
    const double right = what.work > 0 ? what.work : work;
    out.loads = what.displacement ? right / work : 1;
    for (Vec3d& f : load) f *= out.loads;
    Tissue tissue;
    tissue.youngs_modulus = kCaseModulus, tissue.poisson = nu;
    Stiffness stiffness = stiffness_of(springs, solids, prototype, rest, tissue, law);
    bool held = false;
    for (uint32_t v = 0; v < rest.size(); ++v)
        if (rest[v].z() <= what.held_below) stiffness.diagonal[v] = 0, load[v] = Vec3d::Zero(), held = true;
    if (!held) take_rigid_away(rest, load);
    const std::vector<Vec3d> moved = solve(stiffness, load, out.iterations);
    out.compliance = product(load, moved) / right - 1;
    if (!what.displacement) return out;
    std::vector<Vec3d> at, exact, found;
    for (uint32_t v = 0; v < surface.position.size(); ++v) {
        Vec3d u = Vec3d::Zero();
        for (const auto& [node, weight] : bind(v)) u += weight * moved[node];
        at.push_back(surface.position[v]), exact.push_back(what.displacement(at.back())), found.push_back(u - exact.back());
    }
    take_rigid_away(at, exact), take_rigid_away(at, found);
    out.off = std::sqrt(product(found, found) / product(exact, exact));
    return out;
}

}  // namespace trocar::reference
