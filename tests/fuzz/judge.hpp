#pragma once
#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "components/tool_state.hpp"
#include "systems/app/run/run_watch.hpp"
#include "systems/frame/frame.hpp"
#include "systems/haptics/contact/proxy.hpp"
namespace trocar::fuzz {

enum class Kind : uint8_t {
    kNonfinite,  // places, velocities, energies or forces that are no numbers
    kInverted,   // tetrahedra inside out at the end
    kEnergy,     // more energy than what entered the scene, and 1 %
    kOverlap,    // bodies left more than 2 % of the smaller one inside each other
    kForce,      // on a hand: beyond the largest one, or a step above the ramp
    kLostTip,    // a tip inside a body for a fifth of a second without any force
    kTicks,      // the ticks of a pass, repeated, give other forces
    kSlow,       // did not end within the time allowed
    kCrash,      // ended by a signal or an exception
    kCount
};
inline constexpr std::array<std::string_view, static_cast<size_t>(Kind::kCount)> kKindNames = {
    "nonfinite", "inverted", "energy", "overlap", "force", "lost tip", "ticks", "slow", "crash"};

struct Trouble {
    Kind kind = Kind::kCrash;
    bool named = false;  // the run warned of it by name
    std::string reason;
};

// Looks at a frame pass by pass, beside the RunWatch of `trocar run`, whose warnings it compares with what it finds.
class Judge {
 public:
    // Stays at its address.
    explicit Judge(Frame& frame);
    void after_pass();
    std::vector<Trouble> finish();
    bool warned_of_slowness() const { return watch_.is_slow(); }

 private:
    struct Hand {
        HapticScratch scratch;
        Vec3d force = Vec3d::Zero();  // N, after the last tick of the pass
        uint32_t lost = 0;            // ms
    };
    void tick(const World& w);  // the ticks of the pass at hand, apart from the frame's own
    void look_at_tips();
    void look_at_energy();
    void look_at_end();
    void add(Kind kind, bool named, const std::string& reason);

    Frame& frame_;
    RunWatch watch_;
    std::vector<Hand> hands_;
    std::vector<Trouble> found_;
    double start_ = 0, start_gravity_ = 0, least_gravity_ = 0, hand_ = 0, beyond_ = 0;  // J
    std::string energy_text_;
};

}  // namespace trocar::fuzz
