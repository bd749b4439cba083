#include "systems/detect/broad/reachable_pairs.hpp"

#include <algorithm>
#include <cmath>

#include "engine/contact/displacement_bound.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/sum_velocities.hpp"
namespace trocar {
namespace {

constexpr uint32_t kBodiesPerChunk = 32;

BodyDrift drift_of(double period, const Surfaces& s, uint32_t body) {
    const MeshInfo& info = s.meshes.info[s.bodies.mesh[body]];
    const Particles& p = s.particles;
    const uint32_t first = s.bodies.particles[body].first, end = first + info.vertices.count;
    const VelocitySum all = sum_velocities(p, first, info.vertices.count);
    const uint32_t count = all.count;
    BodyDrift drift{all.sum / std::max(1u, count), 0};
    double fastest = 0, squares = 0;
    const auto add = [&](double square) {
        if (!std::isfinite(square)) return;
        fastest = std::max(fastest, square);
        squares += square;
    };
    uint32_t i = first;
    for (; i + 4 <= end; i += 4) {
        const auto beside = [&](const std::vector<float>& v, double mean) { return (Vec4d)_mm256_cvtps_pd(_mm_loadu_ps(&v[i])) - mean; };
        const Vec4d x = beside(p.velocity_x, drift.velocity.x()), y = beside(p.velocity_y, drift.velocity.y()),
                    z = beside(p.velocity_z, drift.velocity.z()), square = x * x + (y * y + z * z);
        for (int k = 0; k < 4; ++k) add(square[k]);
    }
    for (; i < end; ++i) add((Vec3d(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]) - drift.velocity).squaredNorm());
    const double mean = std::sqrt(squares / std::max(1u, count)) * period;
    drift.drift_bound = displacement_bound(std::sqrt(fastest) * period, mean, info.mean_edge);
    return drift;
}

Box without_margin(const Surfaces& s, const BodyBoxes& boxes, uint32_t body) {
    const Vec3d margin = Vec3d::Constant(boxes.margin[body] + 0.5 * s.bodies.thickness[body]);
    return {boxes.box[body].min + margin, boxes.box[body].max - margin};
}

// Whether the bodies are separated along some axis by more than gravity and the smaller drift bound can
// bridge.
bool are_apart(double fall, const Surfaces& s, const BodyBoxes& boxes, uint32_t a, uint32_t b) {
    const Box box_a = without_margin(s, boxes, a), box_b = without_margin(s, boxes, b);
    const double slack = fall + reach_at_rest(s, a) + reach_at_rest(s, b);
    return (box_b.min - box_a.max).maxCoeff() > slack || (box_a.min - box_b.max).maxCoeff() > slack;
}

bool may_meet(double period, double fall, const Surfaces& s, const BodyBoxes& boxes, const std::vector<BodyDrift>& drift, uint32_t a,
              uint32_t b) {
    const Box box_a = without_margin(s, boxes, a), box_b = without_margin(s, boxes, b);
    const Vec3d nearing = (drift[a].velocity - drift[b].velocity) * period;
    const double slack = drift[a].drift_bound + drift[b].drift_bound + fall + 0.5 * (s.bodies.thickness[a] + s.bodies.thickness[b]);
    for (int k = 0; k < 3; ++k) {
        if (box_b.min[k] - box_a.max[k] > std::max(0.0, nearing[k]) + slack) return false;
        if (box_a.min[k] - box_b.max[k] > std::max(0.0, -nearing[k]) + slack) return false;
    }
    return true;
}

// A rigid body as a ball about its origin with constant velocity.
struct RigidBall {
    Vec3d centre, velocity;
    double radius, drift_bound;  // m; drift bound of its points from rotation
};
RigidBall ball_of(double period, const Surfaces& s, uint32_t body) {
    const double radius = s.meshes.info[s.bodies.mesh[body]].radius;
    return {s.poses.origin[body], s.poses.velocity[body], radius,
            std::min(2 * radius, s.poses.angular_velocity[body].norm() * radius * period)};
}

// Free bodies keep their velocity while nothing touches them; hands and scripted bodies do not.
bool may_meet_free(double period, double fall, const Surfaces& s, const BodyBoxes& boxes, const std::vector<BodyDrift>& drift,
                   uint32_t free, uint32_t other) {
    const Motion motion = s.bodies.motion[other];
    if (motion != Motion::kFree && motion != Motion::kStatic && motion != Motion::kDeformable) return true;
    const RigidBall ball = ball_of(period, s, free);
    double apart = 0, drift_bound = ball.drift_bound;
    Vec3d velocity = Vec3d::Zero();
    if (motion == Motion::kFree) {
        const RigidBall second = ball_of(period, s, other);
        apart = (ball.centre - second.centre).norm() - second.radius, drift_bound += second.drift_bound, velocity = second.velocity;
    } else {
        const Box box = without_margin(s, boxes, other);
        apart = (ball.centre - ball.centre.cwiseMax(box.min).cwiseMin(box.max)).norm();
        if (motion == Motion::kDeformable) drift_bound += drift[other].drift_bound, velocity = drift[other].velocity;
    }
    const auto edge = [&](uint32_t body) { return s.meshes.info[s.bodies.mesh[body]].mean_edge; };
    const double slack = fall + least_drift_bound(edge(free) + edge(other)) + 0.5 * (s.bodies.thickness[free] + s.bodies.thickness[other]);
    return !(apart - ball.radius > (ball.velocity - velocity).norm() * period + drift_bound + slack);
}

// How far a pair would interpenetrate, along the axis of largest separation or, if none separates them, along
// the line between their centres: bounds what b may do to a.
Vec3d running_in(double period, double fall, const Surfaces& s, const BodyBoxes& boxes, const std::vector<BodyDrift>& drift, uint32_t a,
                 uint32_t b) {
    const Box box_a = without_margin(s, boxes, a), box_b = without_margin(s, boxes, b);
    const auto velocity = [&](uint32_t body) { return is_deformable(s.bodies, body) ? drift[body].velocity : s.poses.velocity[body]; };
    const Vec3d nearing = (velocity(a) - velocity(b)) * period, after = box_b.min - box_a.max, before = box_a.min - box_b.max;
    int axis = 0;
    const double separation = std::max(after.cwiseMax(before).maxCoeff(&axis), 0.0);
    Vec3d direction = Vec3d::Unit(axis);
    if (!(after[axis] > before[axis])) direction = -direction;
    if (separation == 0 && is_deformable(s.bodies, a) && is_deformable(s.bodies, b))
        direction = (box_b.min + box_b.max - box_a.min - box_a.max).normalized();
    const double in = nearing.dot(direction) - separation;
    if (!(in > 0) || !std::isfinite(in)) return Vec3d::Zero();  // side by side, or at rest on each other
    return -(in + fall) * direction;
}

void find_external_displacements(double period, double fall, const Surfaces& surfaces, const BodyBoxes& boxes, const BroadPhasePairs& pairs,
                                 const ReachablePairsScratch& s, std::vector<ExternalDisplacement>& external) {
    external.assign(surfaces.bodies.mesh.size(), {});
    const auto add = [&](uint32_t body, const Vec3d& displacement) {
        if (surfaces.bodies.motion[body] == Motion::kStatic) return;
        external[body].low = external[body].low.cwiseMin(displacement);
        external[body].high = external[body].high.cwiseMax(displacement);
    };
    for (size_t i = 0; i < pairs.a.size(); ++i) {
        if (!s.reachable[i]) continue;
        const Vec3d displacement = running_in(period, fall, surfaces, boxes, s.drift, pairs.a[i], pairs.b[i]);
        add(pairs.a[i], displacement);
        add(pairs.b[i], -displacement);
    }
}

}  // namespace

