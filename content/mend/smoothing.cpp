#include "content/mend/smoothing.hpp"

#include <algorithm>
#include <vector>
namespace trocar {
namespace {

// Moves every vertex by the fraction `weight` towards the mean of its neighbours.
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

Vec3d cross(const Vec3d& a, const Vec3d& b) {
    return {a.y() * b.z() - a.z() * b.y(), a.z() * b.x() - a.x() * b.z(), a.x() * b.y() - a.y() * b.x()};
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

double restore_volume(double volume, std::span<const Triangle> triangles, std::span<Vec3d> position) {
    if (triangles.empty()) return 0;
    std::vector<Vec3d> gradient(position.size());
    double moved = 0;
    for (int i = 0; i < 3; ++i) {
        std::fill(gradient.begin(), gradient.end(), Vec3d::Zero());
        const Vec3d base = position[triangles[0][0]];
        double enclosed = 0;
        for (const Triangle& t : triangles) {
            const Vec3d a = position[t[0]] - base, b = position[t[1]] - base, c = position[t[2]] - base;
            const Vec3d area = cross(b - a, c - a) / 6;
            enclosed += a.dot(area);
            for (const uint32_t v : t) gradient[v] += area;
        }
        double slope = 0;
        for (const Vec3d& g : gradient) slope += g.norm();
        if (!(slope > 0)) return moved;
        const double distance = (volume - enclosed) / slope;
        for (size_t v = 0; v < position.size(); ++v) {
            const double size = gradient[v].norm();
            if (size > 0) position[v] += gradient[v] * (distance / size);
        }
        moved += distance;
    }
    return moved;
}

}  // namespace trocar
