#pragma once
#include <span>

#include "components/bodies.hpp"
#include "components/haptics.hpp"
#include "components/nodes.hpp"
namespace trocar {

// Gives a model the surfaces with where their bodies are now.
void publish_surfaces(std::span<const HapticSurface> surfaces, const Poses& poses, LocalContactModel& out);

// Gives a model what bodies on buttons, sliders and dials yield to a tool that comes upon them: until two passes saw the
// touch and publish_give can tell, the tool would stand against a surface that does not know of it. A tool of mass m_t on a
// body whose coordinate has inertia m_e along the way in goes on with it at m_t / (m_t + m_e) of its speed: that share s of its
// way is the body's, as of a spring in a row with the coupling k, k2 = k (1 - s) / s. Nothing for a body at the limit that
// it is pressed against. Nothing either under a tool that no force moves. Before publish_give.
void publish_yield(const Nodes& nodes, const NodeState& node_state, const Bodies& bodies, const HandTool& tool, const ToolState& state,
                   LocalContactModel& out);

// Surface properties of a body; null where it has none of its own.
const HapticSurface* surface_of(const LocalContactModel& model, uint32_t body);

// How a tool works against a body: its own coupling and friction, or where the body has properties of its own the coupling
// in a row with the surface's stiffness, k1 k2 / (k1 + k2), dampings added, and the surface's friction for a tip that sticks
// or slides: two coefficients for one friction cone (Harwin & Melder, "Improved haptic rendering for multi-finger
// manipulation using friction cone based god-objects", Eurohaptics 2002).
struct SurfaceFeel {
    double stiffness = 0;  // N/m
    double damping = 0;    // N s/m
    double friction = 0;
};
SurfaceFeel feel_of(const HandTool& tool, const LocalContactModel& model, uint32_t body, bool sliding);

// A texture at a place: how high it stands (m, -height..height) and how that changes along the surface (world axes).
struct TextureHeight {
    double height = 0;
    Vec3d slope = Vec3d::Zero();
};
// `place` (m) in the frame of the texture. Continuous; noise with its slope.
TextureHeight texture_height(const HapticSurface& surface, const Vec3d& place);

// Where a texture is felt, m: at the proxy; by a shell in the middle of what touches, by the forces there.
Vec3d touched_place(const ToolState& state);

// The contact force with the texture felt, `age` (s) after the model's time. A tip pressed d = |proxy - device| deep at a
// place of height h, |h| <= H, is held as by the energy U = k (d^2 / 2 + h (d - H ln(1 + d / H))): along the contact force it
// grows by 1 + h / (d + H), never a pull and without a step at first touch; across it is -dU along the surface, up the
// slope into the valleys as in Minsky et al. ("Feeling and seeing", I3D 1990). So a texture alone gives no energy, whichever
// way the tip takes.
Vec3d textured_force(const HapticSurface& surface, double age, double stiffness, const ToolState& state, const Vec3d& force);

}  // namespace trocar
