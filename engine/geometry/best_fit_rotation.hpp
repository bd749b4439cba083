#pragma once
#include <array>

#include "components/math.hpp"
namespace trocar {

// Rows of a rotation matrix.
std::array<Vec3d, 3> rotation_rows(const Quat& q);

// The rotation R that maximises trace(R^T A) for A given by rows: the best fit of rest positions r to
// positions x when A = sum k x r^T about the centroids (Mueller, Heidelberger, Teschner, Gross, ACM TOG
// 24(3), 2005). Improves `start` by Newton steps on the rotation vector (as Mueller, Bender, Chentanez,
// Macklin, MIG 2016, whose step is Newton's for isotropic A), by Levenberg's where Newton's do not increase
// the value; converged to rounding, deterministic. Returns start if A is zero or not finite.
Quat best_fit_rotation(const std::array<Vec3d, 3>& a, const Quat& start);

// Solves M x = b for a symmetric positive definite M (xx, yy, zz, xy, xz, yz). False if M is not.
bool solve_symmetric(const std::array<double, 6>& m, const Vec3d& b, Vec3d& x);

}  // namespace trocar
