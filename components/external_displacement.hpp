#pragma once
#include <span>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// External displacement bound: how far contact with other bodies may displace a body in the coming period
// beyond its own velocity. Box of displacements, m.
struct ExternalDisplacement {
    Vec3d low = Vec3d::Zero(), high = Vec3d::Zero();
    TROCAR_FIELDS(low, "m", high, "m");
};

// Largest displacement along a unit vector, m; 0 for bodies without an element.
inline double external_displacement_along(std::span<const ExternalDisplacement> external, uint32_t body, const Vec3d& direction) {
    if (body >= external.size()) return 0;
    return direction.cwiseProduct(external[body].low).cwiseMax(direction.cwiseProduct(external[body].high)).sum();
}

}  // namespace trocar
