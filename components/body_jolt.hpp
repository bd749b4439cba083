#pragma once
#include <span>

#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

// How far a body may get in the coming period from where its velocity takes it, because others that it runs into stop it or that
// run into it push it: a box of ways, m.
struct BodyJolt {
    Vec3d low = Vec3d::Zero(), high = Vec3d::Zero();
    TROCAR_FIELDS(low, "m", high, "m");
};

// The farthest along a unit vector, m; 0 for bodies without a row.
inline double jolt_along(std::span<const BodyJolt> jolt, uint32_t body, const Vec3d& way) {
    if (body >= jolt.size()) return 0;
    return way.cwiseProduct(jolt[body].low).cwiseMax(way.cwiseProduct(jolt[body].high)).sum();
}

}  // namespace trocar
