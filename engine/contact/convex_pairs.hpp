#pragma once
#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Times the tolerance: how far surfaces may move past each other in a pass (or its round) for four contacts to keep them apart. What
// moves may touch where none of the four is. Worst overlap of boxes in a pile with 1, 4, 16 and without a limit, of a tolerance of 0.1 mm:
// 100 of them for 2 s 0.03, 0.15, 0.46, 2.6 mm in 0.92, 0.67, 0.52, 0.42 of the time of triangles; 1,000 for 0.6 s 0.01, 0.01, 3.0, 3.7 mm
// in 0.99, 0.94, 0.67, 0.41.
inline constexpr double kMostPast = 4;

// m: the farthest that points of two rigid bodies may move past each other in the period, but for what both fall.
inline double moves_past(const ContactInputs& in, uint32_t a, uint32_t b) {
    const Surfaces& s = in.surfaces;
    const auto turning = [&](uint32_t body) { return s.poses.angular_velocity[body].norm() * s.meshes.info[s.bodies.mesh[body]].radius; };
    return ((s.poses.velocity[a] - s.poses.velocity[b]).norm() + turning(a) + turning(b)) * in.period;
}

// Whether contact of two bodies is that of their convex hulls: both are rigid and convex, one is free, none is in a hand, they hardly
// move past each other, and the scene asks for it (ContactParams::hulls) and for nothing that only triangles answer. All stages between
// broad-phase pairs and contact constraints must agree.
inline bool touch_as_hulls(const ContactInputs& in, uint32_t a, uint32_t b) {
    if (!in.params.hulls || in.hulls == nullptr || in.hulls->hull.empty()) return false;
    const Bodies& bodies = in.surfaces.bodies;
    if (bodies.motion[a] != Motion::kFree && bodies.motion[b] != Motion::kFree) return false;
    if (bodies.motion[a] == Motion::kHand || bodies.motion[b] == Motion::kHand) return false;
    if (in.params.faces || in.params.contours || in.params.regions) return false;
    if (in.params.deep != DeepResponse::kNone || in.params.direction != ResponseDirection::kLocal) return false;
    if (in.hulls->of(bodies, a) == nullptr || in.hulls->of(bodies, b) == nullptr) return false;
    return moves_past(in, a, b) <= kMostPast * in.params.tolerance;
}
inline bool touch_as_hulls(const ContactInputs& in, uint32_t pair) { return touch_as_hulls(in, in.pairs.a[pair], in.pairs.b[pair]); }

}  // namespace trocar
