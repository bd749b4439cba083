#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "components/math.hpp"
namespace trocar {

struct BodySpec;

// [body.scatter]: many copies of one [[body]] on a lattice about its position. The lattice fills columns[0] x
// columns[1] positions per layer, layers along z. columns 0, 0: roughly a cube about the position.
struct ScatterSpec {
    bool asked = false;  // false: the body is not scattered
    uint32_t count = 0;  // number of copies; 0 gives none
    uint64_t seed = 1;
    std::array<uint32_t, 2> columns{0, 0};
    Vec3d spacing = Vec3d::Constant(0.1);  // m
    double jitter = 0;                     // largest random offset, as a fraction of the spacing
    bool turned = false;                   // random orientation for each copy
    double rate = 0;                       // 1/s: copies are spawned one by one at their positions; 0 = at
                                           // start
    double life = 1e9;                     // s, lifetime of a copy; afterwards its slot can be reused
};

// The copies, named NAME_0, NAME_1, ... A larger count does not move earlier copies once the first layer is
// full (unless the lattice is a cube).
void scatter_body(const BodySpec& pattern, std::vector<BodySpec>& bodies);

}  // namespace trocar
