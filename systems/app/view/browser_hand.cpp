#include "systems/app/view/browser_hand.hpp"

#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/real_time.hpp"
#include "systems/haptics/manipulator.hpp"
namespace trocar {
namespace {

constexpr int64_t kPeriod = 1'000'000;  // ns

// The place of the device that puts the tool's tip at `tip`: place_tool backwards.
Vec3d device_place(const HandTool& tool, const Vec3d& tip) {
    Vec3d place = tip;
    if (tool.pivot.kind == PivotKind::kHandle) {
        // the handle is on the other side of the pivot, on the line from the tip
        const Vec3d in = tip - tool.pivot.point;
        const double depth = in.norm();
        const Vec3d axis = depth > 0 ? Vec3d(in / depth) : Vec3d(0, 0, -1);
        place = tool.pivot.point - (tool.pivot.length - depth) * axis;
    }
    const Workspace& w = tool.workspace;
    return rotate_back(w.turn, place - w.origin) / w.scale;
}

}  // namespace

BrowserHand::BrowserHand(const HandTool& tool, const DeviceState& start) : tool_(tool), state_(start) {
    ClutchState clutch;
    tip_ = start_tip_ = place_tool(tool, start, clutch).position;
    target_ = {tip_, start.grip, 0};
}

void BrowserHand::aim(const BrowserHandTarget& target) {
    if (!target.tip.allFinite() || !std::isfinite(target.grip)) return;
    const std::lock_guard guard(lock_);
    target_ = target;
}

DeviceState BrowserHand::step() {
    constexpr double kStep = 1e-9 * kPeriod;
    BrowserHandTarget target;
    {
        const std::lock_guard guard(lock_);
        target = target_;
    }
    Vec3d velocity = (target.tip - tip_) / kLag;
    if (velocity.norm() > kFastest) velocity *= kFastest / velocity.norm();
    tip_ += velocity * kStep;
    const Vec3d place = device_place(tool_, tip_);
    state_.velocity = (place - state_.position) / kStep;
    state_.position = place;
    state_.grip = target.grip;
    state_.buttons = target.buttons;
    state_.time += kStep;
    return state_;
}

std::unique_ptr<DeviceLink> open_browser_device(std::shared_ptr<BrowserHand> hand) {
    return std::make_unique<DeviceLink>("browser", [hand = std::move(hand)](DeviceChannel& channel) {
        int64_t due = monotonic_ns();
        while (!channel.stopping()) {
            DeviceState state = hand->step();
            const int64_t now = monotonic_ns();
            state.time = 1e-9 * static_cast<double>(now);
            channel.publish(state, now);
            channel.count(DeviceCount::kReceived);
            bool fresh = false;
            channel.command(now, fresh);         // a mouse feels nothing
            due = std::max(due + kPeriod, now);  // late: no catching up
            sleep_until_ns(due);
        }
    });
}

}  // namespace trocar
