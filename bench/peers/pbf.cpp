#include "bench/peers/pbf.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace trocar::bench {
namespace {

struct Kernels {
    float h, poly6, spiky;
    explicit Kernels(float support)
        : h(support),
          poly6(315 / (64 * std::numbers::pi_v<float> * std::pow(h, 9.0f))),
          spiky(-45 / (std::numbers::pi_v<float> * std::pow(h, 6.0f))) {}
    float density(float r2) const {
        const float d = h * h - r2;
        return d > 0 ? poly6 * d * d * d : 0;
    }
    // Of the gradient along the separation.
    float slope(float r) const { return r < h ? spiky * (h - r) * (h - r) : 0; }
};

// Density of the rest lattice.
float rest_density(const Kernels& k, float spacing) {
    float sum = 0;
    for (int x = -2; x <= 2; ++x)
        for (int y = -2; y <= 2; ++y)
            for (int z = -2; z <= 2; ++z) sum += k.density(spacing * spacing * static_cast<float>(x * x + y * y + z * z));
    return sum;
}

void find_neighbours(float support, Pbf& f) {
    const size_t n = f.predicted.size();
    Vec3 low = f.predicted[0], high = low;
    for (const Vec3& p : f.predicted) low = low.cwiseMin(p), high = high.cwiseMax(p);
    const Eigen::Array3i size = ((high - low) / support).array().floor().cast<int>() + 1;
    const auto cell_of = [&](const Vec3& p) { return Eigen::Array3i(((p - low) / support).array().floor().cast<int>()); };
    const auto index_of = [&](const Eigen::Array3i& c) { return static_cast<size_t>((c.z() * size.y() + c.y()) * size.x() + c.x()); };
    f.cell_first.assign(static_cast<size_t>(size.x()) * static_cast<size_t>(size.y()) * static_cast<size_t>(size.z()) + 1, 0);
    for (const Vec3& p : f.predicted) ++f.cell_first[index_of(cell_of(p)) + 1];
    for (size_t c = 1; c < f.cell_first.size(); ++c) f.cell_first[c] += f.cell_first[c - 1];
    f.order.resize(n);
    std::vector<uint32_t> next(f.cell_first.begin(), f.cell_first.end() - 1);
    for (uint32_t i = 0; i < n; ++i) f.order[next[index_of(cell_of(f.predicted[i]))]++] = i;
    f.neighbour.clear(), f.first.assign(1, 0);
    for (uint32_t i = 0; i < n; ++i) {
        const Eigen::Array3i c = cell_of(f.predicted[i]), from = (c - 1).max(0), to = (c + 1).min(size - 1);
        for (int z = from.z(); z <= to.z(); ++z)
            for (int y = from.y(); y <= to.y(); ++y)
                for (size_t at = f.cell_first[index_of({from.x(), y, z})]; at < f.cell_first[index_of({to.x(), y, z}) + 1]; ++at) {
                    const uint32_t j = f.order[at];
                    if (j != i && (f.predicted[i] - f.predicted[j]).squaredNorm() < support * support) f.neighbour.push_back(j);
                }
        f.first.push_back(static_cast<uint32_t>(f.neighbour.size()));
    }
}

void solve_once(const Kernels& k, float rest, Pbf& f) {
    const size_t n = f.predicted.size();
    for (size_t i = 0; i < n; ++i) {
        float density = k.density(0), squares = 0;
        Vec3 own = Vec3::Zero();
        for (uint32_t e = f.first[i]; e < f.first[i + 1]; ++e) {
            const Vec3 apart = f.predicted[i] - f.predicted[f.neighbour[e]];
            const float r2 = apart.squaredNorm(), r = std::sqrt(r2) + 1e-9f;
            density += k.density(r2);
            const Vec3 gradient = k.slope(r) / (r * rest) * apart;
            own += gradient, squares += gradient.squaredNorm();
        }
        const float constraint = std::max(density / rest - 1, 0.0f);
        f.lambda[i] = -constraint / (squares + own.squaredNorm() + f.relaxation);
    }
    for (size_t i = 0; i < n; ++i) {
        Vec3 move = Vec3::Zero();
        for (uint32_t e = f.first[i]; e < f.first[i + 1]; ++e) {
            const uint32_t j = f.neighbour[e];
            const Vec3 apart = f.predicted[i] - f.predicted[j];
            const float r = apart.norm() + 1e-9f;
            move += (f.lambda[i] + f.lambda[j]) * k.slope(r) / (r * rest) * apart;
        }
        f.moved[i] = move;
    }
    for (size_t i = 0; i < n; ++i) {
        f.predicted[i] += f.moved[i];
        f.predicted[i].z() = std::max(f.predicted[i].z(), 0.5f * f.spacing);
    }
}

}  // namespace

Pbf pbf_layer(uint32_t nx, uint32_t ny, uint32_t layers) {
    Pbf f;
    for (uint32_t z = 0; z < layers; ++z)
        for (uint32_t y = 0; y < ny; ++y)
            for (uint32_t x = 0; x < nx; ++x)
                f.position.push_back(f.spacing * Vec3(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z) + 0.5f));
    f.velocity.assign(f.position.size(), Vec3::Zero());
    return f;
}

void step_pbf(float seconds, const Vec3& gravity, Pbf& f) {
    const Kernels k(2 * f.spacing);
    const float rest = rest_density(k, f.spacing);
    const size_t n = f.position.size();
    f.predicted.resize(n), f.moved.resize(n), f.lambda.resize(n);
    for (size_t i = 0; i < n; ++i) f.velocity[i] += seconds * gravity, f.predicted[i] = f.position[i] + seconds * f.velocity[i];
    for (Vec3& p : f.predicted) p.z() = std::max(p.z(), 0.5f * f.spacing);
    find_neighbours(2 * f.spacing, f);
    for (uint32_t turn = 0; turn < f.iterations; ++turn) solve_once(k, rest, f);
    for (size_t i = 0; i < n; ++i) f.velocity[i] = (f.predicted[i] - f.position[i]) / seconds, f.position[i] = f.predicted[i];
}

}  // namespace trocar::bench
