#pragma once
#include <memory>

#include "bench/table.hpp"
#include "tests/systems/advance/tissue/spring_graph.hpp"
namespace trocar::bench {

// Cost of one gathered float in s: 16-wide gathers of local indices over `elements` floats, best of several
// runs; NaN without AVX-512.
double gather_seconds(uint32_t elements);

bool have_bullet();

// A Bullet soft body with the same masses and springs, gravity along -z, no collisions. Empty without Bullet.
struct BulletBody {
    std::function<void()> step;                     // 1 ms
    std::function<std::vector<Vec3d>()> positions;  // m
    explicit operator bool() const { return static_cast<bool>(step); }
};
// Position-based links with the given iterations per step.
BulletBody bullet_links(const SpringGraph& graph, int iterations);
// Bullet's deformable world: mass-spring force, implicit; steps of dt s. Gravity (m/s^2) may change.
struct BulletDeformable : BulletBody {
    std::function<void(double gravity)> set_gravity;
};
BulletDeformable bullet_deformable(const SpringGraph& graph, double dt, double damping);

// Error against time: integrators, steps, stiffness. `cache`: folder for references; empty = none.
void error_rows(Report& report, const std::string& cache);
// Processor time and error of a held sheet by both integrators.
void sheet_rows(Report& report);
// Errors of solids against closed forms, with those of finite elements.
void model_rows(Report& report);
// Laws and relaxation of solids against closed forms, and what they cost.
void law_rows(Report& report);

// Solids by how their surface cuts the lattice, against exact solutions.
void boundary_rows(Report& report);

}  // namespace trocar::bench
