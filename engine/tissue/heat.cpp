#include "engine/tissue/heat.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "engine/mesh/mesh_view.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/links.hpp"
namespace trocar {
namespace {

constexpr double kBoiling = 100;          // degrees Celsius
constexpr double kVaporisation = 2.257e6;  // J/kg, of water
// Below, tissue repairs what heat does (the break of thermal doses: Sapareto, Dewey, Int. J. Radiat. Oncol. 10, 1984).
constexpr double kRepair = 43;           // degrees Celsius
constexpr double kGas = 8.314462618;     // J/(mol K)
constexpr double kZeroCelsius = 273.15;  // K

// Capacities and conductances of a body while they are added up.
struct HeatSums {
    std::vector<double> volume, area;
    std::map<std::array<uint32_t, 2>, double> conductance;  // of pairs, the lower index first

    void join(uint32_t a, uint32_t b, double conductance_of_pair) { conductance[{std::min(a, b), std::max(a, b)}] += conductance_of_pair; }
};

// -grad phi_i . grad phi_j V k between all corners of a tetrahedron.
void add_tetrahedron(const std::array<uint32_t, 4>& node, const std::array<Vec3d, 4>& x, double conductivity, HeatSums& sums) {
    const double volume = (x[1] - x[0]).cross(x[2] - x[0]).dot(x[3] - x[0]) / 6;
    if (!(std::abs(volume) > 0)) return;
    std::array<Vec3d, 4> gradient;  // times 6 V
    for (int i = 0; i < 4; ++i) {
        const Vec3d &a = x[(i + 1) % 4], &b = x[(i + 2) % 4], &c = x[(i + 3) % 4];
        gradient[i] = (i % 2 == 0 ? -1.0 : 1.0) * (b - a).cross(c - a);
    }
    for (int i = 0; i < 4; ++i) {
        sums.volume[node[i]] += 0.25 * std::abs(volume);
        for (int j = 0; j < i; ++j) sums.join(node[i], node[j], -conductivity * gradient[i].dot(gradient[j]) / (36 * std::abs(volume)));
    }
}

// Half the cotangents of the opposite angles, times the wall.
void add_triangle(const Triangle& t, const std::array<Vec3d, 3>& x, double conductivity, double wall, HeatSums& sums) {
    const double twice = (x[1] - x[0]).cross(x[2] - x[0]).norm();
    if (!(twice > 0)) return;
    for (int i = 0; i < 3; ++i) {
        sums.volume[t[i]] += twice / 6 * wall;
        const Vec3d a = x[(i + 1) % 3] - x[i], b = x[(i + 2) % 3] - x[i];
        sums.join(t[(i + 1) % 3], t[(i + 2) % 3], 0.5 * conductivity * wall * a.dot(b) / twice);
    }
}

HeatSums sum_body(double conductivity, double wall, uint32_t prototype, const Meshes& meshes, const Solids& solids) {
    HeatSums sums;
    const uint32_t nodes = count_nodes(meshes, solids, prototype);
    sums.volume.assign(nodes, 0.0), sums.area.assign(nodes, 0.0);
    const MeshView mesh = mesh_view(meshes, prototype);
    const bool solid = prototype < solids.info.size() && solids.info[prototype].count > 0;
    const auto place = [&](uint32_t node) { return rest_of_node(meshes, solids, prototype, node); };
    const Range skin = solid ? solids.info[prototype].skin : Range{};
    for (const Triangle& t : mesh.triangle) {
        const std::array<Vec3d, 3> x{mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]};
        const double third = (x[1] - x[0]).cross(x[2] - x[0]).norm() / 6;
        for (const uint32_t v : t) {
            if (skin.count == 0) {
                sums.area[v] += third;
                continue;
            }
            const auto& node = solids.embedding_node[skin.first + v];
            const auto& weight = solids.embedding_weight[skin.first + v];
            double inside = 0;  // of weights that are not negative
            for (const double w : weight) inside += std::max(0.0, w);
            for (int c = 0; c < 4; ++c) sums.area[node[c]] += third * std::max(0.0, weight[c]) / inside;
        }
        if (!solid) add_triangle(t, x, conductivity, wall, sums);
    }
    for (uint32_t i = 0; solid && i < solids.info[prototype].count; ++i) {
        std::array<uint32_t, 4> node;
        std::array<Vec3d, 4> x;
        for (int c = 0; c < 4; ++c) node[c] = solids.corner[c][solids.info[prototype].tetrahedra.first + i], x[c] = place(node[c]);
        add_tetrahedron(node, x, conductivity, sums);
    }
    return sums;
}

}  // namespace

