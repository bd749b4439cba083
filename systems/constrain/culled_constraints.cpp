#include "systems/constrain/culled_constraints.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/contact/contact_constraints.hpp"
#include "engine/contact/displacement_bound.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

constexpr double kAnyDisplacement = std::numeric_limits<double>::infinity();
constexpr uint32_t kCulledPerChunk = 512;

Vec3d velocity_of(const Surfaces& s, uint32_t body, uint32_t vertex) {
    const uint32_t i = s.bodies.particles[body].first + vertex;
    return {s.particles.velocity_x[i], s.particles.velocity_y[i], s.particles.velocity_z[i]};
}

// m/s, by which vertices of a body may come nearer than their present velocities say: tissue that a hit has set vibrating turns a vertex
// round within a period. Three times the root mean square of the velocities relative to their mean, and half the mean for what an
// earlier hit left in springs. Measured: with twice and none, balls of 0.05 to 0.4 MPa that bounce from 30 to 80 mm were found up to 2 mm
// inside.
double vibration_of(const Surfaces& s, uint32_t body) {
    constexpr uint32_t kSample = 512;  // vertices, at most twice as many, tell the spread to 3 %
    const uint32_t all = s.meshes.info[s.bodies.mesh[body]].vertices.count, stride = 1 + all / (2 * kSample);
    Vec3d sum = Vec3d::Zero();
    double squares = 0, count = 0;
    for (uint32_t v = 0; v < all; v += stride, ++count) {
        const Vec3d velocity = velocity_of(s, body, v);
        sum += velocity;
        squares += velocity.squaredNorm();
    }
    const double mean2 = (sum / count).squaredNorm(), variance = squares / count - mean2;
    const double speed2 = 9 * std::max(0.0, variance) + 0.25 * mean2;
    return speed2 > 0 ? std::sqrt(speed2) : 0;  // also if it is no number
}

// Whether a constraint of deformable bodies, or of one and a static one, may act.
bool may_act(const ComingPeriod& coming, std::span<const double> vibration, const ContactConstraints& constraints, uint32_t constraint) {
    constexpr double kTurnShare = 0.25;  // fraction of the speed that rotation may direct towards the plane
    const Surfaces& s = coming.surfaces;
    const Bodies& bodies = s.bodies;
    const uint32_t body = constraints.body[constraint], other = constraints.other[constraint];
    const double period = coming.seconds;
    const double near = fall_in_period(coming.gravity, period) + reach_at_rest(s, body) + reach_at_rest(s, other) +
                        (vibration[body] + vibration[other]) * period;
    if (constraints.distance[constraint] < near) return true;
    Vec3d v = Vec3d::Zero();
    if (is_deformable(bodies, body)) {
        const double along = constraints.along[constraint], across = constraints.across[constraint];
        v += (1 - along - across) * velocity_of(s, body, constraints.vertex[constraint][0]) +
             along * velocity_of(s, body, constraints.vertex[constraint][1]);
        if (constraints.third[constraint] != kNone) v += across * velocity_of(s, body, constraints.third[constraint]);
    }
    if (is_deformable(bodies, other))
        for (int k = 0; k < 3; ++k) v -= constraints.weight[constraint][k] * velocity_of(s, other, constraints.triangle[constraint][k]);
    const Vec3d normal =
        is_deformable(bodies, other) ? constraints.normal[constraint] : rotate(s.poses.orientation[other], constraints.normal[constraint]);
    const double external =
        external_displacement_along(coming.external, body, -normal) + external_displacement_along(coming.external, other, normal);
    const double towards = std::max(0.0, -v.dot(normal)) + kTurnShare * v.norm();
    return !(constraints.distance[constraint] > near + towards * period + external);
}

