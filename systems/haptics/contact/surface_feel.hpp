#pragma once
#include <span>

#include "components/bodies.hpp"
#include "components/haptic_surface.hpp"
#include "components/nodes.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
#include "engine/haptics/local_contact_model.hpp"
namespace trocar {

// Copies the haptic surfaces into a model, with the present poses of their bodies.
void publish_surfaces(std::span<const HapticSurface> surfaces, const Poses& poses, LocalContactModel& out);

// Sets the surface stiffness of bodies on buttons, sliders and dials at the first touch: publish_compliance needs
// two passes with contact, until which such a body would feel rigid. After an impact a tool of mass m_t and a body
// whose coordinate has inertia m_e along the contact normal move on at the fraction s = m_t / (m_t + m_e) of the
// tool's speed, as if a spring k2 = k (1 - s) / s were in series with the coupling k. Omitted for a body pressed
// against its limit, and for a tool that forces do not move. Call before publish_compliance.
void publish_yield(const Nodes& nodes, const NodeState& node_state, const Bodies& bodies, const HandTool& tool, const ToolState& state,
                   LocalContactModel& out);

// Surface properties of a body; made if it has none of its own.
HapticSurface& own_surface(uint32_t body, LocalContactModel& model);

// Surface properties of a body; null if it has none of its own.
const HapticSurface* surface_of(const LocalContactModel& model, uint32_t body);

// Effective properties of a tool against a body: the tool's coupling and friction; or, if the body has its
// own, coupling and surface stiffness in series, k1 k2 / (k1 + k2), dampings added, and the surface's
// friction for a tip that sticks or slides: two coefficients for one friction cone (Harwin & Melder,
// "Improved haptic rendering for multi-finger manipulation using friction cone based god-objects",
// Eurohaptics 2002).
struct SurfaceFeel {
    double stiffness = 0;  // N/m
    double damping = 0;    // N s/m
    double friction = 0;
};
SurfaceFeel feel_of(const HandTool& tool, const LocalContactModel& model, uint32_t body, bool sliding);

// A texture at a point: its height (m, -height..height) and gradient along the surface (world axes).
struct TextureHeight {
    double height = 0;
    Vec3d slope = Vec3d::Zero();
};
// `position`: m, in the frame of the texture. Continuous; noise has a continuous gradient.
TextureHeight texture_height(const HapticSurface& surface, const Vec3d& position);

// Point at which the texture is felt, m: the proxy; for a point shell the force-weighted centre of its
// contacts.
Vec3d touched_position(const ToolState& state);

// The contact force with the texture, `age` (s) after the model's time. A tip pressed by d = |proxy - device|
// at a point of height h, |h| <= H, has the energy U = k (d^2 / 2 + h (d - H ln(1 + d / H))): along the
// contact force its force grows by 1 + h / (d + H), never pulling and continuous at first touch; across it is
// the negative gradient of U along the surface, towards the valleys as in Minsky et al. ("Feeling and
// seeing", I3D 1990). A texture alone therefore generates no energy on any path of the tip.
Vec3d textured_force(const HapticSurface& surface, double age, double stiffness, const ToolState& state, const Vec3d& force);

}  // namespace trocar
