#pragma once
#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Times the tolerance: how far surfaces may move past each other in a pass (or its round) for four contacts to keep them apart. What
// moves may touch where none of the four is. Worst overlap of boxes in a pile with 4, 16, 28 and without a limit, of a tolerance of 0.1 mm,
// in any pass: 100 of them for 1 s 0.25, 0.55, 0.43, 0.77 mm in 0.75, 0.56, 0.44, 0.39 of the time of triangles. 1,000 for 0.6 s with 28
// and without 0.90, 1.03 mm; a heap that slams down at 60 Hz stays below 1 mm with 28, and reports 1.12 mm with 48.
inline constexpr double kMostPast = 28;

// m: the farthest that points of two rigid bodies may move past each other in the period, but for what both fall.
inline double moves_past(const ContactInputs& in, uint32_t a, uint32_t b) {
    const Surfaces& s = in.surfaces;
    const auto turning = [&](uint32_t body) { return s.poses.angular_velocity[body].norm() * s.meshes.info[s.bodies.mesh[body]].radius; };
    return ((s.poses.velocity[a] - s.poses.velocity[b]).norm() + turning(a) + turning(b)) * in.period;
}

// Whether contact of two bodies is that of their convex hulls: both are rigid and convex, one is free, none is in a hand, they
// move little past each other, and the scene asks for it (ContactParams::hulls) and for nothing that only triangles answer. All stages
// between broad-phase pairs and contact constraints must agree.
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
