#pragma once
#include <vector>

#include "tests/systems/advance/tissue/spring_graph.hpp"
namespace trocar::bench {

// Extended position based dynamics of a spring graph (Macklin, Mueller, Chentanez, "XPBD", MIG 2016), eight
// springs at a time: reference for the integrators of deformable bodies. Without contact and volume forces.
class XpbdSprings {
 public:
    // damping: 1/s.
    XpbdSprings(const SpringGraph& graph, double damping);
    // One step of dt (s) with the given sweeps over the springs, under gravity along -z (m/s^2).
    void step(double dt, uint32_t sweeps, double gravity);
    std::vector<Vec3d> positions() const;  // m

 private:
    void sweep(bool many);

    uint32_t count_ = 0;
    double damping_ = 0, last_dt_ = 0;  // 1/s, s
    float stiffness_ = 0, compliance_ = 0;
    // m, w = inverse mass; m. A step's increments are summed separately and added once, at its end.
    std::vector<Float4> position_, increment_;
    std::vector<Vec3> velocity_;  // m/s, half a step behind the positions
    // Eight springs per batch: first ends, second ends, all different. Padding has indices beyond the
    // particles.
    std::vector<uint32_t> end_;
    std::vector<float> rest_, multiplier_;  // m, N s^2
};

}  // namespace trocar::bench
