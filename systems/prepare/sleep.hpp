#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/bodies.hpp"
#include "components/contacts.hpp"
#include "components/nodes.hpp"
#include "components/particles.hpp"
#include "components/paths.hpp"
#include "components/relaxation.hpp"
#include "components/report.hpp"
#include "components/scene.hpp"
#include "components/spawning.hpp"
#include "components/springs.hpp"
#include "engine/contact/sleeping_bodies.hpp"
namespace trocar {

struct SleepScratch {
    std::vector<uint32_t> parent;   // union-find over bodies, the smallest is the root
    std::vector<uint8_t> restless;  // per body; for a root: a body of its group moves
    std::vector<uint8_t> moving;    // per body: its script or drive moves it in this pass
};

// Inputs of the decision.
struct SleepPass {
    const SceneSettings& settings;
    double now = 0;       // s
    uint32_t period = 0;  // ms
    const Bodies& bodies;
    const Paths& paths;
    std::span<const NodeDrive> drives;
    std::span<const std::array<uint32_t, 2>> joined;  // pairs of bodies in one group wherever their boxes are
    const SpawnState& spawning;                       // empty slots are counted neither as awake nor as asleep
    const Springs& springs;
    const Relaxation& relaxation;
};

// What the Maxwell elements of a body have yet to lose: the strain of the springs of its long-term law that has their tension, root mean
// square over the springs. At rest it creeps by no more than about this strain, and its stresses fall by no more than its modulus times it.
double strain_to_relax(const Relaxation& relaxation, const RelaxingBody& body, const Springs& springs, uint32_t prototype);
// Strain that a body which relaxes may have yet to lose when it falls asleep (strain_to_relax): a tenth of a per mille of its extent, and
// of Young's modulus. Chosen: of 10 % strain with a branch as stiff as the body it takes seven relaxation times.
inline constexpr double kRelaxedStrain = 1e-4;

// Decides before contact detection which bodies sleep in this pass. Bodies whose enlarged boxes meet,
// directly or through others, form a group; static bodies, and scripted ones at the end of their path, join
// none. A group sleeps if all its bodies are deformable or free and have been slower than
// settings.sleep_speed (root mean square over the mass; no particle ten times as fast) and, where they relax, below kRelaxedStrain for
// settings.sleep_after. A body whose box comes to meet one of theirs wakes the whole group, one pass before
// it can touch.
// A body that falls asleep loses its velocities; their energy goes to work_numeric. Pairs without a moving
// body are removed from `pairs`. The result does not depend on the number of threads; all state between
// passes is in `sleep`.
void fall_asleep_and_wake(const SleepPass& pass, SleepScratch& scratch, Sleep& sleep, Particles& particles, Poses& poses,
                          BroadPhasePairs& pairs, Energy& energy, Report& report);

}  // namespace trocar
