#pragma once
#include <array>
namespace trocar {

// Colour of a contact depth, t = depth / scale clamped to [0, 1]: pale yellow, orange, red, dark violet.
// Linear RGB. Lightness falls in equal perceived steps (Ottosson's Oklab, 2020), also readable in greyscale.
std::array<float, 3> depth_colour(double t);

// Linear 0..1 to an sRGB byte (IEC 61966-2-1).
unsigned char srgb_byte(double linear);

}  // namespace trocar
