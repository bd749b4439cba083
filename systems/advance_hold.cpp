#include <algorithm>
#include <cmath>

#include "engine/implicit_kernels.hpp"
#include "systems/advance_implicit.hpp"
namespace trocar {
namespace {

// How much stiffer a held row is than the nodes it holds are in the step. What the rows' impulses, which see single masses,
// are left with is one over this; more costs conjugate gradients.
constexpr double kHold = 30;
// Rows nearer than this (m) are held until they turn out to pull.
constexpr double kNear = 1e-5;
// Friction beyond its limit by less than this share stays as it is.
constexpr double kMoreFriction = 1.05;

// Calls visit(held, active) for the rows that a body is held by.
template <typename Visit>
void for_held_rows(AdvanceIsland& island, const AdvanceBody& b, const Visit& visit) {
    AdvanceScratch& s = island.scratch;
    const uint32_t owner = static_cast<uint32_t>(&b - s.body.data());
    for (size_t i = 0; i < s.held.size(); ++i) {
        if (s.held[i].owner == owner) visit(s.held[i], s.held_active[i]);
    }
}
// Calls visit(vertex, weight) for the nodes of a row that move.
template <typename Visit>
void for_moving_nodes(const AdvanceScratch& s, const AdvanceBody& b, const ContactActive& row, const Visit& visit) {
    for (uint32_t k = 0; k < row.nodes; ++k) {
        const ConstContactNode node = s.node[row.node[k]];
        if (node.particle_inv_mass > 0) visit(node.particle - b.particles.first, row.weight[k]);
    }
}

Vec4d velocity_of(const AdvanceBody& b, uint32_t vertex) {
    return make_vec4(b.step.new_velocity_x[vertex], b.step.new_velocity_y[vertex], b.step.new_velocity_z[vertex]);
}

// Three fields of `rows` as vectors.
Vec4d take(const std::vector<float>& field, size_t rows, uint32_t i) { return make_vec4(field[i], field[rows + i], field[2 * rows + i]); }
void add(std::vector<float>& field, size_t rows, uint32_t i, Vec4d more) {
    for (size_t k = 0; k < 3; ++k) field[k * rows + i] = static_cast<float>(double{field[k * rows + i]} + more[k]);
}

// What a row does with a velocity of its point against its plane: N s.
Vec4d press(const HeldRow& h, Vec4d normal, Vec4d velocity) {
    const Vec4d along = dot(normal, velocity) * normal;
    return h.stiffness * along + h.grip * (velocity - along);
}

using Block = std::array<double, 6>;  // xx yy zz xy xz yz
Block inverse(const Block& b) {
    const double m0 = b[1] * b[2] - b[5] * b[5], m1 = b[4] * b[5] - b[3] * b[2], m2 = b[3] * b[5] - b[1] * b[4];
    const double s = 1 / (b[0] * m0 + b[3] * m1 + b[4] * m2);
    return {s * m0, s * (b[0] * b[2] - b[4] * b[4]), s * (b[0] * b[1] - b[3] * b[3]), s * m1, s * m2, s * (b[3] * b[4] - b[0] * b[5])};
}
Block block_at(const ImplicitScratch& s, size_t rows, uint32_t i) {
    Block b;
    for (size_t k = 0; k < 6; ++k) b[k] = s.block[k * rows + i];
    return b;
}

// Adds what held rows resist with to the diagonal block of one node.
void stiffen_block(ImplicitScratch& s, size_t rows, uint32_t i, const HeldRow& h, Vec4d n, double weight) {
    Block b = inverse(block_at(s, rows, i));
    const double w2 = weight * weight, more = w2 * (h.stiffness - h.grip);
    const double own[6] = {n[0] * n[0], n[1] * n[1], n[2] * n[2], n[0] * n[1], n[0] * n[2], n[1] * n[2]};
    for (int k = 0; k < 6; ++k) b[k] += more * own[k] + (k < 3 ? w2 * h.grip : 0);
    b = inverse(b);
    for (size_t k = 0; k < 6; ++k) s.block[k * rows + i] = static_cast<float>(b[k]);
}

}  // namespace

bool bind_held_rows(AdvanceIsland& island, const AdvanceBody& b) {
    AdvanceScratch& s = island.scratch;
    ImplicitScratch& im = s.implicit;
    const size_t rows = b.particles.count;
    const uint32_t owner = static_cast<uint32_t>(&b - s.body.data());
    im.free_residual.clear();
    for (size_t i = 0; i < s.held.size(); ++i) {
        HeldRow& h = s.held[i];
        if (h.owner != owner) continue;
        const ContactActive& row = s.held_active[i];
        double yielding = 0;  // 1/kg
        h.velocity = row.rigid_velocity;
        for (uint32_t k = 0; k < row.nodes; ++k) {
            const uint32_t v = s.node[row.node[k]].particle - b.particles.first;
            h.velocity += row.weight[k] * velocity_of(b, v);
            const double trace = double{im.block[v]} + im.block[rows + v] + im.block[2 * rows + v];
            yielding += row.weight[k] * row.weight[k] * trace / 3;
        }
        h.on = yielding > 0 && dot(row.normal, h.velocity) - row.least_velocity < kNear / island.dt;
        h.stiffness = yielding > 0 ? kHold / yielding : 0;
        h.grip = row.friction > 0 ? h.stiffness : 0;
        h.impulse = Vec4d{};
        if (im.free_residual.empty()) im.free_residual = im.residual, im.free_block = im.block;
    }
    return !im.free_residual.empty();
}

double start_held_rows(AdvanceIsland& island, const AdvanceBody& b, ImplicitStep& step) {
    AdvanceScratch& s = island.scratch;
    ImplicitScratch& im = s.implicit;
    const ImplicitKernels& kernels = implicit_kernels();
    const size_t rows = b.particles.count;
    im.residual = im.free_residual, im.block = im.free_block;
    std::fill(im.change.begin(), im.change.end(), 0.0f);
    std::fill(im.applied.begin(), im.applied.end(), 0.0f);
    for_held_rows(island, b, [&](HeldRow& h, const ContactActive& row) {
        if (!h.on) return;
        const Vec4d impulse = -press(h, row.normal, h.velocity - row.least_velocity * row.normal);
        for_moving_nodes(s, b, row, [&](uint32_t v, double weight) {
            add(im.residual, rows, v, weight * impulse);
            stiffen_block(im, rows, v, h, row.normal, weight);
        });
    });
    for_slices(b.slices, [&](uint32_t begin, uint32_t end) { kernels.turn(&step, 0, begin, end); });
    return sum_over(b, im.sums, [&](uint32_t begin, uint32_t end, double* lanes) { kernels.move(&step, 0, begin, end, lanes); });
}

double apply_held_rows(AdvanceIsland& island, const AdvanceBody& b) {
    AdvanceScratch& s = island.scratch;
    ImplicitScratch& im = s.implicit;
    double bent = 0;
    for_held_rows(island, b, [&](HeldRow& h, const ContactActive& row) {
        if (!h.on) return;
        Vec4d q = {};
        for_moving_nodes(s, b, row, [&](uint32_t v, double weight) {
            q += weight * make_vec4(im.direction[v].x, im.direction[v].y, im.direction[v].z);
        });
        const Vec4d f = press(h, row.normal, q);
        bent += dot(q, f);
        for_moving_nodes(s, b, row, [&](uint32_t v, double weight) { add(im.applied, b.particles.count, v, weight * f); });
    });
    return bent;
}

bool judge_held_rows(AdvanceIsland& island, const AdvanceBody& b, bool may_add) {
    AdvanceScratch& s = island.scratch;
    const ImplicitScratch& im = s.implicit;
    bool changed = false;
    for_held_rows(island, b, [&](HeldRow& h, const ContactActive& row) {
        Vec4d velocity = h.velocity;
        for_moving_nodes(s, b, row, [&](uint32_t v, double weight) { velocity += weight * take(im.change, b.particles.count, v); });
        const double closing = dot(row.normal, velocity) - row.least_velocity;
        h.impulse = Vec4d{};
        h.end_velocity = velocity;
        if (!h.on) {
            if (!may_add || h.stiffness == 0 || closing * island.dt > -kNear) return;
            h.on = changed = true;
            return;
        }
        if (closing > 0) {
            h.on = false, changed = true;
            return;
        }
        h.impulse = -press(h, row.normal, velocity - row.least_velocity * row.normal);
        const double most = row.friction * h.stiffness * -closing,
                     across = h.grip * std::sqrt(norm2(velocity - dot(row.normal, velocity) * row.normal));
        if (across <= kMoreFriction * most) return;
        h.grip *= most / across;
        changed = changed || may_add;
    });
    return changed;
}

double settle_held_rows(AdvanceIsland& island, const AdvanceBody& b) {
    AdvanceScratch& s = island.scratch;
    double work = 0;
    for_held_rows(island, b, [&](HeldRow& h, const ContactActive& row) {
        s.plan[row.plan].held = h.impulse;
        work += dot(h.impulse, h.end_velocity - row.rigid_velocity);
    });
    return work;
}

}  // namespace trocar
