#include "content/scene/scatter.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "content/scene/scene_file.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/geometry/quaternion.hpp"
namespace trocar {
namespace {

// Random number `k` of copy `copy`, uniform in [0, 1): the same on every machine, different for each copy.
double random_number(uint64_t seed, uint32_t copy, uint32_t k) {
    const uint64_t z = StateHash::mix(StateHash::mix(StateHash::mix(0, seed), copy), k);
    return static_cast<double>(z >> 11) * 0x1p-53;
}

// Uniformly distributed rotation (Shoemake, Graphics Gems III, 1992, "Uniform random rotations").
Quat random_turn(double u, double v, double w) {
    const double a = std::sqrt(1 - u), b = std::sqrt(u), p = 2 * std::numbers::pi * v, q = 2 * std::numbers::pi * w;
    Quat turn;
    turn.w = b * std::cos(q);
    turn.x = a * std::sin(p);
    turn.y = a * std::cos(p);
    turn.z = b * std::sin(q);
    return turn;
}

}  // namespace

void scatter_body(const BodySpec& pattern, std::vector<BodySpec>& bodies) {
    const ScatterSpec& s = pattern.scatter;
    if (s.count == 0) return;
    std::array<uint32_t, 2> columns = s.columns;
    const bool cube = columns[0] == 0 || columns[1] == 0;
    if (cube) columns[0] = columns[1] = static_cast<uint32_t>(std::ceil(std::cbrt(static_cast<double>(s.count)) - 1e-9));
    const uint32_t layer = columns[0] * columns[1], layers = (s.count + layer - 1) / layer;
    const uint32_t rows = std::min(columns[1], (s.count + columns[0] - 1) / columns[0]);
    const Vec3d middle(0.5 * (columns[0] - 1), 0.5 * (rows - 1), cube ? 0.5 * (layers - 1) : 0);
    for (uint32_t copy = 0; copy < s.count; ++copy) {
        BodySpec body = pattern;
        body.name += '_' + std::to_string(copy);
        body.copy = copy;
        Vec3d position = Vec3d(copy % columns[0], copy / columns[0] % columns[1], copy / layer) - middle;
        for (uint32_t k = 0; k < 3; ++k) position[k] += s.jitter * (2 * random_number(s.seed, copy, k) - 1);
        body.position += position.cwiseProduct(s.spacing);
        if (s.turned)
            body.orientation = random_turn(random_number(s.seed, copy, 3), random_number(s.seed, copy, 4), random_number(s.seed, copy, 5));
        bodies.push_back(std::move(body));
    }
}

}  // namespace trocar
