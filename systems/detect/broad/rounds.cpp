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
    const auto affordable = static_cast<double>(std::max<uint64_t>(1, kMostPairRounds / std::max<size_t>(1, pairs.a.size())));
    return static_cast<uint32_t>(std::ceil(std::min({most, affordable, 1e3})));
}

}  // namespace trocar
