#include <algorithm>
#include <cmath>

#include "engine/geometry/quaternion.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

// Overlap left alone (m): far below anything seen or felt, above what rounding makes of a resting contact.
constexpr double kRestingOverlap = 1e-6;

Vec3d turned(const std::array<Vec3d, 3>& rows, const Vec3d& v) {
    return {rows[0].dot(v), rows[1].dot(v), rows[2].dot(v)};
}

// Gap of a row at the end of the substep, and its normal there.
double gap_after(const AdvanceScratch& s, const ContactPlan& plan, Vec3d& normal) {
    Vec3d apart = Vec3d::Zero();
    if (plan.rigid_a == kNone) {
        for (int i = 0; i < 2; ++i) apart += plan.weight_a[i] * s.node[plan.node_a[i]].after;
    } else {
        const AdvanceRigid& rigid = s.rigid[plan.rigid_a];
        apart += rigid.origin[1] + turned(rigid.turn[1], plan.point_a);
    }
    if (plan.rigid_b == kNone) {
        for (int k = 0; k < 3; ++k) apart -= plan.weight_b[k] * s.node[plan.node_b[k]].after;
        normal = plan.normal;
    } else {
        const AdvanceRigid& rigid = s.rigid[plan.rigid_b];
        apart -= rigid.origin[1] + turned(rigid.turn[1], plan.point_b);
        normal = turned(rigid.turn[1], plan.normal);
    }
    return normal.dot(apart) - plan.offset;
}

bool can_move(const AdvanceScratch& s, uint32_t node) {
    return s.node[node].particle != kNone && s.node[node].inv_mass > 0;
}

// Share of the way that the side of the point goes.
double share_of_point(const AdvanceIsland& island, const ContactPlan& plan) {
    if (plan.rigid_a != kNone) return 0;
    if (plan.rigid_b != kNone) return 1;
    if (island.params.contact.share == ResponseShare::kHalf) return 0.5;
    const Bodies& bodies = island.inputs.bodies;
    const double a = bodies.spring_stiffness[island.rows.body[plan.row]];
    const double b = bodies.spring_stiffness[island.rows.other[plan.row]];
    return b / (a + b);
}

// Moves both sides by their inverse masses, or each side by its share of the way.
void add_push(AdvanceIsland& island, const ContactActive& row, const Vec3d& way) {
    AdvanceScratch& s = island.scratch;
    const bool by_mass = island.params.contact.share == ResponseShare::kMass;
    double sum[2] = {0, 0};  // of the side of the point, of the plane
    const auto unit = [&](uint32_t k) { return by_mass ? s.node[row.node[k]].inv_mass : 1.0; };
    for (uint32_t k = 0; k < row.nodes; ++k) {
        if (!can_move(s, row.node[k])) continue;
        sum[k >= row.point_nodes] += row.weight[k] * row.weight[k] * unit(k);
    }
    double scale[2] = {0, 0};
    if (by_mass) {
        if (sum[0] + sum[1] > 0) scale[0] = scale[1] = 1 / (sum[0] + sum[1]);
    } else {
        const double point = share_of_point(island, s.plan[row.plan]);
        if (sum[0] > 0) scale[0] = point / sum[0];
        if (sum[1] > 0) scale[1] = (1 - point) / sum[1];
    }
    for (uint32_t k = 0; k < row.nodes; ++k) {
        if (!can_move(s, row.node[k])) continue;
        ContactNodeChange& change = s.change[row.node[k]];
        const Vec3d move = row.weight[k] * unit(k) * scale[k >= row.point_nodes] * way;
        // later rows see the move; but a node pressed from both sides stays where it was for all of them and goes half
        // of each way: it meets its two planes midway
        change.change += (change.opposed ? 0.5 : 1.0) * move;
        if (!change.opposed) s.node[row.node[k]].after += move;
        change.pushed = true;
    }
}

// A body half a substep back, where its velocities are and where measure_energy looks at it: only there do the works of
// kicks and moves add up without a remainder of first order in dt.
struct HalfWay {
    const AdvanceIsland& island;
    const AdvanceBody& body;
    Vec3d offset(uint32_t v) const {
        const uint32_t p = body.particles.first + v;
        const Particles& s = island.particles;
        return Vec3d(body.next[v].x, body.next[v].y, body.next[v].z) -
               0.5 * island.dt * Vec3d(s.velocity_x[p], s.velocity_y[p], s.velocity_z[p]);
    }
    Vec3d goal(uint32_t v) const {
        const SpringStep& step = body.step;
        const auto row = [](const float* values) { return Vec3d(values[0], values[1], values[2]); };
        const Vec3d rest(step.anchor_x[v], step.anchor_y[v], step.anchor_z[v]);
        const Vec3d at_start =
            Vec3d(row(step.turn).dot(rest), row(step.turn + 3).dot(rest), row(step.turn + 6).dot(rest)) +
            row(step.centre) + row(step.centre_rest);
        return at_start + 0.5 * island.dt * (row(step.drag_velocity) + row(step.drag_turn).cross(at_start));
    }
};

