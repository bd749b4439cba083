#include "engine/tissue/solid_limit.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <vector>

#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

constexpr int kLanczosSteps = 60;

struct Rod {
    uint32_t a, b;
    Vec3d along;               // unit
    double stiffness, length;  // N/m, m
};
struct Cell {
    std::array<uint32_t, 4> node;
    std::array<Vec3d, 4> slope;  // gradient of J
    double stiffness;            // bulk V
    double shear = 0;            // mu V, neo-Hookean
};

// y = M^-1/2 K M^-1/2 x on the free nodes.
struct ScaledStiffness {
    std::vector<double> root;  // sqrt(inverse mass), 0 = fixed
    std::vector<double> held;  // N/m
    std::vector<Rod> rod;
    std::vector<Cell> cell;

    // mu V (grad u + its transpose) on the corners
    void add_shear(const Cell& c, const std::vector<Vec3d>& x, std::vector<Vec3d>& y) const {
        Eigen::Matrix3d gradient = Eigen::Matrix3d::Zero();
        for (int k = 0; k < 4; ++k) gradient += root[c.node[k]] * x[c.node[k]] * c.slope[k].transpose();
        const Eigen::Matrix3d stress = c.shear * (gradient + gradient.transpose());
        for (int k = 0; k < 4; ++k) y[c.node[k]] += stress * c.slope[k];
    }
    void operator()(const std::vector<Vec3d>& x, std::vector<Vec3d>& y) const {
        for (size_t i = 0; i < x.size(); ++i) y[i] = held[i] * root[i] * x[i];
        for (const Rod& r : rod) {
            const Vec3d d = root[r.a] * x[r.a] - root[r.b] * x[r.b];
            const Vec3d f = r.stiffness * ((1 - kStretched) * r.along.dot(d) * r.along + kStretched * d);
            y[r.a] += f;
            y[r.b] -= f;
        }
        for (const Cell& c : cell) {
            double swelling = 0;
            for (int k = 0; k < 4; ++k) swelling += root[c.node[k]] * c.slope[k].dot(x[c.node[k]]);
            for (int k = 0; k < 4; ++k) y[c.node[k]] += c.stiffness * swelling * c.slope[k];
            if (c.shear > 0) add_shear(c, x, y);
        }
        for (size_t i = 0; i < x.size(); ++i) y[i] *= root[i];
    }
};

double dot(const std::vector<Vec3d>& a, const std::vector<Vec3d>& b) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) sum += a[i].dot(b[i]);
    return sum;
}

// Largest eigenvalue of the symmetric tridiagonal matrix: bisection on Sturm's count.
double largest_eigenvalue(const std::vector<double>& diagonal, const std::vector<double>& beside) {
    double high = 0;
    for (size_t i = 0; i < diagonal.size(); ++i) {
        high = std::max(high, diagonal[i] + (i > 0 ? beside[i - 1] : 0) + (i < beside.size() ? beside[i] : 0));
    }
    double low = 0;
    for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (low + high);
        double pivot = 1;
        bool below = true;
        for (size_t i = 0; i < diagonal.size() && below; ++i) {
            pivot = diagonal[i] - middle - (i > 0 ? beside[i - 1] * beside[i - 1] / pivot : 0.0);
            below = pivot < 0;
        }
        (below ? high : low) = middle;
    }
    return high;
}

