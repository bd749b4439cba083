#include "systems/advance/contact/rigid_sweeps.hpp"

#include <algorithm>
#include <cmath>
namespace trocar {
namespace {

Vec4d respond(const SweptBody& body, Vec4d j) {
    return j[0] * body.inv_inertia[0] + j[1] * body.inv_inertia[1] + j[2] * body.inv_inertia[2];
}

Vec4d velocity_at(const SweptConstraint& c, std::span<const SweptBody> bodies) {
    const SweptBody &a = bodies[c.body[0]], &b = bodies[c.body[1]];
    return a.velocity + cross(a.spin, c.arm[0]) - b.velocity - cross(b.spin, c.arm[1]);
}

void apply_impulse(const SweptConstraint& c, Vec4d impulse, std::span<SweptBody> bodies) {
    for (int side = 0; side < 2; ++side) {
        SweptBody& body = bodies[c.body[side]];
        if (body.inv_mass == 0) continue;  // what stands still is shared by threads
        const Vec4d j = side == 0 ? impulse : -impulse;
        body.velocity += body.inv_mass * j;
        body.spin += respond(body, cross(c.arm[side], j));
    }
}

// As solve_angular_constraint, but applies both impulses at once. Returns the square of the change.
double solve_swept(SweptConstraint& c, std::span<SweptBody> bodies) {
    Vec4d velocity = velocity_at(c, bodies);
    const double normal_impulse = std::max(0.0, c.normal_impulse - (dot(c.normal, velocity) - c.target_velocity) * c.effective_mass);
    if (normal_impulse == 0 && c.normal_impulse == 0 && norm2(c.friction_impulse) == 0) return 0;
    const double normal_change = normal_impulse - c.normal_impulse;
    c.normal_impulse = normal_impulse;
    Vec4d impulse = normal_change * c.normal;
    double change2 = normal_change * normal_change;
    if (c.friction > 0) {
        velocity += normal_change * c.response;
        const Vec4d sliding = velocity - dot(c.normal, velocity) * c.normal;
        const Vec4d friction = limit_friction(c.friction_impulse - c.friction_mass * sliding, c.friction * normal_impulse);
        const Vec4d friction_change = friction - c.friction_impulse;
        c.friction_impulse = friction;
        impulse += friction_change;
        change2 = std::max(change2, norm2(friction_change));
    }
    apply_impulse(c, impulse, bodies);
    return c.effective_mass > 0 ? change2 / (c.effective_mass * c.effective_mass) : 0;
}

}  // namespace

bool is_swept(const AdvanceIsland& island, const PreparedConstraint& c) {
    const auto is_loose = [&](uint32_t rigid) {
        if (rigid == kNone) return false;
        const AdvanceRigid& r = island.rigid[rigid];
        if (r.free == kNone) return r.node == kNone && r.path == kNone && r.tool == kNone;
        const AdvanceFree& f = island.free[r.free];
        return r.jaw == kNone && !f.held && f.drive == kNone && !f.slides;
    };
    return c.turns() && is_loose(c.rigid_a) && is_loose(c.rigid_b);
}

void load_bodies(const AdvanceIsland& island, std::vector<SweptBody>& bodies) {
    bodies.resize(island.free.size() + 1);
    for (size_t i = 0; i < island.free.size(); ++i) {
        const AdvanceFree& f = island.free[i];
        const uint32_t node = island.rigid[f.rigid].node;
        bodies[i] = {island.nodes.node.velocity[node],
                     f.spin,
                     {f.inv_inertia[0], f.inv_inertia[1], f.inv_inertia[2]},
                     island.nodes.node.inv_mass[node]};
    }
    bodies.back() = {};
}

void store_bodies(std::span<const SweptConstraint> constraints, std::span<const SweptBody> bodies, AdvanceIsland& island) {
    for (const SweptConstraint& c : constraints)
        for (const uint32_t body : c.body) {
            if (body == island.free.size()) continue;
            island.free[body].spin = bodies[body].spin;
            island.nodes.node.velocity[island.rigid[island.free[body].rigid].node] = bodies[body].velocity;
        }
}

SweptConstraint compact(const AdvanceIsland& island, std::span<const SweptBody> bodies, PreparedConstraint& from) {
    SweptConstraint c;
    c.normal = from.normal;
    c.friction_impulse = from.friction_impulse;
    c.friction_before = c.friction_direction = c.response = Vec4d{};
    c.normal_impulse = from.normal_impulse;
    c.normal_before = c.normal_direction = 0;
    c.target_velocity = from.target_velocity;
    c.effective_mass = from.effective_mass;
    c.friction = from.friction;
    c.friction_mass = from.angular.friction_mass;
    for (int side = 0; side < 2; ++side) {
        const uint32_t free = from.angular.free[side];
        c.body[side] = free == kNone ? uint32_t(island.free.size()) : free;
        c.arm[side] = from.angular.arm[side];
        const SweptBody& body = bodies[c.body[side]];
        c.response += body.inv_mass * c.normal + cross(respond(body, cross(c.arm[side], c.normal)), c.arm[side]);
    }
    c.from = &from;
    return c;
}

void store_impulses(std::span<const SweptConstraint> constraints) {
    for (const SweptConstraint& c : constraints) c.from->normal_impulse = c.normal_impulse, c.from->friction_impulse = c.friction_impulse;
}

SweepChange sweep(std::span<SweptConstraint> constraints, std::span<SweptBody> bodies) {
    double velocity2 = 0, squared_impulse = 0;
    for (SweptConstraint& c : constraints) {
        c.normal_before = c.normal_impulse;
        c.friction_before = c.friction_impulse;
        velocity2 = std::max(velocity2, solve_swept(c, bodies));
        const double normal = c.normal_impulse - c.normal_before;
        squared_impulse += normal * normal + norm2(c.friction_impulse - c.friction_before);
    }
    return {std::sqrt(velocity2), squared_impulse};
}

void move_on(double share, std::span<SweptConstraint> constraints, std::span<SweptBody> bodies) {
    for (SweptConstraint& c : constraints) {
        const double normal_on = share * c.normal_direction;
        const Vec4d friction_on = share * c.friction_direction;
        c.normal_direction = c.normal_impulse - c.normal_before + normal_on;
        c.friction_direction = c.friction_impulse - c.friction_before + friction_on;
        if (share == 0) continue;
        c.normal_impulse += normal_on;
        c.friction_impulse += friction_on;
        apply_impulse(c, normal_on * c.normal + friction_on, bodies);
    }
}

}  // namespace trocar
