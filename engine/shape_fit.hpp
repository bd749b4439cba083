#pragma once
#include <array>
#include <vector>

#include "components/math.hpp"
#include "engine/spring_kernels.hpp"
namespace trocar {

// Sums of a whole body, added up in the order of chunks and lanes.
struct ShapeTotals {
    std::array<double, kShapeSums> sum{};
    double operator[](int s) const { return sum[s]; }
    Vec3d vector(int s) const { return {sum[s], sum[s + 1], sum[s + 2]}; }
};

// Runs shape_sums over a body, large ones in parallel. chunk_sums is scratch.
ShapeTotals sum_shape(const SpringStep& body, uint32_t slices, std::vector<double>& chunk_sums);

// Sets the goals of a free body's anchors to the best-fit rigid copy of its rest shape (Mueller et al. 2005), used as a
// potential: the least of sum k |x - goal|^2 / 2 over rigid motions, whose forces keep linear and angular momentum.
// `orientation` is turned to fit.
void fit_goals(const ShapeTotals& totals, Quat& orientation, SpringStep& body);

// Sets the drag velocity to the rigid motion with the momentum of the body, which damping leaves alone.
void fit_drag(const ShapeTotals& totals, SpringStep& body);

}  // namespace trocar
