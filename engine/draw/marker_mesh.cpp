#include "engine/draw/marker_mesh.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

namespace trocar {
namespace {

constexpr uint32_t kSides = 16;

// A ring of a surface of revolution about z: radius, height and normal (radial, axial).
struct Ring {
    double radius, height, radial, axial;
};

constexpr std::array<Ring, 4> kShaft = {{{0, 0, 0, -1}, {1, 0, 0, -1}, {1, 0, 1, 0}, {1, 1, 1, 0}}};
constexpr std::array<Ring, 4> kHead = {{{0, 0, 0, -1}, {1, 0, 0, -1}, {1, 0, 0.8, 0.6}, {0, 1, 0.8, 0.6}}};

std::array<Ring, kSides / 2 + 1> sphere_rings() {
    std::array<Ring, kSides / 2 + 1> rings;
    for (uint32_t i = 0; i < rings.size(); ++i) {
        const double angle = std::numbers::pi * (static_cast<double>(i) / (rings.size() - 1) - 0.5);
        rings[i] = {std::cos(angle), std::sin(angle), std::cos(angle), std::sin(angle)};
    }
    return rings;
}

// Pose of the surface: its z axis (unit), and the scale of its radius and height, m.
struct Pose {
    Vec3d origin, z;
    double radius, height;
};

void append_rings(std::span<const Ring> rings, const Pose& pose, MarkerMesh& out) {
    const Vec3d helper = std::abs(pose.z.x()) < 0.7 ? Vec3d(Vec3d::UnitX()) : Vec3d(Vec3d::UnitY());
    const Vec3d x = pose.z.cross(helper).normalized(), y = pose.z.cross(x);
    std::array<Vec3d, kSides> around;
    for (uint32_t i = 0; i < kSides; ++i) {
        const double angle = 2 * std::numbers::pi * i / kSides;
        around[i] = std::cos(angle) * x + std::sin(angle) * y;
    }
    const uint32_t first = static_cast<uint32_t>(out.vertex.size());
    for (const Ring& ring : rings)
        for (const Vec3d& outward : around) {
            const Vec3d p = pose.origin + pose.radius * ring.radius * outward + pose.height * ring.height * pose.z;
            const Vec3d n = ring.radial / pose.radius * outward + ring.axial / pose.height * pose.z;
            out.vertex.push_back(make_vertex(p.cast<float>(), n.normalized().cast<float>()));
        }
    for (uint32_t r = 0; r + 1 < rings.size(); ++r)
        for (uint32_t i = 0; i < kSides; ++i) {
            const uint32_t a = first + r * kSides + i, b = first + r * kSides + (i + 1) % kSides;
            out.index.insert(out.index.end(), {a, b, b + kSides, a, b + kSides, a + kSides});
        }
}

}  // namespace

void append_marker(const Marker& marker, const Vec3d& eye, MarkerMesh& out) {
    const Vec3d from = marker.from - eye, along = marker.to - marker.from;
    const double r = marker.radius, length = along.norm();
    if (!from.allFinite() || !std::isfinite(length) || !std::isfinite(r) || !(r > 0)) return;
    if (marker.kind == Marker::Kind::kSphere) {
        append_rings(sphere_rings(), {from, Vec3d::UnitZ(), r, r}, out);
        return;
    }
    if (!(length > 0)) return;
    const Vec3d z = along / length;
    if (marker.kind == Marker::Kind::kRod) {
        append_rings(kShaft, {from, z, r, length}, out);
        for (const Vec3d& end : {from, Vec3d(from + along)}) append_rings(sphere_rings(), {end, Vec3d::UnitZ(), r, r}, out);
        return;
    }
    const double head = std::min(0.5 * length, 5 * r), shaft = length - head;
    append_rings(kShaft, {from, z, r, shaft}, out);
    append_rings(kHead, {from + shaft * z, z, 2.4 * r, head}, out);
}

}  // namespace trocar
