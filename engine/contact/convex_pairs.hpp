#pragma once
#include <algorithm>
#include <cmath>

#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// m, that a rigid body of this radius may move relative to another of at least this size until contacts are found anew: rounds
// (systems/detect/broad/rounds.hpp) divide passes so, and four contacts of hulls keep what moves no farther apart; what moves on may touch
// where none of the four is. The factor by trial: with 1 to 6 boxes that slam down on edges stay within the tolerance.
inline double longest_motion(double tolerance, double radius) { return std::sqrt(2.5 * radius * tolerance); }

// Whether points of two rigid bodies may move past each other in the period by more than that, but for what both fall.
inline bool moves_past(const ContactInputs& in, uint32_t a, uint32_t b) {
    const Surfaces& s = in.surfaces;
    const auto radius = [&](uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].radius; };
    const auto turning = [&](uint32_t body) { return s.poses.angular_velocity[body].norm() * radius(body); };
    const double speed = (s.poses.velocity[a] - s.poses.velocity[b]).norm() + turning(a) + turning(b);
    return !(speed * in.period <= longest_motion(in.params.tolerance, std::min(radius(a), radius(b))));
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
    return !moves_past(in, a, b);
}
inline bool touch_as_hulls(const ContactInputs& in, uint32_t pair) { return touch_as_hulls(in, in.pairs.a[pair], in.pairs.b[pair]); }

}  // namespace trocar
