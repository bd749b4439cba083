#include <cmath>

#include "engine/base/format.hpp"
#include "engine/contact/sleeping_bodies.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/motion/free_rotation.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/links.hpp"
#include "systems/app/interface/handles.hpp"
#include "systems/detect/narrow/common_points.hpp"
namespace trocar {
namespace {

const World& world_of(const trocar_world* world) { return needed(world, "world").frame.world(); }
World& world_of(trocar_world* world) { return needed(world, "world").frame.world(); }

void check_index(const char* what, uint32_t index, size_t count) {
    if (index >= count) throw BadCall(std::string(what) + " " + std::to_string(index) + " of " + std::to_string(count));
}
void check_finite(const char* what, const double* v, size_t count) {
    for (size_t k = 0; k < count; ++k)
        if (!std::isfinite(v[k])) throw InputError(std::string(what) + ": not a finite number");
}

void wake(World& w, uint32_t body) {
    if (body < w.sleep.still.size()) w.sleep.still[body] = 0;
}

size_t count_of(const World& w, trocar_kind kind) {
    switch (kind) {
        case TROCAR_BODY:
            return w.bodies.name.size();
        case TROCAR_TOOL:
            return w.haptics.tool.size();
        case TROCAR_LINK:
            return w.links.group.size();
    }
    throw BadCall("no such kind");
}
const std::string& name_of(const World& w, trocar_kind kind, uint32_t index) {
    if (kind == TROCAR_BODY) return w.bodies.name[index];
    if (kind == TROCAR_TOOL) return w.bodies.name[w.haptics.tool[index].body];
    return w.links.group[index].name;
}

double mass_of(const World& w, uint32_t body) {
    if (const RigidMass* free = find_rigid_mass(w.bodies, body)) return free->mass;
    if (w.bodies.motion[body] == Motion::kHand) return w.bodies.inv_mass[body] > 0 ? 1 / w.bodies.inv_mass[body] : 0;
    double mass = 0;
    const Range range = w.bodies.particles[body];
    for (uint32_t p = range.first; p < range.end(); ++p)
        if (w.particles.offset[p].w > 0) mass += 1.0 / w.particles.offset[p].w;
    return mass;
}

// Position of a particle, m, world.
Vec3d particle_position(const World& w, uint32_t body, uint32_t particle) {
    const Float4& o = w.particles.offset[particle];
    return w.poses.origin[body] + Vec3d(o.x, o.y, o.z);
}

void push_deformable(World& w, uint32_t body, const Vec3d& point, const Vec3d& impulse) {
    const Range range = w.bodies.particles[body];
    uint32_t nearest = kNone;
    double least = std::numeric_limits<double>::infinity();
    for (uint32_t p = range.first; p < range.end(); ++p) {
        const double d = (particle_position(w, body, p) - point).squaredNorm();
        if (w.particles.offset[p].w > 0 && d < least) least = d, nearest = p;
    }
    if (nearest == kNone) throw InputError("body \"" + w.bodies.name[body] + "\" is fixed everywhere");
    float* const velocity[] = {&w.particles.velocity_x[nearest], &w.particles.velocity_y[nearest], &w.particles.velocity_z[nearest]};
    for (int k = 0; k < 3; ++k) {
        const double before = *velocity[k];
        *velocity[k] = static_cast<float>(before + impulse[k] * w.particles.offset[nearest].w);
        w.energy.work_hand += 0.5 * impulse[k] * (before + *velocity[k]);
    }
}

void push_free(World& w, uint32_t body, const Vec3d& point, const Vec3d& impulse) {
    const RigidMass& mass = *find_rigid_mass(w.bodies, body);
    const Vec3d arm = rotate(w.poses.orientation[body], mass.centre);  // from the origin to the centre of mass
    const Vec3d centre = w.poses.origin[body] + arm;
    const Quat principal = multiply(w.poses.orientation[body], mass.axes);
    Vec3d& velocity = w.poses.velocity[body];
    Vec3d& spin = w.poses.angular_velocity[body];
    const Vec3d lever = point - centre;
    const auto speed_there = [&] { return Vec3d(velocity + spin.cross(arm + lever)); };
    const Vec3d before = speed_there(), of_centre = velocity + spin.cross(arm) + impulse / mass.mass;
    spin += spin_of(mass.moments, principal, lever.cross(impulse));
    velocity = of_centre - spin.cross(arm);
    w.energy.work_hand += 0.5 * impulse.dot(before + speed_there());
}

}  // namespace

void put_contact(const Contacts& c, size_t row, trocar_contact& out) {
    out = {c.body[row],
           c.other[row],
           {c.vertex[row][0], c.vertex[row][1]},
           c.third[row],
           c.triangle[row],
           c.along[row],
           c.across[row],
           {},
           {},
           {},
           c.distance[row]};
    put(c.point[row], out.point), put(c.closest[row], out.closest), put(c.normal[row], out.normal);
}

void put_pair(const World& w, uint32_t pair, size_t row, trocar_pair& out) {
    const Penetrations& p = w.penetrations;
    const bool inside = row < p.pair.size();
    const Range range = pair < w.candidates.pair.size() ? w.candidates.pair[pair] : Range{};
    out = {};
    out.a = w.pairs.a[pair], out.b = w.pairs.b[pair], out.witness = kNone;
    out.overlap = share_a_point(surfaces_of(w), out.a, out.b, std::span(w.candidates.triangle).subspan(range.first, range.count),
                                inside ? p.depth[row] : 0);
    if (!inside || !out.overlap) return;
    out.saturated = p.saturated[row];
    out.a_in_b = p.vertices_a_in_b[row], out.b_in_a = p.vertices_b_in_a[row];
    out.depth = p.depth[row], out.surface_depth = p.surface_depth[row];
    put(p.direction[row], out.direction);
    out.witness = p.witness[row];
}

}  // namespace trocar

