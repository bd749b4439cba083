#include "content/shapes/dish.hpp"

#include <algorithm>
#include <cmath>

namespace trocar {

Mesh make_dish(uint32_t triangles) {
    constexpr double kRim = 0.1, kDepth = 0.03, kRadius = (kRim * kRim + kDepth * kDepth) / (2 * kDepth);  // m
    const double edge = std::asin(kRim / kRadius);
    const auto rings = std::max(1u, static_cast<uint32_t>(std::lround(std::sqrt(triangles / 6.0))));
    Mesh mesh;
    mesh.position.push_back(Vec3d::Zero());
    const auto vertex = [](uint32_t ring, uint32_t k) { return ring == 0 ? 0 : 1 + 3 * ring * (ring - 1) + k % (6 * ring); };
    for (uint32_t ring = 1; ring <= rings; ++ring) {
        const double polar = edge * ring / rings;
        for (uint32_t k = 0; k < 6 * ring; ++k) {
            const double turn = 2 * M_PI * k / (6 * ring);
            mesh.position.push_back(kRadius *
                                    Vec3d(std::sin(polar) * std::cos(turn), std::sin(polar) * std::sin(turn), 1 - std::cos(polar)));
        }
    }
    for (uint32_t ring = 1; ring <= rings; ++ring) {
        for (uint32_t side = 0; side < 6; ++side) {
            for (uint32_t k = 0; k < ring; ++k) {
                const uint32_t outer = vertex(ring, side * ring + k), next = vertex(ring, side * ring + k + 1);
                const uint32_t inner = vertex(ring - 1, side * (ring - 1) + k);
                mesh.triangle.push_back({inner, outer, next});
                if (k + 1 < ring) mesh.triangle.push_back({inner, next, vertex(ring - 1, side * (ring - 1) + k + 1)});
            }
        }
    }
    for (const Triangle& t : mesh.triangle) {
        std::array<Vec2, 3> uv;
        for (size_t c = 0; c < 3; ++c)
            uv[c] = {static_cast<float>(mesh.position[t[c]].x() / 0.08), static_cast<float>(mesh.position[t[c]].y() / 0.08)};
        mesh.uv.push_back(uv);
    }
    return mesh;
}

}  // namespace trocar
