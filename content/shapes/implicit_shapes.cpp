#include "content/shapes/implicit_shapes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/jobs/parallel.hpp"
namespace trocar {
namespace {

// Samples per side of a block in sample_shape, and of the smallest blocks it is halved into.
constexpr uint32_t kBlock = 32;
constexpr uint32_t kSmallestBlock = 4;

constexpr double kMm = 1e-3;

Vec3d mm(double x, double y, double z) { return kMm * Vec3d(x, y, z); }

// Depth profile of a groove along the segment a b, seen along z: 1 on it, smoothly 0 at distance `width`.
double groove(const Vec3d& point, const Vec3d& a, const Vec3d& b, double width) {
    const Vec3d axis(b.x() - a.x(), b.y() - a.y(), 0);
    const Vec3d offset(point.x() - a.x(), point.y() - a.y(), 0);
    const double t = std::clamp(offset.dot(axis) / axis.squaredNorm(), 0.0, 1.0);
    const double rest = std::max(0.0, 1 - (offset - t * axis).squaredNorm() / (width * width));
    return rest * rest * rest;
}

Vec3d gradient(const ImplicitShape& shape, const Vec3d& point, double step, double* value) {
    // corners of a regular tetrahedron: four evaluations give the gradient and, as their mean, the value
    const Vec3d corner[4] = {{1, 1, 1}, {1, -1, -1}, {-1, 1, -1}, {-1, -1, 1}};
    Vec3d slope = Vec3d::Zero();
    *value = 0;
    for (const Vec3d& c : corner) {
        const double f = shape.distance(point + step * c);
        slope += f * c;
        *value += f / 4;
    }
    return slope / (4 * step);
}

// Fills the block of `side` samples starting at `low`. A sample beyond steepness * spacing in magnitude has
// neighbours of the same sign, and the contour never reads its value: a block of such samples gets one value.
void fill_block(const ImplicitShape& shape, const std::array<uint32_t, 3>& low, uint32_t side, ScalarGrid& grid) {
    const std::array<uint32_t, 3> high{std::min(low[0] + side, grid.nx), std::min(low[1] + side, grid.ny),
                                       std::min(low[2] + side, grid.nz)};
    const double spacing = grid.spacing.x();
    const Vec3d middle = grid.origin + spacing * (Vec3d(low[0], low[1], low[2]) + Vec3d::Constant((side - 1) / 2.0));
    const double value = shape.distance(middle);
    const bool far = std::abs(value) > shape.steepness * spacing * ((side - 1) / 2.0 * std::sqrt(3.0) + 1);
    if (!far && side > kSmallestBlock) {
        const uint32_t half = side / 2;
        for (uint32_t child = 0; child < 8; ++child) {
            const std::array<uint32_t, 3> from{low[0] + (child & 1) * half, low[1] + (child >> 1 & 1) * half, low[2] + (child >> 2) * half};
            if (from[0] < grid.nx && from[1] < grid.ny && from[2] < grid.nz) fill_block(shape, from, half, grid);
        }
        return;
    }
    for (uint32_t z = low[2]; z < high[2]; ++z) {
        for (uint32_t y = low[1]; y < high[1]; ++y) {
            float* row = grid.values.data() + (size_t(z) * grid.ny + y) * grid.nx;
            for (uint32_t x = low[0]; x < high[0]; ++x) {
                row[x] = static_cast<float>(far ? value : shape.distance(grid.origin + spacing * Vec3d(x, y, z)));
            }
        }
    }
}

}  // namespace

double ellipsoid_distance(const Vec3d& point, const Vec3d& centre, const Vec3d& radii) {
    const Vec3d p = point - centre;
    const double scaled = p.cwiseQuotient(radii).norm();
    const double slope = p.cwiseQuotient(radii.cwiseProduct(radii)).norm();
    const double least = radii.minCoeff();
    // the first-order distance near the surface needs the radius along the direction; near the centre, where
    // the direction changes abruptly, the smallest radius is used
    const double t = std::clamp((scaled - 0.3) / 0.4, 0.0, 1.0);
    const double seen = slope > 0 ? scaled / slope : least;
    return (scaled - 1) * (least + (seen - least) * t * t * (3 - 2 * t));
}

double capsule_distance(const Vec3d& point, const Vec3d& a, const Vec3d& b, double radius_a, double radius_b) {
    const Vec3d axis = b - a;
    const double t = std::clamp((point - a).dot(axis) / axis.squaredNorm(), 0.0, 1.0);
    return (point - a - t * axis).norm() - (radius_a + t * (radius_b - radius_a));
}

double smooth_union(double a, double b, double blend) {
    const double overlap = std::max(blend - std::abs(a - b), 0.0) / blend;
    return std::min(a, b) - overlap * overlap * overlap * blend / 6;
}

double smooth_subtraction(double a, double b, double blend) { return -smooth_union(-a, b, blend); }

uint64_t mix_bits(uint64_t key) {
    key += 0x9e3779b97f4a7c15u;
    key = (key ^ key >> 29) * 0xd6e8feb86659fd93u;
    key = (key ^ key >> 32) * 0xd6e8feb86659fd93u;
    return key ^ key >> 32;
}

double lattice_noise(const Vec3d& point, uint64_t seed) {
    const Vec3d base(std::floor(point.x()), std::floor(point.y()), std::floor(point.z()));
    const Vec3d t = point - base;
    const auto ease = [](double s) { return s * s * s * (s * (s * 6 - 15) + 10); };
    const double wx = ease(t.x());
    const double wy = ease(t.y());
    const double wz = ease(t.z());
    const auto at = [&](int dx, int dy, int dz) {
        const uint64_t x = static_cast<uint64_t>(static_cast<int64_t>(base.x()) + dx) & 0x1fffff;
        const uint64_t y = static_cast<uint64_t>(static_cast<int64_t>(base.y()) + dy) & 0x1fffff;
        const uint64_t z = static_cast<uint64_t>(static_cast<int64_t>(base.z()) + dz) & 0x1fffff;
        return static_cast<double>(mix_bits((x << 42 | y << 21 | z) ^ mix_bits(seed)) >> 11) * 0x1p-52 - 1.0;
    };
    const auto blend = [](double a, double b, double w) { return a + (b - a) * w; };
    const auto face = [&](int dz) { return blend(blend(at(0, 0, dz), at(1, 0, dz), wx), blend(at(0, 1, dz), at(1, 1, dz), wx), wy); };
    return blend(face(0), face(1), wz);
}

ScalarGrid sample_shape(const ImplicitShape& shape, double spacing) {
    TROCAR_ASSERT(spacing > 0);
    const Vec3d extent = shape.box.max - shape.box.min;
    const Vec3d cells(std::ceil(extent.x() / spacing), std::ceil(extent.y() / spacing), std::ceil(extent.z() / spacing));
    if (!((cells.array() + 3).prod() < 0x1p31)) throw InputError(shape.name + ": more triangles asked than a grid can give");
    ScalarGrid grid;
    grid.nx = static_cast<uint32_t>(cells.x()) + 3;
    grid.ny = static_cast<uint32_t>(cells.y()) + 3;
    grid.nz = static_cast<uint32_t>(cells.z()) + 3;
    grid.spacing = Vec3d::Constant(spacing);
    grid.origin = (shape.box.min + shape.box.max - spacing * (cells + Vec3d::Constant(2))) / 2;
    grid.values.resize(size_t(grid.nx) * grid.ny * grid.nz);
    const uint32_t nx = chunk_count(grid.nx, kBlock), ny = chunk_count(grid.ny, kBlock), nz = chunk_count(grid.nz, kBlock);
    parallel_for(nx * ny * nz, 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t b = begin; b < end; ++b)
            fill_block(shape, {kBlock * (b % nx), kBlock * (b / nx % ny), kBlock * (b / nx / ny)}, kBlock, grid);
    });
    return grid;
}

