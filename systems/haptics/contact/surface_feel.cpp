#include "systems/haptics/contact/surface_feel.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "engine/geometry/point_triangle.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/motion/node_drive.hpp"
namespace trocar {
namespace {

// Hash of a lattice point to -1..1, identical on every machine.
double lattice_value(int64_t x, int64_t y, int64_t z) {
    uint64_t h = static_cast<uint64_t>(x) * 0x9e3779b97f4a7c15ull ^ static_cast<uint64_t>(y) * 0xbf58476d1ce4e5b9ull ^
                 static_cast<uint64_t>(z) * 0x94d049bb133111ebull;
    h ^= h >> 31, h *= 0x7fb5d329728ea185ull, h ^= h >> 27, h *= 0x81dadef4bc2dd44dull, h ^= h >> 33;
    return 2 * static_cast<double>(h >> 11) * 0x1p-53 - 1;
}

// Trilinear between lattice points, with the weights 3 t^2 - 2 t^3: continuous with its slope (1 per cell).
TextureHeight value_noise(const Vec3d& p) {
    const Vec3d cell(std::floor(p.x()), std::floor(p.y()), std::floor(p.z())), t = p - cell;
    TextureHeight sum;
    for (int corner = 0; corner < 8; ++corner) {
        std::array<double, 3> weight{}, rate{};
        std::array<int64_t, 3> at{};
        for (int k = 0; k < 3; ++k) {
            const size_t axis = static_cast<size_t>(k);
            const int up = corner >> k & 1;
            const double ease = t[k] * t[k] * (3 - 2 * t[k]), eased = 6 * t[k] * (1 - t[k]);
            at[axis] = static_cast<int64_t>(cell[k]) + up;
            weight[axis] = up ? ease : 1 - ease;
            rate[axis] = up ? eased : -eased;
        }
        const double value = lattice_value(at[0], at[1], at[2]);
        sum.height += weight[0] * weight[1] * weight[2] * value;
        sum.slope += value * Vec3d(rate[0] * weight[1] * weight[2], weight[0] * rate[1] * weight[2], weight[0] * weight[1] * rate[2]);
    }
    return sum;
}

// Vector from a point to the closest one of a body's triangles in the model, m; infinite if there are none.
Vec3d offset_to_body(const LocalContactModel& model, uint32_t body, const Vec3d& point) {
    double nearest2 = std::numeric_limits<double>::infinity();
    Vec3d offset = Vec3d::Constant(nearest2);
    for (size_t t = 0; t < model.triangle.size(); ++t) {
        if (model.body[t] != body) continue;
        const Triangle& v = model.triangle[t];
        const TrianglePoint q = closest_point_on_triangle(point, model.position[v[0]], model.position[v[1]], model.position[v[2]]);
        if (q.squared_distance < nearest2) nearest2 = q.squared_distance, offset = q.offset;
    }
    return offset;
}

// 1/kg, of a driven body at a position along a unit direction in which it is pressed; 0 where it cannot move.
double drive_mobility(const NodeDrive& drive, const DriveState& state, const Vec3d& position, const Vec3d& direction) {
    const double along = turns(drive) ? direction.dot(drive.axis.cross(position - drive.pivot)) : direction.dot(drive.axis);
    if ((state.limit > 0 && along > 0) || (state.limit < 0 && along < 0)) return 0;
    return along * along / drive.inertia;
}

}  // namespace

void publish_yield(const Nodes& nodes, const NodeState& node_state, const Bodies& bodies, const HandTool& tool, const ToolState& state,
                   LocalContactModel& out) {
    if (!(bodies.inv_mass[tool.body] > 0)) return;
    const double tool_mass = 1 / bodies.inv_mass[tool.body];
    const uint32_t touched = state.contacts > 0 ? state.touched : kNone;
    for (size_t d = 0; d < nodes.drive.size(); ++d) {
        const NodeDrive& drive = nodes.drive[d];
        if (touched == drive.body && state.last_pass.touched == drive.body) continue;
        const Vec3d at = state.proxy_valid ? state.proxy : state.device.position, offset = offset_to_body(out, drive.body, at);
        const double distance = offset.norm();
        if (!(distance > 0 && std::isfinite(distance))) continue;
        const double mobility = tool_mass * drive_mobility(drive, node_state.drive[d], at + offset, offset / distance);
        const double share = mobility / (1 + mobility);
        if (!(share > 0)) continue;
        own_surface(drive.body, out).stiffness = tool.coupling_stiffness * (1 - share) / share;
    }
}

HapticSurface& own_surface(uint32_t body, LocalContactModel& model) {
    const auto found = std::find_if(model.surface.begin(), model.surface.end(), [&](const HapticSurface& s) { return s.body == body; });
    if (found != model.surface.end()) return *found;
    model.surface.emplace_back().body = body;
    return model.surface.back();
}

void publish_surfaces(std::span<const HapticSurface> surfaces, const Poses& poses, LocalContactModel& out) {
    out.surface.assign(surfaces.begin(), surfaces.end());
    for (HapticSurface& s : out.surface) {
        if (s.deformable) continue;
        s.origin = poses.origin[s.body];
        s.orientation = poses.orientation[s.body];
        s.velocity = poses.velocity[s.body];
        s.spin = poses.angular_velocity[s.body];
    }
}

const HapticSurface* surface_of(const LocalContactModel& model, uint32_t body) {
    if (body == kNone) return nullptr;
    const auto found = std::find_if(model.surface.begin(), model.surface.end(), [&](const HapticSurface& s) { return s.body == body; });
    return found == model.surface.end() ? nullptr : &*found;
}

SurfaceFeel feel_of(const HandTool& tool, const LocalContactModel& model, uint32_t body, bool sliding) {
    SurfaceFeel feel{tool.coupling_stiffness, tool.coupling_damping, tool.friction};
    const HapticSurface* s = model.surface.empty() ? nullptr : surface_of(model, body);
    if (!s) return feel;
    if (s->stiffness > 0) feel.stiffness *= s->stiffness / (tool.coupling_stiffness + s->stiffness);
    // what yields under the tip moves with it
    if (s->deformable) feel.damping *= feel.stiffness / tool.coupling_stiffness;
    feel.damping += s->damping;
    const double friction = sliding ? s->dynamic_friction : s->static_friction;
    if (friction >= 0) feel.friction = friction;
    return feel;
}

TextureHeight texture_height(const HapticSurface& surface, const Vec3d& position) {
    const Vec3d p = position / surface.length;
    TextureHeight at;
    if (surface.texture == TextureKind::kGrating) {
        const double phase = 2 * std::numbers::pi * surface.along.dot(p);
        at = {std::sin(phase), 2 * std::numbers::pi * std::cos(phase) * surface.along};
    } else if (surface.texture == TextureKind::kNoise) {
        at = value_noise(p);
    }
    return {surface.height * at.height, surface.height / surface.length * at.slope};
}

Vec3d touched_position(const ToolState& state) {
    Vec3d sum = Vec3d::Zero();
    double press = 0;
    for (const ShellContact& c : state.contact) {
        if (c.body != state.touched) continue;
        const double force = c.force.norm();
        sum += force * c.arm;
        press += force;
    }
    return press > 0 ? Vec3d(state.proxy + sum / press) : state.proxy;
}

Vec3d textured_force(const HapticSurface& surface, double age, double stiffness, const ToolState& state, const Vec3d& force) {
    const double depth = (state.proxy - state.device.position).norm(), pull = force.norm();
    if (surface.texture == TextureKind::kNone || depth == 0 || pull == 0) return force;
    const Quat turn = multiply(from_rotation_vector(age * surface.spin), surface.orientation);
    const Vec3d carried = surface.deformable ? state.carried : Vec3d(age * surface.velocity);
    const TextureHeight at = texture_height(surface, rotate_back(turn, touched_position(state) - carried - surface.origin));
    const Vec3d slope = rotate(turn, at.slope), normal = force / pull, along = slope - normal.dot(slope) * normal;
    // the smooth force may be below the spring's: it ramps in and is limited
    const double share = std::min(1.0, pull / (stiffness * depth)), most = surface.height;
    return (1 + at.height / (depth + most)) * force - share * stiffness * (depth - most * std::log1p(depth / most)) * along;
}

}  // namespace trocar