using namespace trocar;

uint32_t trocar_count(const trocar_world* world, trocar_kind kind) {
    if (!world || kind > TROCAR_LINK) return 0;
    return static_cast<uint32_t>(count_of(world->frame.world(), kind));
}

trocar_code trocar_find(const trocar_world* world, trocar_kind kind, const char* name, uint32_t* index) {
    return guarded([&] {
        const World& w = world_of(world);
        const std::string asked = &needed(name, "name");
        const size_t count = count_of(w, kind);
        std::string all;
        for (uint32_t i = 0; i < count; ++i) {
            if (kind == TROCAR_LINK && w.links.group[i].body == kNone) continue;
            if (name_of(w, kind, i) == asked) {
                needed(index, "index") = i;
                return TROCAR_OK;
            }
            if (i < 20) all += (all.empty() ? "" : ", ") + name_of(w, kind, i);
        }
        const char* const kinds[] = {"body", "tool", "link"};
        throw BadCall(std::string("no ") + kinds[kind] + " is named \"" + asked + "\"" + (all.empty() ? "" : "; there are " + all));
    });
}

trocar_code trocar_name(const trocar_world* world, trocar_kind kind, uint32_t index, char* text, size_t capacity, size_t* length) {
    return guarded([&] {
        const World& w = world_of(world);
        check_index("index", index, count_of(w, kind));
        return fill_text(name_of(w, kind, index), text, capacity, length);
    });
}

trocar_code trocar_get_body(const trocar_world* world, uint32_t body, trocar_body* out) {
    return guarded([&] {
        const World& w = world_of(world);
        check_index("body", body, w.bodies.mesh.size());
        const MeshInfo& info = w.meshes.info[w.bodies.mesh[body]];
        trocar_body b{};
        b.motion = static_cast<uint32_t>(w.bodies.motion[body]);
        b.vertices = info.vertices.count, b.triangles = info.triangles.count;
        b.first_particle = w.bodies.particles[body].first, b.particles = w.bodies.particles[body].count;
        put(w.poses.origin[body], b.origin), put(w.poses.orientation[body], b.orientation);
        b.mass = mass_of(w, body);
        give(b, out, "out");
        return TROCAR_OK;
    });
}

trocar_code trocar_vertices(const trocar_world* world, uint32_t body, double* xyz, size_t capacity, size_t* count) {
    return guarded([&] {
        const World& w = world_of(world);
        check_index("body", body, w.bodies.mesh.size());
        const Surfaces surfaces = surfaces_of(w);
        return fill(xyz, capacity, count, w.meshes.info[w.bodies.mesh[body]].vertices.count, 3,
                    [&](size_t v, double* to) { put(vertex_position(surfaces, body, static_cast<uint32_t>(v)), to); });
    });
}

trocar_code trocar_triangles(const trocar_world* world, uint32_t body, uint32_t* corners, size_t capacity, size_t* count) {
    return guarded([&] {
        const World& w = world_of(world);
        check_index("body", body, w.bodies.mesh.size());
        const MeshView mesh = mesh_view(w.meshes, w.bodies.mesh[body]);
        return fill(corners, capacity, count, mesh.triangle.size(), 3,
                    [&](size_t t, uint32_t* to) { std::copy_n(mesh.triangle[t].data(), 3, to); });
    });
}

