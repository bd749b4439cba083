#pragma once
#include <array>
#include <cstdint>

#include "components/contacts.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

// Identifies the point of a contact: the columns of Contacts of the same names.
struct ContactSource {
    uint32_t pair, body, other;
    std::array<uint32_t, 2> vertex;
    float along = 0;
    uint32_t third = kNone;
    float across = 0;
};

// Writes all columns of a contact. The point (m) and the closest point are in the frame of the other body.
inline void write_contact(const Surfaces& s, const ContactSource& source, const Vec3d& point, const SurfacePoint& nearest, Contacts& to,
                          uint32_t slot) {
    to.pair[slot] = source.pair;
    to.body[slot] = source.body;
    to.other[slot] = source.other;
    to.vertex[slot] = source.vertex;
    to.along[slot] = source.along;
    to.third[slot] = source.third;
    to.across[slot] = source.across;
    to.point[slot] = frame_to_world(s, source.other, point);
    to.closest[slot] = frame_to_world(s, source.other, nearest.point);
    to.normal[slot] = direction_to_world(s, source.other, nearest.normal);
    to.distance[slot] = nearest.distance;
    to.triangle[slot] = nearest.triangle;
}

}  // namespace trocar
