#pragma once
#include <array>
#include <vector>

#include "components/thread.hpp"
#include "systems/prepare/tool_actions.hpp"
namespace trocar {

struct ThreadContactScratch {
    // A place on a surface that a point of a thread may meet.
    struct Place {
        uint32_t body = kNone, triangle = kNone;
        double squared = 0;            // m^2, from the point
        double ahead = 0;              // m, that the point and the surface have yet to come together
        Vec3d from = Vec3d::Zero();    // m, world: the point, moved along with the body to where it was looked for
        Vec3d place = Vec3d::Zero();   // m, world
        Vec3d normal = Vec3d::Zero();  // unit, world, of the triangle
        bool outward = false;          // the point is to be kept on the side of the normal
    };
    struct Near {
        uint32_t row = 0;
        Vec3d from = Vec3d::Zero();                // m, world: where it is looked for
        Vec3d displacement = Vec3d::Zero();        // m, in the pass, relative to the body at hand
        double reach = 0;                          // m, around `from`, from the body at hand
        bool touched = false;                      // the body at hand, in the last pass
        Place found;                               // on the body at hand
        std::array<Place, kTouchesPerPoint> kept;  // by `ahead`
    };
    std::vector<Near> near;
    std::vector<ThreadTouch> found;
};

// Finds for every point of a thread with `contact` the surfaces that it would meet first in the pass, of the kTouchesPerPoint bodies that
// are nearest so, but not of the one on which its end hangs: of rigid bodies by their trees, of deformable ones by their present triangles.
// Looks as far as the point and the body move relative to each other, but no farther than kFarReach. Points within 1.5 spacings of a bite
// or a held end are left out. The plane of a point that slides is that where it will be in the middle of the pass; that of one which comes
// nearer to a rigid body, where it will meet it. A point stays on the side on which it is; one that is less than kShallow inside a closed
// surface belongs outside, if not an odd number of bites of that body lies between it and the first end. What is nearer than it should be
// is pressed as before, and steps let it out (engine/thread/touch.hpp). The energy of contacts that change goes to energy.work_contact.
void find_thread_contacts(const ActionPass& pass, const Threads& threads, ThreadContactScratch& scratch, ThreadState& state,
                          Energy& energy);
inline constexpr double kShallow = 1e-3, kFarReach = 20e-3;  // m

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
