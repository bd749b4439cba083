#include "content/shapes/tube_organs.hpp"

#include <cmath>

#include "content/shapes/implicit_shapes.hpp"
namespace trocar {
namespace {

constexpr double kMm = 1e-3;

std::vector<Vec3d> from_mm(std::vector<Vec3d> points) {
    for (Vec3d& p : points) p *= kMm;
    return points;
}

}  // namespace

RadiusProfile gallbladder_profile() {
    const double end = gallbladder_line().length;
    return make_profile({{0, 0},
                         {9 * kMm, 12 * kMm},
                         {26 * kMm, 17 * kMm},
                         {40 * kMm, 15.2 * kMm},
                         {54 * kMm, 10 * kMm},
                         {62 * kMm, 8.2 * kMm},
                         {68 * kMm, 7.6 * kMm},
                         {77 * kMm, 3.8 * kMm},
                         {83 * kMm, 2.8 * kMm},
                         {end - 2.6 * kMm, 2.6 * kMm},
                         {end, 0}});
}

CentreLine gallbladder_line() {
    return measure_curve(curve_through(from_mm({{-12, -48, 16},
                                                {-9, -34, 13},
                                                {-5, -18, 9},
                                                {-1, -2, 4},
                                                {1, 11, -1},
                                                {-2, 22, -6},
                                                {2, 30, -11},
                                                {10, 30, -14},
                                                {16, 24, -15},
                                                {21, 16, -15}})));
}

Mesh make_gallbladder(uint32_t triangles, uint64_t seed) {
    const CentreLine line = gallbladder_line();
    Loft loft = tube_loft(line, gallbladder_profile(), [line, seed](double u, double s) {
        Vec3d along, x, y;
        const Vec3d p = line.at(s, along, x, y) / (20 * kMm);
        const Vec3d side = std::cos(2 * M_PI * u) * x + std::sin(2 * M_PI * u) * y;
        return 1 + 0.045 * lattice_noise(p + 0.8 * side, seed) + 0.015 * lattice_noise(2.5 * p + 2 * side, seed + 1);
    });
    loft.tile = 0.12;  // m, one repeat around and one along
    return loft_surface(loft, triangles);
}

RadiusProfile bowel_profile() {
    const double end = bowel_line().length, r = 14 * kMm;
    return make_profile({{0, 0}, {r, r}, {end - r, r}, {end, 0}});
}

// Langbein and Leopold, "River meanders - theory of minimum variance" (1966): direction = sine of arc length.
CentreLine bowel_line() {
    constexpr uint32_t kSteps = 4096;
    constexpr double kWave = 0.334, kLength = 0.42, kTurn = 1.8;
    std::vector<Vec3d> position{Vec3d::Zero()};
    for (uint32_t i = 0; i < kSteps; ++i) {
        const double s = kLength * (i + 0.5) / kSteps;
        const double heading = kTurn * std::sin(2 * M_PI * s / kWave + 0.35);
        const double rise = 0.28 * std::sin(2 * M_PI * s / (0.62 * kWave) + 1.0);
        position.push_back(position.back() +
                           kLength / kSteps *
                               Vec3d(std::cos(heading) * std::cos(rise), std::sin(heading) * std::cos(rise), std::sin(rise)));
    }
    Vec3d middle = Vec3d::Zero();
    for (const Vec3d& p : position) middle += p / double(position.size());
    return measure_curve([position, middle](double t) {
        const double at = t * kSteps;
        const size_t i = std::min<size_t>(static_cast<size_t>(at), kSteps - 1);
        return Vec3d(position[i] + (at - double(i)) * (position[i + 1] - position[i]) - middle);
    });
}

Mesh make_bowel(uint32_t triangles, uint64_t seed) {
    Loft loft = tube_loft(bowel_line(), bowel_profile(), [seed](double u, double s) {
        // contractions are inclined rings that fade around the tube
        const double turn = 2 * M_PI * u;
        const Vec3d position(s / (24 * kMm) + 0.12 * std::cos(turn), 0.35 * std::cos(turn), 0.35 * std::sin(turn));
        const double wide = lattice_noise(position, seed);
        const double fold = lattice_noise(Vec3d(3.1 * position.x(), position.y(), position.z()), seed + 1);
        return 1 + 0.075 * wide + 0.022 * fold;
    });
    loft.tile = 0.088;
    return loft_surface(loft, triangles);
}

}  // namespace trocar
