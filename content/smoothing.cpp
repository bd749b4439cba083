#include "content/smoothing.hpp"

#include <algorithm>
#include <vector>
namespace trocar {
namespace {

// Moves every vertex by `weight` of the way to the mean of its neighbours.
void step_to_mean(double weight, std::span<const Triangle> triangles, std::span<Vec3d> sum, std::span<uint32_t> count,
                  std::span<Vec3d> position) {
    std::fill(sum.begin(), sum.end(), Vec3d::Zero());
    for (const Triangle& t : triangles) {
        for (int k = 0; k < 3; ++k) sum[t[k]] += position[t[(k + 1) % 3]] + position[t[(k + 2) % 3]];
    }
    for (size_t v = 0; v < position.size(); ++v) {
        if (count[v] > 0) position[v] += weight * (sum[v] / count[v] - position[v]);
    }
}

}  // namespace

void smooth_taubin(const TaubinParams& params, std::span<const Triangle> triangles, std::span<Vec3d> position) {
    std::vector<Vec3d> sum(position.size());
    std::vector<uint32_t> count(position.size(), 0);
    for (const Triangle& t : triangles) {
        for (const uint32_t v : t) count[v] += 2;
    }
    for (uint32_t i = 0; i < params.rounds; ++i) {
        step_to_mean(params.lambda, triangles, sum, count, position);
        step_to_mean(params.mu, triangles, sum, count, position);
    }
}

}  // namespace trocar