double stiffest_mode(const ScaledStiffness& matrix, int steps = kLanczosSteps) {
    const size_t n = matrix.root.size();
    std::vector<Vec3d> v(n, Vec3d::Zero()), before(n, Vec3d::Zero()), w(n);
    std::mt19937_64 random(1);
    const auto unit = [&] { return static_cast<double>(random() >> 11) * 0x1p-53 - 0.5; };
    for (size_t i = 0; i < n; ++i) {
        for (int axis = 0; axis < 3; ++axis) v[i][axis] = matrix.root[i] > 0 ? unit() : 0.0;
    }
    const double size = std::sqrt(dot(v, v));
    if (!(size > 0)) return 0;
    for (Vec3d& p : v) p /= size;
    std::vector<double> diagonal, beside;
    for (int step = 0; step < steps; ++step) {
        matrix(v, w);
        const double a = dot(v, w), b = beside.empty() ? 0 : beside.back();
        for (size_t i = 0; i < n; ++i) w[i] -= a * v[i] + b * before[i];
        diagonal.push_back(a);
        const double next = std::sqrt(dot(w, w));
        if (!(next > 1e-12 * std::abs(a))) break;
        beside.push_back(next);
        before.swap(v);
        for (size_t i = 0; i < n; ++i) v[i] = w[i] / next;
    }
    beside.resize(diagonal.size() - 1);
    return largest_eigenvalue(diagonal, beside);
}

// A whole solid at rest.
ScaledStiffness whole_stiffness(const Meshes& meshes, const Springs& springs, const Solids& solids, uint32_t body,
                                const Particles& particles, const Anchors& anchors, const Bodies& bodies) {
    const uint32_t prototype = bodies.mesh[body];
    const SolidInfo& info = solids.info[prototype];
    const uint32_t first = bodies.particles[body].first + embedded_count(info);
    const Range surface{meshes.info[prototype].vertices.first, surface_nodes(meshes, info, prototype)};
    const auto rest = [&](uint32_t node) -> const Vec3d& {
        return node < surface.count ? meshes.position[surface.first + node] : solids.position[info.inner.first + node - surface.count];
    };
    ScaledStiffness matrix;
    for (uint32_t v = 0; v < info.nodes.count; ++v) {
        const float w = particles.offset[first + v].w;
        matrix.root.push_back(w > 0 ? std::sqrt(double{w}) : 0.0);
        matrix.held.push_back(anchors.stiffness[first + v]);
    }
    const TissueLaw law = law_of(bodies, body);
    const double stiffness = double{bodies.spring_stiffness[body]} * ((law == TissueLaw::kSprings ? 1 : 0) + prony_of(bodies, body).sum());
    const uint32_t* column = springs.slice_column.data() + springs.info[prototype].slices.first + prototype;
    for (uint32_t v = 0; v < info.nodes.count; ++v) {
        const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
        for (uint32_t c = column[slice]; c < column[slice + 1]; ++c) {
            const uint32_t index = c * kSliceWidth + lane, far_end = springs.neighbour[index];
            if (far_end <= v) continue;
            const Vec3d between = rest(far_end) - rest(v);
            matrix.rod.push_back({v, far_end, between.normalized(), stiffness * springs.factor[index], between.norm()});
        }
    }
    const SolidModuli moduli = solid_moduli(bodies, body);
    const double mu = 0.75 * moduli.shear, lambda = moduli.bulk - 5 * mu / 6;  // neo-Hookean
    for (uint32_t t = 0; t < info.count; ++t) {
        Cell& cell = matrix.cell.emplace_back();
        std::array<Vec3d, 4> p;
        for (int k = 0; k < 4; ++k) {
            cell.node[k] = solids.corner[k][info.tetrahedra.first + t];
            p[k] = rest(cell.node[k]);
        }
        const Vec3d a = p[1] - p[0], b = p[2] - p[0], c = p[3] - p[0];
        const double six = solids.rest[info.tetrahedra.first + t];
        cell.slope = {Vec3d::Zero(), b.cross(c) / six, c.cross(a) / six, a.cross(b) / six};
        cell.slope[0] = -cell.slope[1] - cell.slope[2] - cell.slope[3];
        const double factor = info.varied ? double{solids.factor[info.tetrahedra.first + t]} : 1.0;
        cell.stiffness = (kStretchRoom * moduli.bulk + kSqueezeRoom * moduli.squeeze) * six / 6 * factor;
        if (law == TissueLaw::kNeoHookean)
            cell.stiffness = kLawRoom * lambda * six / 6 * factor, cell.shear = kLawRoom * mu * six / 6 * factor;
    }
    return matrix;
}

