#pragma once
#include <array>

#include "components/contacts.hpp"
#include "engine/surfaces.hpp"
namespace trocar {

// An edge of `body` across one of `other`. Vertices and triangle are local.
struct EdgeMeeting {
    uint32_t body = kNone, other = kNone;
    std::array<uint32_t, 2> edge{}, other_edge{};  // vertices
    float along = 0, other_along = 0;              // where they are nearest: parts of the way from the first vertex
    uint32_t triangle = kNone;                     // one of other at its edge
    Vec3d normal = Vec3d::Zero();                  // unit, world, from other to body
    double distance = 0;                           // m, along the normal
};

// Appends the row of two edges: a point of body's edge against the other edge's point, which rides on a triangle beside it. It
// names no contact.
void append_edge_row(const Surfaces& surfaces, const EdgeMeeting& meeting, ContactRows& rows);

}  // namespace trocar
