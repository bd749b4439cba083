#include "systems/prepare/tear_bodies.hpp"

#include <algorithm>
#include <array>

#include "engine/mesh/mesh_topology.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "engine/mesh/region.hpp"
#include "engine/tissue/heat.hpp"
#include "engine/tissue/links.hpp"
#include "engine/tissue/solid_tears.hpp"
namespace trocar {
namespace {

// State of the tetrahedra of a solid that may tear: 0 = whole.
std::span<const uint8_t> lost_tetrahedra(const Solids& solids, const Bodies& bodies, const TearBody& tear, const Torn& torn) {
    const SolidInfo& info = solids.info[bodies.mesh[tear.body]];
    return std::span(torn.tetrahedron).subspan(info.tetrahedra.first, info.count);
}

// One flag per triangle number: 1 = absent.
std::vector<uint8_t> removed_flags(const Tears& tears, uint32_t tear, const Torn& torn) {
    std::vector<uint8_t> gone(tears.body[tear].order.count, 0);
    for (const auto& [t, triangle] : torn.triangle) {
        if (t == tear) gone[triangle] = 1;
    }
    return gone;
}

// Number at load of the triangle now at this index of the prototype.
uint32_t at_load(const Tears& tears, uint32_t tear, uint32_t triangle) { return tears.order[tears.body[tear].order.first + triangle]; }

// The same for a solid, with the triangles themselves.
std::vector<uint8_t> hidden_flags(const Tears& tears, const TearBody& tear, std::span<const uint8_t> lost, std::vector<Triangle>& corner) {
    std::vector<uint8_t> gone(tear.faces.count);
    corner.resize(tear.faces.count);
    for (uint32_t number = 0; number < tear.faces.count; ++number) {
        gone[number] = !is_surface(tears.face[tear.faces.first + number], lost.data(), corner[number]);
    }
    return gone;
}

// Removes the tetrahedra in the region of a cut.
void cut_torn_solid(const TearPass& pass, const Cut& cut, const Meshes& meshes, const Tears& tears, const Particles& particles,
               TearState state) {
    const uint32_t body = tears.body[cut.tear].body, prototype = pass.bodies.mesh[body];
    const SolidInfo& info = pass.solids.info[prototype];
    std::vector<uint32_t> taken;
    for (uint32_t t = 0; t < info.count; ++t) {
        Vec3d middle = Vec3d::Zero();
        for (const auto& corner : pass.solids.corner)
            middle += rest_of_node(meshes, pass.solids, prototype, corner[info.tetrahedra.first + t]) / 4;
        if (contains(cut.region, middle)) taken.push_back(t);
    }
    remove_tetrahedra(pass, particles, tears, cut.tear, taken, state);
}

// Records the triangles in the region of a cut.
void mark_cut(const Cut& cut, const Tears& tears, const Bodies& bodies, const Meshes& meshes, Torn& torn) {
    const MeshInfo& info = meshes.info[bodies.mesh[tears.body[cut.tear].body]];
    std::vector<uint32_t> taken;
    for (uint32_t t = 0; t < info.triangles.count; ++t) {
        const Triangle& corner = meshes.triangle[info.triangles.first + t];
        Vec3d middle = Vec3d::Zero();
        for (const uint32_t v : corner) middle += meshes.position[info.vertices.first + v] / 3;
        if (cut.material != kNone && meshes.triangle_material[info.triangles.first + t] != cut.material) continue;
        if (contains(cut.region, middle)) taken.push_back(at_load(tears, cut.tear, t));
    }
    std::sort(taken.begin(), taken.end());
    remove_triangles(tears, cut.tear, taken, torn);
}

// Index of the half-edge from one vertex to another, kNone if no spring joins them.
uint32_t half_edge(const Springs& springs, uint32_t prototype, uint32_t from, uint32_t to) {
    const uint32_t* column = springs.slice_column.data() + springs.info[prototype].slices.first + prototype + from / kSliceWidth;
    for (uint32_t c = column[0]; c < column[1]; ++c) {
        const uint32_t index = c * kSliceWidth + from % kSliceWidth;
        if (springs.neighbour[index] == to) return index;
    }
    return kNone;
}

// Energy of a spring at the time of the velocities, J.
double spring_energy(const Springs& springs, const Bodies& bodies, const Particles& p, uint32_t body, uint32_t index, uint32_t from,
                     uint32_t to) {
    const double back = 0.5 * p.last_dt[body];
    const auto position = [&](uint32_t v) {
        const uint32_t i = bodies.particles[body].first + v;
        return Vec3d(p.offset[i].x - back * p.velocity_x[i], p.offset[i].y - back * p.velocity_y[i],
                     p.offset[i].z - back * p.velocity_z[i]);
    };
    const double stretch = (position(to) - position(from)).norm() - double{springs.rest_length[index]};
    const double factor = springs.info[bodies.mesh[body]].varied ? double{springs.factor[index]} : 1.0;
    return 0.5 * double{bodies.spring_stiffness[body]} * factor * stretch * stretch;
}

// Breaks the springs along edges that are about to lose their last triangle.
void break_bare_edges(const TearPass& pass, const Particles& particles, const Meshes& meshes, const Tears& tears, uint32_t tear,
                      std::span<const uint8_t> gone, TearState state) {
    const Springs& springs = pass.springs;
    Torn& torn = state.torn;
    const uint32_t body = tears.body[tear].body, prototype = pass.bodies.mesh[body];
    const MeshInfo& info = meshes.info[prototype];
    for (uint32_t e = info.edges.first; e < info.edges.end(); ++e) {
        const auto is_gone = [&](uint32_t t) { return t == kNone || gone[at_load(tears, tear, t)]; };
        if (!is_gone(meshes.edge_triangle[e][0]) || !is_gone(meshes.edge_triangle[e][1])) continue;
        const auto [from, to] = meshes.edge[e];
        const uint32_t index = half_edge(springs, prototype, from, to), back = half_edge(springs, prototype, to, from);
        if (index == kNone || back == kNone || torn.spring[index]) continue;
        state.energy.work_links -= spring_energy(springs, pass.bodies, particles, body, index, from, to);
        torn.spring[index] = torn.spring[back] = 1;
        ++state.report.broken_springs;
    }
}

// Sorts the remaining triangles to the front in the order of their numbers, the absent ones behind them.
// Those of a solid come from `corner` if given.
void sort_triangles(std::span<const uint8_t> gone, const TearBody& tear, std::span<const Triangle> corner, MeshInfo& info, Tears& tears,
                    Meshes& meshes) {
    const uint32_t count = tear.order.count;
    std::vector<Triangle> triangle(count);
    std::vector<std::array<Vec2, 3>> uv(count);
    std::vector<uint16_t> material(count);
    for (uint32_t i = 0; i < count; ++i) {
        const uint32_t index = info.triangles.first + i, number = tears.order[tear.order.first + i];
        triangle[number] = corner.empty() ? meshes.triangle[index] : corner[number], uv[number] = meshes.uv[index],
        material[number] = meshes.triangle_material[index];
    }
    uint32_t next = 0;
    for (const uint8_t wanted : {uint8_t{0}, uint8_t{1}}) {
        for (uint32_t number = 0; number < count; ++number) {
            if (gone[number] != wanted) continue;
            const uint32_t index = info.triangles.first + next;
            meshes.triangle[index] = triangle[number], meshes.uv[index] = uv[number], meshes.triangle_material[index] = material[number];
            tears.order[tear.order.first + next++] = number;
        }
        if (wanted == 0) info.triangles.count = next;
    }
}

// Whether every edge has two triangles and every vertex one fan of them.
bool is_manifold(const Meshes& made) {
    const MeshInfo& info = made.info[0];
    for (const auto& across : made.neighbour) {
        for (const uint32_t t : across)
            if (t == kNone) return false;
    }
    for (uint32_t v = 0; v < info.vertices.count; ++v) {
        const uint32_t around = made.incident_first[v + 1] - made.incident_first[v];
        if (around == 0) continue;
        const uint32_t start = made.incident[made.incident_first[v]];
        uint32_t seen = 0;
        for (uint32_t t = start; (seen == 0 || t != start) && seen <= around; ++seen) {
            const Triangle& corner = made.triangle[t];
            t = made.neighbour[t][corner[0] == v ? 0 : corner[1] == v ? 1 : 2];
        }
        if (seen != around) return false;
    }
    return true;
}

// Recomputes everything that depends on the triangles, in the prototype's reserved elements.
void rebuild_topology(uint32_t prototype, Admission whole, Meshes& meshes) {
    MeshInfo& info = meshes.info[prototype];
    Mesh mesh;
    mesh.position.assign(meshes.position.begin() + info.vertices.first, meshes.position.begin() + info.vertices.end());
    mesh.triangle.assign(meshes.triangle.begin() + info.triangles.first, meshes.triangle.begin() + info.triangles.end());
    Meshes made;
    add_prototype(made, mesh, whole);
    const auto copy = [](const auto& from, auto& to, uint32_t first) { std::copy(from.begin(), from.end(), to.begin() + first); };
    copy(made.neighbour, meshes.neighbour, info.triangles.first);
    copy(made.triangle_edge, meshes.triangle_edge, info.triangles.first);
    copy(made.edge, meshes.edge, info.edges.first);
    copy(made.edge_triangle, meshes.edge_triangle, info.edges.first);
    copy(made.incident, meshes.incident, info.incident.first);
    copy(made.incident_first, meshes.incident_first, info.vertices.first + prototype);
    copy(made.component, meshes.component, info.vertices.first);
    // a vertex without triangles belongs to no piece: it takes part in tests with the first
    for (uint32_t v = info.vertices.first; v < info.vertices.end(); ++v) {
        if (meshes.component[v] == kNone) meshes.component[v] = 0;
    }
    const MeshInfo& now = made.info[0];
    info.edges.count = now.edges.count;
    info.incident.count = now.incident.count;
    info.components = now.components;
    info.volume = now.volume, info.area = now.area, info.mean_edge = now.mean_edge, info.max_edge = now.max_edge;
    info.admission = whole == Admission::kSolid && !is_manifold(made) ? Admission::kWinding : whole;
}

// Whether the prototype's triangles match those that torn leaves.
bool is_up_to_date(const Tears& tears, const TearBody& tear, const MeshInfo& info, std::span<const uint8_t> gone,
                   std::span<const Triangle> corner, const Meshes& meshes) {
    for (uint32_t i = 0; i < tear.order.count; ++i) {
        const uint32_t number = tears.order[tear.order.first + i];
        if ((i >= info.triangles.count) != (gone[number] != 0)) return false;
        if (!corner.empty() && !gone[number] && meshes.triangle[info.triangles.first + i] != corner[number]) return false;
    }
    return true;
}

// Rebuilds surface and tree of a body that tears from the remaining triangles.
void lay_surface(const Bodies& bodies, const Particles& particles, std::span<const uint8_t> gone, std::span<const Triangle> corner,
                 const TearBody& tear, Tears& tears, Meshes& meshes, std::span<std::unique_ptr<ClosestPointTree>> trees) {
    const uint32_t prototype = bodies.mesh[tear.body];
    sort_triangles(gone, tear, corner, meshes.info[prototype], tears, meshes);
    rebuild_topology(prototype, tear.whole, meshes);
    const Range range = bodies.particles[tear.body];
    std::unique_ptr<ClosestPointTree>& tree = trees[bodies.tree[tear.body]];
    tree = std::make_unique<ClosestPointTree>(mesh_view(meshes, prototype), std::span(particles.offset).subspan(range.first, range.count),
                                              nullptr, tree->search());
}

// Removes the mass of tetrahedra lost since the last pass. Returns whether any tetrahedron is lost at all.
bool settle_solid(const TearPass& pass, const TearBody& tear, Particles& particles, TearState state) {
    const std::span<const uint8_t> lost = lost_tetrahedra(pass.solids, pass.bodies, tear, state.torn);
    if (std::all_of(lost.begin(), lost.end(), [](uint8_t state) { return state == 0; })) return false;
    state.energy.work_links -=
        lose_mass(pass.solids, pass.bodies, pass.poses, pass.anchors, pass.gravity, tear.body, state.torn, particles);
    return true;
}

}  // namespace

void remove_triangles(const Tears& tears, uint32_t tear, std::span<const uint32_t> triangle, Torn& torn) {
    std::vector<uint8_t> gone = removed_flags(tears, tear, torn);
    size_t left = static_cast<size_t>(std::count(gone.begin(), gone.end(), uint8_t{0}));
    for (const uint32_t t : triangle) {
        if (t >= gone.size() || gone[t] || left == 1) continue;
        gone[t] = 1;
        --left;
        torn.triangle.push_back({tear, t});
    }
}

void remove_tetrahedra(const TearPass& pass, const Particles& particles, const Tears& tears, uint32_t tear,
                       std::span<const uint32_t> tetrahedron, TearState state) {
    const uint32_t body = tears.body[tear].body;
    state.energy.work_links -= drop_tetrahedra(pass.springs, pass.solids, pass.bodies, body, tetrahedron,
                                               positions_of_nodes(pass.solids, pass.bodies, particles, body), state.torn,
                                               state.torn_springs, state.report.broken_springs);
}

namespace {

// Fans of the triangles around a vertex that are not taken; those that share an edge with it are of one fan. Takes all but the largest
// one, of equal ones the one with the first triangle. Returns whether it took any.
bool leave_one_fan(const Meshes& meshes, const MeshInfo& info, std::span<const uint32_t> around, std::vector<uint8_t>& taken) {
    std::vector<uint32_t> left;
    for (const uint32_t t : around)
        if (!taken[t]) left.push_back(t);
    std::vector<std::vector<uint32_t>> fans;
    std::vector<uint8_t> seen(left.size(), 0);
    for (size_t start = 0; start < left.size(); ++start) {
        if (seen[start]) continue;
        std::vector<uint32_t> fan{left[start]};
        seen[start] = 1;
        for (size_t at = 0; at < fan.size(); ++at)
            for (const uint32_t next : meshes.neighbour[info.triangles.first + fan[at]])
                for (size_t k = 0; k < left.size(); ++k)
                    if (left[k] == next && !seen[k]) seen[k] = 1, fan.push_back(next);
        fans.push_back(fan);
    }
    if (fans.size() < 2) return false;
    const auto largest = std::max_element(fans.begin(), fans.end(), [](const auto& a, const auto& b) { return a.size() < b.size(); });
    for (auto fan = fans.begin(); fan != fans.end(); ++fan)
        if (fan != largest)
            for (const uint32_t t : *fan) taken[t] = 1;
    return true;
}

// Numbers at load of the present triangles of a shell that have boiled away, and of those that would hang by a vertex alone.
std::vector<uint32_t> boiled_triangles(const Meshes& meshes, uint32_t prototype, const Tears& tears, uint32_t tear,
                                       std::span<const uint8_t> boiled) {
    const MeshInfo& info = meshes.info[prototype];
    std::vector<uint8_t> taken(info.triangles.count, 0);
    std::vector<uint32_t> vertex, number;
    for (uint32_t t = 0; t < info.triangles.count; ++t) {
        const Triangle& corner = meshes.triangle[info.triangles.first + t];
        if (!boiled[corner[0]] || !boiled[corner[1]] || !boiled[corner[2]]) continue;
        taken[t] = 1;
        vertex.insert(vertex.end(), corner.begin(), corner.end());
    }
    for (size_t i = 0; i < vertex.size(); ++i) {
        const uint32_t* first = meshes.incident_first.data() + info.vertices.first + prototype + vertex[i];
        const auto around = std::span(meshes.incident).subspan(info.incident.first + first[0], first[1] - first[0]);
        const std::vector<uint8_t> before = taken;
        if (!leave_one_fan(meshes, info, around, taken)) continue;
        for (const uint32_t t : around)
            if (taken[t] && !before[t]) {
                const Triangle& corner = meshes.triangle[info.triangles.first + t];
                vertex.insert(vertex.end(), corner.begin(), corner.end());
            }
    }
    for (uint32_t t = 0; t < info.triangles.count; ++t)
        if (taken[t]) number.push_back(at_load(tears, tear, t));
    return number;
}

}  // namespace

void part_what_boiled(const TearPass& pass, const Actions& actions, const HeatState& heat, const Particles& particles,
                      const Meshes& meshes, const Tears& tears, TearState state) {
    for (const HeatBody& body : actions.heat_body) {
        if (!body.parts) continue;
        std::vector<uint8_t> boiled(body.nodes.count);
        for (uint32_t v = 0; v < body.nodes.count; ++v) boiled[v] = has_boiled_away(body, actions, heat, v);
        if (std::count(boiled.begin(), boiled.end(), uint8_t{1}) < 3) continue;
        const auto of = std::find_if(tears.body.begin(), tears.body.end(), [&](const TearBody& t) { return t.body == body.body; });
        if (of == tears.body.end()) continue;
        const auto tear = static_cast<uint32_t>(of - tears.body.begin());
        const uint32_t prototype = pass.bodies.mesh[body.body];
        if (!tears_as_solid(*of)) {
            std::vector<uint32_t> taken = boiled_triangles(meshes, prototype, tears, tear, boiled);
            std::sort(taken.begin(), taken.end());
            remove_triangles(tears, tear, taken, state.torn);
            continue;
        }
        const SolidInfo& info = pass.solids.info[prototype];
        std::vector<uint32_t> taken;
        for (uint32_t t = 0; t < info.count; ++t) {
            const auto is_boiled = [&](const auto& corner) { return boiled[corner[info.tetrahedra.first + t]] != 0; };
            if (!state.torn.tetrahedron[info.tetrahedra.first + t] && std::ranges::all_of(pass.solids.corner, is_boiled)) taken.push_back(t);
        }
        if (taken.empty()) continue;
        copy_torn_springs(pass.springs, pass.solids, pass.bodies, tears, state.torn, state.torn_springs);
        remove_tetrahedra(pass, particles, tears, tear, taken, state);
    }
}

void restore_torn_surfaces(const Solids& solids, const Bodies& bodies, const Particles& particles, const Torn& torn, Meshes& meshes,
                           std::span<std::unique_ptr<ClosestPointTree>> trees, Tears& tears) {
    for (uint32_t t = 0; t < tears.body.size(); ++t) {
        const TearBody& tear = tears.body[t];
        std::vector<Triangle> corner;
        std::vector<uint8_t> gone;
        if (tears_as_solid(tear)) {
            const std::span<const uint8_t> lost = lost_tetrahedra(solids, bodies, tear, torn);
            std::vector<uint8_t> open(lost.size());
            std::transform(lost.begin(), lost.end(), open.begin(), [](uint8_t state) { return uint8_t{state == 2}; });
            gone = hidden_flags(tears, tear, open, corner);
        } else {
            gone = removed_flags(tears, t, torn);
        }
        if (is_up_to_date(tears, tear, meshes.info[bodies.mesh[tear.body]], gone, corner, meshes)) continue;
        lay_surface(bodies, particles, gone, corner, tear, tears, meshes, trees);
    }
}

void cut_bodies(const TearPass& pass, Particles& particles, Meshes& meshes, std::span<std::unique_ptr<ClosestPointTree>> trees,
                Tears& tears, Sleep& sleep, TearState state) {
    const Bodies& bodies = pass.bodies;
    Torn& torn = state.torn;
    for (size_t c = 0; c < tears.cut.size(); ++c) {
        const Cut& cut = tears.cut[c];
        if (torn.cut[c] || pass.now < cut.time) continue;
        if (tears_as_solid(tears.body[cut.tear])) {
            copy_torn_springs(pass.springs, pass.solids, bodies, tears, torn, state.torn_springs);
            cut_torn_solid(pass, cut, meshes, tears, particles, state);
        } else {
            mark_cut(cut, tears, bodies, meshes, torn);
        }
        torn.cut[c] = 1;
    }
    for (uint32_t t = 0; t < tears.body.size(); ++t) {
        const TearBody& tear = tears.body[t];
        const uint32_t body = tear.body, prototype = bodies.mesh[body];
        MeshInfo& info = meshes.info[prototype];
        const bool solid = tears_as_solid(tear);
        const auto of_this = [t](const std::array<uint32_t, 2>& lost) { return lost[0] == t; };
        const bool untouched =
            solid ? !settle_solid(pass, tear, particles, state) : std::none_of(torn.triangle.begin(), torn.triangle.end(), of_this);
        if (untouched && info.triangles.count == (solid ? tear.outer : tear.order.count)) continue;
        std::vector<Triangle> corner;
        const std::vector<uint8_t> gone =
            solid ? hidden_flags(tears, tear, lost_tetrahedra(pass.solids, bodies, tear, torn), corner) : removed_flags(tears, t, torn);
        if (is_up_to_date(tears, tear, info, gone, corner, meshes)) continue;
        const Admission before = info.admission;
        if (!solid) break_bare_edges(pass, particles, meshes, tears, t, gone, state);
        lay_surface(bodies, particles, gone, corner, tear, tears, meshes, trees);
        if (before == Admission::kSolid && info.admission == Admission::kWinding) ++state.report.opened_bodies;
        if (body < sleep.still.size()) sleep.still[body] = 0;
    }
    state.report.removed_triangles = torn.triangle.size();
    state.report.removed_tetrahedra = static_cast<uint64_t>(torn.tetrahedron.size()) -
                                      static_cast<uint64_t>(std::count(torn.tetrahedron.begin(), torn.tetrahedron.end(), uint8_t{0}));
}

namespace {

// Springs of a shell without the broken ones.
void copy_torn_shell(const Springs& springs, uint32_t prototype, const Torn& torn, TornSprings& out) {
    const Range slices = springs.info[prototype].slices;
    const uint32_t* column = springs.slice_column.data() + slices.first + prototype;
    for (uint32_t slice = 0; slice < slices.count; ++slice) {
        for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
            out.neighbour[h] = torn.spring[h] ? slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth) : springs.neighbour[h];
            out.rest_length[h] = torn.spring[h] ? 0.0f : springs.rest_length[h];
        }
    }
}

}  // namespace

void copy_torn_springs(const Springs& springs, const Solids& solids, const Bodies& bodies, const Tears& tears, const Torn& torn,
                       TornSprings& torn_springs) {
    const size_t range = torn.spring.size();
    if (torn_springs.neighbour.size() != range) {
        torn_springs.neighbour.assign(springs.neighbour.begin(), springs.neighbour.begin() + range);
        torn_springs.rest_length.assign(springs.rest_length.begin(), springs.rest_length.begin() + range);
        torn_springs.factor.clear(), torn_springs.rest.clear(), torn_springs.per_rest.clear();
    }
    for (const TearBody& tear : tears.body) {
        const uint32_t prototype = bodies.mesh[tear.body];
        if (tears_as_solid(tear)) {
            copy_torn_solid(springs, solids, prototype, torn, torn_springs);
        } else {
            copy_torn_shell(springs, prototype, torn, torn_springs);
        }
    }
}

}  // namespace trocar