Vec3d project_to_shape(const ImplicitShape& shape, const Vec3d& point, double reach, int steps) {
    constexpr double kStep = 1e-6;  // m; smaller: loses digits; larger: shifted by curvature
    Vec3d at = point;
    for (int i = 0; i < steps; ++i) {
        double value = 0;
        const Vec3d slope = gradient(shape, at, kStep, &value);
        const double steep = slope.squaredNorm();
        if (!(steep > 1e-6)) break;
        Vec3d move = -value / steep * slope;
        const double length = move.norm();
        if (length > reach) move *= reach / length;
        at += move;
        if (length < 1e-9) break;
    }
    return at;
}

ImplicitShape liver_shape(uint64_t seed) {
    ImplicitShape shape;
    shape.name = "liver";
    shape.box = {mm(-120, -100, -85), mm(125, 95, 75)};
    shape.distance = [seed](const Vec3d& p) {
        // domed part under the diaphragm
        const double right = ellipsoid_distance(p, mm(-38, 0, -4), mm(66, 76, 62));
        const double middle = ellipsoid_distance(p, mm(10, 16, 10), mm(60, 54, 42));
        const double left = ellipsoid_distance(p, mm(50, 24, 17), mm(54, 44, 23));
        double f = smooth_union(smooth_union(right, middle, 30 * kMm), left, 30 * kMm);
        // the organs that press from below: the bowel and right kidney bevel the inferior edge, which runs
        // obliquely from the right costal arch up to the left; the stomach lies under the left lobe
        const double bowel = (p - mm(20, -86, -128)).norm() - 134 * kMm;
        const double bevel = 46 * kMm - Vec3d(0.48, -0.72, -0.5).dot(p);
        const double stomach = (p - mm(80, -20, -66)).norm() - 74 * kMm;
        const double below = smooth_union(smooth_union(bowel, bevel, 14 * kMm), stomach, 14 * kMm);
        // deeper impressions: gallbladder, round ligament (which notches the edge) and the vessels between
        // the two
        const double beds = 7 * kMm * groove(p, mm(-20, -80, 0), mm(0, -12, 0), 26 * kMm) +
                            8 * kMm * groove(p, mm(34, -60, 0), mm(27, 2, 0), 15 * kMm) +
                            6 * kMm * groove(p, mm(0, -12, 0), mm(27, 2, 0), 17 * kMm);
        f = smooth_subtraction(f, below - beds, 15 * kMm);
        const double wavelength = 42 * kMm;
        return f + 1.0 * kMm * lattice_noise(p / wavelength, seed) + 0.35 * kMm * lattice_noise(p / (0.4 * wavelength), seed + 1);
    };
    return shape;
}

