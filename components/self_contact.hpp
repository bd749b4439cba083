#pragma once
#include <array>
#include <vector>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// Near parts of surfaces that touch themselves, and of two sheets: a vertex of `body` over a triangle of `other`, or two edges
// that cross; `other` is `body` itself or another sheet, of edges a later one. Each remembers its side from the pass in which it was found.
// In the order: body, other, vertices before edges, first feature, second feature.
struct SelfContacts {
    std::vector<uint32_t> body, other;
    std::vector<std::array<uint32_t, 2>> feature;  // local vertex of body and triangle of other, or edges of both
    std::vector<uint8_t> edges;                    // 1: the features are edges
    std::vector<uint8_t> positive;     // 1: the vertex is on the side of the triangle's normal
    std::vector<Vec3d> normal;         // unit, world, from other to body; edges are on its side, however they turn
    std::vector<uint32_t> constraint;  // index in ContactConstraints, kNone: it cannot act in this pass
    std::vector<Vec3d> force;          // N, on body, in the last substep of the pass before
    TROCAR_COLUMNS(body, "index of bodies", other, "index of bodies", feature, edges, positive, normal, constraint, force, "N");
};

// Surfaces that have self-contact and crossed at the end of the pass before: a body with itself, or two sheets, body < other.
struct CrossedSurfaces {
    std::vector<uint32_t> body, other;
    TROCAR_COLUMNS(body, "index of bodies", other, "index of bodies");
};

// Where bodies that have self-contact are at the start of a pass.
struct SelfContactStart {
    std::vector<uint32_t> body;
    std::vector<Range> particles;  // as body: range of offset
    std::vector<Float4> offset;    // m, as in Particles
    TROCAR_FIELDS(body, "index of bodies", particles, offset, "m");
};

}  // namespace trocar
