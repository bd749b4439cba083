#pragma once
#include "components/tool_state.hpp"
#include "engine/haptics/local_contact_model.hpp"
namespace trocar {

// A tool that is inside a body (LocalContactModel::exit) is moved out by the shortest way at kPushOutSpeed, its proxy
// ahead of the device by ToolState::pushed: the coupling's force grows by stiffness times that speed. Outside, contact
// is as always, and the simulated tool returns to the device at the same speed.
inline constexpr double kPushOutSpeed = 0.05;  // m/s: 25 N/s at 500 N/m, and 1 mm a pass, less than an edge

// ToolState::pushed after `seconds` more.
Vec3d pushed_after(const Vec3d& pushed, const Vec3d& goal, double seconds);

// Holds the proxy of a tool inside a body where it is pushed to. False: it is in none.
bool push_out(const LocalContactModel& model, ToolState& state);

// Where a proxy starts: with the device, or with the simulated tool that was pushed out of a body.
struct ProxyStart {
    Vec3d tip = Vec3d::Zero();
    Quat turn;
};
ProxyStart proxy_start(const LocalContactModel& model, const ToolState& state);

}  // namespace trocar
