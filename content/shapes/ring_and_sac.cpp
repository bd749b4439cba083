#include "content/shapes/ring_and_sac.hpp"

#include <algorithm>
#include <cmath>

#include "content/shapes/loft.hpp"
namespace trocar {
namespace {

// A section (distance from the axis, height) swept about z.
Vec3d about_z(double radius, double height, double turn) { return {radius * std::cos(turn), radius * std::sin(turn), height}; }

constexpr double kSacRadius = 0.02, kSacDepth = 0.05, kFlare = 0.006;  // m
constexpr double kSacWall = kSacDepth - kSacRadius - kFlare;           // m, of the straight part

// Radius and height of the sac at v: 0 to 1 its round end, to 2 its wall, to 3 the bend at its neck, to 4 a lid.
void sac_profile(double v, double& radius, double& height) {
    if (v <= 1) {
        radius = kSacRadius * std::sin(M_PI / 2 * v), height = -kSacDepth + kSacRadius * (1 - std::cos(M_PI / 2 * v));
    } else if (v <= 2) {
        radius = kSacRadius, height = -kSacDepth + kSacRadius + kSacWall * (v - 1);
    } else if (v <= 3) {
        const double angle = M_PI / 2 * (v - 2);
        radius = kSacRadius + kFlare * (1 - std::cos(angle)), height = -kFlare * (1 - std::sin(angle));
    } else {
        radius = (kSacRadius + kFlare) * (4 - v), height = 0;
    }
}

}  // namespace

Mesh make_ring(uint32_t triangles) {
    constexpr double kMiddle = 0.016, kThick = 0.004;
    Loft loft;
    loft.ring = true;
    loft.point = [](double u, double v) {
        return about_z(kMiddle + kThick * std::cos(2 * M_PI * u), -kThick * std::sin(2 * M_PI * u), 2 * M_PI * v);
    };
    return loft_surface(loft, triangles);
}

Mesh make_cannula(uint32_t triangles) {
    constexpr double kBore = 0.005, kWall = 0.001, kHalf = 0.03, kFunnel = 0.012, kMouth = 0.005;  // m
    Loft loft;
    loft.ring = true;
    loft.corner = {0, 0.25, 0.5, 0.75};
    loft.point = [](double u, double v) {
        const double along = 4 * u - std::floor(4 * u);
        const double height = u < 0.25 ? kHalf - 2 * kHalf * along : u < 0.5 ? -kHalf : u < 0.75 ? -kHalf + 2 * kHalf * along : kHalf;
        const double wall = u < 0.25 ? kWall : u < 0.5 ? kWall * (1 - along) : u < 0.75 ? 0 : kWall * along;
        const double open = std::clamp(1 - (kHalf - height) / kFunnel, 0.0, 1.0);
        const double radius = kBore + wall + kMouth * open * open * (3 - 2 * open);
        return about_z(radius, height, 2 * M_PI * v);
    };
    return loft_surface(loft, triangles);
}

Mesh make_sac(uint32_t triangles) {
    Loft loft;
    loft.pieces = 4;
    loft.point = [](double u, double v) {
        double radius, height;
        sac_profile(v, radius, height);
        return about_z(radius, height, 2 * M_PI * u);
    };
    // areas by Pappus; the lid is made and taken away
    const double round = 2 * M_PI * kSacRadius * kSacRadius, wall = 2 * M_PI * kSacRadius * kSacWall,
                 bend = M_PI / 2 * kFlare * 2 * M_PI * (kSacRadius + kFlare * (1 - 2 / M_PI)),
                 lid = M_PI * (kSacRadius + kFlare) * (kSacRadius + kFlare);
    Mesh mesh = loft_surface(loft, static_cast<uint32_t>(std::lround(triangles * (1 + lid / (round + wall + bend)))));
    constexpr double kRounding = 1e-9;  // m
    const auto of_lid = [&](const Vec3d& p) { return p.z() > -kRounding; };
    Mesh sac;
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        if (std::ranges::all_of(mesh.triangle[t], [&](uint32_t v) { return of_lid(mesh.position[v]); })) continue;
        sac.triangle.push_back(mesh.triangle[t]);
        sac.uv.push_back(mesh.uv[t]);
    }
    // vertices run from the round end to the lid
    uint32_t used = 0;
    for (const Triangle& t : sac.triangle)
        for (const uint32_t v : t) used = std::max(used, v + 1);
    sac.position.assign(mesh.position.begin(), mesh.position.begin() + used);
    return sac;
}

}  // namespace trocar