namespace {

void put_sums(const HeatSums& sums, HeatBody& heat, Actions& actions) {
    std::copy(sums.volume.begin(), sums.volume.end(), actions.heat_volume.begin() + heat.nodes.first);
    std::copy(sums.area.begin(), sums.area.end(), actions.heat_area.begin() + heat.nodes.first);
    std::vector<double> leaves(sums.volume.size(), 0.0);  // W/K
    std::fill_n(actions.heat_edge.begin() + heat.edges.first, heat.edges.count, HeatEdge{});
    HeatEdge* edge = actions.heat_edge.data() + heat.edges.first;
    for (const auto& [pair, conductance] : sums.conductance) {
        *edge++ = {pair[0], pair[1], conductance};
        leaves[pair[0]] += std::abs(conductance), leaves[pair[1]] += std::abs(conductance);
    }
    // explicit Euler with rates of at most 2 leaves / capacity + perfusion / per_volume (Gershgorin) is stable below 2 / rate, and
    // keeps a hot node from undershooting its neighbours at half of that
    heat.stable_dt = std::numeric_limits<double>::infinity();
    for (uint32_t v = 0; v < sums.volume.size(); ++v) {
        const double rate = leaves[v] + sums.volume[v] * heat.perfusion;
        if (rate > 0 && sums.volume[v] > 0) heat.stable_dt = std::min(heat.stable_dt, 0.5 * sums.volume[v] * heat.per_volume / rate);
    }
}

// The columns of a body's springs, reserved ones as well, as a range of their factors.
Range columns_of(const HeatBody& heat, const Bodies& bodies, const Springs& springs, const Actions& actions) {
    const uint32_t prototype = bodies.mesh[heat.body];
    const SpringInfo& info = springs.info[prototype];
    const uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    const uint32_t columns = heat.cut == kNone ? column[info.slices.count] - column[0] : actions.cut_body[heat.cut].columns;
    return {column[0] * kSliceWidth, columns * kSliceWidth};
}

}  // namespace

double damage_rate_at(const HeatBody& body, double celsius) {
    return body.damage_rate * std::exp(-body.damage_energy / (kGas * (celsius + kZeroCelsius)));
}

void add_heat_body(const HeatTissue& tissue, double density, double wall, uint32_t body, uint32_t cut, const Bodies& bodies,
                   const Meshes& meshes, const Solids& solids, Actions& actions, HeatState& state) {
    const HeatSums sums = sum_body(tissue.conductivity, wall, bodies.mesh[body], meshes, solids);
    HeatBody heat;
    heat.body = body, heat.cut = cut;
    heat.conductivity = tissue.conductivity, heat.wall = wall;
    heat.stiffening = tissue.stiffening, heat.boil = tissue.water * density * kVaporisation, heat.parts = tissue.parts;
    const size_t nodes = cut == kNone ? sums.volume.size() : actions.cut_body[cut].vertices.count;
    const size_t edges = cut == kNone ? sums.conductance.size() : actions.cut_body[cut].edges;
    heat.nodes = {static_cast<uint32_t>(actions.heat_volume.size()), static_cast<uint32_t>(nodes)};
    heat.edges = {static_cast<uint32_t>(actions.heat_edge.size()), static_cast<uint32_t>(edges)};
    heat.per_volume = density * tissue.specific_heat;
    heat.perfusion = tissue.perfusion, heat.metabolism = tissue.metabolism;
    heat.damage_rate = tissue.damage_rate, heat.damage_energy = tissue.damage_energy;
    const size_t end = heat.nodes.end();
    actions.heat_volume.resize(end, 0.0), actions.heat_area.resize(end, 0.0), actions.heat_edge.resize(heat.edges.end());
    put_sums(sums, heat, actions);
    actions.heat_body.push_back(heat);
    state.rise.resize(end, heat.perfusion > 0 ? heat.metabolism / heat.perfusion : 0.0);
    state.damage.resize(end, 0.0), state.steam.resize(end, 0.0);
}

void step_heat(const Actions& actions, const HeatBody& body, double seconds, std::span<const double> power, HeatState& state,
               std::vector<double>& flow) {
    const double steps = std::ceil(seconds / body.stable_dt), dt = seconds / std::max(1.0, steps);
    const double most = kBoiling - body.blood;
    double* const rise = state.rise.data() + body.nodes.first;
    for (double step = 0; step < std::max(1.0, steps); ++step) {
        flow.assign(body.nodes.count, 0.0);
        for (uint32_t e = body.edges.first; e < body.edges.end(); ++e) {
            const HeatEdge& edge = actions.heat_edge[e];
            const double watt = edge.conductance * (rise[edge.b] - rise[edge.a]);
            flow[edge.a] += watt, flow[edge.b] -= watt;
        }
        for (uint32_t v = 0; v < body.nodes.count; ++v) {
            const double volume = actions.heat_volume[body.nodes.first + v], capacity = volume * body.per_volume;
            if (!(capacity > 0)) continue;
            // coagulated tissue has no blood flow
            const double blood = state.damage[body.nodes.first + v] >= 1 ? 0.0 : body.perfusion * rise[v];
            rise[v] += dt * (flow[v] + power[v] + volume * (body.metabolism - blood)) / capacity;
            if (rise[v] > most) state.steam[body.nodes.first + v] += capacity * (rise[v] - most), rise[v] = most;
            if (body.blood + rise[v] > kRepair) state.damage[body.nodes.first + v] += dt * damage_rate_at(body, body.blood + rise[v]);
        }
    }
}

