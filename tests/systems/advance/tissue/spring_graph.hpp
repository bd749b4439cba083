#pragma once
#include <algorithm>
#include <array>
#include <vector>

#include "tests/systems/advance/advance_scene.hpp"
namespace trocar {

// Point masses joined by given springs, without triangles: closed forms, chains, tetrahedron edges.
struct SpringGraph {
    std::vector<Vec3d> position;  // m
    std::vector<double> mass;     // kg, 0 = fixed
    std::vector<std::array<uint32_t, 2>> edge;
    double rest = -1;      // m, of every spring; negative: its length at `position`
    double stiffness = 0;  // N/m
};

// Appends the SELL-16 columns of a prototype's springs; columns ascend by neighbour as add_springs makes them.
inline void append_graph_springs(Springs& springs, uint32_t prototype, const SpringGraph& graph) {
    const uint32_t count = static_cast<uint32_t>(graph.position.size()), padded = (count + 15) / 16 * 16;
    std::vector<std::vector<uint32_t>> around(padded);
    for (const auto& [i, j] : graph.edge) around[i].push_back(j), around[j].push_back(i);
    for (auto& list : around) std::sort(list.begin(), list.end());
    const uint32_t first_row = static_cast<uint32_t>(springs.slice_column.size());
    springs.info.push_back({{first_row - prototype, padded / 16}, std::max(graph.rest, 0.0)});
    springs.slice_column.push_back(static_cast<uint32_t>(springs.neighbour.size() / 16));
    for (uint32_t slice = 0; slice < padded / 16; ++slice) {
        size_t columns = 0;
        for (uint32_t lane = 0; lane < 16; ++lane) columns = std::max(columns, around[16 * slice + lane].size());
        for (size_t c = 0; c < columns; ++c) {
            for (uint32_t lane = 0; lane < 16; ++lane) {
                const uint32_t v = 16 * slice + lane;
                const bool real = c < around[v].size();
                const uint32_t far_end = real ? around[v][c] : v;
                springs.neighbour.push_back(far_end);
                const double rest = !real ? 0 : graph.rest >= 0 ? graph.rest : (graph.position[v] - graph.position[far_end]).norm();
                springs.rest_length.push_back(static_cast<float>(rest));
            }
        }
        springs.slice_column.push_back(static_cast<uint32_t>(springs.neighbour.size() / 16));
    }
    springs.vertices.push_back({static_cast<uint32_t>(springs.area_share.size()), padded});
    springs.area_share.resize(springs.area_share.size() + padded, 0.0f);
    pack_springs(springs, prototype);
}

// Adds the graph as a deformable body without anchors, damping or triangles.
inline uint32_t add_graph(AdvanceScene& s, const SpringGraph& graph) {
    Mesh mesh;
    mesh.position = graph.position;
    const uint32_t prototype = add_prototype(s.meshes, mesh, Admission::kRefused);
    append_graph_springs(s.springs, prototype, graph);
    const uint32_t count = static_cast<uint32_t>(graph.position.size()), padded = (count + 15) / 16 * 16;
    const uint32_t body = s.add_body(prototype, Motion::kStatic);
    s.bodies.motion[body] = Motion::kDeformable;
    s.bodies.tissue[body].damping = 0;
    s.bodies.spring_stiffness[body] = static_cast<float>(graph.stiffness);
    s.bodies.particles[body] = {static_cast<uint32_t>(s.particles.offset.size()), padded};
    for (auto* field : {&s.particles.velocity_x, &s.particles.velocity_y, &s.particles.velocity_z, &s.anchors.stiffness, &s.anchors.rest_x,
                        &s.anchors.rest_y, &s.anchors.rest_z}) {
        field->resize(s.particles.offset.size() + padded, 0.0f);
    }
    s.particles.last_dt.resize(body + 1, 0.0);
    for (uint32_t v = 0; v < padded; ++v) {
        const Vec3d p = v < count ? graph.position[v] : Vec3d::Zero();
        const float w = v < count && graph.mass[v] > 0 ? static_cast<float>(1 / graph.mass[v]) : 0.0f;
        s.particles.offset.push_back({static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), w});
    }
    update_stable_dt(s.springs, body, s.particles, s.anchors, s.bodies);
    return body;
}

// Edges of n x n masses over a square sheet: both axes and one diagonal.
inline SpringGraph sheet_graph(uint32_t n, double size, double mass, double stiffness) {
    SpringGraph g;
    const double h = size / (n - 1);
    const auto id = [n](uint32_t i, uint32_t j) { return j * n + i; };
    for (uint32_t j = 0; j < n; ++j) {
        for (uint32_t i = 0; i < n; ++i) {
            g.position.push_back({i * h, 0, -(j * h)});
            g.mass.push_back(j == 0 ? 0.0 : mass / (n * n));
            if (i + 1 < n) g.edge.push_back({id(i, j), id(i + 1, j)});
            if (j + 1 < n) g.edge.push_back({id(i, j), id(i, j + 1)});
            if (i + 1 < n && j + 1 < n) g.edge.push_back({id(i, j), id(i + 1, j + 1)});
        }
    }
    g.stiffness = stiffness;
    return g;
}

// Edges of the six Kuhn tetrahedra of every cell of a cube; masses of the top layer are fixed.
inline SpringGraph block_graph(uint32_t cells, double size, double mass, double stiffness) {
    SpringGraph g;
    const uint32_t n = cells + 1;
    const double h = size / cells;
    const auto id = [n](uint32_t i, uint32_t j, uint32_t k) { return (k * n + j) * n + i; };
    for (uint32_t k = 0; k < n; ++k) {
        for (uint32_t j = 0; j < n; ++j) {
            for (uint32_t i = 0; i < n; ++i) {
                g.position.push_back({(i - 0.5 * cells) * h, (j - 0.5 * cells) * h, (k - 0.5 * cells) * h});
                g.mass.push_back(k == cells ? 0.0 : mass / (n * n * n));
                // a Kuhn tetrahedron's edges step from corner to corner in any of seven directions
                for (uint32_t corner = 1; corner < 8; ++corner) {
                    const uint32_t a = i + (corner & 1), b = j + (corner >> 1 & 1), c = k + (corner >> 2);
                    if (a < n && b < n && c < n) g.edge.push_back({id(i, j, k), id(a, b, c)});
                }
            }
        }
    }
    g.stiffness = stiffness;
    return g;
}

inline reference::DoubleBody double_copy(const AdvanceScene& s, uint32_t body, const SpringGraph& graph) {
    reference::DoubleBody b = double_copy(s, body);
    b.spring = graph.edge;
    b.rest_length.clear();
    for (const auto& [i, j] : graph.edge) {
        b.rest_length.push_back(graph.rest >= 0 ? graph.rest : (graph.position[i] - graph.position[j]).norm());
    }
    // the reference has the body's lengths
    const SpringInfo& info = s.springs.info[s.bodies.mesh[body]];
    if (info.packed == kNone) return b;
    for (double& rest : b.rest_length) rest = static_cast<float>(std::lround(rest / info.rest_unit)) * info.rest_unit;
    return b;
}

}  // namespace trocar
