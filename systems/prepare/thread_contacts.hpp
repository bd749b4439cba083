#pragma once
#include <vector>

#include "components/thread.hpp"
#include "systems/prepare/tool_actions.hpp"
namespace trocar {

struct ThreadContactScratch {
    // A point of a thread, and the nearest place on a surface so far.
    struct Near {
        uint32_t row = 0;
        Vec3d at = Vec3d::Zero();       // m
        double reach = 0;               // m
        uint32_t body = kNone, triangle = kNone;
        double squared = 0;             // m^2
        Vec3d place = Vec3d::Zero();    // m, world
        Vec3d normal = Vec3d::Zero();   // unit, world, of the triangle
        bool outward = false;           // the point is to be kept on the side of the normal
    };
    std::vector<Near> near;
};

// Finds for every point of a thread with `contact` the nearest surface of a static or scripted body that it may reach in the pass.
// Points within 1.5 spacings of a bite or a held end are left out. A point stays on the side on which it is; one that is less than kShallow
// inside a closed surface belongs outside. At most kFarReach is looked ahead. The energy of contacts that change goes to energy.work_contact.
void find_thread_contacts(const ActionPass& pass, const Threads& threads, ThreadContactScratch& scratch, ThreadState& state, Energy& energy);
inline constexpr double kShallow = 1e-3, kFarReach = 5e-3;  // m

}  // namespace trocar