// Displacement bound of each body without its neighbours.
void own_displacements(const ComingPeriod& coming, const ContactConstraints& constraints, std::vector<double>& travel) {
    const Surfaces& s = coming.surfaces;
    const Bodies& bodies = s.bodies;
    travel.assign(bodies.mesh.size(), kAnyDisplacement);
    for (uint32_t body = 0; body < travel.size(); ++body)
        if (bodies.motion[body] == Motion::kStatic) travel[body] = 0;
    for (const RigidMass& free : bodies.rigid_mass) {
        const uint32_t body = static_cast<uint32_t>(free.body);
        const double rotation = s.poses.angular_velocity[body].norm() * s.meshes.info[bodies.mesh[body]].radius;
        travel[body] = 2 * coming.seconds * (s.poses.velocity[body].norm() + rotation);
    }
    for (const auto& [a, b] : coming.joined) travel[a] = travel[b] = kAnyDisplacement;
    for (const NodeDrive& drive : coming.drive) travel[drive.body] = kAnyDisplacement;
    for (uint32_t constraint = 0; constraint < constraints.body.size(); ++constraint)
        for (const uint32_t body : {constraints.body[constraint], constraints.other[constraint]})
            if (bodies.motion[body] == Motion::kFree) travel[body] = std::max(travel[body], -2 * constraints.distance[constraint]);
}

// Propagates displacement bounds to neighbours until nothing changes; sweeps in alternating directions.
void propagate_displacements(const Bodies& bodies, const ContactConstraints& constraints, std::vector<double>& travel) {
    const uint32_t count = static_cast<uint32_t>(constraints.body.size());
    bool changed = true;
    const auto visit = [&](uint32_t constraint) {
        const uint32_t a = constraints.body[constraint], b = constraints.other[constraint];
        const double separation = std::max(0.0, constraints.distance[constraint]);
        const auto relax = [&](uint32_t from, uint32_t to) {
            if (bodies.motion[to] != Motion::kFree || !(travel[from] - separation > travel[to])) return;
            travel[to] = travel[from] - separation;
            changed = true;
        };
        relax(a, b), relax(b, a);
    };
    while (changed) {
        changed = false;
        for (uint32_t constraint = 0; constraint < count; ++constraint) visit(constraint);
        for (uint32_t constraint = count; changed && constraint-- > 0;) visit(constraint);
    }
}

}  // namespace

void cull_constraints(const ComingPeriod& coming, CulledConstraintsScratch& scratch, ContactConstraints& constraints) {
    const Bodies& bodies = coming.surfaces.bodies;
    const uint32_t count = static_cast<uint32_t>(constraints.body.size());
    if (!bodies.rigid_mass.empty()) {
        own_displacements(coming, constraints, scratch.travel);
        propagate_displacements(bodies, constraints, scratch.travel);
    }
    scratch.vibration.assign(bodies.mesh.size(), -1.0);
    for (uint32_t constraint = 0; constraint < count; ++constraint)
        for (const uint32_t body : {constraints.body[constraint], constraints.other[constraint]})
            if (double& vibration = scratch.vibration[body]; vibration < 0)
                vibration = is_deformable(bodies, body) ? vibration_of(coming.surfaces, body) : 0.0;
    const double turned_fall = coming.gravity.norm() * coming.seconds * coming.seconds;
    const auto is_moved = [&](uint32_t body) { return !is_deformable(bodies, body) && bodies.motion[body] != Motion::kStatic; };
    const auto stays = [&](uint32_t constraint) {
        if (constraint < coming.pressed.size() && coming.pressed[constraint]) return true;
        const uint32_t body = constraints.body[constraint], other = constraints.other[constraint];
        if (!is_moved(body) && !is_moved(other)) return may_act(coming, scratch.vibration, constraints, constraint);
        if (bodies.rigid_mass.empty() || is_deformable(bodies, body) || is_deformable(bodies, other)) return true;
        return !(constraints.distance[constraint] > scratch.travel[body] + scratch.travel[other] + turned_fall);
    };
    scratch.dropped.resize(count);
    parallel_for(count, kCulledPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t constraint = begin; constraint < end; ++constraint) scratch.dropped[constraint] = !stays(constraint);
    });
    remove_constraints(scratch.dropped, constraints);
}

}  // namespace trocar
