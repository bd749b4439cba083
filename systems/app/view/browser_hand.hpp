#pragma once
#include <atomic>
#include <memory>
#include <mutex>

#include "components/tool.hpp"
#include "engine/devices/link.hpp"
namespace trocar {

// What a mouse says of a hand.
struct BrowserHandTarget {
    Vec3d tip = Vec3d::Zero();  // m, world: where the tool's tip should go
    double grip = 0;            // rad, between the jaws
    uint32_t buttons = 0;       // one bit each
};

// The device `browser`: a hand that follows a mouse. A mouse reports some 60 places a second, far apart: the hand goes after them
// at 1 kHz with a lag of kLag and at most kFastest, and so has a velocity. The safety rules of devices stand behind it, as behind
// any other. Without a mouse it stays where it is.
class BrowserHand {
 public:
    static constexpr double kLag = 0.02;     // s; a mouse's period is 0.008 to 0.017
    static constexpr double kFastest = 0.5;  // m/s, of the tip: what a hand in surgery reaches

    // `start`: what the device of the tool reports at the start of the run.
    BrowserHand(const HandTool& tool, const DeviceState& start);
    // Any thread. Targets that are no numbers are ignored.
    void aim(const BrowserHandTarget& target);
    // One millisecond of its motion: the next state of the device.
    DeviceState step();
    // m, world, of the tip at the start.
    const Vec3d& start_tip() const { return start_tip_; }

 private:
    HandTool tool_;
    DeviceState state_;  // of the device
    Vec3d tip_, start_tip_;
    std::mutex lock_;
    BrowserHandTarget target_;
};

// A device whose thread moves the hand.
std::unique_ptr<DeviceLink> open_browser_device(std::shared_ptr<BrowserHand> hand);

}  // namespace trocar
