#pragma once
#include <array>
#include <vector>

#include "components/thread.hpp"
#include "systems/prepare/tool_actions.hpp"
namespace trocar {

struct ThreadContactScratch {
    // A point of a thread, and the nearest place on a surface so far.
    struct Near {
        uint32_t row = 0;
        Vec3d at = Vec3d::Zero();  // m
        double reach = 0;          // m
        uint32_t body = kNone, triangle = kNone;
        double squared = 0;            // m^2
        Vec3d place = Vec3d::Zero();   // m, world
        Vec3d normal = Vec3d::Zero();  // unit, world, of the triangle
        bool outward = false;          // the point is to be kept on the side of the normal
    };
    std::vector<Near> near;
    std::vector<ThreadTouch> found;
};

// Finds for every point of a thread with `contact` the nearest surface that it may reach in the pass, of any body but the one on which its
// end hangs: of rigid bodies by their trees, of deformable ones by their present triangles. Points within 1.5 spacings of a bite or a held
// end are left out. The plane of a point that slides is that where it will be in the middle of the pass. A point stays on the side on which
// it is; one that is less than kShallow inside a closed surface belongs outside. At most kFarReach is looked ahead. The energy of contacts
// that change goes to energy.work_contact.
void find_thread_contacts(const ActionPass& pass, const Threads& threads, ThreadContactScratch& scratch, ThreadState& state,
                          Energy& energy);
inline constexpr double kShallow = 1e-3, kFarReach = 5e-3;  // m

// The nodes of a deformable body that hold a point of one of its triangles, with their weights: the corners, or of an embedded surface the
// nodes of the nearest corner. weight: barycentric.
struct SewnNodes {
    std::array<uint32_t, 4> node{kNone, kNone, kNone, kNone};
    std::array<double, 4> weight{};
};
SewnNodes nodes_under(const ActionPass& pass, uint32_t body, uint32_t triangle, const Vec3d& weight);
// Where they are, m, world; and where they were at the time of the velocities, at which energies are measured.
Vec3d sewn_place(const ActionPass& pass, uint32_t body, const std::array<uint32_t, 4>& node, const std::array<double, 4>& weight);
Vec3d sewn_place_at_velocity(const ActionPass& pass, uint32_t body, const std::array<uint32_t, 4>& node,
                             const std::array<double, 4>& weight);

}  // namespace trocar
