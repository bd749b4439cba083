#pragma once
#include <algorithm>

#include "components/links.hpp"
namespace trocar {

// Whether a point (m, the region's frame) is in a region, its boundary included.
inline bool contains(const Region& region, const Vec3d& p) {
    switch (region.kind) {
        case RegionKind::kAll:
            return true;
        case RegionKind::kSphere:
            return (p - region.a).squaredNorm() <= region.radius * region.radius;
        case RegionKind::kBox:
            return (p.array() >= region.a.array()).all() && (p.array() <= region.b.array()).all();
        case RegionKind::kCapsule:
            break;
    }
    const Vec3d axis = region.b - region.a, from = p - region.a;
    const double length2 = axis.squaredNorm();
    const double along = length2 > 0 ? std::clamp(from.dot(axis) / length2, 0.0, 1.0) : 0.0;
    return (from - along * axis).squaredNorm() <= region.radius * region.radius;
}

// Its centre, m: reference point of "nearest first".
inline Vec3d middle_of(const Region& region) { return region.kind == RegionKind::kSphere ? region.a : Vec3d(0.5 * (region.a + region.b)); }

}  // namespace trocar
