#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "components/math.hpp"
namespace trocar {

struct BodySpec;

// [body.scatter]: many copies of one [[body]] on a lattice about its position. The lattice fills columns[0] x columns[1]
// places a layer, layer on layer along z; columns 0, 0: as nearly a cube as can be, about the position.
struct ScatterSpec {
    bool asked = false;  // false: the body is not scattered
    uint32_t count = 0;  // copies; with 0 the scene has none
    uint64_t seed = 1;
    std::array<uint32_t, 2> columns{0, 0};
    Vec3d spacing = Vec3d::Constant(0.1);  // m
    double jitter = 0;                     // part of the spacing by which each may be off its place, to either side
    bool turned = false;                   // each turned at random
    double rate = 0;                       // 1/s: they come one after the other, each at its place; 0 = all from the start
    double life = 1e9;                     // s, after which one goes and its slot is free for the next to come
};

// The copies, named NAME_0, NAME_1, ... More copies leave the others where they are, once the first layer is full (and
// unless the lattice is a cube).
void scatter_body(const BodySpec& pattern, std::vector<BodySpec>& bodies);

}  // namespace trocar
