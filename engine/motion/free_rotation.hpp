#pragma once
#include "components/math.hpp"
#include "engine/geometry/quaternion.hpp"
namespace trocar {

// Rotates a torque-free body by `dt` seconds. `principal` is the orientation of its principal frame and
// `momentum` its angular momentum, both in world axes; moments in kg m^2, all positive. One exact rotation
// about each principal axis in the order x y z y x: symplectic and reversible; conserves the momentum to the
// last digit and the energy within a bound of order (rate * dt)^2 that does not grow; stable for any dt, also
// about the middle axis (Dullweber, Leimkuhler, McLachlan 1997, "Symplectic splitting methods for rigid body
// molecular dynamics", section 3).
inline Quat turn_freely(const Vec3d& moments, const Vec3d& momentum, double dt, Quat principal) {
    constexpr int kAxis[5] = {0, 1, 2, 1, 0};
    for (int step = 0; step < 5; ++step) {
        const int axis = kAxis[step];
        const double share = axis == 2 ? dt : 0.5 * dt;
        const double rate = rotate_back(principal, momentum)[axis] / moments[axis];
        principal = multiply(principal, from_rotation_vector(share * rate * Vec3d::Unit(axis)));
    }
    return normalized(principal);
}

// I^-1 momentum: the angular velocity, rad/s, world axes. And the inverse.
inline Vec3d spin_of(const Vec3d& moments, const Quat& principal, const Vec3d& momentum) {
    return rotate(principal, rotate_back(principal, momentum).cwiseQuotient(moments));
}
inline Vec3d momentum_of(const Vec3d& moments, const Quat& principal, const Vec3d& spin) {
    return rotate(principal, rotate_back(principal, spin).cwiseProduct(moments));
}

}  // namespace trocar
