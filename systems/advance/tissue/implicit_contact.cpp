#include "systems/advance/tissue/implicit_contact.hpp"

#include <algorithm>
#include <cmath>

#include "engine/kernels/implicit_kernels.hpp"
#include "systems/advance/island/constants.hpp"
#include "systems/advance/tissue/midpoint.hpp"
namespace trocar {
namespace {

// Calls visit(constraint) for those that may act within a body's step.
template <typename Visit>  // Visit: void(PreparedConstraint&)
void for_implicit_contacts(const AdvanceIsland& island, const AdvanceBody& b, ContactSolver& solver, const Visit& visit) {
    const uint32_t owner = static_cast<uint32_t>(&b - island.body.data());
    for (const uint32_t i : solver.held) {
        if (solver.prepared[i].implicit.owner == owner) visit(solver.prepared[i]);
    }
}
// Calls visit(vertex, weight) for the moving nodes of a constraint.
template <typename Visit>
void for_moving_nodes(const ContactNodeSet& nodes, const AdvanceBody& b, const PreparedConstraint& c, const Visit& visit) {
    for (uint32_t k = 0; k < c.nodes; ++k) {
        const ConstContactNode node = nodes.node[c.node[k]];
        if (node.particle_inv_mass > 0) visit(node.particle - b.particles.first, c.weight[k]);
    }
}

Vec4d velocity_of(const AdvanceBody& b, uint32_t vertex) {
    return make_vec4(b.step.new_velocity_x[vertex], b.step.new_velocity_y[vertex], b.step.new_velocity_z[vertex]);
}

// Entry i of three fields of `count` entries each, as a vector.
Vec4d take(const std::vector<float>& field, size_t count, uint32_t i) {
    return make_vec4(field[i], field[count + i], field[2 * count + i]);
}
void add(std::vector<float>& field, size_t count, uint32_t i, Vec4d more) {
    for (size_t k = 0; k < 3; ++k) field[k * count + i] = static_cast<float>(double{field[k * count + i]} + more[k]);
}

// The impulse with which a constraint resists a velocity of its point relative to its plane, N s.
Vec4d press(const PreparedConstraint& c, Vec4d velocity) {
    const Vec4d along = dot(c.normal, velocity) * c.normal;
    return c.implicit.stiffness * along + c.implicit.grip * (velocity - along);
}

using Block = std::array<double, 6>;  // xx yy zz xy xz yz
Block inverse(const Block& b) {
    const double m0 = b[1] * b[2] - b[5] * b[5], m1 = b[4] * b[5] - b[3] * b[2], m2 = b[3] * b[5] - b[1] * b[4];
    const double s = 1 / (b[0] * m0 + b[3] * m1 + b[4] * m2);
    return {s * m0, s * (b[0] * b[2] - b[4] * b[4]), s * (b[0] * b[1] - b[3] * b[3]), s * m1, s * m2, s * (b[3] * b[4] - b[0] * b[5])};
}
Block block_at(const ImplicitScratch& s, size_t count, uint32_t i) {
    Block b;
    for (size_t k = 0; k < 6; ++k) b[k] = s.block[k * count + i];
    return b;
}

// Adds a constraint's resistance to the diagonal block of one node.
void stiffen_block(ImplicitScratch& s, size_t count, uint32_t i, const PreparedConstraint& c, double weight) {
    const PreparedConstraint::Implicit& h = c.implicit;
    const Vec4d n = c.normal;
    Block b = inverse(block_at(s, count, i));
    const double w2 = weight * weight, more = w2 * (h.stiffness - h.grip);
    const double own[6] = {n[0] * n[0], n[1] * n[1], n[2] * n[2], n[0] * n[1], n[0] * n[2], n[1] * n[2]};
    for (int k = 0; k < 6; ++k) b[k] += more * own[k] + (k < 3 ? w2 * h.grip : 0);
    b = inverse(b);
    for (size_t k = 0; k < 6; ++k) s.block[k * count + i] = static_cast<float>(b[k]);
}

}  // namespace

bool bind_implicit_contacts(const AdvanceCall& call, const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch,
                            ContactSolver& solver) {
    ImplicitScratch& im = scratch.implicit;
    const size_t count = b.particles.count;
    im.free_residual.clear();
    for_implicit_contacts(island, b, solver, [&](PreparedConstraint& c) {
        PreparedConstraint::Implicit& h = c.implicit;
        double yielding = 0;  // 1/kg
        h.velocity = c.rigid_velocity;
        for (uint32_t k = 0; k < c.nodes; ++k) {
            const uint32_t v = island.nodes.node[c.node[k]].particle - b.particles.first;
            h.velocity += c.weight[k] * velocity_of(b, v);
            const double trace = double{im.block[v]} + im.block[count + v] + im.block[2 * count + v];
            yielding += c.weight[k] * c.weight[k] * trace / 3;
        }
        h.on = yielding > 0 && dot(c.normal, h.velocity) - c.target_velocity < kHeldSlack / call.dt;
        h.stiffness = yielding > 0 ? kHeldStiffness / yielding : 0;
        h.grip = c.friction > 0 ? h.stiffness : 0;
        c.held = Vec4d{};
        if (im.free_residual.empty()) im.free_residual = im.residual, im.free_block = im.block;
    });
    return !im.free_residual.empty();
}

double start_implicit_contacts(const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch, ContactSolver& solver,
                               ImplicitStep& step) {
    ImplicitScratch& im = scratch.implicit;
    const ImplicitKernels& kernels = implicit_kernels();
    const size_t count = b.particles.count;
    im.residual = im.free_residual, im.block = im.free_block;
    std::fill(im.change.begin(), im.change.end(), 0.0f);
    std::fill(im.applied.begin(), im.applied.end(), 0.0f);
    for_implicit_contacts(island, b, solver, [&](const PreparedConstraint& c) {
        if (!c.implicit.on) return;
        const Vec4d impulse = -press(c, c.implicit.velocity - c.target_velocity * c.normal);
        for_moving_nodes(island.nodes, b, c, [&](uint32_t v, double weight) {
            add(im.residual, count, v, weight * impulse);
            stiffen_block(im, count, v, c, weight);
        });
    });
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) { kernels.turn(&step, 0, begin, end); });
    return sum_over(b, im.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.move(&step, 0, begin, end, lanes); });
}