ImplicitShape kidney_shape(uint64_t seed) {
    ImplicitShape shape;
    shape.name = "kidney";
    shape.box = {mm(-62, -38, -28), mm(62, 38, 28)};
    shape.distance = [seed](const Vec3d& p) {
        // the poles bend towards the hilum
        constexpr double kBend = 5.0;  // 1/m
        const Vec3d straight(p.x(), p.y() + kBend * p.x() * p.x() - 3 * kMm, p.z());
        double f = ellipsoid_distance(straight, mm(0, 0, 0), mm(56, 26, 21));
        const double upper = ellipsoid_distance(straight, mm(26, 0, 0), mm(28, 27, 22));
        const double lower = ellipsoid_distance(straight, mm(-27, 1, 0), mm(28, 25, 20));
        f = smooth_union(f, smooth_union(upper, lower, 10 * kMm), 10 * kMm);
        const double hilum = ellipsoid_distance(p, mm(-1, -33, 2), mm(18, 20, 10));
        f = smooth_subtraction(f, hilum, 8 * kMm);
        const double wavelength = 26 * kMm;
        f += 0.5 * kMm * lattice_noise(p / wavelength, seed) + 0.15 * kMm * lattice_noise(p / (0.4 * wavelength), seed + 1);
        return f;
    };
    return shape;
}

ImplicitShape stomach_shape(uint64_t seed) {
    ImplicitShape shape;
    shape.name = "stomach";
    shape.box = {mm(-110, -115, -52), mm(95, 125, 52)};
    shape.distance = [seed](const Vec3d& p) {
        struct Ball {
            Vec3d centre;
            double radius;
        };
        // along the middle, from the fundus to the stump of the duodenum
        static const Ball kBody[] = {{mm(36, 68, 0), 40e-3},    {mm(42, 30, 0), 38e-3},   {mm(38, -12, 0), 32e-3},
                                     {mm(22, -50, 0), 28e-3},   {mm(-8, -72, 0), 25e-3},  {mm(-36, -66, 0), 19e-3},
                                     {mm(-57, -46, 0), 9.5e-3}, {mm(-68, -32, 0), 14e-3}, {mm(-84, -27, 0), 12e-3}};
        // flatter from front to back than it is wide
        const Vec3d q(p.x(), p.y(), p.z() / 0.84);
        double f = 1;
        for (size_t i = 0; i + 1 < std::size(kBody); ++i) {
            const double part = capsule_distance(q, kBody[i].centre, kBody[i + 1].centre, kBody[i].radius, kBody[i + 1].radius);
            f = i == 0 ? part : smooth_union(f, part, 9 * kMm);
        }
        const double oesophagus = capsule_distance(q, mm(8, 36, 0), mm(-20, 96, 0), 13e-3, 9e-3);
        f = smooth_union(f, oesophagus, 14 * kMm);
        const double wavelength = 34 * kMm;
        return f + 1.0 * kMm * lattice_noise(p / wavelength, seed) + 0.35 * kMm * lattice_noise(p / (0.4 * wavelength), seed + 1);
    };
    return shape;
}

}  // namespace trocar
