#include "systems/detect/broad/rounds.hpp"

#include <algorithm>
#include <cmath>

namespace trocar {
namespace {

double radius_of(const Surfaces& s, uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].radius; }

// Bound on the speed of a rigid body's points relative to its origin, m/s.
double turning_speed(const Surfaces& s, uint32_t body) { return s.poses.angular_velocity[body].norm() * radius_of(s, body); }

// m, that a body of this radius may move relative to another of at least this size. The factor by trial: with 1 to 6 boxes that slam down
// on edges stay within the tolerance.
double longest_way(double tolerance, double radius) { return std::sqrt(2.5 * radius * tolerance); }

struct PressedPair {
    std::array<uint32_t, 2> bodies;
    Vec3d force;  // N
};

std::vector<PressedPair> pressed_pairs(const ContactMemory& memory) {
    std::vector<PressedPair> pairs;
    for (size_t i = 0; i < memory.body.size(); ++i) {
        const auto [a, b] = std::minmax(memory.body[i], memory.other[i]);
        pairs.push_back({{a, b}, a == memory.body[i] ? memory.force[i] : Vec3d(-memory.force[i])});
    }
    std::ranges::stable_sort(pairs, {}, &PressedPair::bodies);
    return pairs;
}

// m/s
double closing_speed(const std::vector<PressedPair>& pressed, uint32_t a, uint32_t b, const Vec3d& velocity) {
    Vec3d force = Vec3d::Zero();
    for (auto at = std::ranges::lower_bound(pressed, std::array{a, b}, {}, &PressedPair::bodies);
         at != pressed.end() && at->bodies == std::array{a, b}; ++at)
        force += at->force;
    return force.norm() > 0 ? std::abs(velocity.dot(force.normalized())) : velocity.norm();
}

}  // namespace

bool may_need_rounds(const Surfaces& s, double fall, double tolerance, double seconds) {
    return std::ranges::any_of(s.bodies.rigid_mass, [&](const RigidMass& free) {
        const double speed = s.poses.velocity[free.body].norm() + turning_speed(s, free.body);
        return speed * seconds + fall > longest_way(tolerance, radius_of(s, free.body));
    });
}

uint32_t count_rounds(const Surfaces& s, const BroadPhasePairs& pairs, const ContactMemory& memory, double fall, double tolerance,
                      double seconds) {
    const std::vector<PressedPair> pressed = pressed_pairs(memory);
    double most = 1;
    for (size_t i = 0; i < pairs.a.size(); ++i) {
        const uint32_t a = pairs.a[i], b = pairs.b[i];
        if (is_deformable(s.bodies, a) || is_deformable(s.bodies, b)) continue;
        if (s.bodies.motion[a] != Motion::kFree && s.bodies.motion[b] != Motion::kFree) continue;
        const double speed =
            closing_speed(pressed, a, b, s.poses.velocity[a] - s.poses.velocity[b]) + turning_speed(s, a) + turning_speed(s, b);
        const double rounds = (speed * seconds + fall) / longest_way(tolerance, std::min(radius_of(s, a), radius_of(s, b)));
        if (std::isfinite(rounds)) most = std::max(most, rounds);
    }
    const size_t looks = std::clamp<size_t>(pairs.a.size(), 1, kMostNeighbours / 2 * std::max<size_t>(1, s.bodies.rigid_mass.size()));
    const auto affordable = static_cast<double>(std::max<uint64_t>(1, kMostPairRounds / looks));
    return static_cast<uint32_t>(std::ceil(std::min({most, affordable, 1e3})));
}

uint64_t defer_pairs(const Surfaces& s, uint64_t tick, BroadPhasePairs& pairs) {
    const auto triangles = [&](uint32_t body) { return uint64_t{s.meshes.info[s.bodies.mesh[body]].triangles.count}; };
    const auto work_of = [&](size_t i) {
        const Motion a = s.bodies.motion[pairs.a[i]], b = s.bodies.motion[pairs.b[i]];
        return a == Motion::kFree && b == Motion::kFree ? triangles(pairs.a[i]) + triangles(pairs.b[i]) : 0;
    };
    uint64_t most = 0, work = 0;
    for (const RigidMass& free : s.bodies.rigid_mass) most += kMostNeighbours * triangles(static_cast<uint32_t>(free.body));
    if (pairs.a.size() <= kMostNeighbours / 2) return 0;
    for (size_t i = 0; i < pairs.a.size(); ++i) work += work_of(i);
    if (work <= most) return 0;
    // each pair's turn comes with the same probability
    const double share = static_cast<double>(most) / static_cast<double>(work);
    size_t kept = 0;
    for (size_t i = 0; i < pairs.a.size(); ++i) {
        uint64_t dice = (i + 1) * 0x9e3779b97f4a7c15ull ^ (tick + 1) * 0xbf58476d1ce4e5b9ull;
        dice = (dice ^ dice >> 30) * 0x94d049bb133111ebull;
        if (work_of(i) > 0 && static_cast<double>(dice >> 11) * 0x1p-53 > share) continue;
        pairs.a[kept] = pairs.a[i], pairs.b[kept++] = pairs.b[i];
    }
    const uint64_t deferred = pairs.a.size() - kept;
    pairs.a.resize(kept), pairs.b.resize(kept);
    return deferred;
}

}  // namespace trocar
