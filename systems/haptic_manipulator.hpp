#pragma once
#include "components/haptics.hpp"
namespace trocar {

// Where a tool is when its device is at `device` (device frame): into the world by the workspace, held while a clutch
// button is down, then through the pivot. The same sample twice gives the same place twice.
// A grip below grip_closed presses the first button.
// Workspace: x = origin + turn (scale x_device) + what the clutch moved. Pivot at P with the handle at H, u = (H - P)/r,
// r = |H - P|: kHandle puts the tip at H - length u, so that it moves as J = I - (length / r)(I - u u^T) says: inverted
// and scaled by the lever across, as the hand does along. kTip leaves it where the device is. Either way the
// instrument's axis passes through P and the device's turn about it is the roll.
DeviceState place_tool(const HandTool& tool, const DeviceState& device, ClutchState& clutch);

// What the device must do for the tool to feel `command` (world, at the tip), by virtual work: F_device =
// scale turn^T J^T (F + torque of the lever), stiffness and place likewise. Of the torque the roll passes a pivot, all of
// it passes without one. `placed` is what place_tool gave.
DeviceCommand command_for_device(const HandTool& tool, const DeviceState& placed, const ClutchState& clutch, const DeviceCommand& command);

}  // namespace trocar
