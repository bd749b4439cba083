#pragma once
#include <array>
#include <vector>

#include "components/math.hpp"
#include "engine/kernels/spring_kernels.hpp"
namespace trocar {

// Sums over a whole body, in the order of chunks and lanes.
struct ShapeTotals {
    std::array<double, kShapeSums> sum{};
    double operator[](int s) const { return sum[s]; }
    Vec3d vector(int s) const { return {sum[s], sum[s + 1], sum[s + 2]}; }
};

// Runs shape_sums over a body, large ones in parallel. chunk_sums is scratch.
ShapeTotals sum_shape(const SpringStep& body, uint32_t slices, std::vector<double>& chunk_sums);

// Sets the goals of a free body's anchors to the best-fit rigid copy of its rest shape (Mueller et al. 2005),
// used as a potential: the minimum of sum k |x - goal|^2 / 2 over rigid motions, whose forces conserve linear
// and angular momentum. `orientation` is updated to the fit.
void fit_goals(const ShapeTotals& totals, Quat& orientation, SpringStep& body);

// Sets the drag velocity to the rigid motion with the body's momentum, which damping does not affect.
void fit_drag(const ShapeTotals& totals, SpringStep& body);

}  // namespace trocar
