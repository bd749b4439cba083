#include "content/read/vrml/primitives.hpp"

#include <cmath>
#include <numbers>
namespace trocar::vrml {
namespace {

constexpr uint32_t kAround = 32, kDown = 16;

// Whether a part is present: VRML97 has a flag for each, VRML 1.0 a set of names.
bool has_part(const Scene& scene, NodeId id, std::string_view flag, std::string_view part) {
    if (!flag_of(find_value(scene, id, flag), true)) return false;
    const Value parts = find_value(scene, id, "parts");
    if (!parts) return true;
    for (uint32_t w = parts.field->words.first; w < parts.field->words.end(); ++w) {
        const std::string_view word = text_of(*parts.document, parts.document->word[w].bytes);
        if (word.find("ALL") != std::string_view::npos || word.find(part) != std::string_view::npos) return true;
    }
    return false;
}

bool is_size(double value) { return value > 0 && std::isfinite(value); }

void make_box(const Vec3d& size, std::vector<Vec3d>& position, std::vector<Triangle>& triangle) {
    const auto first = static_cast<uint32_t>(position.size());
    for (int k = 0; k < 8; ++k) {
        position.push_back({(k & 1 ? 0.5 : -0.5) * size[0], (k & 2 ? 0.5 : -0.5) * size[1], (k & 4 ? 0.5 : -0.5) * size[2]});
    }
    constexpr uint32_t kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    for (const auto& f : kFaces) {
        triangle.push_back({first + f[0], first + f[1], first + f[2]});
        triangle.push_back({first + f[0], first + f[2], first + f[3]});
    }
}

Vec3d on_ring(double radius, double height, uint32_t k) {
    // vertex 0 is at -z, where the standards put the seam
    const double angle = 2 * std::numbers::pi * (k % kAround) / kAround;
    return {-radius * std::sin(angle), height, -radius * std::cos(angle)};
}

// Adds a ring of vertices; returns the first index.
uint32_t add_ring(double radius, double height, std::vector<Vec3d>& position) {
    const auto first = static_cast<uint32_t>(position.size());
    for (uint32_t k = 0; k < kAround; ++k) position.push_back(on_ring(radius, height, k));
    return first;
}

// Adds triangles from a ring to a point above it (or below, facing down).
void close_ring(uint32_t ring, const Vec3d& tip, bool upwards, std::vector<Vec3d>& position, std::vector<Triangle>& triangle) {
    const auto top = static_cast<uint32_t>(position.size());
    position.push_back(tip);
    for (uint32_t k = 0; k < kAround; ++k) {
        const uint32_t a = ring + k, b = ring + (k + 1) % kAround;
        triangle.push_back(upwards ? Triangle{a, b, top} : Triangle{b, a, top});
    }
}

void join_rings(uint32_t upper, uint32_t lower, std::vector<Triangle>& triangle) {
    for (uint32_t k = 0; k < kAround; ++k) {
        const uint32_t n = (k + 1) % kAround;
        triangle.push_back({upper + k, lower + k, lower + n});
        triangle.push_back({upper + k, lower + n, upper + n});
    }
}

void make_sphere(double radius, std::vector<Vec3d>& position, std::vector<Triangle>& triangle) {
    uint32_t upper = 0;
    for (uint32_t row = 1; row < kDown; ++row) {
        const double polar = std::numbers::pi * row / kDown;
        const uint32_t ring = add_ring(radius * std::sin(polar), radius * std::cos(polar), position);
        if (row > 1) join_rings(upper, ring, triangle);
        upper = ring;
    }
    close_ring(upper, {0, -radius, 0}, false, position, triangle);
    close_ring(upper - (kDown - 2) * kAround, {0, radius, 0}, true, position, triangle);
}

}  // namespace

uint64_t count_primitive_triangles(Role role) {
    switch (role) {
        case Role::kBox:
            return 12;
        case Role::kSphere:
            return 2 * kAround * (kDown - 1);
        case Role::kCone:
            return 2 * kAround;
        case Role::kCylinder:
            return 4 * kAround;
        default:
            return 0;
    }
}

void make_primitive(const Scene& scene, NodeId id, std::vector<Vec3d>& position, std::vector<Triangle>& triangle) {
    const Role role = role_of(scene, id);
    if (role == Role::kBox) {
        Vec3d size(number_of(scene, id, "width", 2), number_of(scene, id, "height", 2), number_of(scene, id, "depth", 2));
        const std::span<const double> numbers = numbers_of(find_value(scene, id, "size"), 3);
        if (numbers.size() >= 3) size = {numbers[0], numbers[1], numbers[2]};
        if (is_size(size[0]) && is_size(size[1]) && is_size(size[2])) make_box(size, position, triangle);
        return;
    }
    const double radius = number_of(scene, id, role == Role::kCone ? "bottomRadius" : "radius", 1);
    const double half = number_of(scene, id, "height", 2) / 2;
    if (!is_size(radius) || !is_size(half)) return;
    if (role == Role::kSphere) return make_sphere(radius, position, triangle);
    const uint32_t lower = add_ring(radius, -half, position);
    if (has_part(scene, id, "bottom", "BOTTOM")) close_ring(lower, {0, -half, 0}, false, position, triangle);
    const bool side = has_part(scene, id, "side", "SIDES");
    if (role == Role::kCone) {
        if (side) close_ring(lower, {0, half, 0}, true, position, triangle);
        return;
    }
    const uint32_t upper = add_ring(radius, half, position);
    if (has_part(scene, id, "top", "TOP")) close_ring(upper, {0, half, 0}, true, position, triangle);
    if (side) join_rings(upper, lower, triangle);
}

}  // namespace trocar::vrml
