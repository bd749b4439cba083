#pragma once
#include "engine/contact/contact_inputs.hpp"
namespace trocar {

// Whether contact of two bodies is that of their convex hulls: both are rigid and convex, one is free, none is in a hand, and the scene
// asks for nothing that only triangles answer. All stages between broad-phase pairs and contact constraints must agree.
inline bool touch_as_hulls(const ContactInputs& in, uint32_t a, uint32_t b) {
    if (in.hulls == nullptr || in.hulls->hull.empty()) return false;
    const Bodies& bodies = in.surfaces.bodies;
    if (bodies.motion[a] != Motion::kFree && bodies.motion[b] != Motion::kFree) return false;
    if (bodies.motion[a] == Motion::kHand || bodies.motion[b] == Motion::kHand) return false;
    if (in.params.faces || in.params.contours || in.params.regions) return false;
    if (in.params.deep != DeepResponse::kNone || in.params.direction != ResponseDirection::kLocal) return false;
    return in.hulls->of(bodies, a) != nullptr && in.hulls->of(bodies, b) != nullptr;
}
inline bool touch_as_hulls(const ContactInputs& in, uint32_t pair) { return touch_as_hulls(in, in.pairs.a[pair], in.pairs.b[pair]); }

}  // namespace trocar
