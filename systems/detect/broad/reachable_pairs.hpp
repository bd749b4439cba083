#pragma once
#include <array>
#include <vector>

#include "components/contacts.hpp"
#include "components/external_displacement.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// How a deformable body moves in the coming period.
struct BodyDrift {
    Vec3d velocity = Vec3d::Zero();  // m/s, mean of its vertices
    double drift_bound = 0;          // m, drift bound of the vertices from the mean motion
};

// Results of passes in which all bodies of the pairs were at rest, and their inputs.
struct RestingPairs {
    struct Answer {
        double period = 0;  // s; 0: none
        BroadPhasePairs pairs;
    };
    std::vector<Box> box;
    BroadPhasePairs asked;
    std::array<Answer, 2> answer;  // passes alternate between two lengths at most
};

struct ReachablePairsScratch {
    std::vector<uint8_t> asked;      // per body: its drift is needed
    std::vector<uint8_t> disturbed;  // per body: something may touch it in this period
    std::vector<BodyDrift> drift;    // per body, if needed
    std::vector<uint8_t> reachable;  // per pair
    RestingPairs rest;
};

// Drops pairs of deformable and free bodies that stay apart in the coming period (s). Boxes are enlarged by
// each body's own speed, so those of bodies that fall side by side overlap although nothing moves relatively.
// A pair stays if along every axis the separation is less than the approach by mean velocities, the vertices'
// drift bound (see body_boxes) and what gravity may add to one of them; or if another body may touch one of
// them in this period and change its velocity. A free body is tested by its bounding ball, which rotates.
// Keeps the order. Sleeping bodies are tested once. external[body] is the external displacement bound, m: the
// largest over its remaining pairs of (approach - separation) + fall along the axis of largest separation
// (between centres if the boxes overlap), with approach = (velocity difference) * period; 0 for pairs that do
// not approach and for static bodies.
void drop_unreachable_pairs(double period, const Vec3d& gravity, const Surfaces& surfaces, const BodyBoxes& boxes,
                            ReachablePairsScratch& scratch, BroadPhasePairs& pairs, std::vector<ExternalDisplacement>& external,
                            const SleepingBodies& sleeping_bodies = {});

// The same for a copy of `all`, without testing again while everything is at rest.
void find_reachable_pairs(double period, const Vec3d& gravity, const Surfaces& surfaces, const BodyBoxes& boxes, const BroadPhasePairs& all,
                          ReachablePairsScratch& scratch, BroadPhasePairs& pairs, std::vector<ExternalDisplacement>& external,
                          const SleepingBodies& sleeping_bodies);

// Whether all bodies of the last call's pairs are still at rest: sleeping without a break, or rigid without
// velocity. Then the same pairs, boxes and period give the same result, and every external displacement bound
// is 0.
bool are_at_rest(const Surfaces& surfaces, const ReachablePairsScratch& scratch, const SleepingBodies& sleeping_bodies);

}  // namespace trocar
