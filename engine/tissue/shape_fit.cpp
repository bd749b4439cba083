#include "engine/tissue/shape_fit.hpp"

#include "components/springs.hpp"
#include "engine/geometry/best_fit_rotation.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/tissue/spring_step.hpp"
namespace trocar {
namespace {

// Angular velocity of the rigid motion with the body's momentum; zero where undefined.
Vec3d rigid_rotation(const ShapeTotals& t, double mass, const Vec3d& centre, const Vec3d& velocity) {
    const auto second = [&](int s, int i, int j) { return t[kSumMxx + s] - mass * centre[i] * centre[j]; };
    const double xx = second(0, 0, 0), yy = second(1, 1, 1), zz = second(2, 2, 2);
    const Vec3d angular = t.vector(kSumL) - mass * centre.cross(velocity);
    Vec3d rotation = Vec3d::Zero();
    if (!solve_symmetric({yy + zz, xx + zz, xx + yy, -second(3, 0, 1), -second(4, 0, 2), -second(5, 1, 2)}, angular, rotation)) {
        return Vec3d::Zero();
    }
    return rotation;
}

}  // namespace

ShapeTotals sum_shape(const SpringStep& body, uint32_t slices, std::vector<double>& chunk_sums) {
    const SpringKernels& kernels = spring_kernels();
    return {sum_slices<kShapeSums>(slices, chunk_sums,
                                   [&](uint32_t begin, uint32_t end, double* sums) { kernels.shape_sums(&body, begin, end, sums); })};
}

void fit_goals(const ShapeTotals& t, Quat& orientation, SpringStep& step) {
    if (!(t[kSumK] > 0)) return;
    const Vec3d centre = t.vector(kSumKx) / t[kSumK], rest = t.vector(kSumKr) / t[kSumK];
    std::array<Vec3d, 3> a;
    for (int i = 0; i < 3; ++i) a[i] = t.vector(kSumKxr + 3 * i) - t[kSumK] * centre[i] * rest;
    orientation = best_fit_rotation(a, orientation);
    const std::array<Vec3d, 3> turn = rotation_rows(orientation);
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            step.turn[3 * i + j] = static_cast<float>(turn[i][j]);
            step.turn_rest[3 * i + j] = static_cast<float>(turn[i][j] - step.turn[3 * i + j]);
        }
        const double goal = centre[i] - turn[i].dot(rest);
        step.centre[i] = static_cast<float>(goal);
        step.centre_rest[i] = static_cast<float>(goal - step.centre[i]);
    }
}

void fit_drag(const ShapeTotals& t, SpringStep& step) {
    if (!(t[kSumM] > 0)) return;
    const Vec3d centre = t.vector(kSumMx) / t[kSumM], velocity = t.vector(kSumMv) / t[kSumM];
    const Vec3d rotation = rigid_rotation(t, t[kSumM], centre, velocity);
    const Vec3d at_origin = velocity - rotation.cross(centre);
    for (int i = 0; i < 3; ++i) {
        step.drag_turn[i] = static_cast<float>(rotation[i]);
        step.drag_velocity[i] = static_cast<float>(at_origin[i]);
    }
}

}  // namespace trocar
