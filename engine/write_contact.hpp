#pragma once
#include <array>
#include <cstdint>

#include "components/contacts.hpp"
#include "engine/closest_point.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// Which point a contact is of: the columns of Contacts of the same names.
struct ContactPlace {
    uint32_t pair, body, other;
    std::array<uint32_t, 2> vertex;
    float along = 0;
    uint32_t third = kNone;
    float across = 0;
};

// Writes all columns of a row of contacts. The point (m) and what is nearest to it are in the frame of the other body.
inline void write_contact(const Surfaces& s, const ContactPlace& place, const Vec3d& point, const SurfacePoint& nearest, Contacts& to,
                          uint32_t row) {
    to.pair[row] = place.pair;
    to.body[row] = place.body;
    to.other[row] = place.other;
    to.vertex[row] = place.vertex;
    to.along[row] = place.along;
    to.third[row] = place.third;
    to.across[row] = place.across;
    to.point[row] = frame_to_world(s, place.other, point);
    to.closest[row] = frame_to_world(s, place.other, nearest.point);
    to.normal[row] = direction_to_world(s, place.other, nearest.normal);
    to.distance[row] = nearest.distance;
    to.triangle[row] = nearest.triangle;
}

}  // namespace trocar