// Largest eigenvalue over single tetrahedra, each with its share of the springs and of the nodes' masses, and
// with the full anchors.
double stiffest_tetrahedron(const ScaledStiffness& whole, const Solids& solids, uint32_t prototype) {
    const SolidInfo& info = solids.info[prototype];
    std::map<std::array<uint32_t, 2>, double> around;  // edge -> sum of the tetrahedra's volume / sum of squared lengths
    std::map<std::array<uint32_t, 2>, const Rod*> rod_of;
    for (const Rod& r : whole.rod) rod_of[{r.a, r.b}] = &r;
    std::vector<double> share(info.count), quarters(info.nodes.count, 0.0);
    const auto node = [&](uint32_t t, int k) { return solids.corner[k][info.tetrahedra.first + t]; };
    const auto edge = [&](uint32_t t, int i, int j) {
        return std::array{std::min(node(t, i), node(t, j)), std::max(node(t, i), node(t, j))};
    };
    for (uint32_t t = 0; t < info.count; ++t) {
        double squared = 0;
        for (int i = 0; i < 4; ++i) {
            for (int j = i + 1; j < 4; ++j) squared += std::pow(rod_of.at(edge(t, i, j))->length, 2);
        }
        share[t] = double{solids.rest[info.tetrahedra.first + t]} / squared;
        for (int k = 0; k < 4; ++k) quarters[node(t, k)] += double{solids.rest[info.tetrahedra.first + t]} / 24;
        for (int i = 0; i < 4; ++i) {
            for (int j = i + 1; j < 4; ++j) around[edge(t, i, j)] += share[t];
        }
    }
    double stiffest = 0;
    ScaledStiffness one;
    for (uint32_t t = 0; t < info.count; ++t) {
        one.root.clear(), one.held.clear(), one.rod.clear(), one.cell.clear();
        const double quarter = double{solids.rest[info.tetrahedra.first + t]} / 24;
        for (int k = 0; k < 4; ++k) {
            const uint32_t v = node(t, k);
            one.root.push_back(whole.root[v] * std::sqrt(quarters[v] / quarter));
            one.held.push_back(whole.held[v]);
        }
        for (uint32_t i = 0; i < 4; ++i) {
            for (uint32_t j = i + 1; j < 4; ++j) {
                Rod rod = *rod_of.at(edge(t, i, j));
                rod.stiffness *= share[t] / around.at(edge(t, i, j));
                rod.a = i, rod.b = j;
                one.rod.push_back(rod);
            }
        }
        one.cell.push_back(whole.cell[t]);
        one.cell[0].node = {0, 1, 2, 3};
        stiffest = std::max(stiffest, stiffest_mode(one, 16));
    }
    return stiffest;
}

double limit_of(double omega_squared, double damping) {
    return omega_squared > 0 ? kSolidShare * (std::sqrt(damping * damping + 4 * omega_squared) - damping) / omega_squared
                             : std::numeric_limits<double>::infinity();
}

}  // namespace

void update_solid_dt(const Meshes& meshes, const Springs& springs, const Solids& solids, uint32_t body, const Particles& particles,
                     const Anchors& anchors, Bodies& bodies) {
    const double stiffest = stiffest_mode(whole_stiffness(meshes, springs, solids, body, particles, anchors, bodies));
    bodies.stable_dt[body] = limit_of(stiffest, bodies.tissue[body].damping);
}

void update_tearing_solid_dt(const Meshes& meshes, const Springs& springs, const Solids& solids, uint32_t body, const Particles& particles,
                             const Anchors& anchors, Bodies& bodies) {
    const ScaledStiffness whole = whole_stiffness(meshes, springs, solids, body, particles, anchors, bodies);
    bodies.stable_dt[body] = limit_of(stiffest_tetrahedron(whole, solids, bodies.mesh[body]), bodies.tissue[body].damping);
}

}  // namespace trocar
