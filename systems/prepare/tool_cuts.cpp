#include "systems/prepare/tool_cuts.hpp"

#include <algorithm>
#include <cmath>

#include "engine/mesh/surface_cut.hpp"
#include "engine/tissue/cut_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/heat.hpp"
namespace trocar {
namespace {

// The part of a list of the state that belongs to one cut body, taken out of it.
std::vector<std::array<uint32_t, 2>> take_slits(uint32_t index, CutSurfaces& cut) {
    std::vector<std::array<uint32_t, 2>> slit;
    std::erase_if(cut.slit, [&](const std::array<uint32_t, 3>& s) {
        if (s[0] == index) slit.push_back({s[1], s[2]});
        return s[0] == index;
    });
    return slit;
}

std::vector<uint32_t> take_front(uint32_t index, uint32_t action, CutSurfaces& cut) {
    std::vector<uint32_t> front;
    std::erase_if(cut.front, [&](const std::array<uint32_t, 3>& f) {
        if (f[0] == index && f[2] == action) front.push_back(f[1]);
        return f[0] == index && f[2] == action;
    });
    return front;
}

void put_lists(uint32_t index, uint32_t action, const CutMesh& mesh, CutSurfaces& cut) {
    for (const auto& s : mesh.slit) cut.slit.push_back({index, s[0], s[1]});
    for (const uint32_t v : mesh.front) cut.front.push_back({index, v, action});
    std::sort(cut.slit.begin(), cut.slit.end());
    std::sort(cut.front.begin(), cut.front.end());
}

double energy_of_body(const CutWorld& w, uint32_t body) {
    Energy energy;
    BodyEnergyScratch scratch;
    const OtherForces other{.solids = &w.solids, .actions = &w.actions};
    add_body_energy({w.springs, w.bodies, w.poses, w.particles, w.anchors, w.gravity, other}, body, scratch, energy);
    return energy.kinetic + energy.elastic + energy.gravity;
}

// Masses follow the areas; a vertex on an edge between two fixed ones is fixed. before: areas before the cut, m^2.
void share_mass(const CutWorld& w, uint32_t body, std::span<const float> before, std::span<const CutVertex> made) {
    const uint32_t first = w.bodies.particles[body].first, old = static_cast<uint32_t>(before.size());
    const Range shares = w.springs.vertices[w.bodies.mesh[body]];
    const auto share = [&](uint32_t v) { return double{w.springs.area_share[shares.first + v]}; };
    double area_mass = 0;  // kg/m^2, uniform: by the heaviest vertex, least rounded
    double heaviest = 0;
    for (uint32_t v = 0; v < old; ++v) {
        const double mass = w.particles.offset[first + v].w > 0 ? 1 / double{w.particles.offset[first + v].w} : 0;
        if (mass > heaviest && before[v] > 0) heaviest = mass, area_mass = mass / double{before[v]};
    }
    for (uint32_t v = 0; v < old; ++v) {
        float& inverse = w.particles.offset[first + v].w;
        if (inverse > 0 && w.springs.area_share[shares.first + v] != before[v]) inverse = static_cast<float>(1 / (area_mass * share(v)));
    }
    for (size_t i = 0; i < made.size(); ++i) {
        const uint32_t v = old + static_cast<uint32_t>(i);
        const bool held = w.particles.offset[first + made[i].a].w == 0 && w.particles.offset[first + made[i].b].w == 0;
        w.particles.offset[first + v].w = held || !(share(v) > 0) ? 0.0f : static_cast<float>(1 / (area_mass * share(v)));
    }
}

// New particles between those that they were made from, with their velocities.
void place_new(const CutWorld& w, uint32_t body, uint32_t old, std::span<const CutVertex> made) {
    Particles& p = w.particles;
    const uint32_t first = w.bodies.particles[body].first;
    for (size_t i = 0; i < made.size(); ++i) {
        const uint32_t to = first + old + static_cast<uint32_t>(i), a = first + made[i].a, b = first + made[i].b;
        const auto between = [&](float from, float end) { return static_cast<float>(from + made[i].along * (double{end} - double{from})); };
        p.offset[to] = {between(p.offset[a].x, p.offset[b].x), between(p.offset[a].y, p.offset[b].y), between(p.offset[a].z, p.offset[b].z),
                        0.0f};
        for (auto* field : {&p.velocity_x, &p.velocity_y, &p.velocity_z}) (*field)[to] = between((*field)[a], (*field)[b]);
    }
}

// Values of new nodes, linear between those that they were made from. The sum of a value over the volumes, thirds of triangles, stays:
// what a split edge takes from its ends and from the corners opposite to it is what its new node gets.
void interpolate(uint32_t old, std::span<const CutVertex> made, std::span<double> value) {
    for (size_t i = 0; i < made.size(); ++i)
        value[old + i] = value[made[i].a] + made[i].along * (value[made[i].b] - value[made[i].a]);
}

// A body that is heated: its new nodes are as warm, and have been as hot, as between those that they were made from. Heat stays.
void cut_heat(const CutWorld& w, uint32_t index, uint32_t old, std::span<const CutVertex> made) {
    for (const HeatBody& heat : w.actions.heat_body) {
        if (heat.cut != index) continue;
        HeatState& state = w.state.heat;
        const auto part = [&](std::vector<double>& of) { return std::span(of).subspan(heat.nodes.first, old + made.size()); };
        const std::span<double> volume = part(w.actions.heat_volume), rise = part(state.rise), damage = part(state.damage), steam = part(state.steam);
        const std::vector<double> before(volume.begin(), volume.end());
        lay_heat(heat, w.bodies, w.meshes, w.solids, w.actions);
        interpolate(old, made, rise), interpolate(old, made, damage);
        for (uint32_t v = 0; v < old; ++v) steam[v] = before[v] > 0 ? steam[v] / before[v] : 0;  // J/m^3
        interpolate(old, made, steam);
        for (size_t v = 0; v < steam.size(); ++v) steam[v] *= volume[v];
        note_factors(heat, w.bodies, w.springs, w.actions);
        Solids none;
        stiffen(heat, w.bodies, w.actions, state, false, w.springs, none);
    }
}

// The present surface, in arrays of its own that a refused cut leaves behind.
struct WorkingSurface {
    std::vector<Vec3d> rest, place, before;
    std::vector<Triangle> triangle;
    std::vector<std::array<Vec2, 3>> uv;
    std::vector<uint16_t> material;
    CutMesh mesh;

