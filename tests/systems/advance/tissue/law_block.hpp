#pragma once
#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "content/scene/make_solid.hpp"
#include "tests/reference/solid_double.hpp"
#include "tests/systems/advance/advance_scene.hpp"

// A block of lattice cubes whose elastic law is measured through the engine's steps, and closed forms of the laws in double.
namespace trocar {

// The stable neo-Hookean law of Smith, de Goes, Kim (2018), per volume at rest.
struct NeoHookeanLaw {
    double mu, lambda;  // Pa, the law's own
    NeoHookeanLaw(double youngs_modulus, double poisson) {
        const double shear = youngs_modulus / (2 * (1 + poisson)), lame = 2 * shear * poisson / (1 - 2 * poisson);
        mu = 4 * shear / 3, lambda = lame + 5 * shear / 6;
    }
    double energy(const Eigen::Matrix3d& f) const {
        const double alpha = 1 + mu / lambda - mu / (4 * lambda), squared = f.squaredNorm(), j = f.determinant();
        const double held = std::max(j, 0.0);  // inside out, the pressure is that of a flat tetrahedron
        return mu / 2 * (squared - 3) + lambda / 2 * ((held - alpha) * (held - alpha) - (1 - alpha) * (1 - alpha)) +
               lambda * (held - alpha) * (j - held) - mu / 2 * std::log((squared + 1) / 4);
    }
    // First Piola-Kirchhoff stress.
    Eigen::Matrix3d stress(const Eigen::Matrix3d& f) const {
        const double alpha = 1 + mu / lambda - mu / (4 * lambda);
        Eigen::Matrix3d cofactors;
        cofactors.col(0) = f.col(1).cross(f.col(2)), cofactors.col(1) = f.col(2).cross(f.col(0)),
        cofactors.col(2) = f.col(0).cross(f.col(1));
        return mu * (1 - 1 / (f.squaredNorm() + 1)) * f + lambda * (std::max(f.determinant(), 0.0) - alpha) * cofactors;
    }
    // Stretch across a bar that is stretched by `along` and free at its sides.
    double across(double along) const {
        double low = 0.3, high = 2;
        for (int i = 0; i < 60; ++i) {
            const double middle = 0.5 * (low + high);
            (stress(Eigen::Vector3d(along, middle, middle).asDiagonal())(1, 1) < 0 ? low : high) = middle;
        }
        return low;
    }
};

struct LawBlock {
    static constexpr double kStep = 1e-3;  // s
    AdvanceScene scene;
    std::vector<Vec3d> rest;  // of the nodes
    double volume = 0;        // m^3