// How far a node of the island is being pushed; zero for other particles.
Vec3d push_of(const AdvanceScratch& s, uint32_t particle) {
    const uint32_t n = s.node_of_particle[particle];
    return n != kNone && s.change[n].rows > 0 && s.change[n].pushed ? s.change[n].change : Vec3d(Vec3d::Zero());
}

// Elastic and gravity energy that a push adds to one node; what it adds to a spring whose both ends move counts by
// half, the other half is the other end's.
double node_push_work(const HalfWay& at, uint32_t v, const Vec3d& push, double inv_mass) {
    const AdvanceBody& body = at.body;
    const SpringStep& step = body.step;
    const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
    const Vec3d from = at.offset(v);
    double springs = 0;
    for (uint32_t c = step.slice_column[slice]; c < step.slice_column[slice + 1]; ++c) {
        const uint32_t q = step.neighbour[c * kSliceWidth + lane];
        if (q == v) continue;
        const double rest = step.rest_length[c * kSliceWidth + lane];
        const Vec3d far_push = push_of(at.island.scratch, body.particles.first + q), d = at.offset(q) - from;
        const double before = d.norm() - rest, after = (d + far_push - push).norm() - rest;
        springs += (far_push.isZero(0) ? 1.0 : 0.5) * (after * after - before * before);
    }
    const Vec3d to_anchor = from - at.goal(v);
    const double anchor = step.anchor_stiffness[v] * ((to_anchor + push).squaredNorm() - to_anchor.squaredNorm());
    return 0.5 * (step.stiffness * springs + anchor) - at.island.params.gravity.dot(push) / inv_mass;
}

double push_work(const AdvanceIsland& island) {
    const AdvanceScratch& s = island.scratch;
    double work = 0;
    for (const uint32_t n : s.touched) {
        const ContactNode& node = s.node[n];
        if (!s.change[n].pushed || s.change[n].change.isZero(0)) continue;
        const AdvanceBody& body = s.body[node.owner];
        work += node_push_work({island, body}, node.particle - body.particles.first, s.change[n].change, node.inv_mass);
    }
    return work;
}

// Limits the moves to the push speed, however many rows push a node, and makes them what the floats will hold.
void limit_moves(AdvanceScratch& s, double most) {
    for (const uint32_t n : s.touched) {
        ContactNodeChange& change = s.change[n];
        if (!change.pushed) continue;
        const double size = change.change.norm();
        if (size > most) change.change *= most / size;
        const AdvanceBody& body = s.body[s.node[n].owner];
        const Float4& o = body.next[s.node[n].particle - body.particles.first];
        const Vec3d from(o.x, o.y, o.z);
        change.change = (from + change.change).cast<float>().cast<double>() - from;
    }
}

void write_moves(AdvanceScratch& s) {
    for (const uint32_t n : s.touched) {
        if (!s.change[n].pushed) continue;
        const AdvanceBody& body = s.body[s.node[n].owner];
        Float4& o = body.next[s.node[n].particle - body.particles.first];
        o.x = static_cast<float>(o.x + s.change[n].change.x());
        o.y = static_cast<float>(o.y + s.change[n].change.y());
        o.z = static_cast<float>(o.z + s.change[n].change.z());
        s.node[n].after = body.origin + Vec3d(o.x, o.y, o.z);
    }
}

}  // namespace

void push_out(AdvanceIsland& island, bool last_substep) {
    AdvanceScratch& s = island.scratch;
    const double most = island.params.contact.push_speed * island.dt;
    double deepest = 0;
    bool any = false;
    Vec3d normal;
    for (ContactActive& row : s.active) {
        const double overlap = -gap_after(s, s.plan[row.plan], normal);
        row.pushed = overlap > kRestingOverlap;
        if (row.pushed) {
            add_push(island, row, std::min(overlap, most) * normal);
            any = true;
        } else {
            deepest = std::max(deepest, overlap);
        }
    }
    if (any) {
        limit_moves(s, most);
        if (island.params.account_energy) island.result.work_push += push_work(island);
        write_moves(s);
    }
    if (!last_substep) return;
    for (const ContactActive& row : s.active) {
        if (row.pushed) deepest = std::max(deepest, -gap_after(s, s.plan[row.plan], normal));
    }
    island.result.deepest_residual = deepest;
    for (const uint32_t n : s.touched) {
        island.result.opposing_planes += s.change[n].opposed && s.node[n].particle != kNone;
    }
}

}  // namespace trocar