double apply_implicit_contacts(const AdvanceIsland& island, const AdvanceBody& b, TissueScratch& scratch, ContactSolver& solver) {
    ImplicitScratch& im = scratch.implicit;
    double bent = 0;
    for_implicit_contacts(island, b, solver, [&](const PreparedConstraint& c) {
        if (!c.implicit.on) return;
        Vec4d q = {};
        for_moving_nodes(island.nodes, b, c, [&](uint32_t v, double weight) {
            q += weight * make_vec4(im.direction[v].x, im.direction[v].y, im.direction[v].z);
        });
        const Vec4d f = press(c, q);
        bent += dot(q, f);
        for_moving_nodes(island.nodes, b, c, [&](uint32_t v, double weight) { add(im.applied, b.particles.count, v, weight * f); });
    });
    return bent;
}

bool update_implicit_contacts(const AdvanceCall& call, const TissueScratch& scratch, const AdvanceIsland& island, const AdvanceBody& b,
                              bool may_add, ContactSolver& solver) {
    const ImplicitScratch& im = scratch.implicit;
    bool changed = false;
    for_implicit_contacts(island, b, solver, [&](PreparedConstraint& c) {
        PreparedConstraint::Implicit& h = c.implicit;
        Vec4d velocity = h.velocity;
        for_moving_nodes(island.nodes, b, c,
                         [&](uint32_t v, double weight) { velocity += weight * take(im.change, b.particles.count, v); });
        const double closing = dot(c.normal, velocity) - c.target_velocity;
        c.held = Vec4d{};
        h.end_velocity = velocity;
        if (!h.on) {
            if (!may_add || h.stiffness == 0 || closing * call.dt > -kHeldSlack) return;
            h.on = changed = true;
            return;
        }
        if (closing > 0) {
            h.on = false, changed = true;
            return;
        }
        c.held = -press(c, velocity - c.target_velocity * c.normal);
        const double most = c.friction * h.stiffness * -closing,
                     across = h.grip * std::sqrt(norm2(velocity - dot(c.normal, velocity) * c.normal));
        if (across <= kMoreFriction * most) return;
        h.grip *= most / across;
        changed = changed || may_add;
    });
    return changed;
}

double finish_implicit_contacts(const AdvanceIsland& island, const AdvanceBody& b, ContactSolver& solver) {
    double work = 0;
    for_implicit_contacts(island, b, solver,
                          [&](const PreparedConstraint& c) { work += dot(c.held, c.implicit.end_velocity - c.rigid_velocity); });
    return work;
}

}  // namespace trocar
