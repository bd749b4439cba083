#include "systems/detect/broad/rounds.hpp"

#include <algorithm>
#include <cmath>

#include "engine/contact/convex_pairs.hpp"
#include "engine/contact/tool_parts.hpp"
#include "engine/geometry/quaternion.hpp"

namespace trocar {
namespace {

double radius_of(const Surfaces& s, uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].radius; }

// Bound on the speed of a rigid body's points relative to its origin, m/s.
double turning_speed(const Surfaces& s, uint32_t body) { return s.poses.angular_velocity[body].norm() * radius_of(s, body); }

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

// m, mean half thickness of a body
double half_thickness(const Surfaces& s, uint32_t body) {
    const MeshInfo& info = s.meshes.info[s.bodies.mesh[body]];
    return info.admission == Admission::kSheet || !(info.area > 0) ? 0.5 * s.bodies.thickness[body] : info.volume / info.area;
}

// Of a hand in the rest of a pass: as its device moves and turns, or as it moves already.
struct HandMotion {
    double length = 0;   // m
    double fastest = 0;  // m/s
};
HandMotion hand_motion(const HandTool& tool, size_t index, const DeviceSamples& devices, const Poses& poses) {
    constexpr double kMillisecond = 1e-3;  // s
    const uint32_t steps = devices.per_tool - 1;
    HandMotion motion;
    motion.fastest = poses.velocity[tool.body].norm();
    const double coasted = motion.fastest * kMillisecond * steps;
    for (const DeviceState* device = &devices.start(index); device != &devices.end(index); ++device) {
        const double step = (device[1].position - device[0].position).norm() +
                            tool.shell_radius * rotation_vector(device[0].orientation, device[1].orientation).norm();
        motion.length += step;
        motion.fastest = std::max(motion.fastest, step / kMillisecond);
    }
    motion.length = std::max(motion.length, coasted);
    return motion;
}

}  // namespace

bool may_need_rounds(const Surfaces& s, double fall, double tolerance, double seconds) {
    return std::ranges::any_of(s.bodies.rigid_mass, [&](const RigidMass& free) {
        const double speed = s.poses.velocity[free.body].norm() + turning_speed(s, free.body);
        return speed * seconds + fall > longest_motion(tolerance, radius_of(s, free.body));
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
        const double rounds = (speed * seconds + fall) / longest_motion(tolerance, std::min(radius_of(s, a), radius_of(s, b)));
        if (std::isfinite(rounds)) most = std::max(most, rounds);
    }
    const size_t looks = std::clamp<size_t>(pairs.a.size(), 1, kMostNeighbours / 2 * std::max<size_t>(1, s.bodies.rigid_mass.size()));
    const auto affordable = static_cast<double>(std::max<uint64_t>(1, kMostPairRounds / looks));
    return static_cast<uint32_t>(std::ceil(std::min({most, affordable, 1e3})));
}

bool any_fast_hand(std::span<const HandTool> tools, const DeviceSamples& devices, const Poses& poses) {
    for (size_t t = 0; t < tools.size(); ++t)
        if (hand_motion(tools[t], t, devices, poses).fastest > HapticParams{}.tool_speed) return true;
    return false;
}

uint32_t count_hand_rounds(const Surfaces& s, const BroadPhasePairs& pairs, const Haptics& haptics, const DeviceSamples& devices) {
    double rounds = 1;
    for (size_t t = 0; t < haptics.tool.size(); ++t) {
        const HandTool& tool = haptics.tool[t];
        const HandMotion motion = hand_motion(tool, t, devices, s.poses);
        if (!(motion.fastest > HapticParams{}.tool_speed)) continue;
        for (size_t i = 0; i < pairs.a.size(); ++i) {
            uint32_t part = pairs.a[i], other = pairs.b[i];
            if (is_deformable(s.bodies, part)) std::swap(part, other);
            if (!is_deformable(s.bodies, other) || !is_part_of_tool(haptics, tool, part)) continue;
            const double thickness = half_thickness(s, part) + half_thickness(s, other);
            if (thickness > 0) rounds = std::max(rounds, motion.length / thickness);
        }
    }
    return static_cast<uint32_t>(std::ceil(std::min<double>(rounds, std::max(1u, devices.per_tool - 1))));
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
