#pragma once
#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

enum class TextureKind : uint8_t {
    kNone,
    kGrating,  // height sin(2 pi x / length) along an axis of the body
    kNoise,    // value noise on a lattice of `length`, -height..height
};

// Haptic properties of a body's surface where they differ from the tool's. Constant after load except the
// last four members, which a local contact model fills in.
struct HapticSurface {
    uint32_t body = kNone;
    double stiffness = 0;          // N/m, in series with the tool's coupling; 0 = rigid. Deformable tissue has its own stiffness
    double damping = 0;            // N s/m, in addition to the coupling's
    double static_friction = -1;   // Coulomb, while the tip sticks; < 0 = the tool's
    double dynamic_friction = -1;  // while it slides
    TextureKind texture = TextureKind::kNone;
    double height = 0;             // m, amplitude
    double length = 1e-3;          // m, period or lattice
    Vec3d along{1, 0, 0};          // unit, body frame: of a grating
    bool deformable = false;       // its texture moves with the touched surface, else with the body
    Vec3d origin = Vec3d::Zero();  // m, world, at the time of the model
    Quat orientation;
    Vec3d velocity = Vec3d::Zero();  // m/s, of the origin, and
    Vec3d spin = Vec3d::Zero();      // rad/s, of rigid bodies
    TROCAR_FIELDS(body, "index of bodies", stiffness, "N/m", damping, "N s/m", static_friction, dynamic_friction, texture, height, "m",
                  length, "m", along, deformable, origin, "m", orientation, velocity, "m/s", spin, "rad/s");
};

}  // namespace trocar
