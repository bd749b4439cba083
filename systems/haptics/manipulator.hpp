#pragma once
#include "components/device.hpp"
#include "components/tool.hpp"
#include "components/tool_state.hpp"
namespace trocar {

// Pose of a tool for a `device` sample (device frame): into the world by the workspace, frozen while a clutch
// button is pressed, then through the pivot. Idempotent for a repeated sample. A grip below grip_closed
// presses the first button. Workspace: x = origin + turn (scale x_device) + clutch offset. Pivot at P with
// the handle at H, u = (H - P)/r, r = |H - P|: kHandle puts the tip at H - length u, with Jacobian J = I -
// (length / r)(I - u u^T): across, the motion is inverted and scaled by the lever; along, it equals the
// hand's. kTip keeps the tip at the device. In both cases the instrument's axis passes through P and the
// device's rotation about it is the roll.
DeviceState place_tool(const HandTool& tool, const DeviceState& device, ClutchState& clutch);

// Device command that lets the tool feel `command` (world, at the tip), by virtual work: F_device = scale
// turn^T J^T (F + torque of the lever), stiffness and position likewise. A pivot transmits only the roll
// component of the torque; without one all of it is transmitted. `placed` is the result of place_tool.
DeviceCommand command_for_device(const HandTool& tool, const DeviceState& placed, const ClutchState& clutch, const DeviceCommand& command);

}  // namespace trocar
