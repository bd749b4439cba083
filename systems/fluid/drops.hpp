#pragma once
#include <memory>

#include "engine/distance/closest_point.hpp"
#include "systems/fluid/amounts.hpp"
#include "systems/fluid/fluid_pass.hpp"
namespace trocar {

// Drops hang from the lowest places of overhangs and from rims until their weight tears them off; they fall without drag, land on the
// first surface they meet and become its film there. Refits the trees of wet deformable bodies near drops.
struct DropsScratch {
    std::vector<Box> box;
    std::vector<uint8_t> refitted;
    FluidShapeScratch shapes;
};
void move_drops(const FluidPass& pass, std::span<const std::unique_ptr<ClosestPointTree>> trees, DropsScratch& scratch, FluidState& state);

}  // namespace trocar