void drop_unreachable_pairs(double period, const Vec3d& gravity, const Surfaces& surfaces, const BodyBoxes& boxes, ReachablePairsScratch& s,
                            BroadPhasePairs& pairs, std::vector<ExternalDisplacement>& external, const SleepingBodies& sleeping_bodies) {
    const uint32_t bodies = static_cast<uint32_t>(surfaces.bodies.mesh.size());
    if (s.drift.size() != bodies) std::fill(sleeping_bodies.seen.begin(), sleeping_bodies.seen.end(), 0);
    s.asked.assign(bodies, 0);
    s.disturbed.assign(bodies, 0);
    s.drift.resize(bodies);
    s.reachable.assign(pairs.a.size(), 0);
    const double fall = fall_in_period(gravity, period);
    const auto is_free = [&](uint32_t body) { return surfaces.bodies.motion[body] == Motion::kFree; };
    const auto disturb = [&](uint32_t a, uint32_t b) {
        for (const uint32_t body : {a, b}) s.disturbed[body] |= surfaces.bodies.motion[body] != Motion::kStatic;
    };
    for (size_t i = 0; i < pairs.a.size(); ++i) {
        const uint32_t a = pairs.a[i], b = pairs.b[i];
        const bool soft = is_deformable(surfaces.bodies, a) && is_deformable(surfaces.bodies, b);
        s.reachable[i] = soft ? !are_apart(fall, surfaces, boxes, a, b) : !is_free(a) && !is_free(b);
        s.asked[a] = s.asked[b] = 1;
        if (s.reachable[i]) disturb(a, b);
    }
    parallel_for(bodies, kBodiesPerChunk, [&](uint32_t begin, uint32_t end) {
        for (uint32_t body = begin; body < end; ++body)
            if (s.asked[body] && is_deformable(surfaces.bodies, body) && !was_seen(sleeping_bodies, body))
                s.drift[body] = drift_of(period, surfaces, body);
    });
    for (size_t i = 0; i < pairs.a.size(); ++i) {
        if (s.reachable[i]) continue;
        const uint32_t a = pairs.a[i], b = pairs.b[i];
        s.reachable[i] = is_free(a)   ? may_meet_free(period, fall, surfaces, boxes, s.drift, a, b)
                         : is_free(b) ? may_meet_free(period, fall, surfaces, boxes, s.drift, b, a)
                                      : may_meet(period, fall, surfaces, boxes, s.drift, a, b);
        if (s.reachable[i]) disturb(a, b);
    }
    find_external_displacements(period, fall, surfaces, boxes, pairs, s, external);
    size_t kept = 0;
    for (size_t i = 0; i < pairs.a.size(); ++i) {
        if (!s.reachable[i] && !s.disturbed[pairs.a[i]] && !s.disturbed[pairs.b[i]]) continue;
        pairs.a[kept] = pairs.a[i], pairs.b[kept] = pairs.b[i];
        ++kept;
    }
    pairs.a.resize(kept);
    pairs.b.resize(kept);
}

