#pragma once
#include <string>
#include <vector>

#include "content/scene/scene_file.hpp"
#include "systems/app/capture/capture_replay.hpp"
namespace trocar {

// Changes a captured world by keys of its scene that a pass reads anew: gravity = [x, y, z], substep, sleep_speed, sleep_after, every
// number, switch and choice of [contact], and BODY.tissue.friction, .damping, .restitution ("body" as BODY: of every body). Throws
// InputError that says what else was asked for, or which value is none.
void change_world(const Override& change, World& world);

// One pass as recorded, and as it goes with the changes.
struct WhatIfPass {
    uint64_t pass = 0;
    double depth[2]{}, force[2]{}, ms[2]{};  // m, N on the hand, ms
    uint64_t contacts[2]{};
    bool same = true;  // state after the pass
};

// Passes of a capture again from its first state, in a world with the changes. Call inside ThreadPool::run. Throws InputError.
std::vector<WhatIfPass> what_if(const Capture& capture, std::span<const Override> changes);

// Maxima and means side by side; one line per pass: pass, then each value as recorded and changed.
std::string what_if_text(const std::vector<WhatIfPass>& passes);
std::string what_if_csv(const std::vector<WhatIfPass>& passes);

}  // namespace trocar
