#pragma once
#include <cstdint>

#include "components/math.hpp"
namespace trocar {

// Position of p along a Hilbert curve through the box, 16 bits per axis, so 48 in all: points with adjacent
// keys are neighbours in space. Points outside (and NaNs) are clamped to the box; a flat box is allowed.
// Skilling, "Programming the Hilbert curve", AIP Conf. Proc. 707 (2004), section 3.
inline uint64_t hilbert_key(const Vec3d& p, const Box& box) {
    constexpr int kBits = 16;
    uint32_t x[3];
    for (int k = 0; k < 3; ++k) {
        const double extent = box.max[k] - box.min[k];
        const double t = extent > 0 ? (p[k] - box.min[k]) / extent * 65536.0 : 0.0;
        x[k] = t > 0 ? (t < 65535.0 ? static_cast<uint32_t>(t) : 65535u) : 0u;
    }
    // undo the excess work of the curve's reflections and rotations, coarsest bit first
    for (uint32_t q = 1u << (kBits - 1); q > 1; q >>= 1) {
        const uint32_t below = q - 1;
        for (int k = 0; k < 3; ++k) {
            if (x[k] & q) {
                x[0] ^= below;
            } else {
                const uint32_t t = (x[0] ^ x[k]) & below;
                x[0] ^= t;
                x[k] ^= t;
            }
        }
    }
    // Gray code
    x[1] ^= x[0];
    x[2] ^= x[1];
    uint32_t t = 0;
    for (uint32_t q = 1u << (kBits - 1); q > 1; q >>= 1) {
        if (x[2] & q) t ^= q - 1;
    }
    for (uint32_t& v : x) v ^= t;
    // interleave: the first axis holds the highest bit
    uint64_t key = 0;
    for (int bit = kBits - 1; bit >= 0; --bit) {
        for (const uint32_t v : x) key = key << 1 | (v >> bit & 1u);
    }
    return key;
}

}  // namespace trocar
