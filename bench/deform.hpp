#pragma once
#include <memory>

#include "bench/rows.hpp"
#include "tests/systems/spring_graph.hpp"
namespace trocar::bench {

// Cost of one gathered float in s: 16-wide gathers of local numbers over `elements` floats, best of several runs; NaN
// without AVX-512.
double gather_seconds(uint32_t elements);

bool have_bullet();

// A Bullet soft body of the same masses and springs, gravity along -z, collisions off. Empty functions without Bullet.
struct BulletBody {
    std::function<void()> step;                  // 1 ms
    std::function<std::vector<Vec3d>()> places;  // m
    explicit operator bool() const { return static_cast<bool>(step); }
};
// Position-based links with so many iterations a step.
BulletBody bullet_links(const SpringGraph& graph, int iterations);
// Its deformable world: mass-spring force, implicit; steps of dt s. Gravity (m/s^2) may change.
struct BulletDeformable : BulletBody {
    std::function<void(double gravity)> set_gravity;
};
BulletDeformable bullet_deformable(const SpringGraph& graph, double dt, double damping);

// Rows of error against time: integrators, steps, stiffness. References are kept in `cache`, empty = nowhere.
void error_rows(Report& report, const std::string& cache);
// Rows of what solids miss closed forms by, finite elements beside.
void model_rows(Report& report);

}  // namespace trocar::bench
