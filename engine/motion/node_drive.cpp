#include "engine/motion/node_drive.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/geometry/quaternion.hpp"
namespace trocar {

double drive_force(const NodeDrive& drive, double coordinate) {
    double force = -drive.stiffness * (coordinate - drive.rest);
    if (drive.click > 0) {
        const double u = std::clamp((coordinate - drive.click_at) / drive.click_width, 0.0, 1.0);
        force += drive.click * u * u * (3 - 2 * u);
    }
    if (drive.detents > 0) force -= drive.detent * std::sin(drive.detents * coordinate);
    return force;
}

double drive_energy(const NodeDrive& drive, double coordinate) {
    double energy = 0.5 * drive.stiffness * (coordinate - drive.rest) * (coordinate - drive.rest);
    if (drive.click > 0 && coordinate > drive.click_at) {
        const double part = (coordinate - drive.click_at) / drive.click_width, u = std::min(part, 1.0);
        energy -= drive.click * drive.click_width * (u * u * u * (1 - 0.5 * u) + std::max(part - 1, 0.0));
    }
    if (drive.detents > 0) energy += drive.detent / drive.detents * (1 - std::cos(drive.detents * coordinate));
    return energy;
}

double drive_omega_squared(const NodeDrive& drive) {
    double stiffness = drive.stiffness + drive.detents * drive.detent;
    if (drive.click > 0) stiffness += 1.5 * drive.click / drive.click_width;  // the largest slope of s is 3/2
    return stiffness / drive.inertia;
}

double drive_inertia(const NodeDrive& drive, const RigidMass& mass, const Quat& orientation, const Vec3d& centre) {
    if (!turns(drive)) return mass.mass;
    const Vec3d axis = rotate_back(multiply(orientation, mass.axes), drive.axis);
    return mass.moments.dot(axis.cwiseProduct(axis)) + mass.mass * (centre - drive.pivot).cross(drive.axis).squaredNorm();
}

double drive_weight(const NodeDrive& drive, double mass, const Vec3d& gravity, const Vec3d& centre) {
    if (!turns(drive)) return mass * drive.axis.dot(gravity);
    return mass * drive.axis.dot((centre - drive.pivot).cross(gravity));
}

Quat drive_orientation(const NodeDrive& drive, double coordinate) {
    return turns(drive) ? normalized(multiply(from_rotation_vector(coordinate * drive.axis), drive.orientation)) : drive.orientation;
}

Vec3d drive_point(const NodeDrive& drive, double coordinate, const Vec3d& in_frame) {
    if (!turns(drive)) return drive.origin + coordinate * drive.axis + rotate(drive.orientation, in_frame);
    const Vec3d arm = drive.origin - drive.pivot + rotate(drive.orientation, in_frame);
    return drive.pivot + rotate(from_rotation_vector(coordinate * drive.axis), arm);
}

int32_t nearest_notch(const NodeDrive& drive, double coordinate) {
    const double notch = coordinate * drive.detents / (2 * std::numbers::pi);
    return static_cast<int32_t>(std::lround(std::clamp(notch, -1e9, 1e9)));
}

void add_node_event(NodeEventKind kind, double time, double coordinate, NodeEvents& events) {
    events.last[events.total++ % kKeptNodeEvents] = {kind, time, coordinate};
    ++events.count[static_cast<size_t>(kind)];
}

void note_coordinate(const NodeDrive& drive, double time, DriveState& state) {
    const double q = state.coordinate;
    const double slack = 0.02 * (std::isfinite(drive.highest - drive.lowest) ? drive.highest - drive.lowest : 1);
    const bool pressed = q >= (state.pressed ? drive.click_at - slack : drive.click_at);
    if (pressed != state.pressed) add_node_event(pressed ? NodeEventKind::kPressed : NodeEventKind::kReleased, time, q, state.events);
    state.pressed = pressed;
    const double lowest = state.limit < 0 ? drive.lowest + slack : drive.lowest;
    const double highest = state.limit > 0 ? drive.highest - slack : drive.highest;
    const int8_t limit = q <= lowest ? -1 : q >= highest ? 1 : 0;
    if (limit != 0 && limit != state.limit) add_node_event(NodeEventKind::kLimit, time, q, state.events);
    state.limit = limit;
    if (drive.detents == 0) return;
    const int32_t notch = nearest_notch(drive, q);
    if (notch != state.notch) add_node_event(NodeEventKind::kDetent, time, q, state.events);
    state.notch = notch;
}

}  // namespace trocar
