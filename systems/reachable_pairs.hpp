#pragma once
#include <array>
#include <vector>

#include "components/body_jolt.hpp"
#include "components/contacts.hpp"
#include "engine/sleepers.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// How a deformable body moves in the coming period.
struct BodyDrift {
    Vec3d velocity = Vec3d::Zero();  // m/s, mean of its vertices
    double stray = 0;                // m, how far vertices may stray from it
};

// Answers of passes in which all bodies of the pairs lay still, and what they were asked about.
struct RestingPairs {
    struct Answer {
        double period = 0;  // s; 0: none
        CandidatePairs pairs;
    };
    std::vector<Box> box;
    CandidatePairs asked;
    std::array<Answer, 2> answer;  // passes alternate between two lengths at most
};

struct ReachablePairsScratch {
    std::vector<uint8_t> asked;      // per body: its drift is wanted
    std::vector<uint8_t> disturbed;  // per body: something may touch it in this period
    std::vector<BodyDrift> drift;    // per body, where asked
    std::vector<uint8_t> reachable;  // per pair
    RestingPairs rest;
};

// Drops pairs of deformable and free bodies that keep their distance in the coming period (s). A body's box looks as far
// ahead as it moves; bodies that fall side by side would all look through each other although nothing moves between them. A
// pair stays when along every axis the gap of the bodies is less than what they come nearer by their mean velocities, what
// vertices stray from them (as body_boxes bounds it) and what gravity may add to one of them alone; or when one of them may
// be touched by anything else in this period, for then it need not keep its velocity. Of a free body, against free, static
// and deformable ones, that is asked of the ball around it, which turns. Order is kept. Sleepers are looked at once.
// jolt[body] is the largest way, m, that one it stays in a pair with may push it: (nearing - gap) + fall along
// the axis on which their boxes are farthest apart (from middle to middle where they meet), with nearing = (velocity
// difference) * period; none where they do not run into each other. Static bodies are not pushed.
void drop_unreachable_pairs(double period, const Vec3d& gravity, const Surfaces& surfaces, const BodyBoxes& boxes,
                            ReachablePairsScratch& scratch, CandidatePairs& pairs, std::vector<BodyJolt>& jolt,
                            const Sleepers& sleepers = {});

// The same for a copy of `all`, which is not asked about again while everything lies still.
void find_reachable_pairs(double period, const Vec3d& gravity, const Surfaces& surfaces, const BodyBoxes& boxes, const CandidatePairs& all,
                          ReachablePairsScratch& scratch, CandidatePairs& pairs, std::vector<BodyJolt>& jolt, const Sleepers& sleepers);

// Whether each body of the pairs of the last call lies still as it lay then: a sleeper in the same sleep, a rigid body without
// velocity. Then the same pairs, boxes and period give the same answer, and no body has a jolt.
bool lie_still(const Surfaces& surfaces, const ReachablePairsScratch& scratch, const Sleepers& sleepers);

}  // namespace trocar
