#include "content/shapes/surface_texture.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "content/shapes/implicit_shapes.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

// A colour in sRGB, 0..255.
using Colour = Vec3d;

Colour blend(const Colour& a, const Colour& b, double weight) { return a + (b - a) * std::clamp(weight, 0.0, 1.0); }

// 0 below low, 1 above high, smooth in between.
double ramp(double value, double low, double high) {
    const double t = std::clamp((value - low) / (high - low), 0.0, 1.0);
    return t * t * (3 - 2 * t);
}

double unit_hash(uint32_t x, uint32_t y, uint64_t seed) {
    return static_cast<double>(mix_bits((uint64_t(x) << 32 | y) ^ mix_bits(seed)) >> 11) * 0x1p-53;
}

// Noise in [-1, 1] with period 1 in u and v; nu and nv lattice steps per period.
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

// Distances, in cells, to the nearest and second nearest of random points, one per cell.
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

// Sequence of random numbers in [0, 1).
struct Dice {
    uint64_t seed = 0;
    uint64_t count = 0;
    double roll() { return static_cast<double>(mix_bits(mix_bits(seed) + count++) >> 11) * 0x1p-53; }
    double roll(double low, double high) { return low + (high - low) * roll(); }
};

// A growing vessel: position and width in pixels, heading in radians.
struct Vessel {
    double x = 0, y = 0, heading = 0;
    double width = 1;  // pixels, at its root
    double length = 0;
    double straight = 0;  // 0 meanders, 1 keeps its heading
};

// Coverage of a picture by vessels, 0..1 per pixel, periodic at the edges.
struct VesselMap {
    std::vector<float> cover = std::vector<float>(size_t(kTextureSize) * kTextureSize, 0.0f);

    double at(double u, double v) const {
        const uint32_t x = static_cast<uint32_t>(u * kTextureSize) % kTextureSize;
        const uint32_t y = static_cast<uint32_t>(v * kTextureSize) % kTextureSize;
        return cover[size_t(y) * kTextureSize + x];
    }
    void stamp(double x, double y, double radius, double strength) {
        const int reach = static_cast<int>(std::ceil(radius + 1));
        const int n = static_cast<int>(kTextureSize);
        for (int dy = -reach; dy <= reach; ++dy) {
            for (int dx = -reach; dx <= reach; ++dx) {
                const double px = std::floor(x) + dx, py = std::floor(y) + dy;
                const double distance = std::hypot(px + 0.5 - x, py + 0.5 - y);
                const double part = strength * std::clamp(radius + 0.5 - distance, 0.0, 1.0);
                const int column = ((static_cast<int>(px) % n) + n) % n, row = ((static_cast<int>(py) % n) + n) % n;
                float& pixel = cover[size_t(row) * kTextureSize + size_t(column)];
                pixel = std::max(pixel, static_cast<float>(part));
            }
        }
    }
};

// Grows vessels pixel by pixel; they thin out and branch, each branch thinner and shorter than its parent.
void grow_vessels(std::vector<Vessel> growing, Dice& dice, VesselMap& map) {
    while (!growing.empty()) {
        Vessel v = growing.back();
        growing.pop_back();
        const double home = v.heading;
        double next_branch = dice.roll(0.1, 0.35) * v.length;
        for (double gone = 0; gone < v.length; gone += 1) {
            const double left = 1 - gone / v.length;
            const double width = v.width * (0.35 + 0.65 * left);
            map.stamp(v.x, v.y, width / 2, std::min(1.0, width) * (0.4 + 0.6 * std::min(1.0, 3 * left)));
            v.heading += dice.roll(-0.16, 0.16) + 0.06 * v.straight * (home - v.heading);
            v.x += std::cos(v.heading);
            v.y += std::sin(v.heading);
            if (gone < next_branch || width < 0.7) continue;
            next_branch = gone + dice.roll(0.1, 0.3) * v.length;
            const double turn = (dice.roll() < 0.5 ? -1 : 1) * dice.roll(0.45, 0.95);
            growing.push_back({v.x, v.y, v.heading + turn, 0.62 * width, dice.roll(0.3, 0.6) * left * v.length, 0.5 * v.straight});
        }
    }
}

// Vessel trees at random positions, with roots `width` pixels wide.
VesselMap strew_vessels(uint32_t trees, double width, double length, uint64_t seed) {
    Dice dice{seed};
    VesselMap map;
    std::vector<Vessel> roots;
    for (uint32_t i = 0; i < trees; ++i) {
        const double x = dice.roll(0, kTextureSize), y = dice.roll(0, kTextureSize), heading = dice.roll(0, 2 * M_PI);
        const double share = dice.roll(0.6, 1.0);
        roots.push_back({x, y, heading, share * width, share * length, 0.2});
    }
    grow_vessels(std::move(roots), dice, map);
    return map;
}

