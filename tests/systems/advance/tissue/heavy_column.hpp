#pragma once
#include <cmath>

#include "content/scene/make_solid.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "tests/reference/embedded_statics.hpp"
#include "tests/systems/advance/tissue/law_block.hpp"

// A square column that is held at its foot and buckles under its own weight.
namespace trocar {

struct HeavyColumn {
    static constexpr double kLength = 0.1, kDensity = 1000;  // m, kg/m^3
    double width, nu;                                        // m

    double area() const { return width * width; }
    double bending() const { return reference::kCaseModulus * std::pow(width, 4) / 12; }
    // kappa G A (Cowper, "The shear coefficient in Timoshenko's beam theory", J Appl Mech 33, 1966).
    double shear() const { return 10 * (1 + nu) / (12 + 11 * nu) * reference::kCaseModulus / (2 * (1 + nu)) * area(); }

    // Weight per length (N/m) at which it buckles: the least q with M' = -s N psi / (1 - N / (kappa G A)), psi' = M / (m E I), N = q (L -
    // x), psi(0) = M(L) = 0, along x at rest. Slender, it is Greenhill's 7.8373 E I / L^3 (Proc Cambridge Phil Soc 4, 1881); shear takes
    // some of it (Engesser 1891; Timoshenko, Gere, "Theory of elastic stability", art. 2.17), and as the law's bar is pressed to s of its
    // length, becomes thicker and changes its modulus, m = a^2 dP/ds / E with the stretch a across, it gains some.
    double critical_weight(bool slender = false) const {
        const NeoHookeanLaw law(reference::kCaseModulus, nu);
        const auto pull = [&](double s) {
            const double a = law.across(s);
            return law.stress(Eigen::Vector3d(s, a, a).asDiagonal())(0, 0);
        };
        constexpr double kPressed = 0.97, kSmall = 1e-3;  // both are nearly linear in the strain
        const double modulus = (pull(kPressed + kSmall) - pull(kPressed - kSmall)) / (2 * kSmall) / reference::kCaseModulus;
        const double stiffer = (1 - modulus * std::pow(law.across(kPressed), 2)) / (kPressed - 1);
        const double end_force = reference::kCaseModulus * area();
        const auto moment_at_end = [&](double q) {
            constexpr int kSteps = 4000;
            const double h = kLength / kSteps;
            double psi = 0, moment = bending();
            for (int i = 0; i < kSteps; ++i) {  // symplectic, from the middle of a step to the next
                const double n = q * (kLength - (i + 0.5) * h), strain = slender ? 0 : -n / end_force;
                psi += h / 2 * moment / (bending() * (1 - stiffer * strain));
                moment -= h * (1 + strain) * n * psi / (slender ? 1 : 1 - n / shear());
                psi += h / 2 * moment / (bending() * (1 - stiffer * strain));
            }
            return moment;
        };
        double low = 0, high = 9 * bending() / std::pow(kLength, 3);
        for (int i = 0; i < 50; ++i) {
            const double middle = 0.5 * (low + high);
            (moment_at_end(middle) > 0 ? low : high) = middle;
        }
        return low;
    }

    // How far its top comes to lie to the side (m) under `gravity` (m/s^2) along -z and two thousandths of it along x, through the engine's
    // steps.
    double lean(double cells, TissueLaw law, double gravity) const {
        AdvanceScene s;
        const Mesh shape = reference::pulled_bar(Vec3d(width, width, kLength), nu, 0, static_cast<int>(2 * cells)).shape;
        const Prototype made = make_solid(s.meshes, s.springs, s.solids, shape, {}, {.cells = cells, .skin = true, .filled = true});
        const double critical = critical_weight() / (kDensity * area());
        // of the first mode of a cantilever, which slows down as 1 - load / critical load: damped critically
        const double rate = 3.516 * std::sqrt(bending() / (kDensity * area() * std::pow(kLength, 4)) * std::abs(1 - gravity / critical));
        Tissue tissue;
        tissue.youngs_modulus = reference::kCaseModulus, tissue.poisson = nu, tissue.density = kDensity;
        tissue.depth = kNoFoundation, tissue.damping = 2 * rate;
        s.bodies.law = {law};
        s.params.gravity = Vec3d(0.002 * gravity, 0, -gravity);
        s.params.account_energy = false;
        s.add_body(made.row, Motion::kDeformable, Vec3d::Zero(), tissue);
        const SolidInfo& info = s.solids.info[made.row];
        for (uint32_t v = 0; v < info.inner.count; ++v)
            if (s.solids.position[info.inner.first + v].z() < -kLength / 2 + 1e-9) s.particles.offset[embedded_count(info) + v].w = 0;
        update_solid_dt(s.meshes, s.springs, s.solids, 0, s.particles, s.anchors, s.bodies);
        const uint32_t ticks = static_cast<uint32_t>(100 / rate);  // ms: ten time constants in a hundred parts
        for (int part = 0; part < 100; ++part) s.advance(ticks, substeps_for(1e-3 * ticks, s.bodies.stable_dt[0], 1));
        const MeshView surface = mesh_view(s.meshes, made.row);
        double sum = 0, count = 0;
        for (uint32_t v = 0; v < surface.position.size(); ++v)
            if (surface.position[v].z() > kLength / 2 - 1e-9) sum += s.offset(0, v).x() - surface.position[v].x(), ++count;
        return sum / count;
    }
    // Southwell's line (Proc R Soc A 135, 1932): 1 / lean falls linearly with the load and is 0 at the critical one. N/m.
    double measured_weight(double cells, TissueLaw law) const {
        const double critical = critical_weight() / (kDensity * area()), low = 0.7 * critical, high = 0.85 * critical;
        // lean per lateral load
        const double a = low / lean(cells, law, low), b = high / lean(cells, law, high);
        return kDensity * area() * (a * high - b * low) / (a - b);
    }
};

}  // namespace trocar
