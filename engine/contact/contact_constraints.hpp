#pragma once
#include <cstdint>
#include <span>

#include "components/contacts.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Resizes all columns but `warm_start` and `gap` to `count` contact constraints; impulses are set to zero.
void resize_constraints(ContactConstraints& constraints, size_t count);

// Removes the marked contact constraints, one mark each; the others keep their order.
void remove_constraints(std::span<const uint8_t> dropped, ContactConstraints& constraints);

// Barycentric coordinates of a point of triangle abc, clamped to it, on a grid of 2^-23, so that the three floats add up to exactly one.
std::array<float, 3> barycentric_weights(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c);

// Whether two bodies are deformable sheets that both have self-contact: their contact is that of one surface with itself.
inline bool touch_as_sheets(const Surfaces& s, uint32_t body, uint32_t other) {
    const auto is_such = [&](uint32_t b) {
        return self_contact_of(s.bodies, b) > 0 && is_deformable(s.bodies, b) && s.meshes.info[s.bodies.mesh[b]].admission == Admission::kSheet;
    };
    return body != other && is_such(body) && is_such(other);
}

}  // namespace trocar
