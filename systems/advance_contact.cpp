#include <algorithm>
#include <cmath>

#include "engine/check.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/surfaces.hpp"
#include "systems/advance_parts.hpp"
namespace trocar {
namespace {

// Below this cosine between a row's normal and its triangle's, the foot along the normal is too far away to be used.
constexpr double kLeastCosine = 0.2;
// Two rows press a node from both sides when the cosine of their ways is below this.
constexpr double kOpposed = -0.5;

Vec3d turned(const std::array<Vec3d, 3>& rows, const Vec3d& v) {
    return {rows[0].dot(v), rows[1].dot(v), rows[2].dot(v)};
}
Vec3d turned_back(const std::array<Vec3d, 3>& rows, const Vec3d& v) {
    return v.x() * rows[0] + v.y() * rows[1] + v.z() * rows[2];
}

uint32_t node_slot(AdvanceScratch& s, uint32_t owner, uint32_t vertex) {
    const AdvanceBody& body = s.body[owner];
    const uint32_t particle = body.particles.first + vertex;
    uint32_t& slot = s.node_of_particle[particle];
    if (slot == kNone) {
        slot = static_cast<uint32_t>(s.node.size());
        ContactNode& node = s.node.emplace_back();
        node.particle = particle;
        node.owner = owner;
        node.inv_mass = body.now[vertex].w;
        s.change.emplace_back();
    }
    return slot;
}

Vec3d rest_position(const Meshes& meshes, uint32_t prototype, uint32_t vertex) {
    return meshes.position[meshes.info[prototype].vertices.first + vertex];
}

ContactPlan make_plan(AdvanceIsland& island, uint32_t row) {
    AdvanceScratch& s = island.scratch;
    const ContactRows& rows = island.rows;
    const Bodies& bodies = island.inputs.bodies;
    const Meshes& meshes = island.inputs.meshes;
    const uint32_t a = rows.body[row], b = rows.other[row];
    ContactPlan plan;
    plan.row = row;
    plan.weight_a = {1.0 - rows.along[row], rows.along[row]};
    plan.weight_b = {rows.weight[row][0], rows.weight[row][1], rows.weight[row][2]};
    plan.normal = rows.normal[row];
    plan.friction = rows.friction[row];
    if (is_deformable(bodies, a)) {
        TROCAR_ASSERT(s.slot_of_body[a] != kNone);
        for (int i = 0; i < 2; ++i) plan.node_a[i] = node_slot(s, s.slot_of_body[a], rows.vertex[row][i]);
    } else {
        plan.rigid_a = rigid_slot(island, a);
        plan.point_a = plan.weight_a[0] * rest_position(meshes, bodies.mesh[a], rows.vertex[row][0]) +
                       plan.weight_a[1] * rest_position(meshes, bodies.mesh[a], rows.vertex[row][1]);
    }
    if (is_deformable(bodies, b)) {
        TROCAR_ASSERT(s.slot_of_body[b] != kNone);
        for (int i = 0; i < 3; ++i) plan.node_b[i] = node_slot(s, s.slot_of_body[b], rows.triangle[row][i]);
    } else {
        plan.rigid_b = rigid_slot(island, b);
        plan.point_b = Vec3d::Zero();
        for (int i = 0; i < 3; ++i) {
            plan.point_b += plan.weight_b[i] * rest_position(meshes, bodies.mesh[b], rows.triangle[row][i]);
        }
    }
    if (meshes.info[bodies.mesh[b]].admission == Admission::kSheet) plan.offset = 0.5 * bodies.thickness[b];
    return plan;
}

// Where the two points of a row are at the start of a substep.
struct RowState {
    Vec3d point, plane, normal;  // m
    double gap;                  // m
};

RowState find_gap(const AdvanceScratch& s, const ContactPlan& plan) {
    RowState r;
    if (plan.rigid_a == kNone) {
        r.point = plan.weight_a[0] * s.node[plan.node_a[0]].place + plan.weight_a[1] * s.node[plan.node_a[1]].place;
    } else {
        const AdvanceRigid& rigid = s.rigid[plan.rigid_a];
        r.point = rigid.origin[0] + turned(rigid.turn[0], plan.point_a);
    }
    if (plan.rigid_b == kNone) {
        r.plane = plan.weight_b[0] * s.node[plan.node_b[0]].place + plan.weight_b[1] * s.node[plan.node_b[1]].place +
                  plan.weight_b[2] * s.node[plan.node_b[2]].place;
        r.normal = plan.normal;
    } else {
        const AdvanceRigid& rigid = s.rigid[plan.rigid_b];
        r.plane = rigid.origin[0] + turned(rigid.turn[0], plan.point_b);
        r.normal = turned(rigid.turn[0], plan.normal);
    }
    r.gap = r.normal.dot(r.point - r.plane) - plan.offset;
    return r;
}

// Velocity of a point of a rigid body, m/s.
Vec3d rigid_velocity(const AdvanceScratch& s, uint32_t slot, const Vec3d& point) {
    const AdvanceRigid& rigid = s.rigid[slot];
    const Vec3d velocity = rigid.velocity + turned(rigid.spin, point);
    return rigid.node == kNone ? velocity : Vec3d(velocity + s.node[rigid.node].velocity);
}

// Velocity of the point relative to the plane point, m/s.
Vec3d relative_velocity(const AdvanceScratch& s, const ContactPlan& plan) {
    Vec3d v;
    if (plan.rigid_a == kNone) {
        v = plan.weight_a[0] * s.node[plan.node_a[0]].velocity + plan.weight_a[1] * s.node[plan.node_a[1]].velocity;
    } else {
        v = rigid_velocity(s, plan.rigid_a, plan.point_a);
    }
    if (plan.rigid_b != kNone) return v - rigid_velocity(s, plan.rigid_b, plan.point_b);
    for (int k = 0; k < 3; ++k) v -= plan.weight_b[k] * s.node[plan.node_b[k]].velocity;
    return v;
}

// No point of a row is faster than this, m/s: most rows are seen to be too far away without asking for velocities.
double fastest(const AdvanceIsland& island) {
    const AdvanceScratch& s = island.scratch;
    double squared = 0;
    for (const ContactNode& node : s.node) squared = std::max(squared, node.velocity.squaredNorm());
    double rigid_speed = 0;
    for (const AdvanceRigid& rigid : s.rigid) {
        const double spin2 = rigid.spin[0].squaredNorm() + rigid.spin[1].squaredNorm() + rigid.spin[2].squaredNorm();
        const double radius = island.inputs.meshes.info[island.inputs.bodies.mesh[rigid.body]].radius;
        rigid_speed = std::max(rigid_speed, rigid.velocity.norm() + std::sqrt(spin2) * radius);
    }
    return std::sqrt(squared) + rigid_speed;
}

// Foot of the point on the plane of the row's triangle, along the normal: barycentric weights. With them the two equal
// and opposite impulses lie on one line and angular momentum is kept exactly. Frame of the other body if it is rigid.
struct Foot {
    std::array<double, 3> weight;
    Vec3d point;       // m
    bool left_behind;  // more than one edge length beyond the triangle
};

Foot find_foot(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& point, const Vec3d& plane,
               const Vec3d& normal, const std::array<double, 3>& fixed) {
    const Vec3d u = b - a, v = c - a;
    const double edge2[3] = {(c - b).squaredNorm(), v.squaredNorm(), u.squaredNorm()};  // opposite corner k
    const double longest2 = std::max({edge2[0], edge2[1], edge2[2]});
    const Vec3d twice_area = u.cross(v);
    const double area2 = twice_area.squaredNorm(), along = normal.dot(twice_area);
    if (!(along > 0 && along * along > kLeastCosine * kLeastCosine * area2 && area2 > 1e-12 * longest2 * longest2)) {
        const Vec3d apart = point - plane, slide = apart - normal * normal.dot(apart);
        return {fixed, plane, slide.squaredNorm() > longest2};
    }
    Foot foot;
    foot.point = point - normal * ((point - a).dot(twice_area) / along);
    const Vec3d q = foot.point - a;
    foot.weight[1] = q.cross(v).dot(twice_area) / area2;
    foot.weight[2] = u.cross(q).dot(twice_area) / area2;
    foot.weight[0] = 1 - foot.weight[1] - foot.weight[2];
    foot.left_behind = false;
    for (int k = 0; k < 3; ++k) {
        // distance beyond side k = -weight * height of the side
        const double w = foot.weight[k];
        foot.left_behind = foot.left_behind || (w < 0 && w * w * area2 > longest2 * edge2[k]);
    }
    return foot;
}

Foot find_foot(const AdvanceIsland& island, const ContactPlan& plan, const RowState& r) {
    const AdvanceScratch& s = island.scratch;
    if (plan.rigid_b == kNone) {
        return find_foot(s.node[plan.node_b[0]].place, s.node[plan.node_b[1]].place, s.node[plan.node_b[2]].place,
                         r.point, r.plane, r.normal, plan.weight_b);
    }
    const AdvanceRigid& rigid = s.rigid[plan.rigid_b];
    const Meshes& meshes = island.inputs.meshes;
    const Vec3d* rest = meshes.position.data() + meshes.info[island.inputs.bodies.mesh[rigid.body]].vertices.first;
    const Triangle& t = island.rows.triangle[plan.row];
    const Vec3d point = turned_back(rigid.turn[0], r.point - rigid.origin[0]);
    return find_foot(rest[t[0]], rest[t[1]], rest[t[2]], point, plan.point_b, plan.normal, plan.weight_b);
}

void add_node(ContactActive& active, uint32_t node, double weight) {
    if (weight == 0) return;
    // an edge point whose two ends are one vertex is one node
    for (uint32_t k = 0; k < active.nodes; ++k) {
        if (active.node[k] == node) {
            active.weight[k] += weight;
            return;
        }
    }
    active.node[active.nodes] = node;
    active.weight[active.nodes++] = weight;
}

// Adds a crossed row to the active ones, or ends it.
void activate(AdvanceIsland& island, uint32_t plan_row, const RowState& r) {
    AdvanceScratch& s = island.scratch;
    const ContactPlan& plan = s.plan[plan_row];
    const Foot foot = find_foot(island, plan, r);
    if (foot.left_behind) {
        island.rows.distance[plan.row] = std::numeric_limits<double>::infinity();
        ++island.result.ended_rows;
        return;
    }
    ContactActive active;
    active.plan = plan_row;
    active.normal = r.normal;
    active.rigid_velocity = Vec3d::Zero();
    active.friction_impulse = Vec3d::Zero();
    active.least_velocity = -std::max(r.gap, 0.0) / island.dt;
    if (plan.rigid_a == kNone) {
        for (int i = 0; i < 2; ++i) add_node(active, plan.node_a[i], plan.weight_a[i]);
    } else {
        const AdvanceRigid& rigid = s.rigid[plan.rigid_a];
        active.rigid_velocity += rigid.velocity + turned(rigid.spin, plan.point_a);
        if (rigid.node != kNone) add_node(active, rigid.node, 1);
    }
    active.point_nodes = active.nodes;
    if (plan.rigid_b == kNone) {
        for (int k = 0; k < 3; ++k) add_node(active, plan.node_b[k], -foot.weight[k]);
    } else {
        const AdvanceRigid& rigid = s.rigid[plan.rigid_b];
        active.rigid_velocity -= rigid.velocity + turned(rigid.spin, foot.point);
        if (rigid.node != kNone) add_node(active, rigid.node, -1);
    }
    for (uint32_t k = 0; k < active.nodes; ++k) {
        ContactNodeChange& change = s.change[active.node[k]];
        const Vec3d way = active.weight[k] > 0 ? active.normal : Vec3d(-active.normal);
        if (change.rows++ == 0) {
            change.first_normal = way;
            change.change = Vec3d::Zero();
            change.pushed = false;
            change.opposed = false;
            s.touched.push_back(active.node[k]);
        } else if (change.first_normal.dot(way) < kOpposed) {
            change.opposed = true;
        }
    }
    s.active.push_back(active);
}

void find_active_rows(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    for (const uint32_t node : s.touched) s.change[node].rows = 0;
    s.touched.clear();
    s.active.clear();
    const double reach = 2.001 * fastest(island) * island.dt;
    for (uint32_t i = 0; i < s.plan.size(); ++i) {
        const ContactPlan& plan = s.plan[i];
        const RowState r = find_gap(s, plan);
        if (!(r.gap < reach)) continue;
        if (island.rows.distance[plan.row] == std::numeric_limits<double>::infinity()) continue;
        const Vec3d velocity = relative_velocity(s, plan);
        const double gap_after = r.gap + std::min(r.normal.dot(velocity), 0.0) * island.dt;
        // a point that is not finite belongs to a body about to be restored: it must not reach its neighbours
        if (!(gap_after < 0) || !std::isfinite(gap_after + velocity.squaredNorm())) continue;
        activate(island, i, r);
    }
    for (ContactActive& active : s.active) {
        double sum = 0;
        for (uint32_t k = 0; k < active.nodes; ++k) {
            sum += active.weight[k] * active.weight[k] * s.node[active.node[k]].inv_mass;
        }
        active.inv_sum = sum > 0 ? 1 / sum : 0;
    }
    island.result.active_rows += s.active.size();
}

// Gives one row the impulse that its nodes' velocities ask for now.
void solve_row(AdvanceScratch& s, ContactActive& row) {
    Vec3d velocity = row.rigid_velocity;
    for (uint32_t k = 0; k < row.nodes; ++k) velocity += row.weight[k] * s.node[row.node[k]].velocity;
    const double approach = row.normal.dot(velocity);
    const double normal_impulse = std::max(0.0, row.normal_impulse - (approach - row.least_velocity) * row.inv_sum);
    Vec3d friction = row.friction_impulse - (velocity - approach * row.normal) * row.inv_sum;
    const double most = s.plan[row.plan].friction * normal_impulse, size = friction.norm();
    if (size > most) friction *= most / size;
    const Vec3d impulse = (normal_impulse - row.normal_impulse) * row.normal + (friction - row.friction_impulse);
    row.normal_impulse = normal_impulse;
    row.friction_impulse = friction;
    for (uint32_t k = 0; k < row.nodes; ++k) {
        ContactNode& node = s.node[row.node[k]];
        node.velocity += row.weight[k] * node.inv_mass * impulse;
    }
}

// Writes what the rows did to the particles: velocity, and the drift that belongs to it.
void scatter_velocities(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    const double dt = island.dt;
    for (const uint32_t n : s.touched) {
        ContactNode& node = s.node[n];
        if (node.particle == kNone || node.inv_mass == 0) continue;
        Particles& p = island.particles;
        p.velocity_x[node.particle] = static_cast<float>(node.velocity.x());
        p.velocity_y[node.particle] = static_cast<float>(node.velocity.y());
        p.velocity_z[node.particle] = static_cast<float>(node.velocity.z());
        AdvanceBody& body = s.body[node.owner];
        Float4& offset = body.next[node.particle - body.particles.first];
        const Vec3d drift = dt * (node.velocity - s.change[n].kicked);
        offset.x = static_cast<float>(offset.x + drift.x());
        offset.y = static_cast<float>(offset.y + drift.y());
        offset.z = static_cast<float>(offset.z + drift.z());
        node.after = body.origin + Vec3d(offset.x, offset.y, offset.z);
    }
}

// Books the work of the rows. A leapfrog kick does work at the mean of the velocities before and after it, all its
// impulses together; `lost` is what damping took, whose share of the kernel's books was at the velocity before the
// rows.
void book_work(AdvanceIsland& island) {
    const AdvanceScratch& s = island.scratch;
    double total = 0, hand = 0;
    for (const uint32_t n : s.touched) {
        const ContactNode& node = s.node[n];
        if (node.particle == kNone || node.inv_mass == 0) continue;
        const ContactNodeChange& change = s.change[n];
        const SpringStep& step = s.body[node.owner].step;
        const Float4& offset = s.body[node.owner].now[node.particle - s.body[node.owner].particles.first];
        const Vec3d turn(step.drag_turn[0], step.drag_turn[1], step.drag_turn[2]);
        const Vec3d drag = Vec3d(step.drag_velocity[0], step.drag_velocity[1], step.drag_velocity[2]) +
                           turn.cross(Vec3d(offset.x, offset.y, offset.z));
        const Vec3d lost = (step.keep - 1.0) * (change.before - drag);
        total += (node.velocity - change.kicked).dot(change.before + node.velocity + lost) / (2 * node.inv_mass);
    }
    for (const ContactActive& row : s.active) {
        const ContactPlan& plan = s.plan[row.plan];
        if (plan.rigid_a == kNone && plan.rigid_b == kNone) continue;
        if (plan.rigid_a != kNone && plan.rigid_b != kNone) continue;
        Vec3d surface = row.rigid_velocity;
        for (uint32_t k = 0; k < row.nodes; ++k) {
            const uint32_t n = row.node[k];
            if (s.node[n].particle != kNone) continue;
            surface += row.weight[k] * 0.5 * (s.change[n].before + s.node[n].velocity);
        }
        hand -= surface.dot(row.normal_impulse * row.normal + row.friction_impulse);
    }
    island.result.work_hand += hand;
    island.result.work_contact += total - hand;
}

void add_impulses(AdvanceIsland& island) {
    const AdvanceScratch& s = island.scratch;
    for (const ContactActive& row : s.active) {
        const Vec3d impulse = row.normal_impulse * row.normal + row.friction_impulse;
        const ContactPlan& plan = s.plan[row.plan];
        island.rows.impulse[plan.row] += impulse;
        const auto on_tool = [&](uint32_t rigid, const Vec3d& j) {
            if (rigid != kNone && s.rigid[rigid].tool != kNone) island.tools[s.rigid[rigid].tool].contact_impulse += j;
        };
        on_tool(plan.rigid_a, impulse);
        on_tool(plan.rigid_b, -impulse);
    }
}

}  // namespace

void plan_contacts(AdvanceIsland& island, std::span<const uint32_t> island_rows) {
    AdvanceScratch& s = island.scratch;
    s.plan.clear();
    s.active.clear();
    s.touched.clear();
    s.node_of_particle.resize(island.particles.offset.size(), kNone);
    for (const uint32_t row : island_rows) {
        if (island.rows.distance[row] == std::numeric_limits<double>::infinity()) continue;
        s.plan.push_back(make_plan(island, row));
    }
}

void forget_contacts(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    for (const ContactNode& node : s.node) {
        if (node.particle != kNone) s.node_of_particle[node.particle] = kNone;
    }
    for (const AdvanceBody& b : s.body) s.slot_of_body[b.body] = kNone;
    for (const AdvanceRigid& r : s.rigid) s.slot_of_body[r.body] = kNone;
}

void note_velocities(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    const Particles& p = island.particles;
    for (uint32_t n = 0; n < s.node.size(); ++n) {
        const uint32_t i = s.node[n].particle;
        if (i != kNone) s.change[n].before = Vec3d(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]);
    }
}

void apply_impulses(AdvanceIsland& island) {
    AdvanceScratch& s = island.scratch;
    const Particles& p = island.particles;
    for (uint32_t n = 0; n < s.node.size(); ++n) {
        ContactNode& node = s.node[n];
        if (node.particle != kNone) {
            const AdvanceBody& body = s.body[node.owner];
            const Float4& o = body.now[node.particle - body.particles.first];
            const Float4& next = body.next[node.particle - body.particles.first];
            node.place = body.origin + Vec3d(o.x, o.y, o.z);
            node.after = body.origin + Vec3d(next.x, next.y, next.z);
            node.velocity =
                Vec3d(p.velocity_x[node.particle], p.velocity_y[node.particle], p.velocity_z[node.particle]);
        }
        s.change[n].kicked = node.velocity;
    }
    find_active_rows(island);
    for (uint32_t pass = 0; pass < island.params.contact.iterations && !s.active.empty(); ++pass) {
        for (ContactActive& row : s.active) solve_row(s, row);
    }
    scatter_velocities(island);
    if (island.params.account_energy) book_work(island);
    add_impulses(island);
}

}  // namespace trocar
