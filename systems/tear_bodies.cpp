#include "systems/tear_bodies.hpp"

#include <algorithm>
#include <array>

#include "engine/mesh_topology.hpp"
#include "engine/mesh_view.hpp"
#include "engine/region.hpp"
namespace trocar {
namespace {

// One bit per triangle at load: removed.
std::vector<uint8_t> removed_flags(const Tears& tears, uint32_t tear, const Torn& torn) {
    std::vector<uint8_t> gone(tears.body[tear].order.count, 0);
    for (const auto& [t, triangle] : torn.triangle) {
        if (t == tear) gone[triangle] = 1;
    }
    return gone;
}

// Number at load of a triangle of the prototype as it lies now.
uint32_t at_load(const Tears& tears, uint32_t tear, uint32_t triangle) { return tears.order[tears.body[tear].order.first + triangle]; }

// Notes the triangles that a cut takes.
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

// Half-edge row from one vertex to another, kNone if no spring joins them.
uint32_t half_edge(const Springs& springs, uint32_t prototype, uint32_t from, uint32_t to) {
    const uint32_t* column = springs.slice_column.data() + springs.info[prototype].slices.first + prototype + from / kSliceWidth;
    for (uint32_t c = column[0]; c < column[1]; ++c) {
        const uint32_t row = c * kSliceWidth + from % kSliceWidth;
        if (springs.neighbour[row] == to) return row;
    }
    return kNone;
}

// Energy of a spring at the time of the velocities, J.
double spring_energy(const Springs& springs, const Bodies& bodies, const Particles& p, uint32_t body, uint32_t row, uint32_t from, uint32_t to) {
    const double back = 0.5 * p.last_dt[body];
    const auto place = [&](uint32_t v) {
        const uint32_t i = bodies.particles[body].first + v;
        return Vec3d(p.offset[i].x - back * p.velocity_x[i], p.offset[i].y - back * p.velocity_y[i], p.offset[i].z - back * p.velocity_z[i]);
    };
    const double stretch = (place(to) - place(from)).norm() - double{springs.rest_length[row]};
    const double factor = springs.info[bodies.mesh[body]].varied ? double{springs.factor[row]} : 1.0;
    return 0.5 * double{bodies.spring_stiffness[body]} * factor * stretch * stretch;
}

// Breaks the springs along edges that are about to lose their last triangle.
void break_bare_edges(const Springs& springs, const Bodies& bodies, const Particles& particles, const Meshes& meshes, const Tears& tears,
                      uint32_t tear, std::span<const uint8_t> gone, Torn& torn, Energy& energy, Report& report) {
    const uint32_t body = tears.body[tear].body, prototype = bodies.mesh[body];
    const MeshInfo& info = meshes.info[prototype];
    for (uint32_t e = info.edges.first; e < info.edges.end(); ++e) {
        const auto is_gone = [&](uint32_t t) { return t == kNone || gone[at_load(tears, tear, t)]; };
        if (!is_gone(meshes.edge_triangle[e][0]) || !is_gone(meshes.edge_triangle[e][1])) continue;
        const auto [from, to] = meshes.edge[e];
        const uint32_t row = half_edge(springs, prototype, from, to), back = half_edge(springs, prototype, to, from);
        if (row == kNone || back == kNone || torn.spring[row]) continue;
        energy.work_links -= spring_energy(springs, bodies, particles, body, row, from, to);
        torn.spring[row] = torn.spring[back] = 1;
        ++report.broken_springs;
    }
}

// Puts the triangles that are left first, in their order at load, and the removed ones behind them.
void sort_triangles(std::span<const uint8_t> gone, const TearBody& tear, MeshInfo& info, Tears& tears, Meshes& meshes) {
    const uint32_t count = tear.order.count;
    std::vector<Triangle> triangle(count);
    std::vector<std::array<Vec2, 3>> uv(count);
    std::vector<uint16_t> material(count);
    for (uint32_t i = 0; i < count; ++i) {
        const uint32_t row = info.triangles.first + i, number = tears.order[tear.order.first + i];
        triangle[number] = meshes.triangle[row], uv[number] = meshes.uv[row], material[number] = meshes.triangle_material[row];
    }
    uint32_t next = 0;
    for (const uint8_t wanted : {uint8_t{0}, uint8_t{1}}) {
        for (uint32_t number = 0; number < count; ++number) {
            if (gone[number] != wanted) continue;
            const uint32_t row = info.triangles.first + next;
            meshes.triangle[row] = triangle[number], meshes.uv[row] = uv[number], meshes.triangle_material[row] = material[number];
            tears.order[tear.order.first + next++] = number;
        }
        if (wanted == 0) info.triangles.count = next;
    }
}

// Works out anew what follows from the triangles, in the rows the prototype has.
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
    // a vertex without triangles is of no piece: it asks with the first
    for (uint32_t v = info.vertices.first; v < info.vertices.end(); ++v) {
        if (meshes.component[v] == kNone) meshes.component[v] = 0;
    }
    const MeshInfo& now = made.info[0];
    info.edges.count = now.edges.count;
    info.incident.count = now.incident.count;
    info.components = now.components;
    info.volume = now.volume, info.area = now.area, info.mean_edge = now.mean_edge, info.max_edge = now.max_edge;
    const bool open = std::any_of(made.edge_triangle.begin(), made.edge_triangle.end(), [](const auto& t) { return t[1] == kNone; });
    info.admission = whole == Admission::kSolid && open ? Admission::kWinding : whole;
}

// Whether the prototype's triangles are those that torn.triangle leaves.
bool is_up_to_date(const Tears& tears, uint32_t tear, uint32_t left, std::span<const uint8_t> gone) {
    const Range order = tears.body[tear].order;
    for (uint32_t i = 0; i < order.count; ++i) {
        if ((i >= left) != (gone[tears.order[order.first + i]] != 0)) return false;
    }
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

void cut_bodies(double now, const Springs& springs, const Bodies& bodies, const Particles& particles, Meshes& meshes,
                std::span<std::unique_ptr<ClosestPointTree>> trees, Tears& tears, Torn& torn, Sleep& sleep, Energy& energy,
                Report& report) {
    for (size_t c = 0; c < tears.cut.size(); ++c) {
        if (torn.cut[c] || now < tears.cut[c].time) continue;
        mark_cut(tears.cut[c], tears, bodies, meshes, torn);
        torn.cut[c] = 1;
    }
    for (uint32_t t = 0; t < tears.body.size(); ++t) {
        const uint32_t body = tears.body[t].body, prototype = bodies.mesh[body];
        MeshInfo& info = meshes.info[prototype];
        if (torn.triangle.empty() && info.triangles.count == tears.body[t].order.count) continue;
        const std::vector<uint8_t> gone = removed_flags(tears, t, torn);
        if (is_up_to_date(tears, t, info.triangles.count, gone)) continue;
        const Admission before = info.admission;
        break_bare_edges(springs, bodies, particles, meshes, tears, t, gone, torn, energy, report);
        sort_triangles(gone, tears.body[t], info, tears, meshes);
        rebuild_topology(prototype, tears.body[t].whole, meshes);
        if (before == Admission::kSolid && info.admission == Admission::kWinding) ++report.opened_bodies;
        if (body < sleep.still.size()) sleep.still[body] = 0;
        const Range rows = bodies.particles[body];
        trees[bodies.tree[body]] = std::make_unique<ClosestPointTree>(mesh_view(meshes, prototype), std::span(particles.offset).subspan(rows.first, rows.count));
    }
    report.removed_triangles = torn.triangle.size();
}

void copy_torn_springs(const Springs& springs, const Torn& torn, TornSprings& torn_springs) {
    const size_t rows = torn.spring.size();
    torn_springs.neighbour.resize(rows);
    torn_springs.rest_length.resize(rows);
    std::copy_n(springs.neighbour.begin(), rows, torn_springs.neighbour.begin());
    std::copy_n(springs.rest_length.begin(), rows, torn_springs.rest_length.begin());
    for (uint32_t prototype = 0; prototype < springs.info.size(); ++prototype) {
        const Range slices = springs.info[prototype].slices;
        const uint32_t* column = springs.slice_column.data() + slices.first + prototype;
        if (slices.count == 0 || size_t{column[slices.count]} * kSliceWidth > rows) continue;
        for (uint32_t slice = 0; slice < slices.count; ++slice) {
            for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
                if (!torn.spring[h]) continue;
                torn_springs.neighbour[h] = slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth);
                torn_springs.rest_length[h] = 0;
            }
        }
    }
}

}  // namespace trocar
