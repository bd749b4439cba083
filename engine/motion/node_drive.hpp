#pragma once
#include "components/bodies.hpp"
#include "components/nodes.hpp"
namespace trocar {

// Forces and poses of a body whose node leaves it one degree of freedom q (m along its axis, rad about it).

inline bool turns(const NodeDrive& drive) { return drive.behaviour == NodeBehaviour::kDial; }

// Force along q of spring, click and detents, N or N m:
//   -stiffness (q - rest) + click s((q - click_at) / click_width) - detent sin(detents q),  s(u) = 3 u^2 - 2 u^3 in 0..1.
double drive_force(const NodeDrive& drive, double coordinate);
// Its potential, J; 0 where spring and detents are at rest and the button has not clicked.
double drive_energy(const NodeDrive& drive, double coordinate);
// Bound of -d force/dq over inertia, 1/s^2.
double drive_omega_squared(const NodeDrive& drive);

// Mass of a sliding body, kg; moment of inertia of a dial about its axis, kg m^2, from the body's principal
// moments about its centre of mass and the parallel-axis theorem. The body is at `orientation`, its centre of
// mass at `centre` (m, world).
double drive_inertia(const NodeDrive& drive, const RigidMass& mass, const Quat& orientation, const Vec3d& centre);
// Force of gravity along q, N or N m, with the centre of mass at `centre` (m, world).
double drive_weight(const NodeDrive& drive, double mass, const Vec3d& gravity, const Vec3d& centre);

// Orientation of the body at a coordinate, and world position (m) of the point `in_frame` (m) of its frame.
Quat drive_orientation(const NodeDrive& drive, double coordinate);
Vec3d drive_point(const NodeDrive& drive, double coordinate, const Vec3d& in_frame);

// Nearest detent, counted from the one at 0.
int32_t nearest_notch(const NodeDrive& drive, double coordinate);
void add_node_event(NodeEventKind kind, double time, double coordinate, NodeEvents& events);

// Updates pressed, limit and notch from the coordinate, with an event for each change; hysteresis for leaving
// a limit and releasing a button is a fiftieth of the range.
void note_coordinate(const NodeDrive& drive, double time, DriveState& state);

}  // namespace trocar