    WorkingSurface(const CutWorld& w, uint32_t index, uint32_t action) {
        CutSurfaces& cut = w.state.cut;
        const CutBody& limits = w.actions.cut_body[index];
        const auto part = [](const auto& from, const Range& range, auto& to) {
            to.assign(from.begin() + range.first, from.begin() + range.end());
        };
        part(cut.position, limits.vertices, rest);
        part(cut.triangle, limits.triangles, triangle), part(cut.uv, limits.triangles, uv), part(cut.material, limits.triangles, material);
        place.resize(rest.size(), Vec3d::Zero());
        part(cut.before, limits.vertices, before);
        for (Vec3d& p : before) p -= w.poses.origin[limits.body];
        for (uint32_t v = 0; v < cut.count[index][0]; ++v) {
            const Float4& o = w.particles.offset[w.bodies.particles[limits.body].first + v];
            place[v] = {o.x, o.y, o.z};
        }
        mesh = {cut.count[index][0], cut.count[index][1], rest, place, triangle, uv, material, {}, {}, limits.edge, before};
        mesh.slit = take_slits(index, cut);
        mesh.front = take_front(index, action, cut);
    }
    void put(const CutBody& limits, uint32_t index, std::span<const CutVertex> made, CutSurfaces& cut) const {
        std::copy(rest.begin(), rest.end(), cut.position.begin() + limits.vertices.first);
        std::copy(triangle.begin(), triangle.end(), cut.triangle.begin() + limits.triangles.first);
        std::copy(uv.begin(), uv.end(), cut.uv.begin() + limits.triangles.first);
        std::copy(material.begin(), material.end(), cut.material.begin() + limits.triangles.first);
        Vec3* goal = cut.goal.data() + limits.vertices.first;
        for (size_t i = 0; i < made.size(); ++i) {
            const float along = static_cast<float>(made[i].along);
            goal[cut.count[index][0] + i] = goal[made[i].a] + along * (goal[made[i].b] - goal[made[i].a]);
        }
        cut.count[index] = {mesh.vertices, mesh.triangles};
    }
};

// Makes one cut of one body. Returns the length of the new slits, m.
double cut_body(const CutWorld& w, uint32_t action, uint32_t index, EdgeSweep sweep) {
    const CutBody& limits = w.actions.cut_body[index];
    const uint32_t body = limits.body, prototype = w.bodies.mesh[body], old = w.state.cut.count[index][0];
    for (Vec3d* p : {&sweep.a0, &sweep.b0, &sweep.a1, &sweep.b1}) *p -= w.poses.origin[body];
    WorkingSurface work(w, index, action);
    const auto slits = work.mesh.slit;
    const auto front = work.mesh.front;
    std::vector<CutVertex> made;
    const CutResult result = cut_surface(sweep, work.mesh, made);
    const bool changed = !made.empty();
    if (result.refused) ++w.state.progress[action].refused;
    if (!changed) {
        put_lists(index, action, work.mesh, w.state.cut);
        return result.length;
    }
    const Range shares = w.springs.vertices[prototype];
    const std::vector<float> before(w.springs.area_share.begin() + shares.first, w.springs.area_share.begin() + shares.first + old);
    const double energy = energy_of_body(w, body);
    CutSurfaces next = w.state.cut;
    work.put(limits, index, made, next);
    if (!lay_cut_surface(limits, index, next, w.bodies, w.meshes, w.springs, w.anchors)) {
        ++w.state.progress[action].refused;
        work.mesh.slit = slits, work.mesh.front = front;
        put_lists(index, action, work.mesh, w.state.cut);
        return 0;
    }
    w.state.cut = std::move(next);
    for (const auto& [a, b] : result.opened) w.state.opened.push_back({body, a, b, action});
    put_lists(index, action, work.mesh, w.state.cut);
    place_new(w, body, old, made);
    share_mass(w, body, before, made);
    cut_heat(w, index, old, made);
    remake_tree(body, w.bodies, w.particles, w.meshes, w.trees);
    w.energy.work_links += energy_of_body(w, body) - energy;
    if (body < w.sleep.still.size()) w.sleep.still[body] = 0;
    return result.length;
}

// Places of the nodes of a solid's lattice, m from the body's origin.
std::vector<Vec3d> places_of_lattice(const CutWorld& w, const CutSolid& limits) {
    const uint32_t first = w.bodies.particles[limits.body].first + embedded_count(w.solids, w.bodies.mesh[limits.body]);
    std::vector<Vec3d> place(limits.nodes);
    for (uint32_t n = 0; n < limits.nodes; ++n) {
        const Float4& o = w.particles.offset[first + n];
        place[n] = {o.x, o.y, o.z};
    }
    return place;
}

// Copies of nodes move as they do; nodes have the mass of the parts around them. A virtual copy of a fixed node is free.
void place_copies(const CutWorld& w, uint32_t body, uint32_t nodes, std::span<const uint32_t> made) {
    Particles& p = w.particles;
    const SolidInfo& info = w.solids.info[w.bodies.mesh[body]];
    const uint32_t first = w.bodies.particles[body].first + embedded_count(info);
    const auto inverse_mass = [&](uint32_t n) {
        return static_cast<float>(1.0 / (w.bodies.tissue[body].density * w.solids.node_volume[info.nodes.first + n]));
    };
    for (uint32_t n = 0; n < nodes; ++n)
        if (p.offset[first + n].w > 0) p.offset[first + n].w = inverse_mass(n);
    for (uint32_t i = 0; i < made.size(); ++i) {
        const uint32_t to = first + nodes + i, from = first + made[i];
        p.offset[to] = p.offset[from];
        p.offset[to].w = inverse_mass(nodes + i);
        for (auto* field : {&p.velocity_x, &p.velocity_y, &p.velocity_z}) (*field)[to] = (*field)[from];
    }
    drape_skin(w.solids, w.bodies, body, p);
}

// Makes one cut of one solid. Returns the area of the new surface on one side, m^2.
double cut_solid(const CutWorld& w, uint32_t action, uint32_t index, EdgeSweep sweep) {
    const CutSolid& limits = w.actions.cut_solid[index];
    const uint32_t body = limits.body;
    CutLattices& state = w.state.lattice;
    for (Vec3d* p : {&sweep.a0, &sweep.b0, &sweep.a1, &sweep.b1}) *p -= w.poses.origin[body];
    const auto start = state.before.begin() + limits.copies.first;
    std::vector<Vec3d> before(start, start + limits.nodes);
    for (Vec3d& p : before) p -= w.poses.origin[body];
    const Lattice lattice = lattice_of(limits, w.actions);
    const auto crossed = crossed_edges(sweep, lattice, places_of_lattice(w, limits), before,
                                       std::span(state.cut_at).subspan(limits.edges.first, limits.edges.count));
    if (crossed.empty()) return 0;
    LatticePieces pieces = take_pieces(limits, index, state);
    const SolidInfo& info = w.solids.info[w.bodies.mesh[body]];
    const std::span rest = std::span(w.solids.position).subspan(info.inner.first, limits.nodes);
    const double area = wall_area(lattice, pieces, rest);
    const uint32_t nodes = state.count[index][0];
    std::vector<uint32_t> made;
    if (!cut_lattice(lattice, crossed, pieces, made)) {
        put_pieces(limits, index, pieces, state);
        return 0;
    }
    const double energy = energy_of_body(w, body);
    CutLattices next = state;
    if (!put_pieces(limits, index, pieces, next) ||
        !lay_cut_solid(limits, index, w.actions, next, w.bodies, {w.meshes, w.springs, w.solids, w.anchors})) {
        ++w.state.progress[action].refused;
        return 0;
    }
    state = std::move(next);
    place_copies(w, body, nodes, made);
    remake_tree(body, w.bodies, w.particles, w.meshes, w.trees);
    w.energy.work_links += energy_of_body(w, body) - energy;
    if (body < w.sleep.still.size()) w.sleep.still[body] = 0;
    return std::max(0.0, wall_area(lattice, pieces, rest) - area);
}

// Takes the work that a tool owes from its motion along the sweep, as far as that goes. Returns the mean force on it, N.
Vec3d resist(const CutWorld& w, const ToolAction& action, const Vec3d& moved, ActionProgress& progress) {
    const uint32_t body = w.tools[action.tool].body;
    const double distance = moved.norm(), inverse = w.bodies.inv_mass[body];
    if (!(progress.owed > 0) || !(distance > 0) || !(inverse > 0)) return Vec3d::Zero();
    const Vec3d along = moved / distance;
    const double speed = w.poses.velocity[body].dot(along);
    if (!(speed > 0)) return Vec3d::Zero();
    const double given = std::min(progress.owed, 0.5 * speed * speed / inverse);
    const double left = std::sqrt(std::max(0.0, speed * speed - 2 * given * inverse));
    w.poses.velocity[body] -= (speed - left) * along;
    progress.owed -= given;
    w.energy.work_hand += given, w.energy.work_cuts -= given;
    return -(speed - left) / inverse / w.period * along;
}

// Notes where the surfaces are that the next sweeps begin from.
void note_places(const CutWorld& w) {
    CutSurfaces& cut = w.state.cut;
    const auto is_cut_now = [&](uint32_t index) {
        return std::any_of(w.actions.cuts.begin(), w.actions.cuts.end(),
                           [&](const auto& c) { return c[1] == index && w.state.progress[c[0]].swept; });
    };
    for (uint32_t index = 0; index < w.actions.cut_solid.size(); ++index) {
        if (std::none_of(w.actions.solid_cuts.begin(), w.actions.solid_cuts.end(),
                         [&](const auto& c) { return c[1] == index && w.state.progress[c[0]].swept; }))
            continue;
        const CutSolid& limits = w.actions.cut_solid[index];
        const std::vector<Vec3d> place = places_of_lattice(w, limits);
        for (uint32_t n = 0; n < limits.nodes; ++n)
            w.state.lattice.before[limits.copies.first + n] = w.poses.origin[limits.body] + place[n];
    }
    for (uint32_t index = 0; index < w.actions.cut_body.size(); ++index) {
        if (!is_cut_now(index)) continue;
        const CutBody& limits = w.actions.cut_body[index];
        for (uint32_t v = 0; v < cut.count[index][0]; ++v) {
            const Float4& o = w.particles.offset[w.bodies.particles[limits.body].first + v];
            cut.before[limits.vertices.first + v] = w.poses.origin[limits.body] + Vec3d(o.x, o.y, o.z);
        }
    }
}

void forget_front(uint32_t action, CutSurfaces& cut) {
    std::erase_if(cut.front, [&](const std::array<uint32_t, 3>& f) { return f[2] == action; });
}

}  // namespace

void cut_with_tools(const CutWorld& w) {
    w.state.opened.clear();
    std::vector<Vec3d> force(w.tools.size(), Vec3d::Zero());
    for (uint32_t i = 0; i < w.actions.action.size(); ++i) {
        const ToolAction& action = w.actions.action[i];
        ActionProgress& progress = w.state.progress[i];
        if (action.kind != ActionKind::kCut) continue;
        if (!progress.on) {
            if (progress.swept) forget_front(i, w.state.cut);
            progress.swept = progress.stroke = false;
            continue;
        }
        const uint32_t tool = w.tools[action.tool].body;
        const auto place = [&](const Vec3d& p) { return Vec3d(w.poses.origin[tool] + rotate(w.poses.orientation[tool], p)); };
        const EdgeSweep sweep{progress.from, progress.from_edge, place(action.point), place(action.edge)};
        const bool moved = progress.swept;
        progress.swept = true, progress.from = sweep.a1, progress.from_edge = sweep.b1;
        if (!moved) continue;
        const auto count = [&](double area) {
            progress.area += area, progress.work += action.toughness * area, progress.owed += action.toughness * area;
            if (area > 0 && !progress.stroke) progress.stroke = true, ++progress.done;
        };
        for (const auto& [by, index] : w.actions.cuts)
            if (by == i) count(cut_body(w, i, index, sweep) * w.actions.cut_body[index].thickness);
        for (const auto& [by, index] : w.actions.solid_cuts)
            if (by == i) count(cut_solid(w, i, index, sweep));
        // what an earlier stroke ended without giving is given once this one cuts
        if (progress.stroke) force[action.tool] += resist(w, action, 0.5 * (sweep.a1 + sweep.b1 - sweep.a0 - sweep.b0), progress);
    }
    note_places(w);
    for (size_t t = 0; t < w.states.size(); ++t) {
        if (!w.links) w.states[t].link_force_before = w.states[t].link_force, w.states[t].link_force.setZero();
        w.states[t].link_force += force[t];
    }
}

}  // namespace trocar
