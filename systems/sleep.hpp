#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/lives.hpp"
#include "components/nodes.hpp"
#include "components/particles.hpp"
#include "components/paths.hpp"
#include "components/report.hpp"
#include "components/scene.hpp"
#include "engine/sleepers.hpp"
namespace trocar {

struct SleepScratch {
    std::vector<uint32_t> parent;   // union-find over bodies, the smallest is the root
    std::vector<uint8_t> restless;  // per body; of a root: something of its group moves
    std::vector<uint8_t> moving;    // per body: its script or drive moves it in this pass
};

// What a pass decides by.
struct SleepPass {
    const SceneSettings& settings;
    double now = 0;       // s
    uint32_t period = 0;  // ms
    const Bodies& bodies;
    const Paths& paths;
    std::span<const NodeDrive> drives;
    std::span<const std::array<uint32_t, 2>> joined;  // bodies of one group wherever their boxes are
    const Lives& lives;                               // empty slots are counted neither as awake nor as asleep
};

// Decides who sleeps in this pass, before contacts are looked for. Bodies whose enlarged boxes meet, directly or through
// others, are a group (static bodies and scripted ones at the end of their path join nothing). A group sleeps when all of
// it is deformable or free and has been slower than settings.sleep_speed (root mean square over the mass; no particle ten
// times as fast) for settings.sleep_after; whatever comes near enough for its box to meet one of theirs wakes them all, a
// pass before it can touch. Who falls asleep loses its velocities, whose energy goes to work_numeric; pairs of which nobody
// moves are dropped from `pairs`. Same result for any number of threads; what is kept from pass to pass is in `sleep`.
void fall_asleep_and_wake(const SleepPass& pass, SleepScratch& scratch, Sleep& sleep, Particles& particles, Poses& poses,
                          CandidatePairs& pairs, Energy& energy, Report& report);

}  // namespace trocar
