#include "systems/advance/tissue/link_forces.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "systems/advance/rigid/rigid_bodies.hpp"
namespace trocar {
namespace {

Vec4d position_of(const AdvanceBody& b, const Float4* offsets, uint32_t node) {
    return b.origin + float_vec4(_mm_load_ps(&offsets[node].x));
}

// Half a substep before the end at `offsets`: the time of the velocities.
Vec4d place_at_velocity(const Particles& particles, const AdvanceBody& b, uint32_t node) {
    const uint32_t p = b.particles.first + node;
    const Vec4d velocity = make_vec4(particles.velocity_x[p], particles.velocity_y[p], particles.velocity_z[p]);
    return position_of(b, b.next, node) - 0.5 * b.last_dt * velocity;
}

// Far end of a link at the start (0) or the end (1) of the substep.
Vec4d far_place(const AdvanceIsland& island, const AdvanceLink& link, int end) {
    if (link.rigid != kNone) return island.rigid[link.rigid].pose[end](link.point);
    if (link.far_body == kNone) return link.point;  // of the world
    const AdvanceBody& b = island.body[link.far_body];
    return position_of(b, end == 0 ? b.now : b.next, link.far_node);
}

// Position at which a body's link forces are evaluated: its present one or, if positions and velocities
// belong to the same time, extrapolated by half a substep. Evaluated at the start such forces would amplify
// oscillations (at the middle it is Verlet's method in terms of positions).
Vec4d place_at_kick(const AdvanceCall& call, const Particles& particles, const AdvanceBody& b, uint32_t node) {
    const Vec4d position = position_of(b, b.now, node);
    if (!b.synchronous()) return position;
    const Particles& p = particles;
    const uint32_t i = b.particles.first + node;
    return position + 0.5 * call.dt * make_vec4(p.velocity_x[i], p.velocity_y[i], p.velocity_z[i]);
}
Vec4d far_place_at_kick(const AdvanceCall& call, const AdvanceIsland& island, const Particles& particles, const AdvanceLink& link,
                        bool at_midpoint) {
    if (link.rigid == kNone && link.far_body == kNone) return link.point;
    if (link.rigid == kNone) return place_at_kick(call, particles, island.body[link.far_body], link.far_node);
    const AdvanceRigid& rigid = island.rigid[link.rigid];
    const Vec4d position = rigid.pose[0](link.point);
    return at_midpoint && rigid.node == kNone ? 0.5 * (position + rigid.pose[1](link.point)) : position;
}

double stretch_of(const AdvanceLink& link, Vec4d link_vector) { return std::sqrt(norm2(link_vector)) - link.rest; }

// Whether a node of a solid has lost its last tetrahedron: it is then fixed and without springs.
bool is_lost(const AdvanceCall& call, const AdvanceIsland& island, uint32_t body, uint32_t node) {
    const AdvanceBody& b = island.body[body];
    const Solids* solids = call.inputs.other.solids;
    if (b.now[node].w > 0 || !solids || !is_solid(*solids, call.inputs.bodies.mesh[b.body])) return false;
    for (size_t c = b.step.slice_column[node / kSliceWidth]; c < b.step.slice_column[node / kSliceWidth + 1]; ++c) {
        if (b.step.neighbour[c * kSliceWidth + node % kSliceWidth] != node) return false;
    }
    return true;
}

void break_link(const AdvanceCall& call, const AdvanceLink& link, AdvanceResult& result) {
    Links& links = *call.inputs.other.links;
    links.whole[link.index] = 0;
    ++links.group[link.group].broken;
    ++result.broken_links;
    result.work_links -= 0.5 * link.stiffness * links.stretch[link.index] * links.stretch[link.index];
}

// The groups that hold bodies of the island, ascending.
void find_island_groups(const HoldingGroups& holding, AdvanceIsland& island) {
    island.links.link_group.clear();
    for (const AdvanceBody& b : island.body) {
        const auto of_body = holding.of(b.body);
        island.links.link_group.insert(island.links.link_group.end(), of_body.begin(), of_body.end());
    }
    std::sort(island.links.link_group.begin(), island.links.link_group.end());
}

// Both ends of every link, in the order of links, body by body.
void sort_link_ends(AdvanceIsland& island) {
    for (AdvanceBody& b : island.body) b.link_ends = {};
    const auto count = [&](uint32_t body) {
        if (body != kNone) ++island.body[body].link_ends.count;
    };
    for (const AdvanceLink& link : island.links.link) count(link.body), count(link.far_body);
    uint32_t first = 0;
    for (AdvanceBody& b : island.body) {
        b.link_ends.first = first;
        first += std::exchange(b.link_ends.count, 0);
    }
    island.links.link_end.resize(first);
    const auto position = [&](uint32_t body, uint32_t end) {
        if (body != kNone) island.links.link_end[island.body[body].link_ends.first + island.body[body].link_ends.count++] = end;
    };
    for (uint32_t l = 0; l < island.links.link.size(); ++l)
        position(island.links.link[l].body, 2 * l), position(island.links.link[l].far_body, 2 * l + 1);
}

}  // namespace

void gather_links(const AdvanceCall& call, AdvanceIsland& island, const AdvanceState& state, AdvanceResult& result) {
    island.links.link.clear();
    Links* links = call.inputs.other.links;
    if (!links) return;
    const Bodies& bodies = call.inputs.bodies;
    find_island_groups(*call.inputs.other.holding, island);
    for (const uint32_t g : island.links.link_group) {
        LinkGroup& group = links->group[g];
        AdvanceLink link;
        link.group = g;
        link.body = island.slot_of_body[group.body];
        if (group.holder == kNone) {
            // the world: its points stand still during a pass
        } else if (is_deformable(bodies, group.holder)) {
            link.far_body = island.slot_of_body[group.holder];
            island.body[link.far_body].linked = true;
        } else {
            link.rigid = rigid_slot(call, group.holder, island, state);
        }
        island.body[link.body].linked = true;
        link.stiffness = group.stiffness;
        link.break_strain = group.break_strain;
        for (uint32_t index = group.links.first; index < group.links.end(); ++index) {
            if (!links->whole[index]) continue;
            link.index = index;
            link.node = links->node[index];
            link.far_node = links->far_node[index];
            link.point = to_vec4(links->point[index]);
            link.rest = static_cast<double>(links->rest[index]);
            link.gauge = link.rest > 0 ? link.rest : group.gauge;
            if (is_lost(call, island, link.body, link.node) ||
                (link.far_body != kNone && is_lost(call, island, link.far_body, link.far_node))) {
                break_link(call, link, result);
                continue;
            }
            island.links.link.push_back(link);
        }
    }
    sort_link_ends(island);
}

void find_link_forces(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island) {
    for (AdvanceLink& link : island.links.link) {
        const AdvanceBody& b = island.body[link.body];
        const Vec4d link_vector =
            far_place_at_kick(call, island, particles, link, b.synchronous()) - place_at_kick(call, particles, b, link.node);
        const double length = std::sqrt(norm2(link_vector)), stretch = length - link.rest;
        link.force = link.rest == 0 ? link.stiffness * link_vector
                     : length > 0   ? Vec4d(link.stiffness * stretch / length * link_vector)
                                    : Vec4d{};
        // a body about to be restored must not affect its partner
        if (!std::isfinite(norm2(link.force))) link.force = Vec4d{};
        // a body that changes from leapfrog to a synchronous integrator gets half a kick more
        link.kick = (b.synchronous() ? 1.0 : 0.5) * call.dt + 0.5 * b.last_dt;
    }
}

void add_link_forces(const AdvanceIsland& island, uint32_t body, float* const axis[3]) {
    const Range ends = island.body[body].link_ends;
    for (uint32_t e = ends.first; e < ends.end(); ++e) {
        const AdvanceLink& link = island.links.link[island.links.link_end[e] / 2];
        const bool far = island.links.link_end[e] % 2 != 0;
        for (int i = 0; i < 3; ++i) {
            float& force = axis[i][far ? link.far_node : link.node];
            force = far ? force - static_cast<float>(link.force[i]) : force + static_cast<float>(link.force[i]);
        }
    }
}

void pull_linked_rigids(const AdvanceCall& call, AdvanceIsland& island, std::span<ToolState> tools) {
    for (const AdvanceLink& link : island.links.link) {
        if (link.rigid == kNone) continue;
        AdvanceRigid& rigid = island.rigid[link.rigid];
        const Vec4d impulse = -link.kick * link.force;
        const uint32_t tool = rigid.holder == kNone ? rigid.tool : island.rigid[rigid.holder].tool;
        if (tool != kNone) tools[tool].contact_impulse += to_vec3(impulse);
        add_grip_moment(call, island, link.rigid, rigid.pose[0](link.point), impulse, tools);
        if (rigid.node == kNone) continue;
        const ContactNode node = island.nodes.node[rigid.node];
        node.velocity += node.inv_mass * impulse;
        if (rigid.free == kNone) continue;
        AdvanceFree& f = island.free[rigid.free];
        f.spin += f.respond(cross(rigid.pose[0](link.point) - node.position, impulse));
        f.spin_before = f.spin;
        note_spin(f, island);
    }
}

void finish_links(const AdvanceCall& call, const Particles& particles, AdvanceIsland& island, AdvanceResult& result) {
    for (AdvanceLink& link : island.links.link) {
        Links& links = *call.inputs.other.links;
        LinkGroup& group = links.group[link.group];
        const AdvanceBody& b = island.body[link.body];
        group.impulse += to_vec3(link.kick * link.force);
        Vec4d far;  // at the time of the velocities
        if (link.rigid != kNone) {
            const AdvanceRigid& rigid = island.rigid[link.rigid];
            const Vec4d from = rigid.pose[0](link.point), to = rigid.pose[1](link.point);
            far = to - (b.synchronous() ? 0.0 : 0.5) * (to - from);
            // scripts and hands move from one such time to the next
            if (rigid.free == kNone || island.free[rigid.free].held)
                result.work_hand += dot(link.force, link.known ? far - link.far : to - from);
            link.far = far;
            link.known = true;
        } else if (link.far_body == kNone) {
            far = link.point;
        } else {
            far = place_at_velocity(particles, island.body[link.far_body], link.far_node);
        }
        const double stretch = stretch_of(link, far - place_at_velocity(particles, b, link.node));
        if (!std::isfinite(stretch)) continue;
        links.stretch[link.index] = stretch;
        const double strain = stretch_of(link, far_place(island, link, 1) - position_of(b, b.next, link.node)) / link.gauge;
        group.largest_strain = std::max(group.largest_strain, strain);
        if (!(strain > link.break_strain)) continue;
        break_link(call, link, result);
    }
    if (std::erase_if(island.links.link, [&](const AdvanceLink& link) { return call.inputs.other.links->whole[link.index] == 0; }) > 0)
        sort_link_ends(island);
}

}  // namespace trocar
