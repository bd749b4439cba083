#include "systems/haptics/manipulator.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

using Matrix = Eigen::Matrix3d;

constexpr double kNearest = 5e-3;  // m, a handle or tip closer to the pivot is treated as at this distance: its
                                   // direction is undefined there

// The shortest rotation from one direction to another.
Quat turn_between(const Vec3d& from, const Vec3d& to) {
    const Vec3d axis = from.cross(to);
    const double w = 1 + from.dot(to);
    if (w > 1e-9) return normalized({w, axis.x(), axis.y(), axis.z()});
    const Vec3d any = from.unitOrthogonal();  // half a turn about any perpendicular axis
    return {0, any.x(), any.y(), any.z()};
}

// Direction of `v`, or of `other` where v is zero.
Vec3d direction_of(const Vec3d& v, const Vec3d& other) {
    const double length = v.norm();
    return length > 1e-9 ? Vec3d(v / length) : other;
}

// Jacobian of the tip with respect to the handle.
Matrix lever(const Pivot& pivot, const Vec3d& u, double r) {
    const Matrix across = Matrix::Identity() - u * u.transpose();
    return Matrix::Identity() - pivot.length / r * across;
}

void pass_pivot(const Pivot& pivot, DeviceState& state) {
    if (pivot.kind == PivotKind::kNone) return;
    const Vec3d carried = rotate(state.orientation, pivot.axis);  // handle to tip, in the orientation of the hand
    Vec3d inwards;
    if (pivot.kind == PivotKind::kHandle) {
        const Vec3d out = state.position - pivot.point;
        const Vec3d u = direction_of(out, -carried);
        state.velocity = lever(pivot, u, std::max(out.norm(), kNearest)) * state.velocity;
        state.position -= pivot.length * u;
        inwards = -u;
    } else {
        inwards = direction_of(state.position - pivot.point, carried);
    }
    state.orientation = normalized(multiply(turn_between(carried, inwards), state.orientation));
}

Matrix rotation_matrix(const Quat& q) { return Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix(); }

}  // namespace

DeviceState place_tool(const HandTool& tool, const DeviceState& device, ClutchState& clutch) {
    const Workspace& w = tool.workspace;
    DeviceState state = device;
    const Vec3d raw = w.origin + rotate(w.turn, w.scale * device.position);
    const bool held = clutch.started && (device.buttons & w.clutch) != 0;
    // a non-finite sample must not displace the clutch permanently
    if (held && raw.allFinite()) clutch.offset = clutch.tool - raw;
    state.position = held ? clutch.tool : Vec3d(raw + clutch.offset);
    state.velocity = held ? Vec3d(Vec3d::Zero()) : rotate(w.turn, w.scale * device.velocity);
    state.orientation = multiply(w.turn, device.orientation);
    if (tool.grip_closed > 0 && device.grip < tool.grip_closed) state.buttons |= 1;
    if (state.position.allFinite()) {
        clutch.tool = state.position;
        clutch.started = true;
    }
    pass_pivot(tool.pivot, state);
    return state;
}

DeviceCommand command_for_device(const HandTool& tool, const DeviceState& placed, const ClutchState& clutch, const DeviceCommand& command) {
    Matrix jacobian = Matrix::Identity();
    Vec3d force = command.force, torque = command.torque, at = command.at;
    if (tool.pivot.kind != PivotKind::kNone) {
        const Vec3d inwards = rotate(placed.orientation, tool.pivot.axis), u = -inwards;
        const double depth = (placed.position - tool.pivot.point).dot(inwards);
        const bool handle = tool.pivot.kind == PivotKind::kHandle;
        const double r = std::max(handle ? tool.pivot.length - depth : std::abs(depth), kNearest);
        if (handle) jacobian = lever(tool.pivot, u, r);
        // the instrument rotates by u x dH / r when its handle moves; by the opposite when its tip moves
        force = jacobian.transpose() * force + (handle ? 1.0 : -1.0) * torque.cross(u) / r;
        torque = torque.dot(inwards) * inwards;
        if (handle) at = placed.position + tool.pivot.length * u;
    }
    const Workspace& w = tool.workspace;
    const Matrix turn = rotation_matrix(w.turn);
    const Matrix stiffness = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(command.stiffness.data());
    DeviceCommand told;
    told.force = w.scale * rotate_back(w.turn, force);
    told.torque = rotate_back(w.turn, torque);
    told.at = rotate_back(w.turn, at - w.origin - clutch.offset) / w.scale;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(told.stiffness.data()) =
        w.scale * w.scale * (turn.transpose() * jacobian.transpose() * stiffness * jacobian * turn);
    return told;
}

}  // namespace trocar
