#pragma once
#include <cmath>
#include <numbers>
#include <random>

#include "components/mesh.hpp"

namespace trocar::reference {

// A sheet of columns x rows squares of `edge` (m), two triangles each, folded into layers `gap` (m) apart every `fold` columns, as a
// bellows is; its vertices are moved by up to `noise` (m). Layers are joined by half circles.
inline Mesh folded_sheet(uint32_t columns, uint32_t rows, double edge, uint32_t fold, double gap, double noise, uint64_t seed) {
    Mesh mesh;
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> shift(-noise, noise);
    const double straight = fold * edge, bend = 0.5 * std::numbers::pi * gap;
    for (uint32_t i = 0; i <= columns; ++i) {
        const double along = i * edge, period = straight + bend;
        const auto layer = static_cast<uint32_t>(along / period);
        const double rest = along - layer * period;
        double x = std::min(rest, straight), z = layer * gap;
        if (rest > straight) {
            const double angle = (rest - straight) / bend * std::numbers::pi;
            x = straight + 0.5 * gap * std::sin(angle), z += 0.5 * gap * (1 - std::cos(angle));
        }
        if (layer % 2 == 1) x = straight - x;
        for (uint32_t k = 0; k <= rows; ++k)
            mesh.position.push_back(Vec3d(x + shift(random), k * edge + shift(random), z + shift(random)));
    }
    for (uint32_t i = 0; i < columns; ++i)
        for (uint32_t k = 0; k < rows; ++k) {
            const uint32_t a = i * (rows + 1) + k, b = a + rows + 1;
            mesh.triangle.push_back({a, b, b + 1});
            mesh.triangle.push_back({a, b + 1, a + 1});
        }
    return mesh;
}

}  // namespace trocar::reference
