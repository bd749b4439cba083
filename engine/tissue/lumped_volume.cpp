#include "engine/tissue/lumped_volume.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>

#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

using Edge = std::array<uint32_t, 2>;

std::vector<Edge> edges_of(std::span<const std::array<uint32_t, 4>> tetrahedra) {
    std::vector<Edge> edge;
    for (const auto& t : tetrahedra) {
        for (int i = 0; i < 4; ++i) {
            for (int j = i + 1; j < 4; ++j) edge.push_back({std::min(t[i], t[j]), std::max(t[i], t[j])});
        }
    }
    std::sort(edge.begin(), edge.end());
    edge.erase(std::unique(edge.begin(), edge.end()), edge.end());
    return edge;
}

// One round: nodes with too little volume take from neighbours with a surplus, in proportion to it; no node
// gives more than its surplus.
void even_once(std::span<const Edge> edge, std::span<const double> need, std::vector<double>& volume) {
    const size_t nodes = volume.size();
    std::vector<double> offered(nodes, 0.0), asked(nodes, 0.0), change(nodes, 0.0);
    const auto spare = [&](uint32_t v) { return std::max(volume[v] - need[v], 0.0); };
    const auto lack = [&](uint32_t v) { return std::max(need[v] - volume[v], 0.0); };
    const auto both_ways = [&](const auto& visit) {
        for (const auto& [a, b] : edge) visit(a, b), visit(b, a);
    };
    both_ways([&](uint32_t to, uint32_t from) { offered[to] += lack(to) > 0 ? spare(from) : 0.0; });
    const auto request = [&](uint32_t to, uint32_t from) { return offered[to] > 0 ? lack(to) * spare(from) / offered[to] : 0.0; };
    both_ways([&](uint32_t to, uint32_t from) { asked[from] += request(to, from); });
    both_ways([&](uint32_t to, uint32_t from) {
        const double given = asked[from] > 0 ? request(to, from) * std::min(1.0, spare(from) / asked[from]) : 0.0;
        change[to] += given;
        change[from] -= given;
    });
    for (size_t v = 0; v < nodes; ++v) volume[v] += change[v];
}

}  // namespace

std::vector<double> quarter_volumes(std::span<const Vec3d> node, std::span<const std::array<uint32_t, 4>> tetrahedra) {
    std::vector<double> volume(node.size(), 0.0);
    for (const auto& t : tetrahedra) {
        for (const uint32_t v : t) volume[v] += six_volumes(node[t[0]], node[t[1]], node[t[2]], node[t[3]]) / 24;
    }
    return volume;
}

std::vector<double> lumped_volume(std::span<const Vec3d> node, std::span<const std::array<uint32_t, 4>> tetrahedra) {
    std::vector<double> volume = quarter_volumes(node, tetrahedra), need(node.size(), 0.0);
    for (const auto& t : tetrahedra) {
        const double whole = six_volumes(node[t[0]], node[t[1]], node[t[2]], node[t[3]]) / 6;
        for (int k = 0; k < 4; ++k) {
            const Vec3d &a = node[t[(k + 1) % 4]], &b = node[t[(k + 2) % 4]], &c = node[t[(k + 3) % 4]];
            need[t[k]] += (b - a).cross(c - a).squaredNorm() / (36 * whole);  // |g| = face / (3 V)
        }
    }
    const double rate = kEvenRate * std::accumulate(need.begin(), need.end(), 0.0) / std::accumulate(volume.begin(), volume.end(), 0.0);
    for (double& n : need) n /= rate;
    const std::vector<Edge> edge = edges_of(tetrahedra);
    for (int round = 0; round < kEvenRounds; ++round) even_once(edge, need, volume);
    return volume;
}

}  // namespace trocar
