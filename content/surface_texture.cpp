#include "content/surface_texture.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "content/implicit_shapes.hpp"
namespace trocar {
namespace {

// A colour in sRGB, 0..255.
using Colour = Vec3d;

Colour blend(const Colour& a, const Colour& b, double weight) { return a + (b - a) * std::clamp(weight, 0.0, 1.0); }

// 0 below low, 1 above high, smooth between.
double ramp(double value, double low, double high) {
    const double t = std::clamp((value - low) / (high - low), 0.0, 1.0);
    return t * t * (3 - 2 * t);
}

double unit_hash(uint32_t x, uint32_t y, uint64_t seed) {
    return static_cast<double>(mix_bits((uint64_t(x) << 32 | y) ^ mix_bits(seed)) >> 11) * 0x1p-53;
}

// Values in [-1, 1] that repeat with period 1 in u and v; nu and nv lattice steps a period.
double periodic_noise(double u, double v, uint32_t nu, uint32_t nv, uint64_t seed) {
    const double x = (u - std::floor(u)) * nu;
    const double y = (v - std::floor(v)) * nv;
    const uint32_t x0 = static_cast<uint32_t>(x) % nu;
    const uint32_t y0 = static_cast<uint32_t>(y) % nv;
    const uint32_t x1 = (x0 + 1) % nu;
    const uint32_t y1 = (y0 + 1) % nv;
    const auto ease = [](double t) { return t * t * t * (t * (t * 6 - 15) + 10); };
    const double wx = ease(x - std::floor(x));
    const double wy = ease(y - std::floor(y));
    const double low = unit_hash(x0, y0, seed) + (unit_hash(x1, y0, seed) - unit_hash(x0, y0, seed)) * wx;
    const double high = unit_hash(x0, y1, seed) + (unit_hash(x1, y1, seed) - unit_hash(x0, y1, seed)) * wx;
    return 2 * (low + (high - low) * wy) - 1;
}

double cloud(double u, double v, uint32_t steps, int octaves, uint64_t seed) {
    double sum = 0;
    double weight = 1;
    double total = 0;
    for (int i = 0; i < octaves; ++i, steps *= 2, weight *= 0.5) {
        sum += weight * periodic_noise(u, v, steps, steps, seed + uint64_t(i));
        total += weight;
    }
    return sum / total;
}

// Distances, in cells, to the nearest and the second nearest of the points strewn one a cell.
std::pair<double, double> nearest_points(double u, double v, uint32_t cells, uint64_t seed) {
    const double x = (u - std::floor(u)) * cells;
    const double y = (v - std::floor(v)) * cells;
    const uint32_t cx = static_cast<uint32_t>(x) % cells;
    const uint32_t cy = static_cast<uint32_t>(y) % cells;
    double first = 9;
    double second = 9;
    for (uint32_t dy = 0; dy < 3; ++dy) {
        for (uint32_t dx = 0; dx < 3; ++dx) {
            const uint32_t px = (cx + dx + cells - 1) % cells;
            const uint32_t py = (cy + dy + cells - 1) % cells;
            const double ox = cx + double(dx) - 1 + 0.2 + 0.6 * unit_hash(px, py, seed) - x;
            const double oy = cy + double(dy) - 1 + 0.2 + 0.6 * unit_hash(px, py, seed + 1) - y;
            const double d = ox * ox + oy * oy;
            second = std::min(second, std::max(first, d));
            first = std::min(first, d);
        }
    }
    return {std::sqrt(first), std::sqrt(second)};
}

// 1 on the wandering lines where a noise changes sign, 0 from `width` on; the lines fade in and out.
double vessels(double u, double v, uint32_t steps, double width, uint64_t seed) {
    const double bent_u = u + 0.035 * cloud(u, v, 2 * steps, 2, seed + 10);
    const double bent_v = v + 0.035 * cloud(u, v, 2 * steps, 2, seed + 20);
    const double value = std::abs(cloud(bent_u, bent_v, steps, 2, seed));
    return (1 - ramp(value, 0.2 * width, width)) * ramp(cloud(u, v, steps, 1, seed + 30), -0.1, 0.5);
}

template <typename Paint>  // Colour(double u, double v)
Image paint_picture(const Paint& paint) {
    Image image{kTextureSize, kTextureSize, {}};
    image.rgba.reserve(size_t(kTextureSize) * kTextureSize * 4);
    for (uint32_t row = 0; row < kTextureSize; ++row) {
        for (uint32_t column = 0; column < kTextureSize; ++column) {
            const Colour c = paint((column + 0.5) / kTextureSize, (row + 0.5) / kTextureSize);
            for (int k = 0; k < 3; ++k) image.rgba.push_back(static_cast<uint8_t>(std::clamp(c[k], 0.0, 255.0) + 0.5));
            image.rgba.push_back(255);
        }
    }
    return image;
}

}  // namespace

Image paint_liver(uint64_t seed) {
    return paint_picture([seed](double u, double v) {
        const double patches = cloud(u, v, 5, 5, seed);
        // lobules: cells with bent rims, each a little lighter or darker
        const double bend = 0.012;
        const double bent_u = u + bend * cloud(u, v, 24, 2, seed + 400);
        const double bent_v = v + bend * cloud(u, v, 24, 2, seed + 500);
        const auto [centre, other] = nearest_points(bent_u, bent_v, 36, seed + 100);
        const double rim = 1 - ramp(other - centre, 0.0, 0.35);
        const double fade = ramp(cloud(u, v, 10, 2, seed + 600), -0.3, 0.5);
        Colour c = blend(Colour(110, 40, 31), Colour(144, 60, 46), 0.5 + 0.55 * patches);
        c = blend(c, Colour(172, 98, 74), 0.24 * rim * fade);
        c = blend(c, Colour(84, 24, 24), 0.16 * ramp(0.45 - centre, 0.0, 0.4));
        c = blend(c, Colour(64, 14, 20), 0.4 * vessels(u, v, 4, 0.05, seed + 200));
        return Colour(c * (1 + 0.05 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_kidney(uint64_t seed) {
    return paint_picture([seed](double u, double v) {
        const double patches = cloud(u, v, 6, 5, seed);
        const double fine = cloud(u, v, 40, 3, seed + 50);
        Colour c = blend(Colour(136, 46, 40), Colour(166, 70, 58), 0.5 + 0.5 * patches + 0.25 * fine);
        c = blend(c, Colour(98, 20, 28), 0.45 * vessels(u, v, 4, 0.05, seed + 200));
        c = blend(c, Colour(98, 20, 28), 0.3 * vessels(u, v, 9, 0.07, seed + 250));
        return Colour(c * (1 + 0.04 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_steel(uint64_t seed) {
    return paint_picture([seed](double u, double v) {
        const double streak = 0.6 * periodic_noise(u, v, 6, 256, seed) + 0.4 * periodic_noise(u, v, 16, 128, seed + 1);
        const double stain = cloud(u, v, 3, 3, seed + 2);
        return Colour(Colour(176, 180, 186) * (1 + 0.1 * streak + 0.04 * stain));
    });
}

Image paint_drape(uint64_t seed) {
    return paint_picture([seed](double u, double v) {
        const uint32_t threads = 64;
        const double x = u * threads - std::floor(u * threads);
        const double y = v * threads - std::floor(v * threads);
        const bool over = (static_cast<uint32_t>(u * threads) + static_cast<uint32_t>(v * threads)) % 2 == 0;
        const double across = over ? x : y;
        const double round = 4 * across * (1 - across);
        const double uneven = cloud(u, v, 8, 3, seed);
        return Colour(blend(Colour(36, 84, 82), Colour(64, 124, 118), 0.35 + 0.5 * round) * (1 + 0.08 * uneven));
    });
}

void project_uv(double tile, Mesh& mesh) {
    // the axis follows a normal averaged over the neighbourhood: the borders between axes become smooth lines
    std::vector<Vec3d> facing(mesh.triangle.size());
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        const Triangle& corner = mesh.triangle[t];
        const Vec3d& a = mesh.position[corner[0]];
        facing[t] = (mesh.position[corner[1]] - a).cross(mesh.position[corner[2]] - a);
    }
    std::vector<Vec3d> around(mesh.position.size());
    for (int round = 0; round < 3; ++round) {
        std::fill(around.begin(), around.end(), Vec3d::Zero());
        for (size_t t = 0; t < facing.size(); ++t) {
            for (const uint32_t v : mesh.triangle[t]) around[v] += facing[t];
        }
        for (size_t t = 0; t < facing.size(); ++t) {
            const Triangle& corner = mesh.triangle[t];
            facing[t] += (around[corner[0]] + around[corner[1]] + around[corner[2]]) / 18;
        }
    }
    mesh.uv.resize(mesh.triangle.size());
    for (size_t t = 0; t < mesh.triangle.size(); ++t) {
        int axis = 0;
        facing[t].cwiseAbs().maxCoeff(&axis);
        for (int k = 0; k < 3; ++k) {
            const Vec3d p = mesh.position[mesh.triangle[t][k]] / tile;
            // mirrored on the far side, so that the picture reads the same way from outside everywhere
            const double u = p[(axis + 1) % 3] * (facing[t][axis] < 0 ? -1 : 1);
            mesh.uv[t][k] = {static_cast<float>(u), static_cast<float>(p[(axis + 2) % 3])};
        }
    }
}

}  // namespace trocar
