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

void push(const SweptConstraint& c, double impulse, std::span<SweptBody> bodies) {
    SweptBody &a = bodies[c.body[0]], &b = bodies[c.body[1]];
    if (c.inv_mass[0] > 0) {  // what stands still is shared by threads
        a.velocity += (impulse * c.inv_mass[0]) * c.normal;
        a.spin += impulse * c.turned[0];
    }
    if (c.inv_mass[1] > 0) {
        b.velocity -= (impulse * c.inv_mass[1]) * c.normal;
        b.spin -= impulse * c.turned[1];
    }
}

void rub(const SweptConstraint& c, Vec4d impulse, std::span<SweptBody> bodies) {
    SweptBody &a = bodies[c.body[0]], &b = bodies[c.body[1]];
    if (c.inv_mass[0] > 0) {
        a.velocity += c.inv_mass[0] * impulse;
        a.spin += respond(a, cross(c.arm[0], impulse));
    }
    if (c.inv_mass[1] > 0) {
        b.velocity -= c.inv_mass[1] * impulse;
        b.spin -= respond(b, cross(c.arm[1], impulse));
    }
}

// As solve_angular_constraint.
double solve_swept(SweptConstraint& c, std::span<SweptBody> bodies) {
    Vec4d velocity = velocity_at(c, bodies);
    const double normal_impulse = std::max(0.0, c.normal_impulse - (dot(c.normal, velocity) - c.target_velocity) * c.effective_mass);
    if (normal_impulse == 0 && c.normal_impulse == 0 && norm2(c.friction_impulse) == 0) return 0;
    const double normal_change = normal_impulse - c.normal_impulse;
    c.normal_impulse = normal_impulse;
    double change = std::abs(normal_change);
    if (normal_change != 0) push(c, normal_change, bodies);
    if (c.friction > 0) {
        velocity = velocity_at(c, bodies);
        const Vec4d sliding = velocity - dot(c.normal, velocity) * c.normal;
        const Vec4d friction = limit_friction(c.friction_impulse - c.friction_mass * sliding, c.friction * normal_impulse);
        const Vec4d friction_change = friction - c.friction_impulse;
        c.friction_impulse = friction;
        rub(c, friction_change, bodies);
        change = std::max(change, std::sqrt(norm2(friction_change)));
    }
    return c.effective_mass > 0 ? change / c.effective_mass : 0;
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
    c.friction_before = c.friction_direction = Vec4d{};
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
        c.inv_mass[side] = bodies[c.body[side]].inv_mass;
        c.turned[side] = respond(bodies[c.body[side]], cross(c.arm[side], c.normal));
    }
    c.from = &from;
    return c;
}

void store_impulses(std::span<const SweptConstraint> constraints) {
    for (const SweptConstraint& c : constraints) c.from->normal_impulse = c.normal_impulse, c.from->friction_impulse = c.friction_impulse;
}

SweepChange sweep(std::span<SweptConstraint> constraints, std::span<SweptBody> bodies) {
    SweepChange all;
    for (SweptConstraint& c : constraints) {
        c.normal_before = c.normal_impulse;
        c.friction_before = c.friction_impulse;
        all.velocity = std::max(all.velocity, solve_swept(c, bodies));
        const double normal = c.normal_impulse - c.normal_before;
        all.squared_impulse += normal * normal + norm2(c.friction_impulse - c.friction_before);
    }
    return all;
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
        push(c, normal_on, bodies);
        rub(c, friction_on, bodies);
    }
}

}  // namespace trocar
