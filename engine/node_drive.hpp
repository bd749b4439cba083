#pragma once
#include "components/bodies.hpp"
#include "components/nodes.hpp"
namespace trocar {

// Forces and poses of a body whose node leaves it one coordinate q (m along its axis, rad about it).

inline bool turns(const NodeDrive& drive) { return drive.behaviour == NodeBehaviour::kDial; }

// Force along q of spring, click and detents, N or N m:
//   -stiffness (q - rest) + click s((q - click_at) / click_width) - detent sin(detents q),  s(u) = 3 u^2 - 2 u^3 in 0..1.
double drive_force(const NodeDrive& drive, double place);
// Its potential, J; 0 where spring and detents are at rest and no click has come.
double drive_energy(const NodeDrive& drive, double place);
// Bound of -d force/dq over inertia, 1/s^2.
double drive_omega_squared(const NodeDrive& drive);

// Mass of what slides, kg; moment of inertia of a dial about its axis, kg m^2: of the body's principal moments about its
// centre of mass, and by the theorem of Steiner. The body is at `orientation`, its centre of mass at `centre` (m, world).
double drive_inertia(const NodeDrive& drive, const RigidMass& mass, const Quat& orientation, const Vec3d& centre);
// Force of gravity along q, N or N m, with the centre of mass at `centre` (m, world).
double drive_weight(const NodeDrive& drive, double mass, const Vec3d& gravity, const Vec3d& centre);

// Orientation of the body at a place, and where its frame's point `in_frame` (m) is, m, world.
Quat drive_orientation(const NodeDrive& drive, double place);
Vec3d drive_point(const NodeDrive& drive, double place, const Vec3d& in_frame);

// Nearest detent, counted from the one at 0.
int32_t nearest_notch(const NodeDrive& drive, double place);
void add_node_event(NodeEventKind kind, double time, double place, NodeEvents& events);

// Takes pressed, limit and notch from the place, with an event for each that changed; a limit is left, and a button released,
// a fiftieth of the range away.
void note_place(const NodeDrive& drive, double time, DriveState& state);

}  // namespace trocar