trocar_code trocar_distance(trocar_world* world, uint32_t body, const double* points, size_t count, trocar_nearest* out) {
    return guarded([&] {
        World& w = world_of(world);
        check_index("body", body, w.bodies.mesh.size());
        if (count == 0) return TROCAR_OK;
        if (count > kNone) throw BadCall("more points than 32 bits count");
        needed(points, "points"), needed(out, "out");
        check_finite("points", points, 3 * count);
        on_threads([&] {
            const Surfaces surfaces = surfaces_of(w);
            ClosestPointTree& tree = *w.trees[w.bodies.tree[body]];
            const Range range = w.bodies.particles[body];
            if (is_deformable(w.bodies, body)) tree.refit(std::span(w.particles.offset).subspan(range.first, range.count));
            const double doubtful = doubtful_depth(surfaces, body);
            parallel_for(static_cast<uint32_t>(count), 64, [&](uint32_t begin, uint32_t end) {
                for (uint32_t i = begin; i < end; ++i) {
                    const Vec3d p = world_to_frame(surfaces, body, vector_at(points + 3 * size_t{i}));
                    SurfacePoint answer = tree.query(p);
                    if (-answer.distance > doubtful) tree.decide_side(p, answer);
                    out[i] = {answer.distance, {}, {}, answer.triangle, 0};
                    put(frame_to_world(surfaces, body, answer.point), out[i].point);
                    put(direction_to_world(surfaces, body, answer.normal), out[i].normal);
                }
            });
        });
        return TROCAR_OK;
    });
}

trocar_code trocar_push(trocar_world* world, uint32_t body, const double point[3], const double impulse[3]) {
    return guarded([&] {
        World& w = world_of(world);
        check_index("body", body, w.bodies.mesh.size());
        check_finite("point", &needed(point, "point"), 3);
        check_finite("impulse", &needed(impulse, "impulse"), 3);
        const Vec3d at = vector_at(point), j = vector_at(impulse);
        if (w.bodies.motion[body] == Motion::kDeformable)
            push_deformable(w, body, at, j);
        else if (w.bodies.motion[body] == Motion::kFree)
            push_free(w, body, at, j);
        else
            throw BadCall("body \"" + w.bodies.name[body] + "\" is not moved by forces");
        wake(w, body);
        return TROCAR_OK;
    });
}

trocar_code trocar_set_target(trocar_world* world, uint32_t tool, const trocar_target* target) {
    return guarded([&] {
        World& w = world_of(world);
        check_index("tool", tool, w.haptics.tool.size());
        const trocar_target asked = taken(target, "target");
        check_finite("target.position", asked.position, 3);
        check_finite("target.orientation", asked.orientation, 4);
        check_finite("target.grip", &asked.grip, 1);
        if (!(asked.seconds >= 0 && asked.seconds < 1e9)) throw InputError("target.seconds: not a time from 0 on");
        ToolMotion m = world->motion[tool];
        if (!m.on && m.script != kNone && world->recording)
            throw BadCall("a tool with a recorded device cannot be taken over while the world records");
        const uint64_t now = w.clock.tick;
        m.from = hand_at(m, tool, now, w);
        m.to = m.from;
        m.to.position = vector_at(asked.position);
        const Quat turn{asked.orientation[0], asked.orientation[1], asked.orientation[2], asked.orientation[3]};
        const double length = std::sqrt(turn.w * turn.w + turn.x * turn.x + turn.y * turn.y + turn.z * turn.z);
        if (length > 0 && std::abs(length - 1) > 1e-6) throw InputError("target.orientation: not a unit quaternion");
        if (length > 0) m.to.orientation = normalized(turn);
        if (asked.grip >= 0) m.to.grip = asked.grip;
        m.from.buttons = m.to.buttons = asked.buttons;
        m.begin = now;
        m.end = std::max(pass_tick(w.clock.pass + 1, w.clock.contact_rate), now + static_cast<uint64_t>(std::llround(1e3 * asked.seconds)));
        const double seconds = 1e-3 * static_cast<double>(m.end - m.begin), way = (m.to.position - m.from.position).norm();
        if (way > HapticParams{}.device_speed * seconds)
            throw InputError(format("target: %g m in %g s is faster than a hand moves, %g m/s; give it more seconds", way, seconds,
                                    HapticParams{}.device_speed));
        m.on = true;
        world->motion[tool] = m;
        return TROCAR_OK;
    });
}

trocar_code trocar_release_tool(trocar_world* world, uint32_t tool) {
    return guarded([&] {
        check_index("tool", tool, world_of(world).haptics.tool.size());
        if (world->motion[tool].script != kNone && world->recording)
            throw BadCall("a tool with a recorded device cannot be given back while the world records");
        world->motion[tool].on = false;
        return TROCAR_OK;
    });
}

