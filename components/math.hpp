#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
namespace trocar {

using Vec3 = Eigen::Vector3f;
using Vec3d = Eigen::Vector3d;

// "No index": absent triangle, neighbour, texture, body.
inline constexpr uint32_t kNone = UINT32_MAX;

// A contiguous slice of a flat array, [first, first + count).
struct Range {
    uint32_t first = 0;
    uint32_t count = 0;
    uint32_t end() const { return first + count; }
};

// Sixteen bytes, loaded by one vector instruction. Positions keep the inverse mass in w.
struct alignas(16) Float4 {
    float x = 0, y = 0, z = 0, w = 0;
};

// Unit quaternion w + xi + yj + zk. Not Eigen's, whose alignment depends on the instruction set.
struct Quat {
    double w = 1, x = 0, y = 0, z = 0;
};

// Axis-aligned box, m. Empty when min > max.
struct Box {
    Vec3d min = Vec3d::Constant(std::numeric_limits<double>::infinity());
    Vec3d max = Vec3d::Constant(-std::numeric_limits<double>::infinity());
};

// A non-finite point is ignored.
inline void grow(Box& box, const Vec3d& p) {
    if (!p.allFinite()) return;
    box.min = box.min.cwiseMin(p);
    box.max = box.max.cwiseMax(p);
}
inline void grow(Box& box, const Box& other) {
    box.min = box.min.cwiseMin(other.min);
    box.max = box.max.cwiseMax(other.max);
}

inline std::array<float, 3> to_floats(const Vec3d& v) {
    return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

// Texture coordinate.
struct Vec2 {
    float u = 0, v = 0;
};

}  // namespace trocar