    // n^3 cubes of 1 cm, inner nodes shaken by `jitter` edges.
    LawBlock(TissueLaw law, const Prony& prony, double youngs_modulus, double poisson, int n = 3, double jitter = 0, double damping = 0,
             AnchorFrame frame = AnchorFrame::kWorld) {
        TetMesh tets;
        reference::lattice_box(n, n, n, 0.01, jitter, tets.position, tets.tetrahedron);
        const Prototype made = add_tet_mesh(scene.meshes, scene.springs, scene.solids, tets, {});
        Tissue tissue;
        tissue.youngs_modulus = youngs_modulus, tissue.poisson = poisson, tissue.damping = damping, tissue.depth = kNoFoundation;
        scene.bodies.law = {law}, scene.bodies.prony = {prony};
        scene.params.gravity.setZero();
        scene.params.account_energy = false;
        scene.add_body(made.row, Motion::kDeformable, Vec3d::Zero(), tissue, frame);
        const MeshView surface = mesh_view(scene.meshes, made.row);
        rest.assign(surface.position.begin(), surface.position.end());
        const Range inner = scene.solids.info[made.row].inner;
        for (uint32_t i = 0; i < inner.count; ++i) rest.push_back(scene.solids.position[inner.first + i]);
        for (const auto& t : tets.tetrahedron)
            volume += six_volumes(tets.position[t[0]], tets.position[t[1]], tets.position[t[2]], tets.position[t[3]]) / 6;
    }
    void place(uint32_t v, const Vec3d& at) {
        Float4& o = scene.particles.offset[v];
        o.x = static_cast<float>(at.x()), o.y = static_cast<float>(at.y()), o.z = static_cast<float>(at.z());
    }
    void deform(const Eigen::Matrix3d& f) {
        for (uint32_t v = 0; v < rest.size(); ++v) place(v, f * rest[v]);
    }
    // Forces on the nodes in the present shape, N: momentum from rest in one step of kStep, after which all are put back. What
    // relaxes has spent kStep since the step before.
    std::vector<Vec3d> forces() {
        Particles& p = scene.particles;
        const std::vector<Float4> before = p.offset;
        std::vector<Vec3d> force;
        for (auto* velocity : {&p.velocity_x, &p.velocity_y, &p.velocity_z}) std::fill(velocity->begin(), velocity->end(), 0.0f);
        p.last_dt[0] = kStep;
        scene.advance(1, 1);
        for (uint32_t v = 0; v < rest.size(); ++v) force.push_back(scene.velocity(0, v) / (kStep * double{before[v].w}));
        p.offset = before;
        return force;
    }
    // First Piola-Kirchhoff stress of the block under a uniform deformation gradient: the derivative of its energy, Pa.
    Eigen::Matrix3d stress(const Eigen::Matrix3d& f) {
        deform(f);
        const std::vector<Vec3d> force = forces();
        Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
        for (size_t v = 0; v < rest.size(); ++v) sum -= force[v] * rest[v].transpose();
        return sum / volume;
    }
    // Stress along a bar stretched by `along` and free at its sides, and how it is stretched across.
    struct Uniaxial {
        double stress, across;
    };
    Uniaxial pull(double along) {
        double low = 0.5, high = 1.6;
        for (int i = 0; i < 30; ++i) {
            const double middle = 0.5 * (low + high);
            const Eigen::Matrix3d s = stress(Eigen::Vector3d(along, middle, middle).asDiagonal());
            (s(1, 1) + s(2, 2) < 0 ? low : high) = middle;
        }
        return {stress(Eigen::Vector3d(along, low, low).asDiagonal())(0, 0), low};
    }
    Eigen::Matrix3d sheared(double by) {
        Eigen::Matrix3d f = Eigen::Matrix3d::Identity();
        f(0, 1) = by;
        return f;
    }
};

// Complex shear modulus of a Prony series over its long-term modulus.
inline std::pair<double, double> storage_and_loss(const Prony& prony, double omega) {
    double storage = 1, loss = 0;
    for (uint32_t b = 0; b < prony.branches(); ++b) {
        const double w = omega * prony.time[b];
        storage += prony.share[b] * w * w / (1 + w * w), loss += prony.share[b] * w / (1 + w * w);
    }
    return {storage, loss};
}
// Measured through the engine, by small shear at a frequency.
inline std::pair<double, double> measured_storage_and_loss(TissueLaw law, const Prony& prony, double omega) {
    constexpr double kShear = 1e-2;
    const double mu = 1e4 / (2 * 1.45);
    LawBlock block(law, prony, 1e4, 0.45, 2);
    const uint32_t period = static_cast<uint32_t>(std::lround(2 * std::numbers::pi / omega / LawBlock::kStep));
    const double exact = 2 * std::numbers::pi / (period * LawBlock::kStep);  // whole steps a period
    const double slowest = *std::max_element(prony.time.begin(), prony.time.end());
    const uint32_t settled = period * static_cast<uint32_t>(std::ceil(8 * slowest / (period * LawBlock::kStep)));
    double sine = 0, cosine = 0;
    for (uint32_t i = 0; i < settled + period; ++i) {
        const double phase = exact * i * LawBlock::kStep;
        const double stress = block.stress(block.sheared(kShear * std::sin(phase)))(0, 1);
        if (i < settled) continue;
        sine += 2 * stress * std::sin(phase) / period, cosine += 2 * stress * std::cos(phase) / period;
    }
    return {sine / (kShear * mu), cosine / (kShear * mu)};
}

}  // namespace trocar
