#include "systems/haptics/contact/push_out.hpp"

#include "systems/haptics/contact/device_motion.hpp"
namespace trocar {

Vec3d pushed_after(const Vec3d& pushed, const Vec3d& goal, double seconds) {
    const Vec3d left = goal - pushed;
    return left == Vec3d::Zero() ? goal : Vec3d(pushed + limited_to(left, kPushOutSpeed * seconds));
}

bool push_out(const LocalContactModel& model, ToolState& state) {
    if (model.exit.body == kNone) return false;
    state.proxy = state.device.position + state.pushed;
    state.proxy_turn = state.device.orientation;
    state.contact.clear();
    state.contacts = 1;
    state.touched = model.exit.body;
    return true;
}

ProxyStart proxy_start(const LocalContactModel& model, const ToolState& state) {
    constexpr double kApart = 1e-3;  // m
    const bool apart = model.placed && state.pushed != Vec3d::Zero() && (model.tip - state.device.position).norm() > kApart;
    return apart ? ProxyStart{model.tip, model.turn} : ProxyStart{state.device.position, state.device.orientation};
}

}  // namespace trocar