bool are_at_rest(const Surfaces& surfaces, const ReachablePairsScratch& scratch, const SleepingBodies& sleeping_bodies) {
    const size_t bodies = surfaces.bodies.mesh.size();
    if (scratch.asked.size() != bodies || sleeping_bodies.sleep.size() != bodies) return false;
    for (uint32_t body = 0; body < bodies; ++body) {
        if (!scratch.asked[body]) continue;
        const bool still = is_deformable(surfaces.bodies, body)
                               ? sleeping_bodies.sleep[body] != 0 && sleeping_bodies.seen[body] == sleeping_bodies.sleep[body]
                               : surfaces.poses.velocity[body] == Vec3d::Zero();
        if (!still) return false;
    }
    return true;
}

void find_reachable_pairs(double period, const Vec3d& gravity, const Surfaces& surfaces, const BodyBoxes& boxes, const BroadPhasePairs& all,
                          ReachablePairsScratch& scratch, BroadPhasePairs& pairs, std::vector<ExternalDisplacement>& external,
                          const SleepingBodies& sleeping_bodies) {
    RestingPairs& rest = scratch.rest;
    const auto is_as_asked = [&] { return same_boxes(rest.box, boxes.box) && rest.asked.a == all.a && rest.asked.b == all.b; };
    if (!are_at_rest(surfaces, scratch, sleeping_bodies) || !is_as_asked())
        for (RestingPairs::Answer& known : rest.answer) known.period = 0;  // keeps allocated memory
    for (const RestingPairs::Answer& known : rest.answer) {
        if (known.period != period) continue;
        pairs = known.pairs;
        external.assign(surfaces.bodies.mesh.size(), {});
        return;
    }
    pairs = all;
    drop_unreachable_pairs(period, gravity, surfaces, boxes, scratch, pairs, external, sleeping_bodies);
    if (!are_at_rest(surfaces, scratch, sleeping_bodies)) return;
    rest.box = boxes.box;
    rest.asked = all;
    std::swap(rest.answer[0], rest.answer[1]);
    rest.answer[1].period = period;
    rest.answer[1].pairs = pairs;
}

}  // namespace trocar