template <typename Paint>  // Colour(double u, double v)
Image paint_picture(const Paint& paint) {
    Image image{kTextureSize, kTextureSize, {}};
    image.rgba.resize(size_t(kTextureSize) * kTextureSize * 4);
    parallel_for(kTextureSize, 16, [&](uint32_t begin, uint32_t end) {
        uint8_t* to = image.rgba.data() + size_t{4} * kTextureSize * begin;
        for (uint32_t row = begin; row < end; ++row) {
            for (uint32_t column = 0; column < kTextureSize; ++column) {
                const Colour c = paint((column + 0.5) / kTextureSize, (row + 0.5) / kTextureSize);
                for (int k = 0; k < 3; ++k) *to++ = static_cast<uint8_t>(std::clamp(c[k], 0.0, 255.0) + 0.5);
                *to++ = 255;
            }
        }
    });
    return image;
}

}  // namespace

Image paint_liver(uint64_t seed) {
    const VesselMap map = strew_vessels(7, 2.2, 200, seed + 200);
    return paint_picture([&map, seed](double u, double v) {
        const double patches = cloud(u, v, 5, 5, seed);
        // lobules: cells with wavy borders, each slightly lighter or darker
        const double bend = 0.012;
        const double bent_u = u + bend * cloud(u, v, 24, 2, seed + 400);
        const double bent_v = v + bend * cloud(u, v, 24, 2, seed + 500);
        const auto [centre, other] = nearest_points(bent_u, bent_v, 36, seed + 100);
        const double rim = 1 - ramp(other - centre, 0.0, 0.35);
        const double fade = ramp(cloud(u, v, 10, 2, seed + 600), -0.3, 0.5);
        Colour c = blend(Colour(110, 40, 31), Colour(144, 60, 46), 0.5 + 0.55 * patches);
        c = blend(c, Colour(172, 98, 74), 0.24 * rim * fade);
        c = blend(c, Colour(84, 24, 24), 0.16 * ramp(0.45 - centre, 0.0, 0.4));
        c = blend(c, Colour(64, 14, 20), 0.3 * map.at(u, v));
        return Colour(c * (1 + 0.05 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_kidney(uint64_t seed) {
    const VesselMap map = strew_vessels(12, 2.4, 200, seed + 200);
    return paint_picture([&map, seed](double u, double v) {
        const double patches = cloud(u, v, 6, 5, seed);
        const double fine = cloud(u, v, 40, 3, seed + 50);
        Colour c = blend(Colour(136, 46, 40), Colour(166, 70, 58), 0.5 + 0.5 * patches + 0.25 * fine);
        c = blend(c, Colour(98, 20, 28), 0.4 * map.at(u, v));
        return Colour(c * (1 + 0.04 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_gallbladder(uint64_t seed) {
    const VesselMap map = strew_vessels(16, 2.4, 190, seed + 7);
    return paint_picture([&map, seed](double u, double v) {
        const double plain = ramp(std::min(v, 1 - v), 0.01, 0.12);
        const double patches = plain * cloud(u, v, 7, 5, seed);
        const double fat = plain * ramp(cloud(u, v, 9, 3, seed + 40), 0.25, 0.7);
        Colour c = blend(Colour(74, 98, 58), Colour(124, 138, 84), 0.5 + 0.6 * patches);
        c = blend(c, Colour(176, 164, 96), 0.45 * fat);
        c = blend(c, Colour(120, 42, 40), 0.75 * plain * map.at(u, v));
        return Colour(c * (1 + 0.04 * plain * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_stomach(uint64_t seed) {
    const VesselMap map = strew_vessels(14, 3.6, 300, seed + 7);
    const VesselMap fine = strew_vessels(40, 1.4, 120, seed + 8);
    return paint_picture([&map, &fine, seed](double u, double v) {
        const double patches = cloud(u, v, 4, 5, seed);
        // muscle fibres visible through the surface
        const double fibres = cloud(u + 0.02 * patches, 3 * v, 24, 2, seed + 60);
        Colour c = blend(Colour(196, 122, 112), Colour(224, 160, 146), 0.5 + 0.6 * patches + 0.12 * fibres);
        c = blend(c, Colour(170, 62, 66), 0.45 * fine.at(u, v));
        c = blend(c, Colour(134, 34, 46), 0.75 * map.at(u, v));
        return Colour(c * (1 + 0.03 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_bowel(uint64_t seed) {
    Dice dice{seed + 7};
    VesselMap map;
    std::vector<Vessel> roots;
    constexpr uint32_t kPairs = 9;
    for (uint32_t i = 0; i < 2 * kPairs; ++i) {
        const double y = (i / 2 + dice.roll(0.1, 0.9)) * kTextureSize / kPairs;
        const double share = dice.roll(0.55, 1.0);
        roots.push_back({0, y, i % 2 == 0 ? 0.0 : M_PI, 3.6 * share, 0.48 * kTextureSize * share, 1});
    }
    // the vessel along the mesenteric border, from which the others branch
    roots.push_back({0, 0, M_PI / 2, 5, kTextureSize, 1});
    grow_vessels(std::move(roots), dice, map);
    return paint_picture([&map, seed](double u, double v) {
        const double patches = cloud(u, v, 4, 5, seed);
        const double rings = periodic_noise(u, v, 3, 40, seed + 60);
        const double border = ramp(std::abs(u - 0.5), 0.40, 0.5);
        Colour c = blend(Colour(214, 134, 124), Colour(238, 176, 160), 0.5 + 0.6 * patches + 0.18 * rings);
        c = blend(c, Colour(226, 188, 126), 0.5 * border * ramp(cloud(u, v, 12, 3, seed + 90), -0.4, 0.4));
        c = blend(c, Colour(160, 44, 52), 0.7 * map.at(u, v));
        return Colour(c * (1 + 0.03 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_muscle(uint64_t seed) {
    return paint_picture([seed](double u, double v) {
        const double bent = v + 0.015 * cloud(u, v, 6, 2, seed + 20);
        const double fibres = 0.6 * periodic_noise(u, bent, 5, 110, seed + 40) + 0.4 * periodic_noise(u, bent, 9, 60, seed + 41);
        const double patches = cloud(u, v, 4, 4, seed);
        Colour c = blend(Colour(118, 34, 34), Colour(168, 66, 58), 0.5 + 0.3 * patches + 0.45 * fibres);
        c = blend(c, Colour(214, 176, 160), 0.35 * ramp(fibres, 0.35, 0.8));
        return Colour(c * (1 + 0.03 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_fascia(uint64_t seed) {
    return paint_picture([seed](double u, double v) {
        const double bent = v + 0.02 * cloud(u, v, 5, 2, seed + 20);
        const double fibres = 0.5 * periodic_noise(u, bent, 4, 90, seed + 40) + 0.5 * periodic_noise(u, bent, 7, 44, seed + 41);
        const double patches = cloud(u, v, 4, 5, seed);
        Colour c = blend(Colour(196, 160, 142), Colour(228, 206, 188), 0.5 + 0.3 * patches + 0.4 * fibres);
        c = blend(c, Colour(178, 88, 76), 0.35 * ramp(cloud(u, v, 3, 4, seed + 70), 0.0, 0.7));
        return Colour(c * (1 + 0.03 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_peritoneum(uint64_t seed) {
    const VesselMap map = strew_vessels(12, 2.2, 240, seed + 7);
    return paint_picture([&map, seed](double u, double v) {
        const double patches = cloud(u, v, 4, 5, seed);
        const double fat = ramp(cloud(u, v, 3, 4, seed + 50), 0.0, 0.9);
        Colour c = blend(Colour(190, 104, 92), Colour(218, 142, 124), 0.5 + 0.6 * patches);
        c = blend(c, Colour(228, 192, 128), 0.5 * fat);
        c = blend(c, Colour(142, 34, 44), 0.65 * map.at(u, v));
        return Colour(c * (1 + 0.03 * periodic_noise(u, v, 170, 170, seed + 300)));
    });
}

Image paint_polypropylene(uint64_t seed) {
    return paint_picture([seed](double u, double v) {
        // threads cross diagonally, 16 repeats in u and in v
        const auto thread = [&](double phase) {
            const double x = phase - std::floor(phase);
            return 4 * x * (1 - x);
        };
        const double over = std::max(thread(16 * (u + v)), thread(16 * (u - v)));
        const double uneven = cloud(u, v, 8, 3, seed);
        Colour c = blend(Colour(150, 166, 178), Colour(248, 251, 252), over);
        c = blend(c, Colour(92, 140, 196), 0.8 * ramp(0.045 - std::abs(v - 0.5), 0.0, 0.01));
        return Colour(c * (1 + 0.03 * uneven));
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
    // the axis follows an averaged normal, so that the borders between axes are smooth lines
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
            // mirrored on the far side, so that the picture is not mirrored when seen from outside
            const double u = p[(axis + 1) % 3] * (facing[t][axis] < 0 ? -1 : 1);
            mesh.uv[t][k] = {static_cast<float>(u), static_cast<float>(p[(axis + 2) % 3])};
        }
    }
}

}  // namespace trocar
