#pragma once
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

struct FogScratch {
    std::vector<uint8_t> blurred, row;
};

// The round picture of a laparoscope behind a film of droplets that scatter the fraction `fog` (0..1) of its light: that part comes
// from around each point (a blur of up to a twelfth of the height) and, as a veil, from all of the picture. Integer arithmetic.
void fog_picture(double fog, FogScratch& scratch, Image& image);

}  // namespace trocar