void lay_heat(const HeatBody& body, const Bodies& bodies, const Meshes& meshes, const Solids& solids, Actions& actions) {
    const uint32_t row = static_cast<uint32_t>(&body - actions.heat_body.data());
    std::fill_n(actions.heat_volume.begin() + body.nodes.first, body.nodes.count, 0.0);
    std::fill_n(actions.heat_area.begin() + body.nodes.first, body.nodes.count, 0.0);
    put_sums(sum_body(body.conductivity, body.wall, bodies.mesh[body.body], meshes, solids), actions.heat_body[row], actions);
}

void restore_heat(const Bodies& bodies, const Meshes& meshes, const Solids& solids, Actions& actions) {
    for (const HeatBody& body : actions.heat_body)
        if (body.cut != kNone) lay_heat(body, bodies, meshes, solids, actions);
}

void let_stiffen(HeatBody& body, Springs& springs, Solids& solids, Bodies& bodies, Actions& actions) {
    const uint32_t prototype = bodies.mesh[body.body];
    SpringInfo& info = springs.info[prototype];
    const Range columns = columns_of(body, bodies, springs, actions);
    springs.factor.resize(std::max<size_t>(springs.factor.size(), columns.end()), 1.0f);
    info.varied = 1, info.packed = kNone;
    body.springs = {static_cast<uint32_t>(actions.heat_spring.size()), columns.count};
    actions.heat_spring.resize(body.springs.end());
    if (prototype < solids.info.size() && solids.info[prototype].count > 0) {
        SolidInfo& solid = solids.info[prototype];
        solids.factor.resize(std::max<size_t>(solids.factor.size(), solid.tetrahedra.end()), 1.0f);
        solid.varied = 1;
        body.tetrahedra = {static_cast<uint32_t>(actions.heat_tetrahedron.size()), solid.count};
        const auto from = solids.factor.begin() + solid.tetrahedra.first;
        actions.heat_tetrahedron.insert(actions.heat_tetrahedron.end(), from, from + solid.count);
    }
    note_factors(body, bodies, springs, actions);
    bodies.stable_dt[body.body] /= std::sqrt(std::max(1.0, body.stiffening));
}

void note_factors(const HeatBody& body, const Bodies& bodies, const Springs& springs, Actions& actions) {
    if (body.springs.count == 0) return;
    const Range columns = columns_of(body, bodies, springs, actions);
    std::copy_n(springs.factor.begin() + columns.first, columns.count, actions.heat_spring.begin() + body.springs.first);
}

double stiffening_of(const HeatBody& body, double damage) { return 1 - (body.stiffening - 1) * std::expm1(-damage); }

bool stiffen(const HeatBody& body, const Bodies& bodies, const Actions& actions, const HeatState& state, bool only_ask, Springs& springs,
             Solids& solids) {
    if (body.springs.count == 0) return false;
    const uint32_t prototype = bodies.mesh[body.body], first = columns_of(body, bodies, springs, actions).first;
    const SpringInfo& info = springs.info[prototype];
    const uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    std::vector<double> node(body.nodes.count);
    for (uint32_t v = 0; v < body.nodes.count; ++v) node[v] = stiffening_of(body, state.damage[body.nodes.first + v]);
    bool changed = false;
    const auto put = [&](double value, float& factor) {
        const float now = static_cast<float>(value);
        changed = changed || now != factor;
        if (!only_ask) factor = now;
    };
    for (uint32_t slice = 0; slice < info.slices.count; ++slice)
        for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
            const uint32_t from = slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth), to = springs.neighbour[h];
            if (from == to) continue;
            put(0.5 * (node[from] + node[to]) * double{actions.heat_spring[body.springs.first + h - first]}, springs.factor[h]);
        }
    for (uint32_t t = 0; t < body.tetrahedra.count; ++t) {
        const size_t at = size_t{solids.info[prototype].tetrahedra.first} + t;
        double sum = 0;
        for (const auto& corner : solids.corner) sum += 0.25 * node[corner[at]];
        put(sum * double{actions.heat_tetrahedron[body.tetrahedra.first + t]}, solids.factor[at]);
    }
    return changed;
}

bool has_boiled_away(const HeatBody& body, const Actions& actions, const HeatState& state, uint32_t node) {
    const double volume = actions.heat_volume[body.nodes.first + node];
    return volume > 0 && state.steam[body.nodes.first + node] >= body.boil * volume;
}

}  // namespace trocar