trocar_code trocar_get_tool(const trocar_world* world, uint32_t tool, trocar_tool* out) {
    return guarded([&] {
        const World& w = world_of(world);
        check_index("tool", tool, w.haptics.tool.size());
        const ToolState& s = w.haptics.state[tool];
        trocar_tool t{};
        t.body = w.haptics.tool[tool].body, t.touched = s.touched, t.contacts = s.contacts;
        put(s.device.position, t.device), put(s.device.orientation, t.orientation), put(s.proxy, t.proxy);
        put(s.output.force, t.force), put(s.output.torque, t.torque);
        put(s.contact_impulse / (1e-3 * w.clock.period), t.tissue), put(s.link_force, t.links);
        t.grip = s.device.grip, t.grip_torque = s.grip_torque;
        give(t, out, "out");
        return TROCAR_OK;
    });
}

trocar_code trocar_contacts(const trocar_world* world, trocar_contact* out, size_t capacity, size_t* count) {
    return guarded([&] {
        const Contacts& c = world_of(world).contacts;
        return fill(out, capacity, count, c.point.size(), 1, [&](size_t i, trocar_contact* to) { put_contact(c, i, *to); });
    });
}

trocar_code trocar_pairs(const trocar_world* world, trocar_pair* out, size_t capacity, size_t* count) {
    return guarded([&] {
        const World& w = world_of(world);
        return fill(out, capacity, count, w.penetrations.pair.size(), 1,
                    [&](size_t i, trocar_pair* to) { put_pair(w, w.penetrations.pair[i], i, *to); });
    });
}

trocar_code trocar_get_link(const trocar_world* world, uint32_t link, trocar_link* out) {
    return guarded([&] {
        const World& w = world_of(world);
        check_index("link", link, w.links.group.size());
        const LinkGroup& g = w.links.group[link];
        trocar_link l{};
        l.body = g.body, l.holder = g.holder, l.holding = g.body == kNone ? 0 : g.links.count;
        l.made = g.made, l.broken = g.broken;
        put(g.impulse / (1e-3 * w.clock.period), l.force);
        l.largest_force = g.largest_force, l.largest_strain = g.largest_strain;
        give(l, out, "out");
        return TROCAR_OK;
    });
}

trocar_code trocar_add_staple(trocar_world* world, const trocar_staple* staple, uint32_t* link) {
    return guarded([&] {
        World& w = world_of(world);
        const trocar_staple asked = taken(staple, "staple");
        check_index("staple.a", asked.a, w.bodies.mesh.size()), check_index("staple.b", asked.b, w.bodies.mesh.size());
        check_finite("staple.position", asked.position, 3);
        for (const double v : {asked.reach, asked.rest, asked.break_strain})
            if (!(v >= 0)) throw InputError("staple: reach, rest and break_strain are from 0 on");
        if (!(asked.stiffness > 0 && std::isfinite(asked.stiffness))) throw InputError("staple.stiffness: not a positive number");
        if (asked.a == asked.b || !is_deformable(w.bodies, asked.a)) throw BadCall("staple.a must be a deformable body, and b another");
        const auto is_free = [](const LinkGroup& g) { return g.body == kNone; };
        if (std::ranges::none_of(w.links.group, is_free)) throw BadCall("the scene has no room for a staple: reserve it by staples = N");
        Staple s{asked.a, asked.b, vector_at(asked.position)};
        if (asked.reach > 0) s.reach = asked.reach;
        s.stiffness = asked.stiffness;
        if (asked.rest > 0) s.rest = asked.rest;
        if (asked.break_strain > 0) s.break_strain = asked.break_strain;
        const Entity made = add_staple({surfaces_of(w), w.solids, w.trees}, s, w.links, w.energy);
        if (made == Entity{}) throw InputError("staple: no node of \"" + w.bodies.name[s.a] + "\" is within reach");
        wake(w, s.a), wake(w, s.b);
        needed(link, "link") = made.index;
        return TROCAR_OK;
    });
}

trocar_code trocar_remove_link(trocar_world* world, uint32_t link) {
    return guarded([&] {
        World& w = world_of(world);
        check_index("link", link, w.links.group.size());
        const LinkGroup group = w.links.group[link];
        if (group.body == kNone || !free_link_group(w.links, group.entity, w.energy)) throw BadCall("link: a free slot");
        LinkScratch scratch;
        update_link_limits(w.bodies, w.solids, w.particles, scratch, w.links);
        wake(w, group.body), wake(w, group.holder);
        return TROCAR_OK;
    });
}
