#include "systems/advance/contact/implicit_contacts.hpp"

#include <algorithm>
#include <cmath>

#include "systems/advance/tissue/backward_euler.hpp"
namespace trocar {
namespace {

// Between two proposals. By trial.
constexpr uint32_t kSweepsPerIterate = 4;
// Rounds of iterations while a step has added energy. By trial.
constexpr uint32_t kMostContactRounds = 4;

bool is_touched_implicit(const AdvanceBody& b) { return b.touched && b.synchronous(); }

template <typename Visit>
void for_touched_implicit(AdvanceIsland& island, const Visit& visit) {
    for (AdvanceBody& b : island.body)
        if (is_touched_implicit(b)) visit(b);
}

// Gives every node its response; bodies that are not implicit respond by their inverse masses.
void find_responses(const AdvanceCall& call, const TissueScratch& scratch, AdvanceIsland& island) {
    ContactNodeSet& nodes = island.nodes;
    resize_raw(nodes.response, nodes.node.size());
    for (uint32_t n = 0; n < nodes.node.size(); ++n) {
        const double w = nodes.node.inv_mass[n];
        nodes.response[n] = {{make_vec4(w, 0, 0), make_vec4(0, w, 0), make_vec4(0, 0, w)}, Vec4d{}};
    }
    for_touched_implicit(island, [&](const AdvanceBody& b) { set_responses(call, b, scratch, island); });
}

// The constraint's masses along its normal, and of the more compliant direction across.
void find_masses(const ContactNodeSet& nodes, PreparedConstraint& c) {
    Vec4d column[3] = {};
    for (uint32_t k = 0; k < c.nodes; ++k)
        for (int i = 0; i < 3; ++i) column[i] += c.weight[k] * c.weight[k] * nodes.response[c.node[k]].column[i];
    const auto respond = [&](Vec4d j) { return j[0] * column[0] + j[1] * column[1] + j[2] * column[2]; };
    const Vec4d n = c.normal;
    const Vec4d aside = std::abs(n[0]) < 0.6 ? make_vec4(1, 0, 0) : make_vec4(0, 1, 0);
    Vec4d s = cross(n, aside);
    s *= 1 / std::sqrt(norm2(s));
    const Vec4d t = cross(n, s), by_s = respond(s), by_t = respond(t);
    const double along = dot(n, respond(n)), ss = dot(s, by_s), tt = dot(t, by_t), st = dot(t, by_s);
    const double across = 0.5 * (ss + tt) + std::sqrt(0.25 * (ss - tt) * (ss - tt) + st * st);
    c.effective_mass = along > 0 ? 1 / along : 0;
    c.angular.friction_mass = across > 0 ? 1 / across : 0;
}

void give(ContactNodeSet& nodes, const PreparedConstraint& c, Vec4d impulse) {
    for (uint32_t k = 0; k < c.nodes; ++k) {
        NodeResponse& response = nodes.response[c.node[k]];
        const Vec4d part = c.weight[k] * impulse;
        response.impulse += part;
        nodes.node.velocity[c.node[k]] += response(part);
    }
}

Vec4d relative_velocity_of(const ContactNodeSet& nodes, const PreparedConstraint& c) {
    Vec4d velocity = c.rigid_velocity;
    for (uint32_t k = 0; k < c.nodes; ++k) velocity += c.weight[k] * nodes.node.velocity[c.node[k]];
    return velocity;
}

// As solve_nodes, with responses that differ by direction.
void solve_responding(ContactNodeSet& nodes, PreparedConstraint& c) {
    const double approach = dot(c.normal, relative_velocity_of(nodes, c)), normal_impulse = corrected_normal_impulse(c, approach);
    if (normal_impulse != c.normal_impulse) give(nodes, c, (normal_impulse - c.normal_impulse) * c.normal);
    c.normal_impulse = normal_impulse;
    if (!(c.friction > 0)) return;
    const Vec4d velocity = relative_velocity_of(nodes, c), sliding = velocity - dot(c.normal, velocity) * c.normal;
    const Vec4d friction = limit_friction(c.friction_impulse - sliding * c.angular.friction_mass, most_friction(c, normal_impulse));
    give(nodes, c, friction - c.friction_impulse);
    c.friction_impulse = friction;
}

template <typename Visit>  // Visit: void(PreparedConstraint&)
void for_each_active(ContactSolver& solver, const Visit& visit) {
    for_each_group(solver, [&](const ConstraintGroup& group) {
        for (const uint32_t i : group.active) visit(solver.prepared[i]);
    });
}

// Iterates until all bodies have converged, `most` times at most. Ends with sweeps, whose velocities finish_touched_step takes.
void iterate(const AdvanceCall& call, uint32_t most, TissueScratch& scratch, ContactSolver& solver, AdvanceIsland& island,
             const AdvanceState& state, AdvanceResult& result) {
    const auto sweep = [&] {
        for (uint32_t sweep = 0; sweep < kSweepsPerIterate; ++sweep)
            for_each_active(solver, [&](PreparedConstraint& c) { solve_responding(island.nodes, c); });
    };
    bool converged = false;
    for (uint32_t iteration = 1;; ++iteration) {
        for_touched_implicit(island, [&](AdvanceBody& b) { relax_touched_step(call, island, scratch, state, b, result); });
        sweep();
        if (converged || iteration >= most) break;
        for_touched_implicit(island, [&](AdvanceBody& b) { smooth_touched_step(call, island, scratch, state, b, result); });
        sweep();
        converged = true;
        for_touched_implicit(island, [&](AdvanceBody& b) {
            converged = accept_touched_step(call, island, scratch, state, b, result) && converged;
        });
    }
}

}  // namespace

bool has_touched_implicit(const AdvanceIsland& island) { return std::ranges::any_of(island.body, is_touched_implicit); }

void begin_touched_steps(const AdvanceCall& call, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state,
                         AdvanceResult& result) {
    uint32_t count = 0;
    for_touched_implicit(island, [&](AdvanceBody& b) { b.implicit_slot = count++; });
    if (scratch.touched.size() < count) scratch.touched.resize(count);
    for_touched_implicit(island, [&](AdvanceBody& b) { begin_touched_step(call, island, scratch, state, b, result); });
}

void solve_with_implicit(const AdvanceCall& call, TissueScratch& scratch, ContactSolver& solver, AdvanceIsland& island,
                         const AdvanceState& state, AdvanceResult& result) {
    find_responses(call, scratch, island);
    for_each_active(solver, [&](PreparedConstraint& c) {
        find_masses(island.nodes, c);
        c.normal_impulse = std::max(0.0, dot(c.warm, c.normal));
        if (c.normal_impulse == 0) return;
        c.friction_impulse = c.warm - dot(c.warm, c.normal) * c.normal;
        give(island.nodes, c, c.normal_impulse * c.normal + c.friction_impulse);
    });
    uint32_t most = 0;
    for_touched_implicit(island, [&](AdvanceBody& b) { most = std::max(most, b.stepping.iterations); });
    for (uint32_t round = 0; round < kMostContactRounds; ++round) {
        iterate(call, most, scratch, solver, island, state, result);
        bool closed = true;
        for_touched_implicit(island, [&](AdvanceBody& b) { closed = finish_touched_step(call, island, scratch, state, b, result) && closed; });
        if (closed) break;
    }
    for_touched_implicit(island, [&](AdvanceBody& b) { account_touched_step(call, scratch, b, result); });
}

void account_implicit_corrections(const AdvanceCall& call, TissueScratch& scratch, AdvanceIsland& island, const AdvanceState& state,
                                  AdvanceResult& result) {
    for_touched_implicit(island, [&](AdvanceBody& b) {
        const uint32_t owner = static_cast<uint32_t>(&b - island.body.data());
        for (uint32_t n = 0; n < island.nodes.node.size(); ++n) {
            if (island.nodes.node.particle[n] == kNone || island.nodes.node.owner[n] != owner) continue;
            if (norm2(island.nodes.change.change[n]) > 0) return account_corrections(call, scratch, state, b, result);
        }
    });
}

}  // namespace trocar
